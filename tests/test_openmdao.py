"""Plans and surface maps as components of OpenMDAO."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest

import sdm_deflect as sdm
from sdm_deflect.openmdao import Hinges, SurfaceWarp, Warp
from tests import calls
from tests.deform.blocks import two_bodies
from tests.deform.test_mesh_motion import AROUND_BOTH, SLAT_AND_FLAP

# Amounts of two surfaces, called left.1 and right#2: OpenMDAO refuses points in names.
AT = {"left_1": 6.0, "right#2": -3.0}
# Largest error per degree of central differences, with steps of 1e-3 degrees, of coordinates up to 4.
ROUNDING = 1e-10


@pytest.fixture(scope="module")
def plan():
    """Two bodies that turn."""
    names, mesh = {"left": "left.1", "right": "right#2", "wall": "wall"}, two_bodies()
    patches = tuple(replace(patch, name=names[patch.name]) for patch in mesh.patches)
    ranges = {names[name]: own for name, own in SLAT_AND_FLAP.items()}
    return sdm.plan(replace(mesh, patches=patches), ranges, box=AROUND_BOTH)


def solved(*components, at):
    """A problem with the components in a row, run at some values."""
    problem = om.Problem(reports=False)
    for i, component in enumerate(components):
        problem.model.add_subsystem(f"part_{i}", component, promotes=["*"])
    problem.setup(mode="rev")
    for name, value in at.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def test_coordinates_are_those_of_the_plan_in_any_parts(plan):
    whole = solved(Warp(plan=plan), at=AT)["x"].reshape(-1, 3)
    assert np.array_equal(whole, plan.at(list(AT.values())))
    rows = np.random.default_rng(4).permutation(len(whole))
    for count in (2, 4):
        for own in np.array_split(rows, count):
            points = plan.plan.mesh.points[own]
            found = solved(Warp(plan=plan, points=points.ravel(), output="aero_vol_coords"), at=AT)
            assert np.array_equal(found["aero_vol_coords"].reshape(-1, 3), whole[own])


def test_derivatives_both_ways_are_those_of_differences(plan):
    moving = np.flatnonzero(plan.at(list(AT.values())) != plan.at([0.0, 0.0]))[::40] // 3
    warp = Warp(plan=plan, points=plan.plan.mesh.points[moving])
    found = solved(warp, at=AT).check_partials(out_stream=None, step=1e-3, form="central")["part_0"]
    assert set(found) == {("x", name) for name in AT}
    for one in found.values():
        assert np.abs(one["J_fwd"]).max() > 1e-3
        assert np.array_equal(one["J_fwd"], one["J_rev"])
        assert np.abs(one["J_fwd"] - one["J_fd"]).max() < ROUNDING


def test_an_amount_that_is_no_mesh_is_an_analysis_error(plan):
    with pytest.raises(om.AnalysisError, match=r"left\.1 = 9 deg is outside its range -6:8"):
        solved(Warp(plan=plan), at=AT | {"left_1": 9.0})
    failing = tuple(replace(one, failed=("inverted_cells",)) if one.amount > 5.0 else one for one in plan.measured[0])
    with pytest.raises(om.AnalysisError, match=r"left\.1 = 6 deg: outside -6:\S+, which passed; failed: inverted"):
        solved(Warp(plan=replace(plan, measured=(failing, plan.measured[1]))), at=AT)


class Distance(om.ExplicitComponent):
    """Sum of squared distances of nodes from where they should be; counts its evaluations."""

    def __init__(self, target):
        super().__init__()
        self.target, self.count = target.ravel(), 0

    def setup(self):
        self.add_input("x", np.zeros_like(self.target))
        self.add_output("distance")
        self.declare_partials("distance", "x")

    def compute(self, inputs, outputs):
        self.count += 1
        outputs["distance"] = 1e3 * np.sum((inputs["x"] - self.target) ** 2)

    def compute_partials(self, inputs, partials):
        partials["distance", "x"] = 2e3 * (inputs["x"] - self.target)


def test_an_optimiser_finds_the_angle_of_a_half_wing(tmp_path):
    assert calls.sdm("example", tmp_path) == 0
    mesh = sdm.read(tmp_path / "naca.su2")
    given = {"motion": "blended", "fixed": "wing", "slide": "symmetry:plane", "range": (0, 25)}
    plan = sdm.plan(mesh, "flap", [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], **given)
    plan.save(tmp_path / "flap.npz")
    distance = Distance(plan.at(14.0))
    problem = om.Problem(reports=False)
    warp = Warp(plan=sdm.MeshMotion.load(tmp_path / "flap.npz"), points=mesh.points)
    problem.model.add_subsystem("warp", warp, promotes=["*"])
    problem.model.add_subsystem("distance", distance, promotes=["*"])
    problem.model.add_design_var("flap", lower=0.0, upper=25.0)
    problem.model.add_objective("distance")
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-9, disp=False)
    problem.setup(mode="rev")
    problem.set_val("flap", 10.0)
    problem.run_driver()
    assert problem["flap"][0] == pytest.approx(14.0, abs=1e-4)
    assert distance.count <= 10


@pytest.fixture(scope="module")
def surface():
    """The two bodies of the plan, of which any shape can follow."""
    return sdm.surface_map(two_bodies(), ["left", "right"], box=AROUND_BOTH, fixed="wall")


def wave(start):
    """A surface that waves by two hundredths."""
    return start + 0.02 * np.sin(3.0 * start[:, [1, 2, 0]])


def test_coordinates_follow_a_surface_whatever_the_order_of_its_points(surface):
    whole = surface.at(wave(surface.start))
    order = np.random.default_rng(4).permutation(len(surface.start))
    twice = np.concatenate([order, order[:7]])  # a solver may hold points at the borders of its blocks twice
    fixed = surface.plan.mesh.points[surface.plan.mesh.on("wall")][:5]
    start = np.vstack([surface.start[twice], fixed])
    moved = np.vstack([wave(surface.start)[twice], fixed])
    warp = SurfaceWarp(map=surface, start=start.ravel(), points=surface.coordinates[::3], surface="x_aero")
    found = solved(warp, at={"x_aero": moved.ravel()})["aero_vol_coords"]
    assert np.array_equal(found.reshape(-1, 3), whole[::3])


def test_derivatives_by_a_surface_both_ways_are_those_of_differences(surface):
    moving = np.flatnonzero((surface.at(wave(surface.start)) != surface.coordinates).any(axis=1))[::400]
    start = np.vstack([surface.start, surface.start[:3]])
    warp = SurfaceWarp(map=surface, start=start, points=surface.coordinates[moving], check=False)
    problem = solved(warp, at={"x_aero0": wave(start).ravel()})
    rng = np.random.default_rng(3)
    speeds, gradient = rng.normal(size=start.shape), rng.normal(size=(len(moving), 3))
    speeds[-3:] = speeds[:3]
    (along,) = problem.compute_jacvec_product(
        ["aero_vol_coords"], ["x_aero0"], "fwd", {"x_aero0": speeds.ravel()}
    ).values()
    (back,) = problem.compute_jacvec_product(
        ["aero_vol_coords"], ["x_aero0"], "rev", {"aero_vol_coords": gradient.ravel()}
    ).values()
    assert np.vdot(along, gradient.ravel()) == pytest.approx(np.vdot(back, speeds.ravel()), rel=1e-10)
    assert not back.reshape(-1, 3)[-3:].any()
    ends, h = [], 1e-5
    for sign in (-1.0, 1.0):
        problem.set_val("x_aero0", (wave(start) + sign * h * speeds).ravel())
        problem.run_model()
        ends.append(problem["aero_vol_coords"].copy())
    np.testing.assert_allclose(along.ravel(), (ends[1] - ends[0]) / (2.0 * h), atol=1e-7)


def test_a_surface_that_is_no_mesh_is_an_analysis_error(surface):
    start, fixed = surface.start, surface.plan.mesh.points[surface.plan.mesh.on("wall")][:1]
    crushed = start * [1.0, 1.0, 4.0]
    with pytest.raises(om.AnalysisError, match=r"inverted_cells is \d+, limit 0"):
        solved(SurfaceWarp(map=surface), at={"x_aero0": crushed.ravel()})
    warp = SurfaceWarp(map=surface, start=np.vstack([start, fixed]))
    with pytest.raises(om.AnalysisError, match=f"1 points are off, such as {len(start)}, which is no node of the map"):
        solved(warp, at={"x_aero0": np.vstack([start, fixed + 0.1]).ravel()})
    twice = np.vstack([start, start[:1]])
    torn = np.vstack([start, start[:1] + 1e-3])
    with pytest.raises(om.AnalysisError, match=f"such as {len(start)}, which was at the place of 0, by 0.00173"):
        solved(SurfaceWarp(map=surface, start=twice), at={"x_aero0": torn.ravel()})


def test_places_of_another_surface_are_refused(surface):
    for start in (1e3 * surface.start, surface.start[1:], surface.start.astype(np.float32)):
        with pytest.raises(sdm.InputError, match=r"start: \d+ of the map's \d+ nodes have no point at their place"):
            solved(SurfaceWarp(map=surface, start=start), at={})


def test_hinges_are_geometry_before_a_map(plan, surface):
    whole = replace(plan.plan.mesh, patches=surface.plan.mesh.patches)
    assert np.array_equal(whole.points, surface.coordinates)
    problem = solved(Hinges(plan=plan, points=surface.start), SurfaceWarp(map=surface, check=False), at=AT)
    found = problem["aero_vol_coords"].reshape(-1, 3)
    assert np.array_equal(found[surface.nodes], plan.at(list(AT.values()))[surface.nodes])
    with pytest.raises(om.AnalysisError, match=r"left\.1 = 9 deg is outside its range -6:8"):
        solved(Hinges(plan=plan, points=surface.start), at=AT | {"left_1": 9.0})


def test_variables_have_the_tags_by_which_mphys_promotes_them(plan, surface):
    tags = {}
    for component in (Warp(plan=plan), Hinges(plan=plan, points=surface.start), SurfaceWarp(map=surface)):
        problem = solved(component, at={})
        variables = problem.model.part_0.get_io_metadata(metadata_keys=["tags"]).values()
        tags[type(component).__name__] = {one["prom_name"]: one["tags"] for one in variables}
    amounts = {name: {"mphys_input"} for name in AT}
    assert tags == {
        "Warp": amounts | {"x": {"mphys_coupling"}},
        "Hinges": amounts | {"x_aero0": {"mphys_coordinates"}},
        "SurfaceWarp": {"x_aero0": {"mphys_coupling"}, "aero_vol_coords": {"mphys_coupling"}},
    }

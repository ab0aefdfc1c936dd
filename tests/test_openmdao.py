"""A plan as a component of OpenMDAO."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest

import sdm_deflect as sdm
from sdm_deflect.openmdao import Warp
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

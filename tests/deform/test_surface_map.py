"""The volume as a function of its surface: exact on the surface, nothing outside, derivatives true both ways."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect import InputError, Mesh, MeshMotion, Patch, deflect, surface_map
from sdm_deflect.base import threads
from sdm_deflect.cases.api import OF_MAPS
from sdm_deflect.cases.settings.job_settings import BY_NAME
from sdm_deflect.meshing.mesh.cells import Cells
from tests.deform.blocks import SIDES
from tests.deform.plates import plate

# Turn by 0.3 rad about x.
TILT = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)], [0.0, np.sin(0.3), np.cos(0.3)]])
# Largest difference of the two products in the test of the transpose, over both norms: rounding of sums that cancel.
TRANSPOSED = 2e-12


@pytest.fixture(scope="module")
def maps(inboard_wing, block, block_on_cylinder):
    """Prisms beside a sliding plane, along y and tilted, hexahedra in space and around a fin that stays on a cylinder,
    and a plane mesh."""
    wing = inboard_wing.mesh
    tilted = replace(wing, points=wing.points @ TILT.T, name="tilted")
    beside = {"largest": 0.1, "slide": "symmetry:plane", "fixed": "far*"}
    return {
        "wing": (wing, surface_map(wing, ["wing_*", "flap_*"], **beside)),
        "tilted": (tilted, surface_map(tilted, ["wing_*", "flap_*"], **beside)),
        "block": (block, surface_map(block, "body", largest=0.2, fixed=[*SIDES])),
        "cylinder": (
            block_on_cylinder,
            surface_map(block_on_cylinder, "body", largest=0.05, slide="round:cylinder", fixed="rest"),
        ),
        "plate": (
            plate(32, "triangle"),
            surface_map(plate(32, "triangle"), "hole", largest=0.1, fixed=["bottom", "rest"]),
        ),
    }


CASES = ("wing", "tilted", "block", "cylinder", "plate")


def shape_of(mesh, warp, size=0.02):
    """A smooth displacement (K, 3) that keeps nodes on planes y = const, tilted or not, and, about z, on cylinders."""
    tilt = TILT if mesh.name == "tilted" else np.eye(3)
    x, y, z = (warp.start @ tilt).T
    move = size * np.column_stack([np.sin(2.0 * z + x), 0.0 * x, np.cos(x - 1.5 * y)])
    if "round" in mesh.names:
        turn = size * np.sin(z)
        move = np.column_stack(
            [x * (np.cos(turn) - 1) - y * np.sin(turn), y * (np.cos(turn) - 1) + x * np.sin(turn), 0 * z]
        )
    if mesh.plane:
        move[:, mesh.across] = 0.0
    return move @ tilt.T


@pytest.mark.parametrize("case", CASES)
def test_the_surface_is_met_and_outside_nothing_moves(maps, case):
    mesh, warp = maps[case]
    move = shape_of(mesh, warp)
    points = warp.at(warp.start + move)
    assert np.abs(points[warp.nodes] - warp.start - move).max() < 1e-15 * 4.0
    assert np.array_equal(warp.nodes, mesh.on(*warp.plan.patches))
    stays = np.setdiff1d(np.arange(len(mesh.points)), warp.box.movable)
    assert points[stays].tobytes() == mesh.points[stays].tobytes()
    assert warp.at(warp.start).tobytes() == mesh.points.tobytes()


@pytest.mark.parametrize("case", CASES)
def test_derivatives_are_those_of_the_map_and_transposes_of_each_other(maps, case):
    mesh, warp = maps[case]
    surface, rng = warp.start + shape_of(mesh, warp), np.random.default_rng(1)
    speeds = np.cos(warp.start @ rng.standard_normal((3, 3)))
    if "round" in mesh.names or mesh.names[0] != "body":  # keeps the nodes on their shapes to the second order
        speeds = shape_of(mesh, warp) / 0.02
    rate, h = warp.jvp(surface, speeds), 1e-6
    ends = [warp.at(surface + sign * h * speeds) for sign in (-1.0, 1.0)]
    assert np.abs((ends[1] - ends[0]) / (2.0 * h) - rate).max() < 3e-8 * np.abs(rate).max()
    for _ in range(3):
        speeds, gradient = rng.standard_normal(surface.shape), rng.standard_normal(mesh.points.shape)
        rate = warp.jvp(surface, speeds)
        one, other = np.sum(gradient * rate), np.sum(warp.vjp(surface, gradient) * speeds)
        assert abs(one - other) < TRANSPOSED * np.linalg.norm(gradient) * np.linalg.norm(rate)
    one, other = np.sum(rate * rate), np.sum(warp.vjp(surface, rate) * speeds)
    assert abs(one - other) < 1e-11 * one


@pytest.mark.parametrize("case", CASES)
def test_a_part_in_any_order_has_the_bits_of_the_whole(maps, case):
    mesh, warp = maps[case]
    surface = warp.start + shape_of(mesh, warp)
    rows = np.random.default_rng(2).permutation(len(mesh.points))[: len(mesh.points) // 3]
    part, whole = warp.on(mesh.points[rows]), warp.at(surface)
    assert part.at(surface).tobytes() == whole[rows].tobytes()
    speeds, gradient = np.ones_like(surface), np.zeros_like(mesh.points)
    assert part.jvp(surface, speeds).tobytes() == warp.jvp(surface, speeds)[rows].tobytes()
    gradient[rows] = 1.0
    np.testing.assert_allclose(part.vjp(surface, gradient[rows]), warp.vjp(surface, gradient), atol=1e-10)
    with pytest.raises(InputError, match=r"times 0\.001 they would be|measured on another mesh"):
        warp.on(1000.0 * mesh.points)
    with pytest.raises(InputError, match="give all digits"):
        warp.on(mesh.points + 1e-9)


def test_coincident_points_move_as_one_in_a_part(maps):
    mesh, warp = maps["block"]
    surface = warp.start + shape_of(mesh, warp)
    twice = np.concatenate([warp.nodes, warp.nodes[::-1]])
    part = warp.on(mesh.points[twice])
    assert part.at(surface).tobytes() == surface[np.r_[: len(surface), len(surface) - 1 : -1 : -1]].tobytes()
    gradient = np.random.default_rng(3).standard_normal((len(twice), 3))
    half = len(surface)
    np.testing.assert_allclose(part.vjp(surface, gradient), gradient[:half] + gradient[half:][::-1], atol=1e-12)


def test_the_checks_are_those_of_a_deflection(maps):
    mesh, warp = maps["block"]
    checks = {check.name: check for check in warp.check(warp.start + shape_of(mesh, warp))}
    expected = deflect(mesh, "body", [[0, -1, 0], [0, 1, 0]], 2.0, fixed=[*SIDES]).checks
    assert {*checks} == {check.name for check in expected}
    assert all(check.passed for check in checks.values())
    assert checks["site_error"].verdict == "information"
    inverted = warp.start.copy()
    inverted[0] += [1.2, 1.2, 1.2]
    failed = {check.name for check in warp.check(inverted) if not check.passed}
    assert "inverted_cells" in failed


def test_a_file_read_in_pieces_gives_the_same_map(maps, block, tmp_path, monkeypatch, sdm):
    del sdm
    from sdm_deflect.cases.file_mesh import save_mesh

    path = save_mesh(block, block.points, tmp_path / "block.cgns")
    whole = maps["block"][1]
    monkeypatch.setattr(threads, "LIMITS", threads.SizeLimits(file=1))
    pieces = surface_map(path, "body", largest=0.2, fixed=[*SIDES])
    assert pieces.plan.mesh.whole is not None
    surface = whole.start + shape_of(block, whole)
    assert np.array_equal(pieces.nodes, whole.nodes)
    assert pieces.at(surface).tobytes() == whole.at(surface).tobytes()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "largest is missing: give the largest displacement to come, a length, or a box"),
        ({"largest": 0.0}, "largest = 0.0 must be a length above 0"),
        ({"largest": "0.1 m"}, "largest = '0.1 m' must be a length above 0"),
        ({"largest": 0.1, "angle": 3}, "angle: a surface map has no use for it; it takes largest, fixed"),
        ({"largest": 0.1, "repair": "auto"}, "repair: a surface map has no use for it"),
        ({"largest": 0.1, "fixd": "x-"}, "unknown setting fixd"),
        ({"largest": 0.1, "fixed": "wall"}, "no patch"),
    ],
)
def test_settings_that_cannot_be_are_one_sentence(block, given, said):
    with pytest.raises(InputError, match=re.escape(said)):
        surface_map(block, "body", **given)


def test_settings_of_maps_exist():
    assert {*OF_MAPS} <= {*BY_NAME}


def test_surfaces_that_cannot_be_are_one_sentence(maps):
    mesh, warp = maps["wing"]
    for surface, said in (
        (warp.start[:-1], rf"surface \({len(warp.start) - 1}, 3\) must be \({len(warp.start)}, 3\)"),
        (np.full_like(warp.start, np.nan), "finite"),
        (
            warp.start + np.array([0.0, 0.01, 0.0]),
            "nodes shared by the moving surface and symmetry would leave its shape .* keep",
        ),
    ):
        with pytest.raises(InputError, match=said):
            warp.at(surface)
    with pytest.raises(InputError, match=r"gradient \(3, 3\) must be"):
        warp.vjp(warp.start, np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"speeds \(3, 3\) must be"):
        warp.jvp(warp.start, np.zeros((3, 3)))
    del mesh


def test_a_surface_beside_a_fixed_patch_stays_there(block):
    lid, rest = block.patch("x+"), [name for name in SIDES if name != "x+"]
    warp = surface_map(block, "x+", box=[[-2.5, -2.5, -2.5], [2.5, 2.5, 2.5]], fixed=["body", *rest])
    border = np.isin(warp.nodes, block.on(*rest))
    moved = warp.start + np.array([0.1, 0.0, 0.0])
    with pytest.raises(InputError, match=r"which is fixed, would move by up to 0\.1; leave them in place, or let"):
        warp.at(moved)
    moved[border] = warp.start[border]
    assert np.array_equal(warp.at(moved)[warp.nodes], moved)
    assert len(lid) == 64


def test_nodes_at_one_place_stay_together(block):
    """A mesh whose body is doubled: each copy of a node must go to the same place."""
    count, body = len(block.points), block.on("body")
    copies = count + np.arange(len(body))
    index = np.arange(count)
    index[body] = copies
    faces = tuple(Cells(face.shape, index[face.nodes]) for face in block.patch("body").faces)
    patches = (*block.patches, Patch("double", faces))
    mesh = Mesh(np.vstack([block.points, block.points[body]]), block.cells, patches)
    warp = surface_map(mesh, ["body", "double"], largest=0.2, fixed=[*SIDES])
    surface = warp.start + np.array([0.05, 0.0, 0.0])
    assert np.array_equal(warp.at(surface)[copies], surface[-len(body) :])
    surface[0] += 0.01
    with pytest.raises(InputError, match="1 nodes part from others at their place"):
        warp.at(surface)


@pytest.fixture
def modes(maps):
    """Twenty shapes of the wing by name, none of which leaves the symmetry plane."""
    _, warp = maps["wing"]
    x, y, _ = warp.start.T
    shapes = [np.column_stack([0.0 * x, 0.0 * x, 0.02 * np.sin((1 + k) * y / 3.0) * y]) for k in range(20)]
    return {f"mode {k}": shape for k, shape in enumerate(shapes)}


def test_a_sum_of_modes_is_checked_as_a_table_of_it(maps, modes):
    mesh, warp = maps["wing"]
    motion = warp.modes(modes, (-1.0, 2.0))
    amounts = {"mode 0": 0.5, "mode 3": -0.3, "mode 7": 0.2}
    total = sum(amount * modes[name] for name, amount in amounts.items())
    points = motion.at(amounts)
    assert np.abs(points[warp.nodes] - warp.start - total).max() < 1e-15
    assert motion.at({}).tobytes() == mesh.points.tobytes()
    by_table = deflect(
        mesh, ["wing_*", "flap_*"], None, 1.0, table=(warp.start, total), slide="symmetry:plane", fixed="far*"
    )
    expected = {check.name: check for check in by_table.checks}
    checks = [check for check in motion.check(amounts) if check.name in expected]
    assert [check.verdict for check in checks] == [expected[check.name].verdict for check in checks]
    for check in checks:
        assert float(check.value or 0.0) == pytest.approx(float(expected[check.name].value or 0.0), abs=0.01)
    assert np.abs(points - warp.at(warp.start + total)).max() < 1e-3  # a map is not linear
    assert [row.failed for row in motion.judged(count=3).measured[0]] == [(), (), ()]


def test_modes_of_a_part_and_of_a_file_have_the_bits_of_the_whole(maps, modes, tmp_path):
    mesh, warp = maps["wing"]
    amounts, some = {"mode 1": 0.5, "mode 2": 1.0}, np.random.default_rng(3).permutation(len(mesh.points))[:400]
    whole = warp.modes(modes)
    points = whole.at(amounts)
    assert warp.on(mesh.points[some]).modes(modes).at(amounts).tobytes() == points[some].tobytes()
    whole.save(tmp_path / "modes.npz")
    assert MeshMotion.load(tmp_path / "modes.npz", mesh.points).at(amounts).tobytes() == points.tobytes()


@pytest.mark.parametrize(
    ("change", "ends", "said"),
    [
        (lambda shape: {}, (-1.0, 1.0), r"shapes = \{\} must be displacements \(K, 3\) by name"),
        (lambda shape: [shape], (-1.0, 1.0), r"must be displacements \(K, 3\) by name"),
        (lambda shape: {1: shape}, (-1.0, 1.0), r"must be displacements \(K, 3\) by name"),
        (lambda shape: {"a": 0.0 * shape}, (-1.0, 1.0), "a moves no node"),
        (lambda shape: {"a": shape[:-1]}, (-1.0, 1.0), r"a \(\d+, 3\) must be \(\d+, 3\), one row for each node"),
        (lambda shape: {"a": np.nan * shape}, (-1.0, 1.0), "a: a coordinate is not finite"),
        (
            lambda shape: {"a": shape + np.array([0.0, 0.1, 0.0])},
            (-1.0, 1.0),
            "nodes shared by the moving surface and symmetry",
        ),
        (lambda shape: {"a": shape}, (1.0, 2.0), "must be the least and the largest amount, with 0 among them"),
        (lambda shape: {"a": shape}, (0.0, 0.0), "must be the least and the largest amount"),
        (lambda shape: {"a": shape}, 1.0, "must be the least and the largest amount"),
        (lambda shape: {"a": shape}, "xy", "ends must be real numbers"),
    ],
)
def test_modes_that_are_none(maps, modes, change, ends, said):
    with pytest.raises(InputError, match=said):
        maps["wing"][1].modes(change(modes["mode 1"]), ends)

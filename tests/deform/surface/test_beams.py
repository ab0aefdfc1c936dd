"""Tables with rotations: the points of a beam move the sections of a surface, and turn them."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation as Turning

from sdm_deflect import Mesh, deflect, plan, surface_map
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface.motions import Powers
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tables import BeamLaw, Table
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Patch

# Axes of beams from a share of the span to points.
BEAMS = {
    "straight": lambda t: np.column_stack([0.4 + 0.0 * t, 2.0 * t, 0.0 * t]),
    "swept": lambda t: np.column_stack([0.4 + 0.3 * t, 2.0 * t, 0.05 * t]),
    "cranked": lambda t: np.column_stack([0.4 + 0.6 * np.maximum(t - 0.3, 0.0), 2.0 * t, 0.0 * t]),
    "from tip to tip": lambda t: np.column_stack([0.8 * np.abs(2.0 * t - 1.0), 4.0 * t - 2.0, 0.0 * t]),
    "arched": lambda t: np.column_stack([0.4 + 0.0 * t, 2.0 * np.sin(t), 2.0 - 2.0 * np.cos(t)]),
}
# Bending, torsion and yaw of the free wing at most, in radians.
BEND, TORSION = 0.2, 0.1


def cloud(points):
    """A surface without faces."""
    return Surface.of(Mesh(points, (), (Patch("all", (), np.arange(len(points))),)), ("all",))


def nodes_of(count, rng):
    return rng.uniform([0.0, -2.0, -0.06], [1.2, 2.0, 0.06], (count, 3))


def rigid(points, vector, center=(0.7, 0.2, -0.1)):
    """Displacements of points (N, 3) in a rotation by a vector (3,) about an axis through a point."""
    return Turning.from_rotvec(vector).apply(points - center) - (points - center)


def bent(y, length=2.0):
    """Displacements and rotation vectors of a beam along y that bends and twists, at stations (N,)."""
    up = BEND * y**2 * (3.0 * length - y) / (3.0 * length**2)
    slope = BEND * y * (2.0 * length - y) / length**2
    return np.column_stack([0.0 * y, 0.0 * y, up]), np.column_stack(
        [slope, TORSION * np.sin(0.5 * np.pi * y / length), 0.0 * y]
    )


def along_y(count):
    """A table of that beam, with `count` points."""
    y = np.linspace(0.0, 2.0, count)
    vectors, rotations = bent(y)
    return Table(np.column_stack([0.4 + 0.0 * y, y, 0.0 * y]), vectors, rotations=rotations)


@pytest.mark.parametrize("count", [2, 3, 4, 11, 60])
@pytest.mark.parametrize("shape", BEAMS)
@pytest.mark.parametrize("vector", [(0.0, 0.3, 0.0), (0.3, 0.0, 0.0), (0.1, -0.2, 0.2), (2.0, 1.0, 0.5)])
def test_a_rigid_rotation_of_a_beam_is_one_of_the_surface(count, shape, vector):
    """In any order of its rows; beyond its ends, too."""
    rng = np.random.default_rng(count)
    points = rng.permutation(BEAMS[shape]((np.arange(count) + 0.8 * rng.random(count)) / count))
    table = Table(points, rigid(points, vector), rotations=np.tile(vector, (count, 1)))
    nodes = nodes_of(500, rng)
    assert np.abs(table.law(cloud(nodes)).displacement(1.0) - rigid(nodes, vector)).max() < 1e-14


def test_the_error_of_a_bent_and_twisted_beam_falls_with_the_fourth_power_of_its_steps():
    nodes = np.random.default_rng(1).uniform([0.0, 0.0, -0.06], [1.2, 2.0, 0.06], (2000, 3))
    vectors, rotations = bent(nodes[:, 1])
    arms = nodes - np.column_stack([np.full(len(nodes), 0.4), nodes[:, 1], np.zeros(len(nodes))])
    exact = vectors + Turning.from_rotvec(rotations).apply(arms) - arms
    errors = [np.abs(along_y(n).law(cloud(nodes)).displacement(1.0) - exact).max() for n in (5, 9, 17, 33)]
    assert errors[0] < 1e-4
    assert (np.divide(errors[:-1], errors[1:]) > 12.0).all()


def test_nodes_at_points_of_the_beam_move_with_them_and_sections_beyond_the_ends_with_the_end():
    table = along_y(7)
    law = table.law(cloud(np.vstack([table.points, [[0.4, 2.5, 0.0]]])))
    assert np.abs(law.displacement(1.0)[:-1] - table.vectors).max() < 1e-15
    arm = np.array([0.0, 0.5, 0.0])
    end = table.vectors[-1] + Turning.from_rotvec(table.rotations[-1]).apply(arm) - arm
    assert np.abs(law.displacement(1.0)[-1] - end).max() < 1e-15


def test_the_amount_scales_displacements_and_rotation_vectors():
    """A turn of the end by .3 rad is one by .15 at half the amount, and not half the displacement."""
    nodes = nodes_of(200, np.random.default_rng(2))
    points = BEAMS["straight"](np.linspace(-1.0, 1.0, 9))
    law = Table(points, np.zeros_like(points), rotations=np.tile([0.0, 0.3, 0.0], (9, 1))).law(cloud(nodes))
    for amount in (-1.5, -0.5, 0.0, 0.5):
        expected = rigid(nodes, (0.0, 0.3 * amount, 0.0), (0.4, 0.0, 0.0))
        assert np.abs(law.displacement(amount) - expected).max() < 1e-14
    tiny = 1e-7
    assert np.abs(law.displacement(tiny) / tiny - law.slope).max() < 1e-7
    assert isinstance(law.frozen_at(0.3), BeamLaw)


CSV = "x,y,z,dx,dy,dz,rx,ry,rz"
STRAIGHT = [[0.4, y, 0.0] for y in (0.0, 0.5, 1.0, 2.0)]


@pytest.mark.parametrize(
    ("titles", "points", "rotation", "said"),
    [
        ("x,y,z,rx,ry,rz", STRAIGHT, 0.1, "titles must be x,y,z,dx,dy,dz, in a plane mesh x,y,dx,dy; rotations of"),
        ("x,y,z,dx,dy,dz,rx,ry", STRAIGHT, 0.1, "titles must be"),
        ("x,y,dx,dy,rx,ry,rz", STRAIGHT, 0.1, "titles must be"),
        (CSV, STRAIGHT, 12.0, "table: a rotation of 12.03 is more than a whole turn: give radians"),
        (CSV, STRAIGHT, np.nan, "not finite"),
        (CSV, [*STRAIGHT, [0.4, 1.0, 0.0]], 0.1, "[0.4, 1.0, 0.0] is given twice, with the rotations"),
        (CSV, [*STRAIGHT, [0.4, 1.0, 1e-9]], 0.1, "are close together: leave one of them out"),
        (CSV, [*STRAIGHT, [0.9, 1.0, 0.0]], 0.1, "are in one section: give each beam a table"),
        (CSV, [[0.4, 1.0, 0.0]] * 5, 0.0, "all its points are at one place; a beam needs two"),
        (CSV, STRAIGHT[:1], 0.1, "1 points; it needs at least 2"),
    ],
)  # fmt: skip
def test_rotations_that_are_none(titles, points, rotation, said, tmp_path):
    rows = []
    for i, point in enumerate(points):
        known = dict(zip("xyz", point, strict=True), ry=rotation + 0.01 * i * bool(rotation))
        rows.append([known.get(title, 0.0) for title in titles.split(",")])
    path = tmp_path / "beam.csv"
    path.write_text("\n".join([titles, *(",".join(map(repr, row)) for row in rows)]) + "\n")
    with pytest.raises(InputError, match=re.escape(said)) as error:
        Table.read(path).law(cloud(nodes_of(20, np.random.default_rng(0))))
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def half_wing(hybrid_wing):
    """A mesh of span 1, its nodes on wing and flap, a beam that bends and twists, and how far it moves them."""
    mesh = hybrid_wing.mesh
    nodes, y = mesh.on(*mesh.expand(WING, "")), np.linspace(0.0, 1.0, 9)
    vectors, rotations = bent(y, 1.0)
    table = Table(np.column_stack([0.35 + 0.1 * y, y, 0.0 * y]), vectors, rotations=0.5 * rotations)
    return mesh, nodes, table, table.law(cloud(mesh.points[nodes])).displacement


WING = ["wing_*", "flap_*"]
SLIDES = {"slide": {"symmetry": "plane"}}


def test_a_bent_and_twisted_wing_passes_its_checks(half_wing, tmp_path):
    """From arrays, and from a file with other titles."""
    mesh, nodes, table, moved = half_wing
    arrays = (table.points, table.vectors, table.rotations)
    result = deflect(mesh, WING, None, 1.0, table=arrays, **SLIDES)
    assert result.passed
    assert np.abs(result.points[nodes] - mesh.points[nodes] - moved(1.0)).max() < 1e-15
    rows = np.hstack([table.rotations, table.vectors, table.points])[::-1]
    titles = "rotation_x,Rotation:1,rz,displacement:0,dy,dz,Points:0,Points:1,Points:2"
    np.savetxt(tmp_path / "beam.csv", rows, "%.17g", ",", header=titles)
    from_file = deflect(mesh, WING, None, 1.0, table=tmp_path / "beam.csv", **SLIDES)
    assert np.abs(from_file.points - result.points).max() < 1e-12


def test_a_plan_of_a_beam_is_near_its_deflections_and_has_its_derivative(half_wing):
    mesh, nodes, table, moved = half_wing
    motion = plan(mesh, [{"patches": WING, "table": table, "range": (-1.0, 1.0)}], **SLIDES)
    assert isinstance(motion.controls[0].functions, Powers)
    for amount in (-1.0, -0.35, 0.6, 1.0):
        off = motion.at((amount,))[nodes] - mesh.points[nodes] - moved(amount)
        assert np.abs(off).max() < 1e-5
    step = 1e-4
    near = (motion.at((0.6 + step,)) - motion.at((0.6 - step,))) / (2.0 * step)
    rate, gradient = motion.jvp((0.6,), (1.0,)), np.random.default_rng(5).random(mesh.points.shape)
    assert np.abs(rate - near).max() < 1e-7
    assert motion.vjp((0.6,), gradient) == pytest.approx(np.sum(rate * gradient), rel=1e-12)


def test_modes_of_beams_and_of_points_count_to_first_order(half_wing):
    mesh, _, table, moved = half_wing
    warp = surface_map(mesh, WING, largest=0.3, **SLIDES)
    corners = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in np.linspace(0.0, 1.0, 6) for z in (-0.06, 0.06)])
    sweep = 0.1 * np.column_stack([corners[:, 1], *np.zeros((2, len(corners)))])
    motion = warp.modes({"bend": table, "sweep": Table(corners, sweep)})
    points = motion.at({"bend": 0.4, "sweep": -0.5})[warp.nodes]
    by_bend = (moved(1e-6) - moved(-1e-6)) / 2e-6
    by_sweep = 0.1 * np.column_stack([warp.start[:, 1], *np.zeros((2, len(warp.start)))])
    assert np.abs(points - warp.start - 0.4 * by_bend + 0.5 * by_sweep).max() < 1e-9
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warp.modes({"bend": Table(table.points, table.vectors)})
    assert any(str(one.message).startswith("bend: table: its points lie on a line") for one in caught)
    with pytest.raises(InputError, match=r"times 0\.001 its points would lie where"):
        warp.modes({"bend": replace(table, points=1000.0 * table.points)})


LINE = "table: its points lie on a line and have no rotations, so that sections of wing_upper, .* move without turning"


def test_what_a_table_cannot_say_is_named(half_wing):
    mesh, _, table, _ = half_wing
    few = replace(table, points=0.8 * table.points + [0.0, 0.1, 0.0])
    degrees = replace(table, vectors=0.0 * table.vectors, rotations=np.tile([0.0, 1.2, 0.0], (9, 1)))
    half = np.array([0.3, 0.0, 0.0])
    spars = np.vstack([few.points - half, few.points + half])
    for given, said in (
        (Table(table.points, table.vectors), LINE),
        (
            Table(np.tile(table.points[4], (5, 1)), np.tile([0.01, 0.0, 0.0], (5, 1))),
            "are at one place, .* as one piece",
        ),
        (few, "lie beyond its points, by up to 0.1: they move with the beam's end$"),
        (Table(spars, np.tile(few.vectors, (2, 1))), r"is extrapolated, to 0.1\d* where the table's largest is 0.1"),
        (
            Table(spars[::3], np.tile(few.vectors + 0.2 * half[::-1], (2, 1))[::3]),
            "it moves wing_upper, .* on symmetry by up to .* of .*, at .*: should that stay, give it points there",
        ),
        (degrees, "it turns by up to 1.2 radians, 68.75 degrees: is it in radians"),
    ):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            deflect(mesh, WING, None, 0.05, table=given, repair="off", **SLIDES)
        assert any(re.search(said, str(one.message)) for one in caught), [str(one.message) for one in caught]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plan(mesh, [{"patches": WING, "table": table, "range": (0.0, 1.0)}], **SLIDES)


@pytest.mark.parametrize(("angle", "off"), [(0.3, 0.0008), (1.0, 0.03)])
def test_rotation_vectors_about_two_axes_are_not_the_shortest_way(angle, off):
    """The guide says by how much a section halfway between them differs."""
    ends = np.array([[angle, 0.0, 0.0], [0.0, angle, 0.0]])
    table = Table(np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.zeros((2, 3)), rotations=ends)
    middle = np.array([0.0, 0.5, 0.0])
    moved = table.law(cloud(middle + np.eye(3))).displacement(1.0)[[0, 2]] + np.eye(3)[[0, 2]]
    first, last = map(Turning.from_rotvec, ends)
    shortest = first * Turning.from_rotvec(0.5 * (first.inv() * last).as_rotvec())
    assert np.linalg.norm(moved - shortest.apply(np.eye(3)[[0, 2]]), axis=1).max() == pytest.approx(off, rel=0.05)


@pytest.mark.parametrize(
    ("axis", "normal"),
    [("swept", [0.0, 1.0, 0.0]), ("along x", [1.0, 0.0, 0.0]), ("fin", [0.0, 0.0, 1.0]), ("given", [0.3, 2.0, 0.1])],
)  # fmt: skip
def test_sections_lie_across_the_span_or_across_a_hinge(axis, normal):
    t = np.linspace(0.0, 1.0, 6)
    swept, body = BEAMS["swept"](t), np.column_stack([3.0 * t, 0.2 * t, 0.1 * t**2])
    points = {"along x": body, "fin": swept[:, [0, 2, 1]]}.get(axis, swept)
    vectors, rotations = bent(np.linspace(0.0, 2.0, 6))
    hinge = Axis(points[0], np.array(normal)) if axis == "given" else None
    table = Table(points, vectors, hinge, rotations=rotations)
    arm = np.cross(normal, [0.3, 0.2, 0.7])
    expected = vectors + Turning.from_rotvec(rotations).apply(arm) - arm
    assert np.abs(table.law(cloud(points + arm)).displacement(1.0) - expected).max() < 1e-14

"""Faces that go through others: found whatever their shape, and only where they did not before."""

from itertools import combinations

import numpy as np
import pytest

from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons, Zone
from sdm_deflect.meshing.mesh.crossing import IntersectingFaces
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import FACES, grid
from tests.frozen.test_frozen import FOLDER, frozen_mesh


def sheet(count, z, shape="quad"):
    """A square of faces of side 1 at a height: points (N, 3) and faces."""
    x = np.linspace(0.0, 1.0, count + 1)
    points = np.array([(a, b, z) for a in x for b in x])
    i = np.arange(len(points)).reshape(count + 1, count + 1)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    if shape == "triangle":
        return points, Cells(shape, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    if shape == "polygon":
        return points, Polygons(quads.ravel(), np.arange(0, quads.size + 1, 4))
    return points, Cells(shape, quads)


def shifted(faces, by):
    if isinstance(faces, Polygons):
        return Polygons(faces.nodes + by, faces.offsets)
    return Cells(faces.shape, faces.nodes + by)


def two_sheets(gap, shape="quad", zones=()):
    """Two sheets, ``low`` and ``high``, a gap apart; their nodes do not lie over each other."""
    (one, low), (other, high) = sheet(9, 0.0, shape), sheet(7, gap, shape)
    patches = (Patch("low", (low,)), Patch("high", (shifted(high, len(one)),)))
    return Mesh(np.vstack([one, other]), (), patches, zones)


def bulged(mesh, height):
    """The lower sheet bulged upwards, its rim where it was."""
    points = mesh.points.copy()
    x, y, _ = points[:100].T
    points[:100, 2] += height * np.sin(np.pi * x) * np.sin(np.pi * y)
    return points


@pytest.mark.parametrize("shape", ["triangle", "quad", "polygon"])
@pytest.mark.parametrize("gap", [1e-3, 1e-2, 3e-2])
def test_a_skin_that_bulges_through_another_one(gap, shape):
    mesh = two_sheets(gap, shape)
    found = IntersectingFaces.of(mesh, bulged(mesh, 0.08))
    assert found.faces > 0
    assert found.where.startswith("the first is of low, through high at (")
    assert IntersectingFaces.of(mesh, bulged(mesh, 0.9 * gap)).faces == 0
    assert IntersectingFaces.of(mesh, bulged(mesh, -0.08)).faces == 0


def test_nothing_that_moves_is_not_applicable():
    mesh = two_sheets(0.01)
    assert IntersectingFaces.of(mesh, mesh.points) == IntersectingFaces(0, 0, 0)
    alone = Mesh(mesh.points, (), (Patch("nodes", (), np.arange(50)),))
    assert IntersectingFaces.of(alone, bulged(mesh, 0.1)) == IntersectingFaces(0, 0, 0)


def test_zones_overlap_and_are_not_compared():
    mesh = two_sheets(0.01, zones=(Zone("one", 0, 100), Zone("other", 100, 164)))
    assert IntersectingFaces.of(mesh, bulged(mesh, 0.08)).faces == 0


def test_patches_without_a_common_node_that_overlap_before_are_not_compared():
    mesh = two_sheets(0.03)
    start = mesh.with_points(bulged(mesh, 0.04))
    assert IntersectingFaces.of(start, bulged(mesh, 0.08)).faces == 0


def test_patches_that_share_a_node_are_compared_but_for_faces_that_cross_before():
    mesh = two_sheets(0.03)
    tie = Patch("high", (*mesh.patches[1].faces, Cells("triangle", np.array([[0, 100, 101]]))))
    start = Mesh(bulged(mesh, 0.04), (), (mesh.patches[0], tie))
    few, more = IntersectingFaces.of(start, bulged(mesh, 0.0401)), IntersectingFaces.of(start, bulged(mesh, 0.08))
    assert few.faces < more.faces
    assert IntersectingFaces.of(start, start.points + np.ones(3)).faces == 0


def test_copies_of_a_node_are_neighbours():
    """The same sheet twice, node by node, with other diagonals: a wall of no thickness."""
    (points, low), (_, high) = sheet(6, 0.0, "triangle"), sheet(6, 0.0)
    patches = (Patch("low", (low,)), Patch("high", (shifted(high, len(points)),)))
    mesh = Mesh(np.vstack([points, points]), (), patches)
    moved = mesh.points + 0.1 * np.sin(7.0 * mesh.points[:, [1, 2, 0]])
    assert IntersectingFaces.of(mesh, moved).faces == 0


def test_touching_is_no_crossing():
    """A box that moves until one of its sides lies in a wall, and a bit farther."""
    points, cells = grid([0.2, 0.2, 0.5], [0.6, 0.6, 0.9], [1, 1, 1])
    wall, faces = sheet(5, 0.0)
    patches = (Patch("box", (Cells("quad", cells[:, FACES].reshape(-1, 4)),)), Patch("wall", (shifted(faces, 8),)))
    mesh = Mesh(np.vstack([points, wall]), (), patches)
    down = np.where(np.arange(len(mesh.points))[:, None] < 8, [0.0, 0.0, -1.0], 0.0)
    assert IntersectingFaces.of(mesh, mesh.points + 0.5 * down).faces == 0
    assert IntersectingFaces.of(mesh, mesh.points + (0.5 + 1e-9) * down).faces == 0
    assert IntersectingFaces.of(mesh, mesh.points + (0.5 + 1e-6) * down).faces == 4


def test_lines_of_a_plane_mesh():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0.5, 0.2, 0], [1.5, 0.2, 0], [1.5, 1, 0]], dtype=float)
    cells = (Cells("triangle", np.array([[3, 4, 5]])),)
    lines = (
        Patch("wall", (Cells("line", np.array([[0, 1], [1, 2]])),)),
        Patch("flap", (Cells("line", [[3, 4], [4, 5]]),)),
    )
    mesh = Mesh(points, cells, lines)
    for depth, faces in ((0.1, 0), (0.2, 0), (0.3, 2)):
        moved = points.copy()
        moved[4, 1] -= depth
        assert IntersectingFaces.of(mesh, moved).faces == faces


def test_triangles_that_intersect_are_those_of_every_pair():
    """Beside every pair tried: an edge of one reaches a point of the other (Moeller and Trumbore)."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(size=(60, 1, 3)) + rng.uniform(-0.3, 0.3, (60, 3, 3))
    middle = corners.mean(axis=1, keepdims=True)
    apart = middle + 0.01 * (corners - middle)
    patch = Patch("all", (Cells("triangle", np.arange(180).reshape(-1, 3)),))
    mesh = Mesh(apart.reshape(-1, 3), (), (patch,))
    pairs = [(i, j) for i, j in combinations(range(60), 2) if any(_hits(*corners[[i, j]]))]
    assert len(pairs) > 30
    assert IntersectingFaces.of(mesh, corners.reshape(-1, 3)).faces == len({face for pair in pairs for face in pair})


def _hits(one, other):
    for s, t in ((one, other), (other, one)):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            u, v, w = np.linalg.solve(np.stack([t[1] - t[0], t[2] - t[0], s[a] - s[b]], axis=1), s[a] - t[0])
            yield u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= w <= 1.0


def test_a_plate_between_two_flows_fails_by_this_check_alone():
    """Flow on both sides of a thin plate: the upper skin bulges through the lower one, and no cell is inverted."""
    (one, cells), (other, more) = (
        grid([-1, 0, 0], [-5e-3, 1, 1], [6, 10, 10]),
        grid([5e-3, 0, 0], [1, 1, 1], [6, 10, 10]),
    )
    points, cells = np.vstack([one, other]), np.vstack([cells, more + len(one)])
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[first[count == 1]]
    x, y, z = points[faces].mean(axis=1).T
    inner = (np.abs(x + 5e-3) < 1e-9) & (np.abs([y - 0.5, z - 0.5]) < 0.2).all(axis=0)
    parts = {"skin": inner, "other": np.abs(x - 5e-3) < 1e-9, "rim": (np.abs(x + 5e-3) < 1e-9) & ~inner}
    parts["far"] = ~np.any(list(parts.values()), axis=0)
    mesh = Mesh(
        points, (Cells("hexahedron", cells),), tuple(Patch(k, (Cells("quad", faces[v]),)) for k, v in parts.items())
    )
    at = points[mesh.patch("skin").nodes]
    bulge = np.maximum(np.cos(np.pi * (at[:, 1:] - 0.5) / 0.4), 0.0).prod(axis=1)
    bulge[bulge < 1e-9] = 0.0
    moving = Moving(("skin",), Table(at, 0.08 * bulge[:, None] * [1.0, 0.0, 0.0]), 1.0)
    plan = Plan.of(mesh, [Job((moving,), fixed=("rim", "other"), box=Automatic(margin=0.25))])
    found = deflect(plan, (1.0,))
    assert found.inverted == 0
    assert found.points[:, 0][mesh.patch("skin").nodes].max() > 0.05
    assert [check.name for check in checks_of(found) if not check.passed] == ["surfaces_crossed"]


CASES = (
    "aileron-12_mv",
    "aileron-30_squv",
    "aileron-chimera-12",
    "aileron-chimera-30",
    "all+12",
    "rudder+15",
    "tail+12",
)


@pytest.mark.parametrize("name", CASES)
def test_no_surface_of_the_aircraft_goes_through_another(name):
    mesh, found = frozen_mesh("block" if "chimera" in name else "aircraft"), np.load(FOLDER / f"{name}.npz")
    points = mesh.points.copy()
    points[found["rows"]] = found["points"]
    crossings = IntersectingFaces.of(mesh, points)
    assert crossings.faces == 0
    assert crossings.moved > 50

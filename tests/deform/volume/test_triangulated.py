"""Patches of any shape that slide on their own undeformed faces."""

import numba
import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons
from sdm_deflect.meshing.mesh.closest import Triangles
from sdm_deflect.meshing.mesh.edges import polygons_of
from sdm_deflect.meshing.mesh.sliding import SlidingPatch, TriangleSet, Triangulated
from tests.deform.blocks import block_with_body, grid
from tests.deform.jobs import sensitivity, turn

SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")


def rng():
    return np.random.default_rng(7)


def sheet(n, shape):
    """Quadrilaterals over the unit square, lifted by shape(u, v)."""
    points, _ = grid([0, 0, 0], [1, 1, 1], [n, n, 1])
    u, v = points[::2, :2].T
    index = np.arange(len(u)).reshape(n + 1, n + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    return np.column_stack([u, v, shape(u, v)]), polygons_of([Cells("quad", quads)])


def cap(n=24):
    """A piece of the sphere of radius 1 around (0.5, 0.5, 0)."""
    return sheet(n, lambda u, v: np.sqrt(1.0 - (u - 0.5) ** 2 - (v - 0.5) ** 2))


def roof(n=8):
    """Two planes that meet along u = 0.5 at 90 degrees."""
    return sheet(n, lambda u, v: -np.abs(u - 0.5))


def nearest_by_hand(corners, point):
    """Smallest distance of a point from triangles (T, 3, 3), by projection onto planes and segments."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    share = np.einsum("ij,ij->i", point - corners[:, 0], normal) / np.maximum(np.sum(normal**2, axis=1), 1e-300)
    foot, inside, found = point - share[:, None] * normal, normal.any(axis=1), []
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        inside &= np.einsum("ij,ij->i", np.cross(b - a, foot - a), normal) >= 0.0
        length = np.maximum(np.sum((b - a) ** 2, axis=1), 1e-300)
        along = np.clip(np.einsum("ij,ij->i", point - a, b - a) / length, 0.0, 1.0)
        found.append(np.linalg.norm(a + along[:, None] * (b - a) - point, axis=1))
    off = np.where(inside, np.linalg.norm(foot - point, axis=1), np.inf)
    return np.minimum(off, np.min(found, axis=0)).min()


@pytest.mark.parametrize("count", [1, 3, 4, 5, 400])
@pytest.mark.parametrize("spread", [0.1, 3.0])
def test_the_closest_point_is_the_closest_of_all_triangles(count, spread):
    """Large triangles, small ones, needles, segments and points, near and far."""
    size = 10.0 ** rng().uniform(-3.0, 0.0, (count, 1, 1))
    corners = rng().uniform(0.0, 1.0, (count, 1, 3)) + size * rng().normal(size=(count, 3, 3))
    corners[::5, 2] = corners[::5, 1]
    corners[::7] = corners[::7, :1]
    points = 0.5 + spread * rng().normal(size=(200, 3))
    hit = Triangles.of(corners).closest(points)
    expected = [nearest_by_hand(corners, point) for point in points]
    np.testing.assert_allclose(np.linalg.norm(hit.places - points, axis=1), expected, rtol=1e-9, atol=1e-12)
    assert hit.weights.min() >= 0.0
    np.testing.assert_allclose(hit.weights.sum(axis=1), 1.0, atol=1e-14)


def test_a_tree_of_nothing_is_refused():
    with pytest.raises(ValueError, match="one triangle at least"):
        Triangles.of(np.empty((0, 3, 3)))


def test_a_mesh_of_the_same_sphere_lies_on_it_to_second_order():
    """Distance of a finer cap from a coarser one falls with the square of the edge."""
    fine = cap(61)[0]
    off = [float(Triangulated.of(*cap(n)).distance(fine).max()) for n in (10, 20, 40)]
    assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.2)
    assert np.log2(off[1] / off[2]) == pytest.approx(2.0, abs=0.2)


def test_a_flat_patch_is_a_plane():
    points, faces = sheet(6, lambda u, v: 0.3 * u)
    surface, move = Triangulated.of(points, faces), 0.02 * rng().normal(size=points.shape)
    inner = (np.abs(points[:, :2] - 0.5) < 0.4).all(axis=1)
    normal = np.array([-0.3, 0.0, 1.0]) / np.hypot(1.0, 0.3)
    flat = move - np.outer(move @ normal, normal)
    np.testing.assert_allclose(surface.projected(points, move)[inner], flat[inner], atol=1e-15)
    np.testing.assert_allclose(surface.rate(points, move, move)[inner], flat[inner], atol=1e-15)
    np.testing.assert_allclose(surface.rate(points, 0.0 * move, move)[inner], flat[inner], atol=1e-15)


@pytest.mark.parametrize("made", [cap, roof])
def test_moved_nodes_are_on_the_surface_and_others_keep_their_bits(made):
    points, faces = made()
    surface, move = Triangulated.of(points, faces), 0.05 * rng().normal(size=points.shape)
    move[::3] = 0.0
    out = surface.projected(points, move)
    assert surface.distance(points).max() < 1e-15
    assert surface.distance(points + out).max() < 1e-15
    assert np.array_equal(points[::3] + out[::3], points[::3])
    assert np.abs(out[1::3]).max() > 0.01
    np.testing.assert_allclose(surface.projected(points, out), out, atol=1e-15)


@pytest.mark.parametrize("made", [cap, roof])
def test_the_rate_is_the_derivative_of_the_projection(made):
    """Everywhere but where the two places of the difference are on different triangles."""
    points, faces = made()
    surface, h = Triangulated.of(points, faces), 1e-7
    move, speed = 0.03 * rng().normal(size=points.shape), rng().normal(size=points.shape)
    ends = [move + h * speed, move - h * speed]
    difference = (surface.projected(points, ends[0]) - surface.projected(points, ends[1])) / (2.0 * h)
    off = np.abs(surface.rate(points, move, speed) - difference).max(axis=1)
    rows = [surface.faces.search.closest(points + end).rows for end in ends]
    same = rows[0] == rows[1]
    assert same.mean() > 0.95
    assert off[same].max() < 1e-6


def test_beside_a_convex_edge_only_the_motion_along_it_stays():
    """A blunt ridge, 20 degrees: in the wedge over it every place goes to the same line."""
    points, faces = sheet(4, lambda u, v: -np.tan(np.radians(10.0)) * np.abs(u - 0.5))
    surface = Triangulated.of(points, faces)
    inner = (np.abs(points[:, :2] - 0.5) < 0.4).all(axis=1)
    assert not surface.ridges.search.within(points[inner], 1e-9).any()
    over = np.array([[0.5, 0.3, 0.2]])
    assert np.array_equal(surface.projected(over, np.full((1, 3), 1e-3))[0] + over[0], [0.5, 0.301, 0.0])
    np.testing.assert_allclose(surface.rate(over, 0.0 * over, np.ones((1, 3))), [[0.0, 1.0, 0.0]], atol=1e-15)
    above = np.array([[-0.2, -0.2, 0.5]])
    assert not surface.rate(above, 0.0 * above, np.ones((1, 3))).any()


def test_nodes_of_a_sharp_edge_slide_along_it_and_its_ends_stay():
    points, faces = roof()
    surface, move = Triangulated.of(points, faces), np.full_like(points, 0.02)
    out, rate = surface.projected(points, move), surface.rate(points, move, np.ones_like(points))
    on = points[:, 0] == 0.5
    ends = on & (np.abs(points[:, 1] - 0.5) == 0.5)
    assert ends.sum() == 2
    assert not out[ends].any()
    assert not rate[ends].any()
    assert np.array_equal(out[on & ~ends] != 0.0, np.tile([False, True, False], (7, 1)))
    np.testing.assert_allclose(out[on & ~ends][:, 1], 0.02, atol=1e-16)
    np.testing.assert_allclose(rate[on & ~ends], np.tile([0.0, 1.0, 0.0], (7, 1)), atol=1e-15)


def test_where_sharp_edges_meet_or_bend_nodes_stay():
    """A pyramid: on its four ridges nodes slide, its top stays."""
    points, faces = sheet(10, lambda u, v: -np.abs(u - 0.5) - np.abs(v - 0.5))
    surface = Triangulated.of(points, faces)
    u, v = points[:, :2].T - 0.5
    ridge = np.isclose(u * v, 0.0) & (np.abs(u) + np.abs(v) < 0.45)
    out = surface.projected(points[ridge], np.full((ridge.sum(), 3), [0.01, 0.02, 0.0]))
    top = np.isclose(u, v)[ridge]
    assert top.sum() == 1
    assert not out[top].any()
    along = np.where(np.abs(u[ridge]) > 0.0, out[:, 0], out[:, 1])[~top]
    np.testing.assert_allclose(np.abs(out[~top]).sum(axis=1), 2.0 * np.abs(along), atol=1e-15)
    assert np.abs(along).min() > 1e-3
    bent = TriangleSet.curves(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [1.1, 2, 0]]), np.array([[0, 1], [1, 2], [2, 3]])
    )
    assert np.array_equal(bent.projectors.any(axis=(1, 2)), [False, False, True, False])


def test_the_bytes_do_not_depend_on_the_number_of_threads(monkeypatch):
    points, faces = cap(40)
    move, found = 0.05 * rng().normal(size=points.shape), []
    for threads in (1, 2, 3):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)
        found.append(Triangulated.of(points, faces).projected(points, move).tobytes())
    assert found[0] == found[1] == found[2]


def test_polygons_are_cut_and_those_of_other_shapes_agree():
    """A hexagon of one polygon is that of its four triangles."""
    angles = np.radians(np.arange(0, 360, 60))
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    one = Triangulated.of(points, Polygons(np.arange(6), np.array([0, 6])))
    probe = rng().normal(size=(50, 3))
    four = Triangulated.of(points, polygons_of([Cells("triangle", np.array([[0, k, k + 1] for k in range(1, 5)]))]))
    np.testing.assert_allclose(one.distance(probe), four.distance(probe), atol=1e-15)


def warped_block():
    """A block around a body whose sides are no planes."""
    mesh = block_with_body()
    x, y, z = mesh.points.T
    far = (np.abs(mesh.points).max(axis=1) - 0.5) / 1.5
    bulge = 0.15 * np.clip(far, 0.0, 1.0) ** 2
    wave = np.stack([np.sin(y + z), np.cos(x - z), np.sin(x * y)], axis=1)
    return mesh.with_points(mesh.points + bulge[:, None] * wave)


def test_nodes_slide_on_the_sides_of_a_warped_block():
    mesh = warped_block()
    with pytest.raises(InputError, match=r"x-:plane: the patch is no plane; .*; any shape is a surface"):
        turn(mesh, slide=dict.fromkeys(SIDES, "plane"))
    result = turn(mesh, angle=20.0, slide=dict.fromkeys(SIDES, "surface"), box=[[-3.0] * 3, [3.0] * 3])
    slid = np.setdiff1d(mesh.on(*SIDES), mesh.on("body"))
    assert np.abs(result.points[slid] - mesh.points[slid]).max() > 0.02
    checks = {check.name: check for check in checks_of(result)}
    for name in SIDES:
        assert checks[f"on_{name}"].over > 40
        assert checks[f"on_{name}"].passed


def test_the_sensitivity_is_that_of_the_deflection():
    mesh = warped_block()
    more = {"slide": dict.fromkeys(SIDES, "surface"), "box": [[-3.0] * 3, [3.0] * 3]}
    result, h = turn(mesh, angle=10.0, **more), 1e-4
    assert result is not None
    ends = [turn(mesh, angle=10.0 + sign * h, **more).points for sign in (1.0, -1.0)]
    difference, rate = (ends[0] - ends[1]) / (2.0 * h), sensitivity(result)
    off = np.linalg.norm(difference - rate, axis=1) / np.linalg.norm(rate, axis=1).max()
    assert np.quantile(off, 0.99) < 1e-4


def test_a_patch_without_faces_has_no_surface(block):
    mesh = block_with_body()
    loose = Patch("dots", (), mesh.patch("x-").nodes)
    with pytest.raises(InputError, match="slide = dots:surface: the patch needs faces that hold all of its 81 nodes"):
        SlidingPatch.of(type(mesh)(mesh.points, mesh.cells, (*mesh.patches, loose)), "dots", "surface")

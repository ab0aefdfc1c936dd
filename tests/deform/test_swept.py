"""Faces sweep what their cells gain: for every type of cell, in real deflections, over a period."""

from math import pi, sin

import numpy as np
import pytest

from sdm_deflect.deform.mesh.mesh import Polygons, Polyhedra
from sdm_deflect.deform.mesh.polyhedra import face_centres_and_areas, pyramids_of
from sdm_deflect.deform.mesh.swept import CONSERVED, Swept, gained, swept_volumes
from sdm_deflect.deform.volume.deflection import sweep
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.formats.polyhedra import bounded
from tests.deform.jobs import blended, job, turn
from tests.deform.shapes import SHAPES, body_in
from tests.meshing.formats.examples import hybrid, polyhedral
from tests.meshing.formats.wing import wing

PERIOD = [round(10.0 * sin(2.0 * pi * k / 8), 12) for k in range(9)]
"""Degrees of a harmonic oscillation."""


def in_time(plan, angles):
    """Points at each of some angles, and the cells by their faces; an angle that comes again has the same bits."""
    distinct = list(dict.fromkeys(angles))
    found = {one.angle: one.points for _, one in sweep(plan, distinct)}
    return [found[angle] for angle in angles], bounded(plan.mesh).cells


def conserved(points, cells):
    """Check one period, time by time and as a whole; return the sweeps."""
    volumes = [pyramids_of(one, cells).volume for one in points]
    total, least = np.zeros(len(cells)), 0.0
    for k in range(1, len(points)):
        found = Swept.of(cells, points[k - 1], points[k])
        gain = gained(cells, found.faces)
        np.testing.assert_array_less(np.abs(gain - (volumes[k] - volumes[k - 1])), CONSERVED * volumes[k])
        assert found.gap <= found.gap_of_volume <= CONSERVED
        least = max(least, np.abs(gain / volumes[k]).max())
        total += gain
    assert least > 0.01  # cells do change
    np.testing.assert_array_equal(points[0], points[-1])
    np.testing.assert_array_less(np.abs(total), CONSERVED * volumes[0])


@pytest.mark.parametrize("shape", SHAPES)
def test_faces_sweep_what_cells_gain_over_a_period(shape):
    plan = Plan.of(body_in(shape), job(("body",)), PERIOD)
    conserved(*in_time(plan, PERIOD))


def test_faces_sweep_what_cells_gain_in_a_mesh_of_all_types_with_layers(hybrid_wing):
    plan = Plan.of(hybrid_wing.mesh, job(("flap_*",), hybrid_wing.hinge, **blended(hybrid_wing)), PERIOD)
    conserved(*in_time(plan, PERIOD))


@pytest.mark.parametrize("mesh", [hybrid(), polyhedral(hybrid())], ids=["cells", "polyhedra"])
def test_faces_sweep_what_cells_gain_wherever_nodes_go(mesh):
    cells, random = bounded(mesh).cells, np.random.default_rng(7)
    before = mesh.points
    for _ in range(20):
        after = mesh.points + random.uniform(-0.1, 0.1, mesh.points.shape)
        assert Swept.of(cells, before, after).gap_of_volume < CONSERVED
        before = after


def faces_of(*rows):
    """Faces of the numbers of corners that the rows have."""
    return Polygons(np.concatenate(rows), np.cumsum([0, *map(len, rows)]))


SQUARES = Polyhedra(
    faces_of([4, 5, 6, 7], [0, 3, 2, 1], [8, 9, 10, 11], *(
        [low + i, low + (i + 1) % 4, low + 4 + (i + 1) % 4, low + 4 + i] for low in (0, 4) for i in range(4)
    )),
    np.array([0, 0, 1, 0, 0, 0, 0, 1, 1, 1, 1]),
    np.array([1]),
)  # fmt: skip
"""Two cubes, one upon the other; the first face is between them."""
CORNERS = np.array([[x, y, z] for z in (0.0, 1.0, 2.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)


def test_the_owner_gains_where_its_face_moves_along_the_normal():
    after = CORNERS.copy()
    after[4:8, 2] += 0.25
    found = Swept.of(SQUARES, CORNERS, after)
    np.testing.assert_allclose(found.faces, [0.25, *np.zeros(10)], atol=1e-16)
    np.testing.assert_allclose(gained(SQUARES, found.faces), [0.25, -0.25], rtol=1e-15)
    np.testing.assert_allclose(found.volumes, [1.25, 0.75])
    assert found.gap < 1e-15


@pytest.mark.parametrize("wrong", ["sign", "sides", "one face", "half"])
def test_a_wrong_sign_or_side_is_a_gap(wrong):
    """The measure itself must notice what it is there for."""
    mesh = body_in("hexahedron")
    cells, one = bounded(mesh).cells, turn(mesh)
    good = Swept.of(cells, mesh.points, one.points)
    faces, sides = good.faces.copy(), cells
    if wrong == "sign":
        faces = -faces
    elif wrong == "sides":
        inner = len(cells.neighbour)
        sides = Polyhedra(cells.faces, np.concatenate([cells.neighbour, cells.owner[inner:]]), cells.owner[:inner])
    elif wrong == "one face":
        faces[np.argmax(np.abs(faces[: len(cells.neighbour)]))] *= -1.0
    else:
        faces *= 0.5
    change = pyramids_of(one.points, cells).volume - pyramids_of(mesh.points, cells).volume
    assert np.abs(gained(sides, faces) - change).max() > 1e6 * np.abs(good.gaps).max() > 0.0


def test_a_face_that_is_carried_along_sweeps_its_area_times_the_way():
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (7, 3))
    faces, way = faces_of([0, 1, 2], [2, 3, 4, 5], [0, 2, 4, 6, 5]), np.array([0.3, -0.2, 0.9])
    _, areas = face_centres_and_areas(points, faces)
    np.testing.assert_allclose(swept_volumes(faces, points, points + way), areas @ way, rtol=1e-13)


def test_a_triangle_sweeps_what_quadrature_says():
    """Volume = integral over the way of the area vector times the mean velocity; three Gauss points are exact."""
    before, after = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 3, 3))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    expected = 0.0
    for t, weight in zip((nodes + 1.0) / 2.0, weights / 2.0, strict=True):
        a, b, c = before + t * (after - before)
        expected += weight * 0.5 * np.cross(b - a, c - a) @ (after - before).mean(axis=0)
    assert swept_volumes(faces_of([0, 1, 2]), before, after)[0] == pytest.approx(expected, rel=1e-13)


def test_the_way_back_sweeps_the_same_to_the_bit():
    mesh = body_in("polyhedron")
    faces, after = bounded(mesh).cells.faces, turn(mesh).points
    there, back = swept_volumes(faces, mesh.points, after), swept_volumes(faces, after, mesh.points)
    np.testing.assert_array_equal(there, -back)


def test_where_nothing_moves_nothing_is_swept_and_no_cell_is_measured():
    mesh = body_in("tetra", 4)
    cells = bounded(mesh).cells
    found = Swept.of(cells, mesh.points, mesh.points)
    assert not found.faces.any()
    assert len(found.rows) == found.gap == found.gap_of_volume == 0
    after = mesh.points.copy()
    after[mesh.on("x+")[0], 0] += 0.1
    assert 0 < len(Swept.of(cells, mesh.points, after).rows) < len(cells)


@pytest.mark.parametrize(("height", "layers"), [(1e-6, 30), (1e-8, 46)])
def test_rounding_alone_is_left_in_layers_a_millionth_of_the_chord_high(height, layers):
    """Their volumes are far smaller than what their faces sweep, and than the cubes of their widths."""
    thin = wing(first_height=height, cells=3, layers=layers)
    plan = Plan.of(thin.mesh, job(("flap_*",), thin.hinge, **blended(thin)), (0.1, 10.0))
    (small, large), cells = in_time(plan, (0.1, 10.0))
    for before, after in ((thin.mesh.points, small), (small, large)):
        found = Swept.of(cells, before, after)
        assert found.gap < CONSERVED
        assert (found.sizes / found.volumes).max() > 100.0
    assert CONSERVED < found.gap_of_volume < 1e-16 / height


def test_in_cells_of_common_shape_the_measure_is_their_volume_and_what_is_swept():
    mesh = body_in("hexahedron")
    cells, after = bounded(mesh).cells, turn(mesh).points
    found = Swept.of(cells, mesh.points, after)
    least = found.volumes + gained(cells, np.abs(found.faces))[found.rows]
    most = found.volumes + np.abs(found.faces).max() * 6
    assert np.all((found.sizes > least) & (found.sizes < 1.001 * most))

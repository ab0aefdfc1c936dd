"""Planes that slide hold their normal direction in the first pass, on the classical test of a block in a square."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.block import PUBLISHED, SIDES, deflected, scores, square, turned
from sdm_deflect import InputError, deflect
from sdm_deflect.deform.around.bound import along, held_directions


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
@pytest.mark.parametrize("slides", [SIDES, ("left", "lower", "upper")])
def test_no_cell_is_inverted_before_a_repair(tilt, slides):
    """Without sites at planes 16 cells are inverted. The figures are the same however the square stands."""
    points = turned(deflected(slides, tilt, repair="off").points, -tilt)
    found, mesh = scores(points), square()
    assert found.inverted == 0
    assert found.least > 0.2 > PUBLISHED[1]
    assert found.mean > 0.68 > PUBLISHED[2]
    for name in slides:
        normal, nodes = 0 if name in ("left", "right") else 1, mesh.on(name)
        assert np.ptp(points[nodes, normal]) < 1e-14, "nodes stay in their planes"
        assert np.abs(points - mesh.points)[nodes, 1 - normal].max() > 1e-3, "and slide"


def test_sides_at_other_angles_hold_one_direction_alone_and_are_refused():
    mesh, slides = square(), [f"{name}:plane" for name in SIDES]
    rhombus = replace(mesh, points=mesh.points + 0.5 * mesh.points[:, [1, 0, 2]] * [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="these are not at right angles, so that nothing would hold the mesh"):
        deflect(rhombus, "block", [0.75, 0.5], 10.0, slide=slides, margin=3.0)
    assert deflect(rhombus, "block", [0.75, 0.5], 10.0, slide=slides[1:], fixed="left").passed


def test_directions_are_normals_of_planes_and_what_is_across_them():
    x, y, z = np.eye(3)
    tilted = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    across = np.array([-np.sin(0.3), np.cos(0.3), 0.0])
    none = np.empty(0, dtype=np.intp)
    assert held_directions(none, [x, -z, y]) is None
    found = held_directions(none, [tilted, z, x])
    np.testing.assert_allclose(found[:2], [tilted, z], atol=1e-16)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-15)
    found = held_directions(np.array([2]), [tilted])
    assert np.array_equal(found[2], z), "a plane mesh keeps its own normal"
    assert [along(found, normal) for normal in (tilted, -tilted, across, z, x)] == [0, 0, 1, 2, None]
    assert along(None, -y) == 1

"""Cells of one block that a file counts in either hand are judged, each by itself, as flow solvers read them."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.cells import MIRRORED, Cells
from sdm_deflect.meshing.mesh.quality import one_hand
from tests.deform.blocks import block_with_body
from tests.deform.jobs import turn

HINGE = [[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]


def half_mirrored(mesh, share=2):
    """The mesh with every `share`-th cell counted in the other hand."""
    (cells,) = mesh.cells
    nodes = cells.nodes.copy()
    nodes[::share] = nodes[::share][:, MIRRORED[cells.shape]]
    return replace(mesh, cells=(Cells(cells.shape, nodes),))


@pytest.mark.parametrize("share", [2, 3, 100])
def test_each_cell_is_judged_in_its_own_hand(share):
    mesh = block_with_body()
    one, other = (turn(each, hinge=HINGE, angle=80.0, repair="auto") for each in (mesh, half_mirrored(mesh, share)))
    np.testing.assert_array_equal(one.points, other.points)
    assert one.quality == other.quality
    assert one.boxes[0].repaired is not None
    assert np.count_nonzero(other.plan.affected.newly_inverted(other.boxes[0].interpolated)) > 0
    assert sum(other.plan.affected.inverted) == 0


def test_a_cell_that_is_good_in_neither_hand_stays():
    mesh = block_with_body()
    points = mesh.points.copy()
    (cells,) = mesh.cells
    points[cells.nodes[0, 6]] = points[cells.nodes[0, 0]] - 0.1
    assert one_hand(points, cells) is cells

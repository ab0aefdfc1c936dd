"""Cells whose file counts their nodes the other way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sdm_deflect.deform.mesh import Cells
from sdm_deflect.meshing.mesh import FloatArray, IntArray

MIRRORED = {
    "tetra": (0, 2, 1, 3), "pyramid": (0, 3, 2, 1, 4), "wedge": (0, 2, 1, 3, 5, 4),
    "hexahedron": (0, 3, 2, 1, 4, 7, 6, 5),
}  # fmt: skip
"""The same corners in the order of the mirror image. For a wedge: from CGNS and Gmsh to VTK, and back."""
AXES = {"tetra": (1, 2, 3), "pyramid": (1, 3, 4), "wedge": (2, 1, 3), "hexahedron": (1, 3, 4)}
"""Corners whose edges from corner 0 are a right-handed system in a cell that is not inverted."""
SAMPLE = 1 << 16


def oriented(points: FloatArray, cells: Cells) -> Cells:
    """Return the cells in VTK's order, whichever of the two orders the file used for the block.

    Formats that say "VTK's order" are written with wedges (and sometimes all cells) of either hand, and solvers turn
    them as they read. A block is turned as a whole, where most of its cells are left-handed: single inverted cells
    stay inverted.

    Parameters
    ----------
    points
        (N, 3) coordinates.
    cells
        Volume cells of one shape.
    """
    step = max(1, len(cells) // SAMPLE)
    sample = cells.nodes[::step]
    hands = _handedness(points, sample, AXES[cells.shape])
    if 2 * int(np.count_nonzero(hands < 0.0)) <= len(sample):
        return cells
    return replace(cells, nodes=mirrored(cells.shape, cells.nodes))


def mirrored(shape: str, nodes: IntArray) -> IntArray:
    """Return nodes (M, k) of volume cells in the order of their mirror images."""
    turned: IntArray = nodes[:, list(MIRRORED[shape])]
    return turned


def _handedness(points: FloatArray, nodes: IntArray, axes: tuple[int, ...]) -> FloatArray:
    """Triple product (M,) of the edges from corner 0 to `axes`, in cubed length."""
    origin = points[nodes[:, 0]]
    a, b, c = (points[nodes[:, axis]] - origin for axis in axes)
    product: FloatArray = np.einsum("ij,ij->i", np.cross(a, b), c)
    return product

"""Shape quality and inversion of cells of every type; the whole program uses these measures alone.

Tetrahedra have the paper's mean ratio; pyramids, wedges and hexahedra VTK's scaled Jacobian. Plane triangles have their
mean ratio, plane quads VTK's scaled Jacobian. Cells given by their faces are judged by their type, too.

Other polyhedra have a part of Ansys Fluent's orthogonal quality (Ansys Meshing User's Guide, Orthogonal Quality): the
smallest cosine between a face's normal and the line from the cell's centre to the face's. Fluent's also takes the lines
to the centres of neighbouring cells.

A tetrahedron is inverted if its signed volume is not positive. Another cell of fixed shape is inverted if the
determinant of its edges at some corner is not positive. A cell given by its faces is inverted if OpenFOAM's checkMesh
says so: such meshes have hexahedra with an inverted corner, and solvers accept them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError

from . import compiled_quality, polyhedra
from .cells import MIRRORED, VOLUMES, Cells, Polyhedra, Volume
from .standard import POLYHEDRON, parts_of

# Quality measure of each type of cell.
MEASURES = {
    "triangle": "mean ratio",
    "quad": "scaled Jacobian",
    "tetra": "mean ratio",
    "pyramid": "scaled Jacobian",
    "wedge": "scaled Jacobian",
    "hexahedron": "scaled Jacobian",
    POLYHEDRON: "orthogonal quality",
}
# Types of cells as a reader calls many of them.
PLURALS = {
    "triangle": "triangles",
    "quad": "quadrilaterals",
    "tetra": "tetrahedra",
    "pyramid": "pyramids",
    "wedge": "prisms",
    "hexahedron": "hexahedra",
    POLYHEDRON: "polyhedra",
}
# Limits of checkMesh: degrees above which a face is severely non-orthogonal; skewness that is an error.
SEVERE, SKEW = 70.0, 4.0


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the signed volume (M,) of tetrahedra (M, 4), in the unit of length cubed; negative if inverted."""
    return compiled_quality.signed_volumes(points, tets)


def mean_ratio(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the mean ratio (M,) of tetrahedra (M, 4): 1 for the regular one, 0 for flat and inverted ones.

    Q = 12 (9 V^2)^(1/3) / (sum of the squared lengths of the six edges), the paper's footnote x.
    """
    return quality_and_inverted(points, Cells("tetra", tets))[0]


def quality_of(points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0) -> FloatArray:
    """Return the quality (R,) of the cells of a block, or of R rows of it, by their measure in `MEASURES`.

    Parameters
    ----------
    points : (N, 3) node coordinates.
    orientation
        -1 for cells with left-handed nodes, else 1.

    Notes
    -----
    The scaled Jacobian is the least determinant of the edges' directions at a cell's corners, over the ideal cell's.
    VTK adds the axes of a hexahedron, takes all corners of the tetrahedra between a pyramid's base and tip, and sets
    inverted pyramids to 0. A cell with an edge of zero length has 0 (in VTK 1e30).
    """
    return quality_and_inverted(points, block, rows, orientation)[0]


def inverted_of(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> NDArray[np.bool_]:
    """Return which cells (R,) of a block, or of R rows of it, are inverted; parameters as for `quality_of`."""
    if isinstance(block, Polyhedra):
        return polyhedra.pyramids_of(points, block, rows, orientation).inverted
    return compiled_quality.inverted_of(points, block, rows, orientation)


def quality_and_inverted(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return `quality_of` (R,) and `inverted_of` (R,) in one pass."""
    if isinstance(block, Polyhedra):
        pyramids = polyhedra.pyramids_of(points, block, rows, orientation)
        quality = pyramids.orthogonality
        for _, cells, cell_rows, at in parts_of(block, rows):
            if isinstance(cells, Cells):
                quality[at] = compiled_quality.quality_and_inverted(points, cells, cell_rows, orientation)[0]
        return quality, pyramids.inverted
    return compiled_quality.quality_and_inverted(points, block, rows, orientation)


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of the cells of one type.

    Attributes
    ----------
    shape : ``"tetra"``, ``"pyramid"``, ``"wedge"``, ``"hexahedron"``, ``"triangle"``, ``"quad"`` or ``"polyhedron"``.
    measure : quality measure, a value of `MEASURES`.
    cells : number of cells.
    min, p01, mean : least quality, quality that 99 % of the cells exceed, mean quality.
    below_0_2, below_0_4 : shares of the cells with a quality below 0.2 and 0.4.
    inverted : number of inverted cells.
    """

    shape: str
    measure: str
    cells: int
    min: float
    p01: float
    mean: float
    below_0_2: float
    below_0_4: float
    inverted: int


def summarise(values: FloatArray, shape: str = "tetra", inverted: int | None = None) -> Quality:
    """Summarise the quality (M,) of cells of one shape; unless given, cells not above 0 count as inverted.

    Raises ValueError if there are no cells.
    """
    if not len(values):
        raise ValueError("no cells to judge")
    return Quality(
        shape=shape,
        measure=MEASURES[shape],
        cells=len(values),
        min=float(values.min()),
        p01=float(np.percentile(values, 1.0)),
        mean=float(values.mean()),
        below_0_2=float(np.mean(values < 0.2)),
        below_0_4=float(np.mean(values < 0.4)),
        inverted=int(np.count_nonzero(values <= 0.0)) if inverted is None else inverted,
    )


def find_orientation(points: FloatArray, block: Volume) -> tuple[float, int]:
    """Return a block's orientation, -1 if most cells have left-handed nodes, and its number of inverted cells."""
    bad = np.count_nonzero(inverted_of(points, block))
    if 2 * bad <= len(block):
        return 1.0, int(bad)
    mirrored = np.count_nonzero(inverted_of(points, block, orientation=-1.0))
    return (-1.0, int(mirrored)) if mirrored < bad else (1.0, int(bad))


def other_handed(points: FloatArray, block: Volume, orientation: float) -> IntArray:
    """Return the rows (R,) of cells that are good but for the handedness of their nodes, opposite to the block's.

    An inverted tetrahedron is not among them: it is its own mirror image.
    """
    if isinstance(block, Polyhedra) or block.shape not in VOLUMES[1:]:
        return np.empty(0, dtype=np.intp)
    bad = np.flatnonzero(inverted_of(points, block, orientation=orientation))
    return bad[~inverted_of(points, block, bad, -orientation)] if len(bad) else bad


def one_hand(points: FloatArray, block: Volume) -> Volume:
    """Return the block with all cells in the handedness of most, as flow solvers read them."""
    if isinstance(block, Polyhedra) or block.shape not in VOLUMES[1:]:
        return block
    rows = other_handed(points, block, find_orientation(points, block)[0])
    return replace(block, nodes=other_hand(block, rows)) if len(rows) else block


def other_hand(block: Cells, rows: IntArray) -> IntArray:
    """Return the nodes (M, k) of a block with the handedness of some cells (R,) reversed."""
    nodes = block.nodes.copy()
    nodes[rows] = nodes[rows][:, MIRRORED[block.shape]]
    return nodes


def check_most(name: str, inverted: int, cells: int) -> None:
    """Raise InputError if more than half of the cells are inverted, as `find_orientation` counts: the mesh was misread.

    Left-handed blocks are no error: their cells are judged in that order.
    """
    if 2 * inverted > cells:
        raise InputError(
            f"{name}: more than half of the cells ({inverted} of {cells}) are inverted or flat: the file is damaged "
            "or not read right; export it from the mesher as CGNS or SU2"
        )


def by_shape(points: FloatArray, parts: Iterable[tuple[Volume, IntArray | None, float]]) -> tuple[Quality, ...]:
    """Return the quality of each type of cell, given blocks, their rows (None: all) and their orientation."""
    values: dict[str, list[FloatArray]] = {}
    inverted: dict[str, int] = {}
    for block, rows, orientation in parts:
        if not len(block if rows is None else rows):
            continue
        value, bad = quality_and_inverted(points, block, rows, orientation)
        for shape, _, _, typed in parts_of(block, rows):
            values.setdefault(shape, []).append(value[typed])
            inverted[shape] = inverted.get(shape, 0) + int(np.count_nonzero(bad[typed]))
    return tuple(summarise(_join(values[shape]), shape, inverted[shape]) for shape in values)


def _join(parts: list[FloatArray]) -> FloatArray:
    """Join arrays; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)

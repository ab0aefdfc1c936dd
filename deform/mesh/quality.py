"""Shape quality of cells of every type, and which of them are inverted: the one measure of the whole program.

Tetrahedra have the paper's mean ratio; pyramids, wedges and hexahedra the scaled Jacobian of VTK. Of plane cells,
triangles have their mean ratio and quads VTK's scaled Jacobian. Cells that a file gives by their faces are judged by
their types, too. Those of no type have the cell's own half of the orthogonal quality of Ansys Fluent: the smallest
cosine between the normal of a face and the line from the cell's centre to the face's. (Ansys Meshing User's Guide,
Orthogonal Quality: the smallest of these and of those with the lines to the centres of the cells around.)

A tetrahedron is inverted if its signed volume is not positive, another cell of fixed shape if the determinant of its
edges at some corner is not, a cell given by its faces if OpenFOAM's checkMesh says so: such meshes have hexahedra with
a corner that is not, and solvers take them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError

from . import compiled_quality, polyhedra
from .cells import MIRRORED, VOLUMES, Cells, Polyhedra, Volume
from .standard import POLYHEDRON, parts_of

MEASURES = {
    "triangle": "mean ratio",
    "quad": "scaled Jacobian",
    "tetra": "mean ratio",
    "pyramid": "scaled Jacobian",
    "wedge": "scaled Jacobian",
    "hexahedron": "scaled Jacobian",
    POLYHEDRON: "orthogonal quality",
}
"""What the quality of each type of cell is."""
SEVERE, SKEW = 70.0, 4.0
"""checkMesh counts faces of a larger non-orthogonality (degrees), and finds fault with faces of a larger skewness."""


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume (M,) of tetrahedra (M, 4), in the unit of length cubed; negative where they are inverted."""
    return compiled_quality.signed_volumes(points, tets)


def mean_ratio(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the mean ratio (M,) of tetrahedra (M, 4): 1 for the regular one, 0 for flat and inverted ones.

    Q = 12 (9 V^2)^(1/3) / (sum of the squared lengths of the six edges), the paper's footnote x.
    """
    return quality_and_inverted(points, Cells("tetra", tets))[0]


def quality_of(points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0) -> FloatArray:
    """Return the quality (R,) of the cells of a block, or of R rows of them, by the measure of `MEASURES`.

    Parameters
    ----------
    points : (N, 3) node coordinates.
    orientation
        -1 for cells whose nodes are counted left-handed, else 1.

    Notes
    -----
    The scaled Jacobian is the smallest over a cell's corners of the determinant of the edges' directions, divided by
    that of the ideal cell. VTK adds the axes of a hexahedron, takes the corners of all tetrahedra that a pyramid's
    nodes form with its tip, and sets inverted pyramids to 0. A cell with an edge of no length has 0 (in VTK 1e30).
    """
    return quality_and_inverted(points, block, rows, orientation)[0]


def inverted_of(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> NDArray[np.bool_]:
    """Return which cells (R,) of a block, or of R rows of them, are inverted; parameters as in `quality_of`."""
    if isinstance(block, Polyhedra):
        return polyhedra.pyramids_of(points, block, rows, orientation).inverted
    return compiled_quality.inverted_of(points, block, rows, orientation)


def quality_and_inverted(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return `quality_of` (R,) and `inverted_of` (R,) at once."""
    if isinstance(block, Polyhedra):
        pyramids = polyhedra.pyramids_of(points, block, rows, orientation)
        quality = pyramids.orthogonality
        for _, cells, own, at in parts_of(block, rows):
            if isinstance(cells, Cells):
                quality[at] = compiled_quality.quality_and_inverted(points, cells, own, orientation)[0]
        return quality, pyramids.inverted
    return compiled_quality.quality_and_inverted(points, block, rows, orientation)


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of the cells of one type.

    Attributes
    ----------
    shape : ``"tetra"``, ``"pyramid"``, ``"wedge"``, ``"hexahedron"``, ``"triangle"``, ``"quad"`` or ``"polyhedron"``.
    measure : what the figures are, a value of `MEASURES`.
    cells : number of cells.
    min, p01, mean : smallest value, the one that 99 % of the cells exceed, average.
    below_0_2, below_0_4 : shares of these cells with a quality below 0.2 and 0.4.
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
    """Condense the quality (M,) of cells of one shape; unless told, those not above 0 count as inverted.

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


def oriented(points: FloatArray, block: Volume) -> tuple[float, int]:
    """Return the orientation of a block, -1 if its nodes are counted left-handed, and how many cells are inverted."""
    bad = np.count_nonzero(inverted_of(points, block))
    if 2 * bad <= len(block):
        return 1.0, int(bad)
    mirrored = np.count_nonzero(inverted_of(points, block, orientation=-1.0))
    return (-1.0, int(mirrored)) if mirrored < bad else (1.0, int(bad))


def other_handed(points: FloatArray, block: Volume, orientation: float) -> IntArray:
    """Return the rows (R,) of cells that are counted in the other hand than the block, and good so.

    Tetrahedra are none of these: one that is inverted is its own mirror image.
    """
    if isinstance(block, Polyhedra) or block.shape not in VOLUMES[1:]:
        return np.empty(0, dtype=np.intp)
    bad = np.flatnonzero(inverted_of(points, block, orientation=orientation))
    return bad[~inverted_of(points, block, bad, -orientation)] if len(bad) else bad


def one_hand(points: FloatArray, block: Volume) -> Volume:
    """Return a block whose cells are all counted in the hand of most of them, as flow solvers do when they read it."""
    if isinstance(block, Polyhedra) or block.shape not in VOLUMES[1:]:
        return block
    rows = other_handed(points, block, oriented(points, block)[0])
    return replace(block, nodes=other_hand(block, rows)) if len(rows) else block


def other_hand(block: Cells, rows: IntArray) -> IntArray:
    """Return the nodes (M, k) of a block with some cells (R,) counted in the other hand."""
    nodes = block.nodes.copy()
    nodes[rows] = nodes[rows][:, MIRRORED[block.shape]]
    return nodes


def check_most(name: str, inverted: int, cells: int) -> None:
    """Raise InputError if more than half of a mesh's cells are inverted, counted by `oriented`: it was not read right.

    Blocks whose nodes a file counts left-handed are none of these: they are judged by the order that suits them.
    """
    if 2 * inverted > cells:
        raise InputError(
            f"{name}: more than half of the cells ({inverted} of {cells}) are inverted or flat: the file is damaged "
            "or not read right; export it from the mesher as CGNS or SU2"
        )


def by_shape(points: FloatArray, parts: Iterable[tuple[Volume, IntArray | None, float]]) -> tuple[Quality, ...]:
    """Return the quality of blocks, one for each type of cell; of each block some rows, or all, and its orientation."""
    values: dict[str, list[FloatArray]] = {}
    inverted: dict[str, int] = {}
    for block, rows, orientation in parts:
        if not len(block if rows is None else rows):
            continue
        value, bad = quality_and_inverted(points, block, rows, orientation)
        for shape, _, _, own in parts_of(block, rows):
            values.setdefault(shape, []).append(value[own])
            inverted[shape] = inverted.get(shape, 0) + int(np.count_nonzero(bad[own]))
    return tuple(summarise(_joined(values[shape]), shape, inverted[shape]) for shape in values)


def _joined(parts: list[FloatArray]) -> FloatArray:
    """Return arrays as one, without a copy if it is one already."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)

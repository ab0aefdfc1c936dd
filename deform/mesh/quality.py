"""Shape quality of cells of every type, and which of them are inverted: the one measure of the whole program.

Tetrahedra have the paper's mean ratio; pyramids, wedges and hexahedra the scaled Jacobian of VTK; polyhedra their
smallest face pyramid over their volume. Of plane cells, triangles have their mean ratio and quads VTK's scaled
Jacobian. A tetrahedron is inverted if its signed volume is not positive, another cell of fixed shape if the determinant
of its edges at some corner is not, a polyhedron if OpenFOAM's checkMesh says so.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh import polyhedra
from sdm_deflect.deform.mesh.edges import rows_of
from sdm_deflect.deform.mesh.mesh import VOLUMES, Cells, Polyhedra, Volume

BLOCK = 1 << 13
"""Cells handled at a time: temporaries stay in the processor's cache, and millions of cells in little memory."""
MANY = 1 << 18
"""Volume cells of one shape beyond so many are judged by compiled code, to the same bits."""
POLYHEDRON = "polyhedron"
MEASURES = {
    "triangle": "mean ratio",
    "quad": "scaled Jacobian",
    "tetra": "mean ratio",
    "pyramid": "scaled Jacobian",
    "wedge": "scaled Jacobian",
    "hexahedron": "scaled Jacobian",
    POLYHEDRON: "smallest face pyramid over volume",
}
"""What the quality of each type of cell is."""
CORNERS = {
    "triangle": ((0, 1, 2, 0),),
    "quad": ((0, 1, 3, 0), (1, 2, 0, 1), (2, 3, 1, 2), (3, 0, 2, 3)),
    "tetra": ((0, 1, 2, 3),),
    "pyramid": ((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
    "wedge": ((0, 2, 1, 3), (1, 0, 2, 4), (2, 1, 0, 5), (3, 4, 5, 0), (4, 5, 3, 1), (5, 3, 4, 2)),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7), (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
}  # fmt: skip
"""A corner and the three others at its edges, right-handed, in VTK's order of nodes (one corner of a tetrahedron
stands for all; a pyramid's are those of its base). Of a plane cell the third edge is the unit vector along z, and the
corner itself stands for its end."""
NORMAL = np.array([[0.0], [0.0], [1.0]])
"""The third edge at a corner of a plane cell, (3, 1)."""
AXES = ((0, 3, 7, 4), (1, 2, 6, 5)), ((0, 1, 5, 4), (3, 2, 6, 7)), ((0, 1, 2, 3), (4, 5, 6, 7))
"""Opposite faces of a hexahedron, whose centres its three axes join."""
TETRAHEDRA = (0, 1, 2, 4), (0, 2, 3, 4), (0, 1, 3, 4), (1, 2, 3, 4)
"""Those that a pyramid's nodes form with its tip."""
WEDGE = 2.0 / np.sqrt(3.0)
"""One over the determinant of the edges' directions at a corner of the ideal wedge."""
TINY = np.finfo(np.float64).tiny

Corners = FloatArray
"""Corners of R cells as (k, 3, R): coordinates of one corner stand one after another."""


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume (M,) of tetrahedra (M, 4), in the unit of length cubed; negative where they are inverted."""
    return np.asarray(_blockwise(points, tets, None, lambda p: _determinants("tetra", p, 1.0))[0] / 6.0)


def mean_ratio(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the mean ratio (M,) of tetrahedra (M, 4): 1 for the regular one, 0 for flat and inverted ones.

    Q = 12 (9 V^2)^(1/3) / (sum of the squared lengths of the six edges), the paper's footnote x.
    """
    return np.asarray(_blockwise(points, tets, None, lambda p: _mean_ratio(p, 1.0))[0])


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
    return judged(points, block, rows, orientation)[0]


def inverted_of(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> NDArray[np.bool_]:
    """Return which cells (R,) of a block, or of R rows of them, are inverted; parameters as in `quality_of`."""
    if isinstance(block, Polyhedra):
        return polyhedra.pyramids_of(points, block, rows, orientation).inverted
    if _are_many(block, rows):
        from sdm_deflect.deform.mesh import compiled_quality  # loads the compiler

        return compiled_quality.inverted_of(points, block, rows, orientation)
    shape = block.shape
    return np.asarray(_blockwise(points, block.nodes, rows, lambda p: _determinants(shape, p, orientation))[0] <= 0.0)


def judged(
    points: FloatArray, block: Volume, rows: IntArray | None = None, orientation: float = 1.0
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return `quality_of` (R,) and `inverted_of` (R,) at once."""
    if isinstance(block, Polyhedra):
        pyramids = polyhedra.pyramids_of(points, block, rows, orientation)
        return pyramids.quality, pyramids.inverted
    if _are_many(block, rows):
        from sdm_deflect.deform.mesh import compiled_quality  # loads the compiler

        return compiled_quality.judged(points, block, rows, orientation)
    measure = JUDGES[block.shape]
    quality, determinant = _blockwise(points, block.nodes, rows, lambda p: measure(p, orientation))
    return quality, determinant <= 0.0


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
        shape = POLYHEDRON if isinstance(block, Polyhedra) else block.shape
        value, bad = judged(points, block, rows, orientation)
        values.setdefault(shape, []).append(value)
        inverted[shape] = inverted.get(shape, 0) + int(np.count_nonzero(bad))
    return tuple(summarise(_joined(values[shape]), shape, inverted[shape]) for shape in values)


def _joined(parts: list[FloatArray]) -> FloatArray:
    """Return arrays as one, without a copy if it is one already."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _are_many(block: Cells, rows: IntArray | None) -> bool:
    """True for so many volume cells that compiled code is worth its loading."""
    return block.shape in VOLUMES and len(block if rows is None else rows) > MANY


def _blockwise(
    points: FloatArray, nodes: IntArray, rows: IntArray | None, measure: Callable[[Corners], FloatArray]
) -> FloatArray:
    """Return m measures (m, R) of the cells with nodes (M, k), or of R rows of them."""
    count = len(nodes) if rows is None else len(rows)
    parts = []
    for part in rows_of(max(count, 1), BLOCK):
        corners = points[nodes[part if rows is None else rows[part]]]
        parts.append(measure(np.ascontiguousarray(corners.transpose(1, 2, 0))))
    return np.concatenate(parts, axis=1)


def _determinants(shape: str, p: Corners, orientation: float) -> FloatArray:
    """Return the smallest determinant (1, R) of three edges over the corners of each cell."""
    least = np.full(p.shape[2], np.inf)
    for corner in CORNERS[shape]:
        np.minimum(least, orientation * _determinant(*_edges(p, *corner)), out=least)
    return least[None]


def _edges(p: Corners, o: int, a: int, b: int, c: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the three edges (3, R) at a corner, as `CORNERS` has them."""
    return p[a] - p[o], p[b] - p[o], NORMAL if c == o else p[c] - p[o]


def _triangle(p: Corners, orientation: float) -> FloatArray:
    """Return the mean ratio 4 sqrt(3) A / (sum of the squared lengths of the edges), and 2 A, (2, R) of triangles.

    As that of tetrahedra it is 1 for the regular one, and 0 for flat and inverted ones.
    """
    determinant = orientation * _determinant(*_edges(p, 0, 1, 2, 0))
    squares = sum(_square(p[i] - p[j]) for i, j in ((1, 0), (2, 1), (0, 2)))
    return np.stack([2.0 * np.sqrt(3.0) * np.maximum(determinant, 0.0) / np.maximum(squares, TINY), determinant])


def _mean_ratio(p: Corners, orientation: float) -> FloatArray:
    """Return the mean ratio and the determinant (2, R) of tetrahedra."""
    a, b, c = p[1] - p[0], p[2] - p[0], p[3] - p[0]
    determinant = orientation * _determinant(a, b, c)
    squares = sum(_square(edge) for edge in (a, b, c, b - a, c - a, c - b))
    return np.stack([ratio(determinant, np.asarray(squares)), determinant])


def ratio(determinant: FloatArray, squares: FloatArray) -> FloatArray:
    """Return the mean ratio (R,), given determinants and the sums of the edges' squares (R,)."""
    return np.asarray(12.0 * np.cbrt(0.25 * np.maximum(determinant, 0.0) ** 2) / np.maximum(squares, TINY))


def _pyramid(p: Corners, orientation: float) -> FloatArray:
    """Return VTK's scaled Jacobian and the smallest determinant (2, R) of pyramids."""
    least, determinant = np.full((2, p.shape[2]), np.inf)
    for corners in TETRAHEDRA:
        o, a, b, c = (p[k] for k in corners)
        volume = orientation * _determinant(a - o, b - o, c - o)
        oa, ob, oc, ab, ac, bc = (_square(edge) for edge in (a - o, b - o, c - o, b - a, c - a, c - b))
        largest = np.maximum.reduce([oa * ob * oc, oa * ab * ac, ob * ab * bc, oc * ac * bc])
        np.minimum(least, 2.0 * volume / np.sqrt(np.maximum(largest, TINY)), out=least)
        np.minimum(determinant, volume, out=determinant)
    return np.stack([folded(least), determinant])


def folded(least: FloatArray) -> FloatArray:
    """Return VTK's scaled Jacobian (R,) of pyramids, given the smallest of their tetrahedra (R,)."""
    return np.asarray(np.maximum(np.where(least > 1.0, 2.0 - least, least), 0.0))


def _wedge(p: Corners, orientation: float) -> FloatArray:
    """Return the scaled Jacobian and the smallest determinant (2, R) of wedges."""
    found = _smallest("wedge", p, orientation)
    found[0] *= WEDGE
    return found


def _hexahedron(p: Corners, orientation: float) -> FloatArray:
    """Return VTK's scaled Jacobian and the smallest determinant (2, R) of hexahedra."""
    found = _smallest("hexahedron", p, orientation)
    axes = [p[list(end)].sum(axis=0) - p[list(start)].sum(axis=0) for start, end in AXES]
    np.minimum(found[0], orientation * _determinant(*axes) / _lengths(*axes), out=found[0])
    return found


def _smallest(shape: str, p: Corners, orientation: float) -> FloatArray:
    """Return the smallest determinant over the edges' lengths, and the smallest determinant (2, R), of all corners."""
    found = np.full((2, p.shape[2]), np.inf)
    for corner in CORNERS[shape]:
        edges = _edges(p, *corner)
        determinant = orientation * _determinant(*edges)
        np.minimum(found[0], determinant / _lengths(*edges), out=found[0])
        np.minimum(found[1], determinant, out=found[1])
    return found


def _determinant(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the determinants (R,) of edges (3, R)."""
    return np.asarray(
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _lengths(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the products (R,) of the lengths of edges (3, R), never 0."""
    return np.asarray(np.sqrt(np.maximum(_square(a) * _square(b) * _square(c), TINY)))


def _square(edge: FloatArray) -> FloatArray:
    return np.asarray(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])


def _quad(p: Corners, orientation: float) -> FloatArray:
    """Return VTK's scaled Jacobian and the smallest determinant (2, R) of quads."""
    return _smallest("quad", p, orientation)


JUDGES: dict[str, Callable[[Corners, float], FloatArray]] = {
    "triangle": _triangle,
    "quad": _quad,
    "tetra": _mean_ratio,
    "pyramid": _pyramid,
    "wedge": _wedge,
    "hexahedron": _hexahedron,
}
"""Quality and smallest determinant (2, R) of cells, given their corners and orientation."""

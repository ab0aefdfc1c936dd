"""Quality and inversion of cells of fixed shape: the compiled formulas of `quality`.

Volume cells are judged `LANES` at a time. The same coordinate of their corners is stored side by side, so that one
instruction works on several cells.
"""

from collections.abc import Callable

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.threads import in_chunks

from .cells import PLANE, Cells
from .edges import rows_of

# Cells in one block, whose temporaries stay in the processor's cache.
BLOCK = 1 << 13
# Cells judged at a time: the corners of so many hexahedra take 12 kB.
LANES = 64
# Work on one cell in kernel pairs, by which `in_chunks` divides it.
WEIGHT = 100
# A corner and the ends of its three edges, right-handed, in VTK's order of nodes. One corner stands for all of a
# tetrahedron; a pyramid has those of its base. The third edge of a plane cell is the unit vector along z, whose end is
# written as the corner itself.
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
# Opposite faces of a hexahedron; its axes join their centres.
AXES = ((0, 3, 7, 4), (1, 2, 6, 5)), ((0, 1, 5, 4), (3, 2, 6, 7)), ((0, 1, 2, 3), (4, 5, 6, 7))
# Tetrahedra of a pyramid's nodes with its tip.
TETRAHEDRA = (0, 1, 2, 4), (0, 2, 3, 4), (0, 1, 3, 4), (1, 2, 3, 4)
# Inverse of the determinant of the edges' directions at a corner of the ideal wedge.
WEDGE = 2.0 / np.sqrt(3.0)
TINY = np.finfo(np.float64).tiny

Vector = tuple[float, float, float]
Measure = Callable[[FloatArray, IntArray, float, FloatArray, BoolArray], None]


def inverted_of(points: FloatArray, block: Cells, rows: IntArray | None, orientation: float) -> BoolArray:
    """Return which cells (R,) of a block, or of R rows of them, are inverted."""
    if block.shape in PLANE:
        return quality_and_inverted(points, block, rows, orientation)[1]
    corners = np.array(CORNERS[block.shape])
    inverted = np.empty(len(block if rows is None else rows), dtype=np.bool_)

    def judge(nodes: IntArray, part: slice) -> None:
        _find_inverted(points, nodes, orientation, corners, inverted[part])

    _share_out(judge, block.nodes, rows)
    return inverted


def quality_and_inverted(
    points: FloatArray, block: Cells, rows: IntArray | None, orientation: float
) -> tuple[FloatArray, BoolArray]:
    """Return the quality (R,) of the cells of a block, or of R rows of them, and which are inverted."""
    quality = np.empty(len(block if rows is None else rows))
    inverted = np.empty(len(quality), dtype=np.bool_)
    measure = MEASURES[block.shape]

    def judge(nodes: IntArray, part: slice) -> None:
        measure(points, nodes, orientation, quality[part], inverted[part])

    _share_out(judge, block.nodes, rows)
    return quality, inverted


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Return the volume (M,) of tetrahedra (M, 4), in the unit of length cubed; negative where they are inverted."""
    determinants, squares = np.empty((2, len(tets)))

    def measure(nodes: IntArray, part: slice) -> None:
        _measure_edges(points, nodes, determinants[part], squares[part])

    _share_out(measure, tets, None)
    return np.asarray(determinants / 6.0)


def _share_out(judge: Callable[[IntArray, slice], None], nodes: IntArray, rows: IntArray | None) -> None:
    """Call judge(nodes, part) for short slices of cells (M, k), or of R rows of them, on all threads."""
    count = len(nodes if rows is None else rows)

    def chunk(start: int, stop: int) -> None:
        for short in rows_of(stop - start, BLOCK):
            part = slice(start + short.start, min(start + short.stop, stop))
            corners = nodes[part] if rows is None else nodes.take(rows[part], axis=0)
            judge(np.ascontiguousarray(corners, dtype=np.intp), part)

    in_chunks(chunk, count, WEIGHT)


def _triangle(
    points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray
) -> None:
    """Fill in the mean ratio of triangles, 4 sqrt(3) A / (sum of the squared lengths of the edges); 1 at most."""
    determinants, squares = np.empty((2, len(nodes)))
    _measure_triangles(points, nodes, determinants, squares)
    determinants *= orientation
    quality[:] = 2.0 * np.sqrt(3.0) * np.maximum(determinants, 0.0) / np.maximum(squares, TINY)
    inverted[:] = determinants <= 0.0


def _tetra(points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray) -> None:
    determinants, squares = np.empty((2, len(nodes)))
    _measure_edges(points, nodes, determinants, squares)
    determinants *= orientation
    quality[:] = 12.0 * np.cbrt(0.25 * np.maximum(determinants, 0.0) ** 2) / np.maximum(squares, TINY)
    inverted[:] = determinants <= 0.0


def _pyramid(points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray) -> None:
    """Fill in VTK's scaled Jacobian of pyramids, from the smallest of their tetrahedra."""
    _judge_tetrahedra(points, nodes, orientation, np.array(TETRAHEDRA), quality, inverted)
    quality[:] = np.maximum(np.where(quality > 1.0, 2.0 - quality, quality), 0.0)


def _wedge(points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray) -> None:
    axes = np.empty((0, 2, 4), dtype=np.intp)
    _judge_corners(points, nodes, orientation, np.array(CORNERS["wedge"]), axes, quality, inverted)
    quality *= WEDGE


def _hexahedron(
    points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray
) -> None:
    corners, axes = np.array(CORNERS["hexahedron"]), np.array(AXES)
    _judge_corners(points, nodes, orientation, corners, axes, quality, inverted)


@compiled_exactly
def _find_inverted(
    points: FloatArray, nodes: IntArray, orientation: float, corners: IntArray, inverted: BoolArray
) -> None:  # pragma: no cover - machine code
    """Find the cells (R,) with a corner where the determinant of three edges is not positive."""
    p, least = np.empty((nodes.shape[1], 3, LANES)), np.empty(LANES)
    for start in range(0, len(nodes), LANES):
        few = nodes[start : start + LANES]
        _gather(points, few, p)
        least[:] = np.inf
        for k in range(len(corners)):
            o, a, b, c = corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3]
            for j in range(len(few)):
                determinant = orientation * _determinant(_edge(p, o, a, j), _edge(p, o, b, j), _edge(p, o, c, j))
                least[j] = np.minimum(least[j], determinant)
        for j in range(len(few)):
            inverted[start + j] = least[j] <= 0.0


@compiled_exactly
def _judge_corners(
    points: FloatArray,
    nodes: IntArray,
    orientation: float,
    corners: IntArray,
    axes: IntArray,
    quality: FloatArray,
    inverted: BoolArray,
) -> None:  # pragma: no cover - machine code
    """Fill in cells' smallest ratio of determinant to edge lengths, at corners and axes, and which are inverted."""
    p, ways = np.empty((nodes.shape[1], 3, LANES)), np.empty((3, 3, LANES))
    share, least = np.empty(LANES), np.empty(LANES)
    for start in range(0, len(nodes), LANES):
        few = nodes[start : start + LANES]
        _gather(points, few, p)
        share[:] = least[:] = np.inf
        for k in range(len(corners)):
            o, a, b, c = corners[k, 0], corners[k, 1], corners[k, 2], corners[k, 3]
            for j in range(len(few)):
                u, v, w = _edge(p, o, a, j), _edge(p, o, b, j), _edge(p, o, c, j)
                determinant = orientation * _determinant(u, v, w)
                share[j] = np.minimum(share[j], determinant / _lengths(u, v, w))
                least[j] = np.minimum(least[j], determinant)
        if len(axes):
            _join(p, axes, ways)
            for j in range(len(few)):
                u, v, w = _vector(ways, 0, j), _vector(ways, 1, j), _vector(ways, 2, j)
                share[j] = np.minimum(share[j], orientation * _determinant(u, v, w) / _lengths(u, v, w))
        for j in range(len(few)):
            quality[start + j], inverted[start + j] = share[j], least[j] <= 0.0


@compiled_exactly
def _judge_tetrahedra(
    points: FloatArray,
    nodes: IntArray,
    orientation: float,
    tetrahedra: IntArray,
    quality: FloatArray,
    inverted: BoolArray,
) -> None:  # pragma: no cover - machine code
    """Fill in the smallest scaled Jacobian over tetrahedra of a cell's nodes, and whether one is inverted."""
    p, share, least = np.empty((nodes.shape[1], 3, LANES)), np.empty(LANES), np.empty(LANES)
    for start in range(0, len(nodes), LANES):
        few = nodes[start : start + LANES]
        _gather(points, few, p)
        share[:] = least[:] = np.inf
        for k in range(len(tetrahedra)):
            o, a, b, c = tetrahedra[k, 0], tetrahedra[k, 1], tetrahedra[k, 2], tetrahedra[k, 3]
            for j in range(len(few)):
                u, v, w = _edge(p, o, a, j), _edge(p, o, b, j), _edge(p, o, c, j)
                determinant = orientation * _determinant(u, v, w)
                oa, ob, oc = _square(u), _square(v), _square(w)
                ab, ac, bc = _square(_edge(p, a, b, j)), _square(_edge(p, a, c, j)), _square(_edge(p, b, c, j))
                largest = np.maximum(np.maximum(oa * ob * oc, oa * ab * ac), np.maximum(ob * ab * bc, oc * ac * bc))
                share[j] = np.minimum(share[j], 2.0 * determinant / np.sqrt(np.maximum(largest, TINY)))
                least[j] = np.minimum(least[j], determinant)
        for j in range(len(few)):
            quality[start + j], inverted[start + j] = share[j], least[j] <= 0.0


@compiled_exactly
def _measure_edges(
    points: FloatArray, nodes: IntArray, determinants: FloatArray, squares: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in the determinants of tetrahedra and the sums of their squared edge lengths.

    Tetrahedra are measured one at a time, because collecting their corners would cost more.
    """
    for i in range(len(nodes)):
        o, p, q, r = nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3]
        a, b, c = _way(points, o, p), _way(points, o, q), _way(points, o, r)
        determinants[i] = _determinant(a, b, c)
        total = _square(a) + _square(b) + _square(c)
        total += _square((b[0] - a[0], b[1] - a[1], b[2] - a[2]))
        total += _square((c[0] - a[0], c[1] - a[1], c[2] - a[2]))
        squares[i] = total + _square((c[0] - b[0], c[1] - b[1], c[2] - b[2]))


@compiled_exactly
def _measure_triangles(
    points: FloatArray, nodes: IntArray, determinants: FloatArray, squares: FloatArray
) -> None:  # pragma: no cover - machine code
    """Fill in twice the area of triangles in a plane of constant z, and the sums of their squared edge lengths."""
    for i in range(len(nodes)):
        o, p, q = nodes[i, 0], nodes[i, 1], nodes[i, 2]
        a, b = _way(points, o, p), _way(points, o, q)
        determinants[i] = a[0] * b[1] - a[1] * b[0]
        squares[i] = _square(a) + _square(_way(points, p, q)) + _square(_way(points, q, o))


@compiled_exactly
def _judge_quads(
    points: FloatArray, nodes: IntArray, orientation: float, quality: FloatArray, inverted: BoolArray
) -> None:  # pragma: no cover - machine code
    """Fill in VTK's scaled Jacobian of quads in a plane of constant z, and which are inverted."""
    for i in range(len(nodes)):
        share = least = np.inf
        for k in range(4):
            a = _way(points, nodes[i, k], nodes[i, (k + 1) % 4])
            b = _way(points, nodes[i, k], nodes[i, (k + 3) % 4])
            determinant = orientation * (a[0] * b[1] - a[1] * b[0])
            length = np.sqrt(np.maximum(_square(a) * _square(b), TINY))
            share = np.minimum(share, determinant / length)
            least = np.minimum(least, determinant)
        quality[i], inverted[i] = share, least <= 0.0


@compiled_exactly
def _way(points: FloatArray, o: int, a: int) -> Vector:  # pragma: no cover - machine code
    return points[a, 0] - points[o, 0], points[a, 1] - points[o, 1], points[a, 2] - points[o, 2]


@compiled_exactly
def _gather(points: FloatArray, few: IntArray, p: FloatArray) -> None:  # pragma: no cover - machine code
    """Copy the corners of a few cells to p (k, 3, LANES)."""
    for j in range(len(few)):
        for k in range(few.shape[1]):
            for axis in range(3):
                p[k, axis, j] = points[few[j, k], axis]


@compiled_exactly
def _edge(p: FloatArray, o: int, a: int, j: int) -> Vector:  # pragma: no cover - machine code
    return p[a, 0, j] - p[o, 0, j], p[a, 1, j] - p[o, 1, j], p[a, 2, j] - p[o, 2, j]


@compiled_exactly
def _join(p: FloatArray, axes: IntArray, ways: FloatArray) -> None:  # pragma: no cover - machine code
    """Fill in four times the axes (3, 3, LANES) of hexahedra."""
    for k in range(3):
        a, b, c, d = axes[k, 0, 0], axes[k, 0, 1], axes[k, 0, 2], axes[k, 0, 3]
        e, f, g, h = axes[k, 1, 0], axes[k, 1, 1], axes[k, 1, 2], axes[k, 1, 3]
        for x in range(3):
            for j in range(LANES):
                start = p[a, x, j] + p[b, x, j] + p[c, x, j] + p[d, x, j]
                ways[k, x, j] = p[e, x, j] + p[f, x, j] + p[g, x, j] + p[h, x, j] - start


@compiled_exactly
def _vector(ways: FloatArray, k: int, j: int) -> Vector:  # pragma: no cover - machine code
    return ways[k, 0, j], ways[k, 1, j], ways[k, 2, j]


@compiled_exactly
def _determinant(a: Vector, b: Vector, c: Vector) -> float:  # pragma: no cover - machine code
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])


@compiled_exactly
def _lengths(a: Vector, b: Vector, c: Vector) -> float:  # pragma: no cover - machine code
    return float(np.sqrt(np.maximum(_square(a) * _square(b) * _square(c), TINY)))


@compiled_exactly
def _square(a: Vector) -> float:  # pragma: no cover - machine code
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]


# Fills in quality (R,) and inversion (R,) of cells, given points (N, 3), nodes (R, k) and their orientation.
MEASURES: dict[str, Measure] = {
    "triangle": _triangle,
    "quad": _judge_quads,
    "tetra": _tetra,
    "pyramid": _pyramid,
    "wedge": _wedge,
    "hexahedron": _hexahedron,
}

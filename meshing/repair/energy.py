"""The energy of spoiled and inverted cells, its gradient and its curvature, compiled.

The energy of a cell is the sum over the tetrahedra at its corners. With J the map from a tetrahedron's target to it,
f = tr(J'J) / 3 and d = det J, the energy is

    (weight f^3 / chi^2)^power,    chi = (d + sqrt(d^2 + eps^2)) / 2

(Garanzha et al., "Foldover-free maps in 50 lines of code", 2021, eq. 3, to the power 3). For eps = 0 it is the mean
ratio to the power -3, infinite for flat tetrahedra. For eps > 0 it is finite for inverted tetrahedra, too. All weights
are then 1, so that no cell is sacrificed while others are untangled.

The third edge at a corner of a plane cell is the unit vector along z. The energy is that of a right prism over the
cell with constant height, so it also measures changes of the area.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.compiled import compiled_exactly
from sdm_deflect.base.threads import in_chunks

from .elements import RegionElements

# Elements or nodes in one block; constant, so that the bits do not depend on the number of threads.
BLOCK = 1 << 11
# Work on one element in kernel pairs, by which `in_chunks` divides it.
WEIGHT = 64
# Elements whose numbers are side by side, for the processor's wide registers.
LANES = 32
EDGES, TARGET, JACOBIAN, COFACTORS = 0, 9 * LANES, 18 * LANES, 27 * LANES
SIZE, ROOT, DETERMINANT, BASE = 36 * LANES, 37 * LANES, 38 * LANES, 39 * LANES
SHARE, SLOPES = 40 * LANES, 41 * LANES
# Start of each number of `LANES` elements in their common array, and the length of the array.
LENGTH = 65 * LANES


class Energy:
    """The energy of some elements as a function of their nodes.

    Parameters
    ----------
    elements : corner tetrahedra, and their unknown nodes.
    """

    def __init__(self, elements: RegionElements) -> None:
        self.elements = elements
        self._measures = np.empty((2, len(elements.nodes)))
        self._slopes = np.empty((len(elements.nodes), 12))

    @property
    def determinants(self) -> FloatArray:
        """Determinant of J of each element (E,) at the last evaluated place."""
        return np.asarray(self._measures[1])

    def __call__(self, points: FloatArray, eps: float, power: int) -> tuple[float, FloatArray]:
        """Return the energy and its gradient (U, 3) with the nodes at `points` (M, 3)."""
        elements, out, measures = self.elements, self._slopes, self._measures
        form = float(eps), int(power)
        _blockwise(
            lambda a, b: _energies(points, elements.nodes, elements.targets, form, measures, out, (a, b)), len(out)
        )
        with np.errstate(over="ignore"):  # the energy of a nearly flat cell
            return float(measures[0].sum()), self._gather(out, 3)

    def least(self, points: FloatArray) -> float:
        """Return the least weighted mean ratio of an element to its target; 0 if one is inverted."""
        self(points, 0.0, 1)
        flat = self.determinants.min(initial=1.0) <= 0.0
        return 0.0 if flat else float(self._measures[0].max(initial=1.0) ** (-1.0 / 3.0))

    def curvature(self, points: FloatArray, eps: float, power: int) -> FloatArray:
        """Return a positive matrix for each unknown node (U, 6), as an upper triangle: its second derivative.

        Parts that may be negative are left out; the matrix only scales a step.
        """
        elements, out = self.elements, np.empty((len(self.elements.nodes), 24))
        form = float(eps), int(power)
        _blockwise(lambda a, b: _curvatures(points, elements.nodes, elements.targets, form, out, (a, b)), len(out))
        return self._gather(out, 6)

    def _gather(self, values: FloatArray, width: int) -> FloatArray:
        """Add the values of elements at their four corners (E, 4 width) to each unknown node (U, width)."""
        elements = self.elements
        total = np.empty((elements.unknown, width))
        _blockwise(lambda a, b: _sums(elements.starts, elements.corners, values, total, (a, b)), elements.unknown)
        return total


def _blockwise(kernel: Callable[[int, int], Any], count: int) -> None:
    """Call kernel(start, stop) for blocks of rows; the blocks do not depend on the number of threads."""

    def work(low: int, high: int) -> None:
        for block in range(low, high):
            kernel(block * BLOCK, min((block + 1) * BLOCK, count))

    in_chunks(work, -(-count // BLOCK), BLOCK * WEIGHT)


@compiled_exactly
def _energies(
    points: FloatArray,
    nodes: IntArray,
    targets: FloatArray,
    form: tuple[float, int],
    measures: FloatArray,
    out: FloatArray,
    rows: tuple[int, int],
) -> None:
    """Write energies and determinants (2, E) of some rows, and the gradients (E, 12) by their four nodes."""
    row = np.ones(LENGTH)
    eps, power = form
    for begin in range(rows[0], rows[1], LANES):
        count = min(LANES, rows[1] - begin)
        _load(points, nodes[begin : begin + count], targets[begin : begin + count], row)
        _shape(row, eps)
        _slope(row)
        for i in range(count):
            energy = 1.0
            for _ in range(power):
                energy *= row[BASE + i]
            measures[0, begin + i] = energy
            measures[1, begin + i] = row[DETERMINANT + i]
            scale = power * energy
            edges = 2 if nodes[begin + i, 3] == nodes[begin + i, 0] else 3  # the third edge of a plane cell is constant
            for k in range(3):
                first = 0.0
                out[begin + i, 9 + k] = 0.0
                for c in range(edges):
                    slope = scale * row[SLOPES + (3 * c + k) * LANES + i]
                    out[begin + i, 3 * c + 3 + k] = slope
                    first -= slope
                out[begin + i, k] = first


@compiled_exactly
def _curvatures(
    points: FloatArray,
    nodes: IntArray,
    targets: FloatArray,
    form: tuple[float, int],
    out: FloatArray,
    rows: tuple[int, int],
) -> None:
    """Write the positive parts of the second derivatives (E, 24) of some rows by each of their four nodes."""
    row = np.ones(LENGTH)
    eps, power = form
    for begin in range(rows[0], rows[1], LANES):
        count = min(LANES, rows[1] - begin)
        _load(points, nodes[begin : begin + count], targets[begin : begin + count], row)
        _shape(row, eps)
        for c in range(4):
            _bend(row, c, float(power))
        for i in range(count):
            energy = float(power)
            for _ in range(power):
                energy *= row[BASE + i]
            plane = nodes[begin + i, 3] == nodes[begin + i, 0]  # then z is separate, and the third edge is constant
            for k in range(24):
                apart = plane and (k % 6 == 2 or k % 6 == 4 or k >= 18)
                out[begin + i, k] = 0.0 if apart else energy * row[SLOPES + k * LANES + i]


@compiled_exactly
def _load(points: FloatArray, nodes: IntArray, targets: FloatArray, row: FloatArray) -> None:
    """Write the edges, the inverse targets and the weights of at most `LANES` elements."""
    for i in range(len(nodes)):
        n0, n1, n2, n3 = nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3]
        for k in range(3):
            origin = points[n0, k]
            row[EDGES + k * LANES + i] = points[n1, k] - origin
            row[EDGES + (3 + k) * LANES + i] = points[n2, k] - origin
            row[EDGES + (6 + k) * LANES + i] = points[n3, k] - origin
        if n3 == n0:  # a plane cell
            row[EDGES + 8 * LANES + i] = 1.0
        for k in range(9):
            row[TARGET + k * LANES + i] = targets[i, k]
        row[SHARE + i] = targets[i, 9]


@compiled_exactly
def _shape(row: FloatArray, eps: float) -> None:
    """Write J, its cofactors, f, sqrt(d^2 + eps^2), d and the weighted f^3 / chi^2."""
    for i in range(LANES):
        ax, ay, az = row[EDGES + i], row[EDGES + 1 * LANES + i], row[EDGES + 2 * LANES + i]
        bx, by, bz = row[EDGES + 3 * LANES + i], row[EDGES + 4 * LANES + i], row[EDGES + 5 * LANES + i]
        cx, cy, cz = row[EDGES + 6 * LANES + i], row[EDGES + 7 * LANES + i], row[EDGES + 8 * LANES + i]
        w0, w1, w2 = row[TARGET + i], row[TARGET + 1 * LANES + i], row[TARGET + 2 * LANES + i]
        w3, w4, w5 = row[TARGET + 3 * LANES + i], row[TARGET + 4 * LANES + i], row[TARGET + 5 * LANES + i]
        w6, w7, w8 = row[TARGET + 6 * LANES + i], row[TARGET + 7 * LANES + i], row[TARGET + 8 * LANES + i]
        j00, j01, j02 = ax * w0 + bx * w3 + cx * w6, ax * w1 + bx * w4 + cx * w7, ax * w2 + bx * w5 + cx * w8
        j10, j11, j12 = ay * w0 + by * w3 + cy * w6, ay * w1 + by * w4 + cy * w7, ay * w2 + by * w5 + cy * w8
        j20, j21, j22 = az * w0 + bz * w3 + cz * w6, az * w1 + bz * w4 + cz * w7, az * w2 + bz * w5 + cz * w8
        k00, k01, k02 = j11 * j22 - j12 * j21, j12 * j20 - j10 * j22, j10 * j21 - j11 * j20
        k10, k11, k12 = j21 * j02 - j22 * j01, j22 * j00 - j20 * j02, j20 * j01 - j21 * j00
        k20, k21, k22 = j01 * j12 - j02 * j11, j02 * j10 - j00 * j12, j00 * j11 - j01 * j10
        d = j00 * k00 + j01 * k01 + j02 * k02
        f = j00 * j00 + j01 * j01 + j02 * j02 + j10 * j10 + j11 * j11 + j12 * j12
        f = (f + j20 * j20 + j21 * j21 + j22 * j22) / 3.0
        root = np.sqrt(d * d + eps * eps)
        large = 0.5 * (root + abs(d))
        small = 0.25 * eps * eps / large
        chi = large if d > 0.0 else small
        base = f * f * f / (chi * chi) * (row[SHARE + i] if eps == 0.0 else 1.0)
        row[SIZE + i], row[ROOT + i], row[DETERMINANT + i], row[BASE + i] = f, root, d, base
        row[JACOBIAN + i], row[JACOBIAN + 1 * LANES + i], row[JACOBIAN + 2 * LANES + i] = j00, j01, j02
        row[JACOBIAN + 3 * LANES + i], row[JACOBIAN + 4 * LANES + i], row[JACOBIAN + 5 * LANES + i] = j10, j11, j12
        row[JACOBIAN + 6 * LANES + i], row[JACOBIAN + 7 * LANES + i], row[JACOBIAN + 8 * LANES + i] = j20, j21, j22
        row[COFACTORS + i], row[COFACTORS + 1 * LANES + i], row[COFACTORS + 2 * LANES + i] = k00, k01, k02
        row[COFACTORS + 3 * LANES + i], row[COFACTORS + 4 * LANES + i], row[COFACTORS + 5 * LANES + i] = k10, k11, k12
        row[COFACTORS + 6 * LANES + i], row[COFACTORS + 7 * LANES + i], row[COFACTORS + 8 * LANES + i] = k20, k21, k22


@compiled_exactly
def _slope(row: FloatArray) -> None:
    """Write the gradients of log(f^3 / chi^2) by the three edges."""
    for i in range(LANES):
        w0, w1, w2 = row[TARGET + i], row[TARGET + 1 * LANES + i], row[TARGET + 2 * LANES + i]
        w3, w4, w5 = row[TARGET + 3 * LANES + i], row[TARGET + 4 * LANES + i], row[TARGET + 5 * LANES + i]
        w6, w7, w8 = row[TARGET + 6 * LANES + i], row[TARGET + 7 * LANES + i], row[TARGET + 8 * LANES + i]
        u, v = 2.0 / row[SIZE + i], 2.0 / row[ROOT + i]
        g0 = u * row[JACOBIAN + i] - v * row[COFACTORS + i]
        g1 = u * row[JACOBIAN + 1 * LANES + i] - v * row[COFACTORS + 1 * LANES + i]
        g2 = u * row[JACOBIAN + 2 * LANES + i] - v * row[COFACTORS + 2 * LANES + i]
        row[SLOPES + i] = g0 * w0 + g1 * w1 + g2 * w2
        row[SLOPES + 3 * LANES + i] = g0 * w3 + g1 * w4 + g2 * w5
        row[SLOPES + 6 * LANES + i] = g0 * w6 + g1 * w7 + g2 * w8
        g0 = u * row[JACOBIAN + 3 * LANES + i] - v * row[COFACTORS + 3 * LANES + i]
        g1 = u * row[JACOBIAN + 4 * LANES + i] - v * row[COFACTORS + 4 * LANES + i]
        g2 = u * row[JACOBIAN + 5 * LANES + i] - v * row[COFACTORS + 5 * LANES + i]
        row[SLOPES + 1 * LANES + i] = g0 * w0 + g1 * w1 + g2 * w2
        row[SLOPES + 4 * LANES + i] = g0 * w3 + g1 * w4 + g2 * w5
        row[SLOPES + 7 * LANES + i] = g0 * w6 + g1 * w7 + g2 * w8
        g0 = u * row[JACOBIAN + 6 * LANES + i] - v * row[COFACTORS + 6 * LANES + i]
        g1 = u * row[JACOBIAN + 7 * LANES + i] - v * row[COFACTORS + 7 * LANES + i]
        g2 = u * row[JACOBIAN + 8 * LANES + i] - v * row[COFACTORS + 8 * LANES + i]
        row[SLOPES + 2 * LANES + i] = g0 * w0 + g1 * w1 + g2 * w2
        row[SLOPES + 5 * LANES + i] = g0 * w3 + g1 * w4 + g2 * w5
        row[SLOPES + 8 * LANES + i] = g0 * w6 + g1 * w7 + g2 * w8


@compiled_exactly
def _bend(row: FloatArray, corner: int, power: float) -> None:
    """Write the positive part of the second derivative by one corner, over energy times power.

    It has three parts: from f, and from the squared gradients of log chi and of the whole logarithm.
    """
    for i in range(LANES):
        first, second, third = row[TARGET + i], row[TARGET + 3 * LANES + i], row[TARGET + 6 * LANES + i]
        r0 = -(first + second + third)
        r0 = first if corner == 1 else second if corner == 2 else third if corner == 3 else r0
        first, second, third = row[TARGET + 1 * LANES + i], row[TARGET + 4 * LANES + i], row[TARGET + 7 * LANES + i]
        r1 = -(first + second + third)
        r1 = first if corner == 1 else second if corner == 2 else third if corner == 3 else r1
        first, second, third = row[TARGET + 2 * LANES + i], row[TARGET + 5 * LANES + i], row[TARGET + 8 * LANES + i]
        r2 = -(first + second + third)
        r2 = first if corner == 1 else second if corner == 2 else third if corner == 3 else r2
        u, v = 2.0 / row[SIZE + i], 1.0 / row[ROOT + i]
        kx = (row[COFACTORS + i] * r0 + row[COFACTORS + 1 * LANES + i] * r1 + row[COFACTORS + 2 * LANES + i] * r2) * v
        gx = (
            row[JACOBIAN + i] * r0 + row[JACOBIAN + 1 * LANES + i] * r1 + row[JACOBIAN + 2 * LANES + i] * r2
        ) * u - 2.0 * kx
        ky = (
            row[COFACTORS + 3 * LANES + i] * r0
            + row[COFACTORS + 4 * LANES + i] * r1
            + row[COFACTORS + 5 * LANES + i] * r2
        ) * v
        gy = (
            row[JACOBIAN + 3 * LANES + i] * r0 + row[JACOBIAN + 4 * LANES + i] * r1 + row[JACOBIAN + 5 * LANES + i] * r2
        ) * u - 2.0 * ky
        kz = (
            row[COFACTORS + 6 * LANES + i] * r0
            + row[COFACTORS + 7 * LANES + i] * r1
            + row[COFACTORS + 8 * LANES + i] * r2
        ) * v
        gz = (
            row[JACOBIAN + 6 * LANES + i] * r0 + row[JACOBIAN + 7 * LANES + i] * r1 + row[JACOBIAN + 8 * LANES + i] * r2
        ) * u - 2.0 * kz
        along = u * (r0 * r0 + r1 * r1 + r2 * r2)
        at = SLOPES + 6 * corner * LANES + i
        row[at] = along + 2.0 * kx * kx + power * gx * gx
        row[at + 1 * LANES] = 2.0 * kx * ky + power * gx * gy
        row[at + 2 * LANES] = 2.0 * kx * kz + power * gx * gz
        row[at + 3 * LANES] = along + 2.0 * ky * ky + power * gy * gy
        row[at + 4 * LANES] = 2.0 * ky * kz + power * gy * gz
        row[at + 5 * LANES] = along + 2.0 * kz * kz + power * gz * gz


@compiled_exactly
def _sums(starts: IntArray, corners: IntArray, values: FloatArray, out: FloatArray, rows: tuple[int, int]) -> None:
    """Add the values (E, 4 w) at the corners to their nodes (U, w), in the order of the elements."""
    width = out.shape[1]
    for n in range(rows[0], rows[1]):
        for k in range(width):
            out[n, k] = 0.0
        for at in range(starts[n], starts[n + 1]):
            e, c = corners[at] >> 2, width * (corners[at] & 3)
            for k in range(width):
                out[n, k] += values[e, c + k]

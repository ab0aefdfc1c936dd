"""Local rotation of a surface: the rotation at each boundary node, from the edges that meet there.

At node j with edges a_k that become b_k, the rotation nearest to the deformation is the orthogonal factor R of
H = sum of b_k a_k' / |a_k|**2 = R S, S symmetric. If the neighbourhood moves rigidly, R is its rotation.
"""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray

# Ratio of the second singular value to the first, below which the edges determine no rotation.
DEGENERATE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LocalRotation:
    """Edges between boundary nodes, each in both directions.

    Attributes
    ----------
    start, end : (E,) rows of the boundary nodes.
    vectors : (E, 3) from start to end, divided by their squared length.
    count : number of boundary nodes.
    normal : (3,) unit normal, if all nodes are in one plane and turn within it.
    """

    start: IntArray = field(repr=False)
    end: IntArray = field(repr=False)
    vectors: FloatArray = field(repr=False)
    count: int
    normal: FloatArray | None = None

    @classmethod
    def of(cls, points: FloatArray, edges: IntArray, certain: int, normal: FloatArray | None = None) -> "LocalRotation":
        """Take edges (E, 2) between points (K, 3), without those of zero length.

        The first `certain` points turn by the edges among themselves alone; the others follow.
        """
        start, end = np.vstack([edges, edges[:, ::-1]]).T
        vectors = points[end] - points[start]
        square = np.sum(vectors**2, axis=1)
        some = (square > 0.0) & ((start >= certain) | (end < certain))
        return cls(start[some], end[some], vectors[some] / square[some, None], len(points), normal)

    def rotations(self, displacement: FloatArray) -> FloatArray:
        """Return R - 1 (K, 3, 3) at each node, given displacements (K, 3)."""
        if not len(self.start):
            return np.zeros((self.count, 3, 3))
        turn = self._polar(displacement)[0] - np.eye(3)
        turn[~self._sums(displacement).any(axis=(1, 2))] = 0.0  # exact zeros where nothing turns
        return np.asarray(turn)

    def linearized(self, displacement: FloatArray) -> "RotationRates":
        """Return the derivative of `rotations` at displacements (K, 3)."""
        rotation, stretch, flat = self._polar(displacement)
        return RotationRates(self, rotation, np.asarray(np.linalg.inv(_trace_less(stretch)), dtype=np.float64), flat)

    def strain(self, displacement: FloatArray) -> FloatArray:
        """Return the strain (K,) at each node: how much its edges change beyond the rotation, over their length.

        The displacements (K, 3) are small, so the rotation w is linear in them. S is the sum over the unit
        edges, H the sum over their changes; (tr S - S) w is the vector of H - H'.
        """
        if not len(self.start):
            return np.zeros(self.count)
        stretch, skew = self._polar(np.zeros_like(displacement))[1], self._sums(displacement)
        turn = np.linalg.solve(_trace_less(stretch), _vector(skew)[:, :, None])[:, :, 0]
        along = self.vectors / np.sum(self.vectors**2, axis=1, keepdims=True)
        off = displacement[self.end] - displacement[self.start] - np.cross(turn[self.start], along)
        out = np.zeros(self.count)
        np.maximum.at(out, self.start, np.linalg.norm(off, axis=1) * np.linalg.norm(self.vectors, axis=1))
        return out

    def _polar(self, displacement: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return R and S (K, 3, 3), and where (K,) the edges determine no rotation: there both are the identity."""
        still = self._sums(np.zeros_like(displacement), unit=1.0)
        if self.normal is not None:
            still += np.outer(self.normal, self.normal)  # as an edge along the normal that stays
        u, s, vt = np.linalg.svd(still + self._sums(displacement))
        sign = np.linalg.det(u @ vt)
        u[:, :, 2] *= sign[:, None]
        s[:, 2] *= sign
        rotation, stretch = u @ vt, np.einsum("kji,kj,kjl->kil", vt, s, vt)
        flat = s[:, 1] <= DEGENERATE * np.maximum(s[:, 0], np.finfo(float).tiny)
        rotation[flat], stretch[flat] = np.eye(3), np.eye(3)
        return rotation, stretch, flat

    def _sums(self, values: FloatArray, unit: float = 0.0) -> FloatArray:
        """Return the sums (K, 3, 3) of (value differences + unit edges) times edges."""
        change = values[self.end] - values[self.start]
        if unit:
            square = np.sum(self.vectors**2, axis=1, keepdims=True)
            change = change + unit * self.vectors / square
        out = np.empty((self.count, 3, 3))
        for i in range(3):
            for j in range(3):
                weights = change[:, i] * self.vectors[:, j]
                out[:, i, j] = np.bincount(self.start, weights=weights, minlength=self.count)
        return out

    def _sums_reverse(self, gradient: FloatArray) -> FloatArray:
        """Return the gradient (K, 3) by the values of `_sums`, given that (K, 3, 3) by the sums."""
        change = np.einsum("eij,ej->ei", gradient[self.start], self.vectors)
        ends = (self.end, change), (self.start, -change)
        return np.asarray(
            sum(
                np.stack([np.bincount(nodes, weights=part[:, i], minlength=self.count) for i in range(3)], axis=1)
                for nodes, part in ends
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class RotationRates:
    """The derivative of local rotations R: with H = R S, dR = R [w], (tr S - S) w the vector of R'dH - dH'R.

    Attributes
    ----------
    of : the edges.
    rotation : (K, 3, 3) R.
    inverse : (K, 3, 3) inverse of tr S - S.
    flat : (K,) nodes whose edges determine no rotation.
    """

    of: LocalRotation = field(repr=False)
    rotation: FloatArray = field(repr=False)
    inverse: FloatArray = field(repr=False)
    flat: BoolArray = field(repr=False)

    def forward(self, rate: FloatArray) -> FloatArray:
        """Return the rates (K, 3, 3) of the rotations, given those (K, 3) of the displacements."""
        turned = np.einsum("kji,kjl->kil", self.rotation, self.of._sums(rate))
        return self._with_spin(_vector(turned))

    def reverse(self, gradient: FloatArray) -> FloatArray:
        """Return the gradient (K, 3) by the displacements, given that (K, 3, 3) by the rotations."""
        turned = np.einsum("kji,kjl->kil", self.rotation, gradient)
        return self.of._sums_reverse(self._with_spin(_vector(turned)))

    def _with_spin(self, vector: FloatArray) -> FloatArray:
        """Return R [w] (K, 3, 3), w the inverse times vectors (K, 3); zero at flat nodes."""
        w = np.einsum("kij,kj->ki", self.inverse, vector)
        cross = np.zeros_like(self.rotation)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cross[:, k, j], cross[:, j, k] = w[:, i], -w[:, i]
        out = self.rotation @ cross
        out[self.flat] = 0.0
        return out


def _vector(matrices: FloatArray) -> FloatArray:
    """Return the vectors (K, 3) of the antisymmetric parts of matrices (K, 3, 3), twice as long."""
    skew = matrices - np.swapaxes(matrices, 1, 2)
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


def _trace_less(stretch: FloatArray) -> FloatArray:
    """Return tr S - S for matrices S (K, 3, 3)."""
    return np.asarray(np.trace(stretch, axis1=1, axis2=2)[:, None, None] * np.eye(3) - stretch)

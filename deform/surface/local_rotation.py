"""How a surface turns locally: the rotation at each boundary node, from the edges that meet there.

At node j with edges a_k that become b_k, the rotation nearest to the deformation is the orthogonal factor R of
H = sum of b_k a_k' / |a_k|**2 = R S, S symmetric. Under a rigid motion of the neighbourhood it is that motion's own.
"""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray

DEGENERATE = 1e-6  # second singular value, relative to the first, of edges that determine no rotation


@dataclass(frozen=True, slots=True, eq=False)
class LocalRotation:
    """Edges between boundary nodes, each in both directions.

    Attributes
    ----------
    start, end : (E,) rows of the boundary nodes.
    vectors : (E, 3) from start to end, divided by the squared length.
    count : number of boundary nodes.
    plane : whether they are in a plane of constant z, which then turns within itself.
    """

    start: IntArray = field(repr=False)
    end: IntArray = field(repr=False)
    vectors: FloatArray = field(repr=False)
    count: int
    plane: bool = False

    @classmethod
    def of(cls, points: FloatArray, edges: IntArray, certain: int, plane: bool = False) -> "LocalRotation":
        """Take edges (E, 2) between points (K, 3); those without length are left out.

        The first `certain` points turn among themselves, whatever the others, which follow them, do.
        """
        start, end = np.vstack([edges, edges[:, ::-1]]).T
        vectors = points[end] - points[start]
        square = np.sum(vectors**2, axis=1)
        some = (square > 0.0) & ((start >= certain) | (end < certain))
        return cls(start[some], end[some], vectors[some] / square[some, None], len(points), plane)

    def rotations(self, displacement: FloatArray) -> FloatArray:
        """Return the rotation less the identity (K, 3, 3) at each node, given displacements (K, 3)."""
        if not len(self.start):
            return np.zeros((self.count, 3, 3))
        turn = self._polar(displacement)[0] - np.eye(3)
        turn[~self._sums(displacement).any(axis=(1, 2))] = 0.0  # no rounding where nothing turns
        return np.asarray(turn)

    def rotation_rates(self, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the derivative (K, 3, 3) of the rotations, given that (K, 3) of the displacement.

        With H = R S and dR = R W, W the cross product with w: (tr S - S) w = the vector of R' dH - dH' R.
        """
        if not len(self.start):
            return np.zeros((self.count, 3, 3))
        rotation, stretch = self._polar(displacement)
        skew = np.einsum("kji,kjl->kil", rotation, self._sums(rate))
        skew -= np.swapaxes(skew, 1, 2)
        right = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        matrix = np.trace(stretch, axis1=1, axis2=2)[:, None, None] * np.eye(3) - stretch
        w = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        cross = np.zeros((self.count, 3, 3))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cross[:, k, j], cross[:, j, k] = w[:, i], -w[:, i]
        return np.asarray(rotation @ cross)

    def strain(self, rate: FloatArray) -> FloatArray:
        """Return how fast edges at each node change (K,) beyond its own turn, over their length, given rates (K, 3)."""
        turn = self.rotation_rates(np.zeros_like(rate), rate)
        along = self.vectors / np.sum(self.vectors**2, axis=1, keepdims=True)
        off = rate[self.end] - rate[self.start] - np.einsum("eij,ej->ei", turn[self.start], along)
        out = np.zeros(self.count)
        np.maximum.at(out, self.start, np.linalg.norm(off, axis=1) * np.linalg.norm(self.vectors, axis=1))
        return out

    def _polar(self, displacement: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return R and S (K, 3, 3); both the identity where the edges determine no rotation."""
        still = self._sums(np.zeros_like(displacement), unit=1.0)
        if self.plane:
            still[:, 2, 2] = 1.0  # an edge along z, as it were, that stays
        u, s, vt = np.linalg.svd(still + self._sums(displacement))
        sign = np.linalg.det(u @ vt)
        u[:, :, 2] *= sign[:, None]
        s[:, 2] *= sign
        rotation, stretch = u @ vt, np.einsum("kji,kj,kjl->kil", vt, s, vt)
        flat = s[:, 1] <= DEGENERATE * np.maximum(s[:, 0], np.finfo(float).tiny)
        rotation[flat], stretch[flat] = np.eye(3), np.eye(3)
        return rotation, stretch

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

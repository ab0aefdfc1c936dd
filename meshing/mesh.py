"""The tetrahedral mesh with named boundary patches."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.mesh.mesh import Cells, Mesh, Patch

VOLUME = "volume"
FREE_FORM = 1e-5
"""Largest allowed distance (m) of nodes from a CAD face that is neither a plane nor a cylinder."""


@dataclass(frozen=True, slots=True, eq=False)
class TetMesh:
    """Tetrahedra and the named triangles that bound them.

    Parameters
    ----------
    points : (N, 3) node coordinates in metres.
    tets : (M, 4) node indices; positively oriented: det(p1-p0, p2-p0, p3-p0) > 0.
    triangles : (F, 3) node indices of the boundary, oriented out of the fluid: into the body, out of the far field.
    patch : (F,) index into `names` of each triangle, at least 1.
    face : (F,) index of the CAD face each triangle lies on, -1 where there is none (far field).
    names : Patch names; position 0 is ``"volume"``, the tetrahedra themselves.

    Raises ValueError for arrays of the wrong shape, non-finite coordinates and indices out of range.
    """

    points: FloatArray = field(repr=False)
    tets: IntArray = field(repr=False)
    triangles: IntArray = field(repr=False)
    patch: IntArray = field(repr=False)
    face: IntArray = field(repr=False)
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        _check_shape("points", self.points, 3)
        _check_shape("tets", self.tets, 4)
        _check_shape("triangles", self.triangles, 3)
        if not np.isfinite(self.points).all():
            raise ValueError("points hold a coordinate that is not finite")
        _check_range("tets", self.tets, 0, len(self.points))
        _check_range("triangles", self.triangles, 0, len(self.points))
        for name, labels in (("patch", self.patch), ("face", self.face)):
            if labels.shape != (len(self.triangles),):
                raise ValueError(f"{name} has shape {labels.shape}, expected ({len(self.triangles)},)")
        if not self.names or self.names[0] != VOLUME or len(set(self.names)) != len(self.names):
            raise ValueError(f"names must start with {VOLUME!r} and be distinct, got {self.names}")
        _check_range("patch", self.patch, 1, len(self.names))
        _check_range("face", self.face, -1, np.iinfo(np.intp).max)

    def triangles_of(self, name: str) -> IntArray:
        """Triangles (K, 3) of one patch; ValueError if the mesh has no patch of that name."""
        own: IntArray = self.triangles[self.patch == self._index(name)]
        return own

    def on(self, *names: str) -> IntArray:
        """Sorted, distinct indices (K,) of the nodes on the union of the named patches."""
        wanted = np.isin(self.patch, [self._index(name) for name in names])
        return distinct(self.triangles[wanted])

    def touching(self, nodes: IntArray) -> BoolArray:
        """True for cells (M,) with any of these nodes (K,)."""
        chosen = np.zeros(len(self.points), dtype=bool)
        chosen[nodes] = True
        return np.asarray(chosen[self.tets].any(axis=1))

    def with_points(self, points: FloatArray) -> TetMesh:
        """The same cells and patches on moved nodes (N, 3); ValueError if the number of nodes changes."""
        if points.shape != self.points.shape:
            raise ValueError(f"points have shape {points.shape}, expected {self.points.shape}")
        return replace(self, points=points)

    def as_mesh(self, name: str = "mesh") -> Mesh:
        """The tetrahedra (M, 4) and each patch's triangles (K, 3), if any, as the engine sees a mesh of any cells.

        Points and tetrahedra are shared, not copied; the labels of CAD faces are lost. Messages call the mesh `name`.
        """
        triangles = {patch: self.triangles_of(patch) for patch in self.names[1:]}
        patches = tuple(Patch(patch, (Cells("triangle", own),)) for patch, own in triangles.items() if len(own))
        return Mesh(self.points, (Cells("tetra", self.tets),), patches, name=name)

    def _index(self, name: str) -> int:
        if name not in self.names[1:]:
            raise ValueError(f"no patch {name!r}; the mesh has {', '.join(self.names[1:])}")
        return self.names.index(name)


def _check_shape(name: str, array: FloatArray | IntArray, columns: int) -> None:
    """Raise ValueError unless the array is (*, columns)."""
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name} has shape {array.shape}, expected (*, {columns})")


def _check_range(name: str, indices: IntArray, low: int, end: int) -> None:
    """Raise ValueError unless all indices, of any shape, lie in low ... end - 1."""
    if len(indices) and (indices.min() < low or indices.max() >= end):
        raise ValueError(f"{name} holds {indices.min()} ... {indices.max()}, expected {low} ... {end - 1}")

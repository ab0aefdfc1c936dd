"""Tetrahedral meshes whose boundary triangles are labelled with CAD faces."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray

from .cells import Cells, Patch
from .mesh import Mesh

# Name of the cells among those of the patches in files.
VOLUME = "volume"
# Largest allowed distance (m) of nodes from a CAD face that is neither a plane nor a cylinder.
FREE_FORM = 1e-5
# Labels of boundary faces: index of the face of the CAD, -1 where there is none; place among all boundary faces.
CAD_FACE, ROW = "cad_face", "row"


class Skin(NamedTuple):
    """The boundary triangles of a mesh, in the order of files.

    Attributes
    ----------
    triangles : (F, 3) node indices, oriented out of the fluid: into the body, out of the far field.
    patch : (F,) index of the patch of each.
    face : (F,) index of the CAD face that each lies on, -1 where there is none (far field).
    """

    triangles: IntArray
    patch: IntArray
    face: IntArray


def tetrahedral(points: FloatArray, tets: IntArray, skin: Skin, names: Sequence[str], name: str = "mesh") -> Mesh:
    """Return tetrahedra (M, 4), each with det(p1-p0, p2-p0, p3-p0) > 0, and the labelled triangles that bound them.

    Raises InputError or ValueError for arrays of the wrong shape and indices out of range.
    """
    triangles, patch, face = skin
    if triangles.shape[1:] != (3,) or not len(triangles) == len(patch) == len(face):
        raise ValueError(f"triangles {triangles.shape}, patch {patch.shape} and face {face.shape} do not fit together")
    for label, values, low, end in (("patch", patch, 0, len(names)), (CAD_FACE, face, -1, np.iinfo(np.intp).max)):
        if len(values) and (values.min() < low or values.max() >= end):
            raise ValueError(f"{label} holds {values.min()} ... {values.max()}, expected {low} ... {end - 1}")
    patches = []
    for index, patch_name in enumerate(names):
        rows = np.flatnonzero(patch == index)
        labels = {CAD_FACE: face[rows], ROW: rows}
        patches.append(Patch(patch_name, (Cells("triangle", triangles[rows]),), labels=labels))
    return Mesh(points, (Cells("tetra", tets),), tuple(patches), name=name)


def tets_of(mesh: Mesh) -> IntArray:
    """Return the tetrahedra (M, 4) of a mesh of tetrahedra alone."""
    (block,) = mesh.cells
    if not isinstance(block, Cells) or block.shape != "tetra":
        raise ValueError(f"{mesh.name} holds other cells than tetrahedra")
    return block.nodes


def triangles_of(mesh: Mesh, name: str) -> IntArray:
    """Return the triangles (K, 3) of a patch; KeyError if there is none of that name."""
    (faces,) = mesh.patch(name).faces
    return faces.nodes


def skin(mesh: Mesh) -> Skin:
    """Return the boundary of a mesh made by `tetrahedral`."""
    patch = np.repeat(np.arange(len(mesh.patches)), [len(patch) for patch in mesh.patches])
    triangles = np.concatenate([np.empty((0, 3), dtype=np.intp), *(triangles_of(mesh, name) for name in mesh.names)])
    face, row = (
        np.concatenate([np.empty(0, dtype=np.intp), *(patch.labels[label] for patch in mesh.patches)])
        for label in (CAD_FACE, ROW)
    )
    order = np.argsort(row)
    return Skin(triangles[order], patch[order], face[order])


def nodes_by_face(mesh: Mesh, name: str) -> Iterator[IntArray]:
    """Yield the sorted nodes (K,) of a patch on each of its CAD faces, in the order of these."""
    triangles, face = triangles_of(mesh, name), mesh.patch(name).labels[CAD_FACE]
    for index in np.unique(face):
        yield np.unique(triangles[face == index])


def touching(mesh: Mesh, nodes: IntArray) -> BoolArray:
    """Return which tetrahedra (M,) have any of these nodes (K,)."""
    chosen = np.zeros(len(mesh.points), dtype=np.bool_)
    chosen[nodes] = True
    return np.asarray(chosen[tets_of(mesh)].any(axis=1))

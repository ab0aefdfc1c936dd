"""A conforming surface mesh of the CAD faces: the input of the volume mesher and the reference for names."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing import child
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.files import hidden_folder
from sdm_deflect.meshing.formats.format import written

SECONDS = 600.0
# Nodes of a CAD face's mesh further off that face (metres) show that faces were mixed up.
ASTRAY = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class InputSurface:
    """Triangles of the CAD model's exterior faces, and of the internal sheets that the mesher needs too.

    Attributes
    ----------
    points : (N, 3) in metres
    outer : (T, 3) triangles of the exterior faces, oriented out of the solid
    face : (T,) CAD face of each of them
    inner : (S, 3) triangles of the sheets
    """

    points: FloatArray
    outer: IntArray
    face: IntArray
    inner: IntArray

    @property
    def triangles(self) -> IntArray:
        """All triangles (T + S, 3)."""
        return np.concatenate([self.outer, self.inner])

    def spots(self) -> FloatArray:
        """Points (K, 3) spread over the surface about half an edge apart: nodes and triangle centres."""
        return np.concatenate([self.points, self.points[self.triangles].mean(axis=1)])


def mesh_surface(model: CadModel, background: tuple[FloatArray, IntArray, FloatArray]) -> InputSurface:
    """Mesh all faces with sizes from a background mesh: points (N, 3), tetrahedra (M, 4), target edge lengths (N,).

    MeshingError where gmsh fails on a face or the result does not match the CAD.
    """
    points, tets, lengths = background
    with hidden_folder() as folder:
        brep = folder / "faces.brep"
        with written(brep):
            model.write_faces(brep)
        question = {"brep": np.array(str(brep)), "points": points, "tets": tets, "lengths": lengths}
        answer = child.call("sdm_deflect.meshing.generate.gmsh_worker", question, SECONDS)
    nodes = answer["points"].astype(np.float64)
    triangles, face = answer["triangles"].astype(np.intp), answer["face"].astype(np.intp)
    expected = len(model.faces) + len(model.sheets)
    if len(answer["areas"]) != expected:
        raise MeshingError(f"gmsh found {len(answer['areas'])} faces in a CAD model of {expected}")
    exterior = face < len(model.faces)
    outer = _outward(model, nodes, triangles[exterior], face[exterior])
    return InputSurface(nodes, outer, face[exterior], triangles[~exterior])


def _outward(model: CadModel, points: FloatArray, triangles: IntArray, face: IntArray) -> IntArray:
    """Turn the triangles (T, 3) of each face (T,), which agree among themselves, out of the solid."""
    turned = triangles.copy()
    for index, cad in enumerate(model.faces):
        own = np.flatnonzero(face == index)
        corners = points[triangles[own]]
        astray = np.abs(cad.project(corners[:, 0]) - corners[:, 0]).max()
        if astray > ASTRAY:
            raise MeshingError(f"gmsh's face {index} lies {astray:.1e} m off the CAD face on {cad.patch}")
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if np.einsum("ij,ij->", normals, cad.normal_at(corners.mean(axis=1))) < 0.0:
            turned[own] = triangles[own][:, ::-1]
    return turned

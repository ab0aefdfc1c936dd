"""From the mesher's tetrahedra to the named flow mesh on the exact CAD."""

from __future__ import annotations

import numpy as np

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.attachment import attach
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.exterior import inside_solid
from sdm_deflect.meshing.mesh import VOLUME, FloatArray, IntArray, TetMesh
from sdm_deflect.meshing.naming import boundary_triangles, cad_faces
from sdm_deflect.meshing.snapping import snapped
from sdm_deflect.meshing.surface import Surface
from sdm_deflect.meshing.topology import cell_faces
from sdm_deflect.meshing.volume import Filling

FAR_FIELD = "far_field"


def assemble(filling: Filling, surface: Surface, model: CadModel, envelope: float) -> TetMesh:
    """Select the flow, name its boundary and put that on the CAD.

    Parameters
    ----------
    envelope
        How far (metres) the filling's surface strays from the surface mesh.

    Raises
    ------
    MeshingError
        If the boundary cannot be matched with the CAD.
    """
    faces = cell_faces(filling.tets)
    solid = inside_solid(filling.points, filling.tets, faces, surface, envelope)
    fluid = solid if model.fluid_inside else ~solid
    triangles, outermost = boundary_triangles(faces, fluid)
    if model.fluid_inside and outermost.any():
        raise MeshingError("the flow inside the solid leaks to the outside")
    body = triangles[~outermost]
    out_of_solid = body if model.fluid_inside else body[:, ::-1]
    face = cad_faces(filling.points, out_of_solid, surface)
    if (face < 0).any():
        raise MeshingError(f"{np.count_nonzero(face < 0)} boundary triangles are near no CAD face")
    points = snapped(filling.points, attach(filling.points, body, face, model), model)
    return _named(points, filling.tets[fluid], (body, face), triangles[outermost], model)


def _named(
    points: FloatArray,
    tets: IntArray,
    body: tuple[IntArray, IntArray],
    far: IntArray,
    model: CadModel,
) -> TetMesh:
    """Mesh of the used points, its patches in the order of the CAD faces, the far field last."""
    patches = list(dict.fromkeys(face.patch for face in model.faces))
    names = (VOLUME, *patches, *([FAR_FIELD] if len(far) else []))
    patch_of_face = np.array([names.index(face.patch) for face in model.faces])
    triangles, face = body
    used, compact = np.unique(np.concatenate([tets.ravel(), triangles.ravel(), far.ravel()]), return_inverse=True)
    cells, skin = compact[: tets.size].reshape(-1, 4), compact[tets.size :].reshape(-1, 3)
    return TetMesh(
        points=points[used],
        tets=cells,
        triangles=skin,
        patch=np.concatenate([patch_of_face[face], np.full(len(far), len(names) - 1)]),
        face=np.concatenate([face, np.full(len(far), -1)]),
        names=names,
    )

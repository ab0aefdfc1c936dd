"""The child process that runs gmsh; it receives CAD faces and a size field, and answers a conforming surface mesh."""

import gmsh
import numpy as np

from sdm_deflect.meshing.child import Array, Arrays, MeshingError, serve

FRONTAL_DELAUNAY = 6


def mesh_faces(question: Arrays) -> Arrays:
    """Triangulate the faces of the file ``brep``, by edge lengths on a mesh ``points``, ``tets``, ``lengths``.

    Answers ``points`` (N, 3), ``triangles`` (T, 3), ``face`` (T,) and the faces' ``areas`` (K,).
    """
    gmsh.initialize(interruptible=False)
    try:
        for name, value in (("General.Terminal", 0), ("General.NumThreads", 1)):
            gmsh.option.setNumber(name, value)
        gmsh.model.occ.importShapes(str(question["brep"]), highestDimOnly=False)
        gmsh.model.occ.synchronize()
        _size_by_background(question)
        gmsh.model.mesh.generate(2)
        return _collect()
    finally:
        gmsh.finalize()


def _size_by_background(question: Arrays) -> None:
    points, tets, lengths = question["points"], question["tets"], question["lengths"]
    for source in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{source}", 0)
    gmsh.option.setNumber("Mesh.Algorithm", FRONTAL_DELAUNAY)
    corners = points[tets]
    rows = np.concatenate([corners[:, :, 0], corners[:, :, 1], corners[:, :, 2], lengths[tets]], axis=1)
    view = gmsh.view.add("target edge length")
    gmsh.view.addListData(view, "SS", len(tets), rows.ravel())
    field = gmsh.model.mesh.field.add("PostView")
    gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)


def _collect() -> dict[str, Array]:
    """Return the mesh of all faces for `mesh_faces`; gmsh numbers the faces in the order of the file."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    index = np.full(int(tags.max()) + 1, -1)
    index[tags.astype(np.intp)] = np.arange(len(tags))
    faces = sorted(tag for _, tag in gmsh.model.getEntities(2))
    triangles = []
    for number, tag in enumerate(faces):
        nodes = gmsh.model.mesh.getElements(2, tag)[2]
        if not len(nodes):
            raise MeshingError(f"gmsh could not mesh CAD face {number}")
        triangles.append(index[nodes[0].astype(np.intp)].reshape(-1, 3))
    used, compact = np.unique(np.concatenate(triangles), return_inverse=True)
    return {
        "points": coordinates.reshape(-1, 3)[used],
        "triangles": compact.reshape(-1, 3),
        "face": np.repeat(np.arange(len(faces)), [len(t) for t in triangles]),
        "areas": np.array([gmsh.model.occ.getMass(2, tag) for tag in faces]),
    }


if __name__ == "__main__":
    serve(mesh_faces)

"""The child process that lets MeshLab (pymeshlab) measure a mesh's boundary and its distance from the CAD."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pymeshlab

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, components
from sdm_deflect.meshing.child import Arrays, serve

Question = Mapping[str, Any]

# MeshLab's rounding takes some coplanar neighbours for crossing ones, others each time that the mesh is turned
# (measured: 3 triangles in 1000). What crosses does so in every orientation.
ORIENTATIONS = 5
# Angle (rad) between two of them.
TURN = 1.0
# Largest angle (deg) between neighbouring triangles of one smooth CAD face.
FOLD = 90.0


def judge(question: Question) -> Arrays:
    """Measure a boundary.

    The question holds ``points`` (N, 3) in metres, ``triangles`` (F, 3) and the CAD face ``face`` (F,) of each, -1 for
    none; ``cad_points``, ``cad_triangles`` and ``cad_face`` of the triangulated CAD. The answer has the counts
    ``crowded`` (triangles at edges that more than two share), ``open`` (edges of one triangle), ``pinched`` (nodes
    where the boundary touches itself). For a boundary without them it has ``turned`` (whether any triangle is turned
    against its neighbours), the enclosed ``volume``, and ``crossing`` (rows of triangles that cross others).
    ``faces`` (K,) are the CAD faces with triangles, ``folded`` (K,) the number of these that are folded over neighbours
    (in a plane MeshLab misses that they cross), ``off_cad`` and ``off_mesh`` (K,) the distances (m) of these triangles'
    nodes from the CAD face, and of the nodes of its triangulation from them.
    """
    points, triangles = question["points"], question["triangles"]
    answer = topology(points, triangles)
    if not any(answer.values()):
        answer |= {**sides(points, triangles), "crossing": crossing(points, triangles, question["face"] < 0)}
    return {name: np.asarray(value) for name, value in {**answer, **on_cad(question)}.items()}


def topology(points: FloatArray, triangles: IntArray) -> dict[str, object]:
    """Count the faults by which triangles (F, 3) are no closed surface: two at each edge, one fan at each node."""
    meshes = load(points, triangles)
    meshes.compute_selection_by_non_manifold_edges_per_face()
    crowded = meshes.current_mesh().selected_face_number()
    if crowded:  # MeshLab may not come back from measuring such a mesh
        return {"crowded": crowded, "open": 0, "pinched": 0}
    measures = meshes.get_topological_measures()
    return {"crowded": 0, "open": measures["boundary_edges"], "pinched": measures["non_two_manifold_vertices"]}


def sides(points: FloatArray, triangles: IntArray) -> dict[str, object]:
    """Return whether any of the triangles (F, 3) is turned against its neighbours, and the volume that they enclose."""
    meshes = load(points, triangles)
    volume, before = meshes.get_geometric_measures()["mesh_volume"], meshes.current_mesh().face_matrix()
    meshes.meshing_re_orient_faces_coherently()
    return {"turned": not np.array_equal(before, meshes.current_mesh().face_matrix()), "volume": volume}


def crossing(points: FloatArray, triangles: IntArray, far: BoolArray) -> IntArray:
    """Return the rows of triangles (F, 3) that cross others in every orientation; body and far field are tested apart.

    MeshLab sorts triangles into boxes of one size; the whole body would be in one box of the far field's size.
    """
    rows = [np.flatnonzero(part) for part in (far, ~far) if part.any()]
    return np.sort(np.concatenate([row[_crossing(points, triangles[row])] for row in rows]))


def _crossing(points: FloatArray, triangles: IntArray) -> BoolArray:
    chosen = np.ones(len(triangles), dtype=np.bool_)
    for step in range(ORIENTATIONS):
        meshes = load(components(points, rotation(step * TURN).T), triangles)
        meshes.compute_selection_by_self_intersections_per_face()
        chosen &= meshes.current_mesh().face_selection_array()
    return chosen


def rotation(angle: float) -> FloatArray:
    """Return the rotation (3, 3) by an angle (rad) about an axis that is askew to all planes of an aircraft."""
    x, y, z = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def on_cad(question: Question) -> dict[str, object]:
    """Return, by CAD face, folds of its boundary triangles, and both one-sided Hausdorff distances to these."""
    faces = np.intersect1d(question["face"], question["cad_face"])
    reach = 2.0 * float(np.linalg.norm(np.ptp(question["points"], axis=0)))
    measures = np.array([_on_face(question, face, pymeshlab.PureValue(reach)) for face in faces]).reshape(-1, 3)
    return {"faces": faces, **dict(zip(("folded", "off_cad", "off_mesh"), measures.T, strict=True))}


def _on_face(question: Question, face: int, reach: pymeshlab.PureValue) -> tuple[int, float, float]:
    meshes = load(question["points"], question["triangles"][question["face"] == face])
    meshes.compute_selection_bad_faces(usear=False, usenf=True, nfratio=FOLD)
    folded = meshes.current_mesh().selected_face_number()
    meshes.add_mesh(mesh_of(question["cad_points"], question["cad_triangles"][question["cad_face"] == face]))
    there = meshes.get_hausdorff_distance(sampledmesh=0, targetmesh=1, maxdist=reach)
    back = meshes.get_hausdorff_distance(sampledmesh=1, targetmesh=0, maxdist=reach)
    return folded, there["max"], back["max"]


def load(points: FloatArray, triangles: IntArray) -> pymeshlab.MeshSet:
    """Return a MeshLab document with the triangles (F, 3) and their nodes in double precision."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(mesh_of(points, triangles))
    return meshes


def mesh_of(points: FloatArray, triangles: IntArray) -> pymeshlab.Mesh:
    """Return MeshLab's mesh of triangles (F, 3) on points (N, 3), without unused points."""
    used, compact = np.unique(triangles, return_inverse=True)
    return pymeshlab.Mesh(points[used], compact.reshape(-1, 3))


if __name__ == "__main__":
    serve(judge)

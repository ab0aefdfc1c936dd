"""Triangles on a CAD face, for sampling it and for distances from its trimmed shape."""

import numpy as np
from cadquery import Face
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location

# Largest angle in radians between neighbouring chords on a curved face.
ANGLE = 0.3


def tessellate(face: Face, deflection: float) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Points (N, 3) on the face and outward triangles (T, 3); exact on a plane, else within `deflection` metres.

    Raises
    ------
    ValueError
        If the kernel finds no triangle on the face.
    """
    BRepMesh_IncrementalMesh(face.wrapped, deflection, False, ANGLE, False)
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face.wrapped, location)
    if mesh is None:
        raise ValueError(f"the CAD kernel could not triangulate a face at {face.Center().toTuple()}")
    move = location.Transformation()
    nodes = (mesh.Node(i + 1).Transformed(move) for i in range(mesh.NbNodes()))
    points = np.array([[p.X(), p.Y(), p.Z()] for p in nodes])
    triangles = np.array([mesh.Triangle(i + 1).Get() for i in range(mesh.NbTriangles())], dtype=np.intp) - 1
    reversed_face = face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return points, triangles[:, ::-1] if reversed_face else triangles

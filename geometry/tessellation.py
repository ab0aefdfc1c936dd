"""Triangles on CAD faces: for sampling, for distances from trimmed faces and for STL files."""

from collections.abc import Sequence

import numpy as np
from cadquery import Face, Shape
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shape

FloatArray = NDArray[np.float64]

# Largest angle in radians between neighbouring chords on a curved face.
ANGLE = 0.3


def tessellate(face: Face, deflection: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points (N, 3) on the face and outward triangles (T, 3); exact on a plane, else within `deflection` metres.

    Raises
    ------
    ValueError
        If the kernel finds no triangle on the face.
    """
    alone = Face(_unmeshed(face))
    BRepMesh_IncrementalMesh(alone.wrapped, deflection, False, ANGLE, False)
    return _triangulation(alone)


def closed_triangles(solids: Sequence[Shape], deflection: float, angle: float) -> FloatArray:
    """Corners (T, 3, 3) of outward triangles on all faces, watertight, in single precision.

    Triangles that single precision makes degenerate (the kernel makes two at the apex of a nose) are left out.
    """
    corners = []
    for solid in solids:
        alone = Shape.cast(_unmeshed(solid))
        BRepMesh_IncrementalMesh(alone.wrapped, deflection, False, angle, False)
        for face in alone.Faces():
            points, triangles = _triangulation(face)
            corners.append(points.astype(np.float32).astype(np.float64)[triangles])
    found = np.concatenate(corners)
    distinct = np.all(np.any(found != np.roll(found, 1, axis=1), axis=2), axis=1)
    return np.asarray(found[distinct], dtype=np.float64)


def _unmeshed(shape: Shape) -> TopoDS_Shape:
    """A copy for the kernel to keep its triangles in: it would mix them with those of earlier calls."""
    return BRepBuilderAPI_Copy(shape.wrapped, False, False).Shape()


def _triangulation(face: Face) -> tuple[FloatArray, NDArray[np.intp]]:
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

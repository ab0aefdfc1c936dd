"""CAD shapes as triangles and in files."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from cadquery import Compound, Face, Shape
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_FormatVersion

from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.projection import coordinates
from sdm_deflect.geometry.sections import FloatArray

# Largest angle in radians between neighbouring chords on a curved face.
ANGLE = 0.3

# Chord error in metres and angle in radians of tessellated files.
STL_TOLERANCE = 1e-4
STL_ANGLE = 0.1

# Keeps the normal of a triangle without area zero instead of undefined.
TINY = 1e-300


def tessellate(face: Face, deflection: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points (N, 3) on the face and outward triangles (T, 3); exact on a plane, else within `deflection` metres.

    ValueError where the kernel finds no triangle on the face.
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
    """Points (N, 3) and outward triangles (T, 3) that the kernel keeps with a face."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face.wrapped, location)
    if mesh is None:
        raise ValueError(f"the CAD kernel could not triangulate a face at {face.Center().toTuple()}")
    move = location.Transformation()
    points = coordinates(mesh.Node(i + 1).Transformed(move) for i in range(mesh.NbNodes()))
    triangles = np.array([mesh.Triangle(i + 1).Get() for i in range(mesh.NbTriangles())], dtype=np.intp) - 1
    reversed_face = face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    return points, triangles[:, ::-1] if reversed_face else triangles


def write_brep(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes in the CAD kernel's own format, without triangles; several go into one compound, in order."""
    version = TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
    content = BytesIO()  # of a file, the kernel does not tell why it could not be written
    BRepTools.Write_s(_together(shapes).wrapped, content, False, False, version)
    path.write_bytes(content.getvalue())


def write_step(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes as STEP, in millimetres as the kernel assumes: 1 m in memory is 1000 mm in the file."""
    writer = STEPControl_Writer()
    writer.Transfer(_together(shapes).scale(1000.0).wrapped, STEPControl_AsIs)
    content = BytesIO()
    if writer.WriteStream(content) != IFSelect_RetDone:
        raise CadError(f"{path.name}: the CAD kernel cannot write this shape as STEP")
    path.write_bytes(content.getvalue())


def write_stl(shapes: Sequence[Shape], path: Path) -> None:
    """Write a watertight triangulation as binary STL, in metres."""
    corners = closed_triangles(shapes, STL_TOLERANCE, STL_ANGLE)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.zeros(len(corners), dtype=[("vectors", "<f4", (4, 3)), ("attribute", "<u2")])
    rows["vectors"][:, 0] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), TINY)
    rows["vectors"][:, 1:] = corners
    header = b"binary STL in metres".ljust(80) + np.uint32(len(rows)).astype("<u4").tobytes()
    path.write_bytes(header + rows.tobytes())


def _together(shapes: Sequence[Shape]) -> Shape:
    return shapes[0] if len(shapes) == 1 else Compound.makeCompound(shapes)

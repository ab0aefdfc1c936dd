"""CAD shapes as triangles and in files."""

from collections.abc import Mapping, Sequence
from colorsys import hsv_to_rgb
from io import BytesIO
from pathlib import Path

import numpy as np
from cadquery import Compound, Face, Shape
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy, BRepBuilderAPI_Transform
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.gp import gp_Trsf
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopLoc import TopLoc_Location
from OCP.TopTools import TopTools_FormatVersion
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool

from .parameters import FloatArray
from .projection import coordinates
from .quantity import CadError

# The faces of a solid by patch.
Named = Mapping[str, Sequence[Face]]

# Largest angle in radians between neighbouring chords on a curved face.
ANGLE = 0.3

# Chord error in metres and angle in radians of tessellated files.
STL_TOLERANCE = 1e-4
# Angle (rad) between neighbouring triangles of an STL.
STL_ANGLE = 0.1

FACET = """facet normal {:.9g} {:.9g} {:.9g}
  outer loop
    vertex {:.9g} {:.9g} {:.9g}
    vertex {:.9g} {:.9g} {:.9g}
    vertex {:.9g} {:.9g} {:.9g}
  endloop
endfacet
"""

# Between the hues of two patches, as a share of the circle: the golden ratio.
GOLDEN = 0.618034

# Keeps the normal of a triangle without area zero instead of undefined.
TINY = 1e-300


def tessellate(face: Face, deflection: float) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return points (N, 3) on the face and outward triangles (T, 3); exact on a plane, else within `deflection` metres.

    ValueError if the kernel finds no triangle on the face.
    """
    alone = Face(BRepBuilderAPI_Copy(face.wrapped, False, False).Shape())  # which holds no triangles of earlier calls
    BRepMesh_IncrementalMesh(alone.wrapped, deflection, False, ANGLE, False)
    return _triangulation(alone)


def closed_triangles(solid: Shape, faces: Named, deflection: float, angle: float) -> dict[str, FloatArray]:
    """Return corners (T, 3, 3) of outward triangles of each patch, watertight together, in single precision.

    Triangles that single precision makes degenerate (the kernel makes two at the apex of a nose) are left out.
    """
    copied = BRepBuilderAPI_Copy(solid.wrapped, False, False)
    BRepMesh_IncrementalMesh(copied.Shape(), deflection, False, angle, False)
    found = {}
    for name, patch_faces in faces.items():
        corners = []
        for face in patch_faces:
            same = copied.ModifiedShape(face.wrapped).Oriented(face.wrapped.Orientation())
            points, triangles = _triangulation(Face(same))
            corners.append(points.astype(np.float32).astype(np.float64)[triangles])
        some = np.concatenate(corners)
        found[name] = some[np.all(np.any(some != np.roll(some, 1, axis=1), axis=2), axis=1)]
    return found


def _triangulation(face: Face) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return points (N, 3) and outward triangles (T, 3) that the kernel stores with a face."""
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
    shape = shapes[0] if len(shapes) == 1 else Compound.makeCompound(shapes)
    BRepTools.Write_s(shape.wrapped, content, False, False, version)
    path.write_bytes(content.getvalue())


def write_step(solid: Shape, faces: Named, path: Path) -> None:
    """Write a solid as STEP with the name and a colour of its patch on each face, in millimetres: 1 m is 1000 mm."""
    scale = gp_Trsf()
    scale.SetScaleFactor(1000.0)
    scaled = BRepBuilderAPI_Transform(solid.wrapped, scale, True)
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    body = shapes.AddShape(scaled.Shape(), False)
    TDataStd_Name.Set_s(body, TCollection_ExtendedString("sdm"))
    for number, (name, patch_faces) in enumerate(faces.items()):
        for face in patch_faces:
            label = shapes.AddSubShape(body, scaled.ModifiedShape(face.wrapped))
            TDataStd_Name.Set_s(label, TCollection_ExtendedString(name))
            colours.SetColor(label, _colour(number), XCAFDoc_ColorType.XCAFDoc_ColorSurf)
    writer, content = STEPCAFControl_Writer(), BytesIO()  # of a file, the kernel does not tell why it cannot write it
    Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    if not writer.Transfer(document) or writer.WriteStream(content) != IFSelect_RetDone:
        raise CadError(f"{path.name}: the CAD kernel cannot write this shape as STEP")
    path.write_bytes(content.getvalue())


def write_stl(solid: Shape, faces: Named, path: Path) -> None:
    """Write a triangulation as ASCII STL in metres: one named solid for each patch, watertight together."""
    with path.open("w", encoding="ascii") as out:
        for name, corners in closed_triangles(solid, faces, STL_TOLERANCE, STL_ANGLE).items():
            out.write(f"solid {name}\n")
            out.writelines(FACET.format(*row) for row in np.hstack([_normals(corners), corners.reshape(-1, 9)]))
            out.write(f"endsolid {name}\n")


def write_binary_stl(solid: Shape, faces: Named, path: Path) -> None:
    """Write the triangulation as binary STL, which cannot hold names."""
    corners = np.concatenate([*closed_triangles(solid, faces, STL_TOLERANCE, STL_ANGLE).values()])
    rows = np.zeros(len(corners), dtype=[("vectors", "<f4", (4, 3)), ("attribute", "<u2")])
    rows["vectors"][:, 0] = _normals(corners)
    rows["vectors"][:, 1:] = corners
    header = b"binary STL in metres".ljust(80) + np.uint32(len(rows)).astype("<u4").tobytes()
    path.write_bytes(header + rows.tobytes())


def _normals(corners: FloatArray) -> FloatArray:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), TINY))


def _colour(number: int) -> Quantity_Color:
    """Return a colour for the patch of a number, far from the colours of neighbouring numbers."""
    red, green, blue = hsv_to_rgb(number * GOLDEN % 1.0, 0.5, 0.9)
    return Quantity_Color(red, green, blue, Quantity_TypeOfColor.Quantity_TOC_sRGB)

"""Writing CAD shapes to files that appear whole or not at all."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from cadquery import Compound, Shape
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TopTools import TopTools_FormatVersion

from sdm_deflect.geometry.tessellation import closed_triangles

Writer = Callable[[Sequence[Shape], Path], None]

# Chord error in metres and angle in radians of tessellated files.
STL_TOLERANCE = 1e-4
STL_ANGLE = 0.1

# Keeps the normal of a triangle without area zero instead of undefined.
TINY = 1e-300


def write_atomically(path: Path, writer: Writer, shapes: Sequence[Shape]) -> None:
    """Let `writer` fill a file beside `path`, then rename it; OSError where the folder cannot be written."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        unfinished = Path(folder) / path.name
        writer(shapes, unfinished)
        unfinished.replace(path)


def write_brep(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes in the CAD kernel's own format, without triangles; several go into one compound, in order."""
    version = TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1
    if not BRepTools.Write_s(_together(shapes).wrapped, str(path), False, False, version):
        raise OSError(f"cannot write {path}")


def write_step(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes as STEP, in millimetres as the kernel assumes: 1 m in memory is 1000 mm in the file."""
    writer = STEPControl_Writer()
    writer.Transfer(_together(shapes).scale(1000.0).wrapped, STEPControl_AsIs)
    if writer.Write(str(path)) != IFSelect_RetDone:
        raise OSError(f"cannot write {path}")


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

"""Writing CAD shapes to files that appear whole or not at all."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from cadquery import Compound, Shape
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.IFSelect import IFSelect_RetDone
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.StlAPI import StlAPI_Writer

Writer = Callable[[Sequence[Shape], Path], None]

# Chord error in metres and angle in radians of tessellated files.
STL_TOLERANCE = 1e-4
STL_ANGLE = 0.1


def write_atomically(path: Path, writer: Writer, shapes: Sequence[Shape]) -> None:
    """Let `writer` fill a file beside `path`, then rename it; OSError where the folder cannot be written."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        unfinished = Path(folder) / path.name
        writer(shapes, unfinished)
        unfinished.replace(path)


def write_brep(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes in the CAD kernel's own format; several go into one compound, in order."""
    if not BRepTools.Write_s(_together(shapes).wrapped, str(path)):
        raise OSError(f"cannot write {path}")


def write_step(shapes: Sequence[Shape], path: Path) -> None:
    """Write shapes as STEP, in millimetres as the kernel assumes: 1 m in memory is 1000 mm in the file."""
    writer = STEPControl_Writer()
    writer.Transfer(_together(shapes).scale(1000.0).wrapped, STEPControl_AsIs)
    if writer.Write(str(path)) != IFSelect_RetDone:
        raise OSError(f"cannot write {path}")


def write_stl(shapes: Sequence[Shape], path: Path) -> None:
    """Write a watertight triangulation as binary STL, in metres."""
    shape = _together(shapes).wrapped
    BRepMesh_IncrementalMesh(shape, STL_TOLERANCE, False, STL_ANGLE, False)
    writer = StlAPI_Writer()
    writer.ASCIIMode = False
    if not writer.Write(shape, str(path)):
        raise OSError(f"cannot write {path}")


def _together(shapes: Sequence[Shape]) -> Shape:
    return shapes[0] if len(shapes) == 1 else Compound.makeCompound(shapes)

"""SU2 meshes (.su2) in two and three dimensions."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh, Polyhedra
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files.staged import fresh
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points, fitting_names
from sdm_deflect.meshing.formats.numbers import Placed, with_numbers
from sdm_deflect.meshing.formats.periodic import unwritten
from sdm_deflect.meshing.formats.polyhedra import standard_cells
from sdm_deflect.meshing.formats.shapes import simple_faces
from sdm_deflect.meshing.formats.su2_read import CHUNK, FACES, PARALLEL, SOLIDS, Su2File, read_zones
from sdm_deflect.meshing.formats.zones import part

NUMBERS = {shape: number for number, shape in (SOLIDS | FACES | {3: "line"}).items()}
ROWS = 1 << 15
"""Lines written at a time."""
UNFIT = r"[\s(),%=]"
"""SU2 drops blanks, and its lists of markers are separated by commas and parentheses."""


@dataclass(frozen=True, slots=True)
class Su2:
    """Text with one line for each point, cell and boundary face; markers by name, several zones in one file.

    Points of other processes (markers SEND_RECEIVE), free-form boxes, periodic data and comments are no part of the
    mesh; a rewritten file keeps them. Cells are one block of each shape, in the file's order within the shape.
    """

    name: str = "su2"
    suffixes: tuple[str, ...] = (".su2",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        with about(path), path.open("rb") as file:
            return read_zones(Su2File.opened(file, partial(progress, f"reading {path.name}")))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        return DOUBLE

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; each coordinate that changed is written with as many digits as it needs."""
        with fresh(out, source) as beside, about(source), source.open("rb") as file, beside.open("wb") as copy:
            copy_moved(Su2File.opened(file, partial(progress, f"writing {out.name}")), points, copy)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; polyhedra that are no usual cells, or faces of five corners, are a MeshFileError."""
        with fresh(out) as beside, about(out), beside.open("wb") as file:
            usual = replace(mesh, cells=standard_cells(mesh))
            renamed = write_mesh(usual, file, partial(progress, f"writing {out.name}"))
        lost = [f"patch {old} is marker {new}" for old, new in renamed.items()]
        if len(mesh.zones) > 1:
            lost.append("SU2 numbers its zones; the names " + ", ".join(z.name for z in mesh.zones) + " are lost")
        if mesh.plane and mesh.points[:, 2].any():
            lost.append(f"SU2 has no z in a plane mesh; z = {mesh.points[0, 2]:g} is lost")
        return (*lost, *unwritten(mesh.periodic))


def copy_moved(source: Su2File, points: FloatArray, out: BinaryIO) -> None:
    """Copy a file with coordinates `points` (N, 3): only the characters of changed coordinates differ.

    MeshFileError or ValueError if the file is damaged, or has another number of points.
    """
    tables = [section for section in source.sections if section.keyword == "NPOIN"]
    check_points(points, sum(section.count for section in tables))
    at = start = 0
    for section in tables:
        _copy(source.file, at, section.begin, out)
        for text, table in source.points(section):
            own = points[start : start + len(table.values), : source.dimension]
            out.write(_moved(text, table, own))
            start += len(table.values)
        at = section.end
    _copy(source.file, at, source.sections[-1].end, out)


def write_mesh(mesh: Mesh, out: BinaryIO, report: Callable[[float], None]) -> dict[str, str]:
    """Write a mesh of shapes that SU2 has; return the markers of patches whose names SU2 cannot read.

    MeshFileError if it has polyhedra, or boundary faces of more than four corners.
    """
    if len(mesh.zones) > 1:
        out.write(b"NZONE= %d\n" % len(mesh.zones))
    renamed: dict[str, str] = {}
    for i, zone in enumerate(mesh.zones):
        if len(mesh.zones) > 1:
            out.write(b"IZONE= %d\n" % (i + 1))
        own = part(mesh, zone)
        names = fitting_names([patch.name for patch in own.patches], UNFIT, (PARALLEL,))
        renamed |= {name: marker for name, marker in names.items() if name != marker}
        for text, done in _zone(own, names):
            out.write(text.encode())
            report((i + done) / len(mesh.zones))
    return renamed


def _copy(file: BufferedReader, begin: int, end: int, out: BinaryIO) -> None:
    file.seek(begin)
    piece = memoryview(bytearray(min(CHUNK, end - begin)))
    while count := file.readinto(piece[: end - begin]):
        out.write(piece[:count])
        begin += count


def _moved(text: bytes, table: Placed, points: FloatArray) -> bytes:
    changed = table.values[: len(points)] != points
    if not changed.any():
        return text
    begin, end = (each[: len(points)][changed] for each in (table.begin, table.end))
    return with_numbers(text, begin, end, points[changed])


def _zone(mesh: Mesh, names: dict[str, str]) -> Iterator[tuple[str, float]]:
    """Text of one zone, and the fraction of it that is written."""
    dimension = 2 if mesh.plane else 3
    yield f"NDIME= {dimension}\nNELEM= {sum(len(block) for block in mesh.cells)}\n", 0.0
    number = 0
    for block in mesh.cells:
        if isinstance(block, Polyhedra):
            raise MeshFileError(f"SU2 holds no polyhedra, and the mesh has {len(block)}")
        yield from ((text, 0.7) for text in table(f"{NUMBERS[block.shape]}", block.nodes, number))
        number += len(block)
    yield f"NPOIN= {len(mesh.points)}\n", 0.7
    yield from ((text, 0.9) for text in table("", mesh.points[:, :dimension], 0))
    yield f"NMARK= {len(mesh.patches)}\n", 0.9
    for patch in mesh.patches:
        yield f"MARKER_TAG= {names[patch.name]}\nMARKER_ELEMS= {len(patch)}\n", 0.9
        for block in simple_faces(patch):
            yield from ((text, 0.9) for text in table(f"{NUMBERS[block.shape]}", block.nodes, None))
    yield "", 1.0


def table(prefix: str, rows: FloatArray | IntArray, number: int | None) -> Iterator[str]:
    """Lines of a prefix, the rows' values (floats so that they read back exactly), and the row's number if wanted."""
    words = [prefix] * bool(prefix) + ["%r"] * rows.shape[1] + ["%d"] * (number is not None)
    line = " ".join(words) + "\n"
    width = line.count("%")
    for start in range(0, len(rows), ROWS):
        own = rows[start : start + ROWS]
        values: list[float] = [0] * (width * len(own))
        for i, column in enumerate(own.T):
            values[i::width] = column.tolist()
        if number is not None:
            values[width - 1 :: width] = range(number + start, number + start + len(own))
        yield (line * len(own)) % tuple(values)

"""SU2 meshes (.su2) in two and three dimensions."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import short_list
from sdm_deflect.deform.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.deform.mesh.cells import Polyhedra, Zone
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files import fresh

from .format import MeshFileError, about, check_points, fitting_names
from .known import registered
from .layout import Format, whole
from .numbers import copy_text, table
from .shapes import simple_faces
from .su2_read import FACES, PARALLEL, SOLIDS, KeywordBlock, Su2File, notes_of, patches_of, points_of, zone_of, zones_of
from .table_pieces import TablePieces

NUMBERS = {shape: number for number, shape in (SOLIDS | FACES | {3: "line"}).items()}
UNFIT = r"[\s(),%=]"
"""SU2 drops blanks, and its lists of markers are separated by commas and parentheses."""


@registered("su2", ".su2")
class Su2(Format):
    """Text with one line for each point, cell and boundary face; markers by name, several zones in one file.

    Points of other processes (markers SEND_RECEIVE), free-form boxes, periodic data and comments are no part of the
    mesh; a rewritten file keeps them. Cells are one block of each shape, in the file's order within the shape.
    """

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshInPieces | None:
        """See `Format.layout`; None for a plane mesh, and for several zones."""
        with about(path), path.open("rb") as file:
            source = Su2File.opened(file, partial(progress, f"reading {path.name}"))
            zones = zones_of(source.sections)
            if source.dimension != 3 or len(zones) > 1:
                return None
            return _layout(path.resolve(), source, *zones.popitem(), scratch)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        with about(path), path.open("rb") as file:
            source = Su2File.opened(file, partial(progress, f"reading {path.name}"))
            zones = zones_of(source.sections)
            parts = [whole(_layout(path, source, name, own), lambda _: None) for name, own in zones.items()]
            if len(parts) == 1:
                return parts[0]
            from .zones import joined

            return replace(joined(list(zones), parts), notes=notes_of(source.sections))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        return DOUBLE

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; each coordinate that changed is written with as many digits as it needs."""
        with fresh(out, source) as beside, about(source), source.open("rb") as file, beside.open("wb") as copy:
            text = Su2File.opened(file, partial(progress, f"writing {out.name}"))
            sections = _points(text)
            check_points(points, sum(section.count for section in sections))
            copy_text(file, text.placed(sections), points[:, : text.dimension].ravel(), copy)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; polyhedra that are no usual cells, or faces of five corners, are a MeshFileError."""
        from .polyhedra import standard_cells
        from .zones import unwritten

        with fresh(out) as beside, about(out), beside.open("wb") as file:
            usual = replace(mesh, cells=standard_cells(mesh))
            renamed = write_mesh(usual, file, partial(progress, f"writing {out.name}"))
        lost = [f"patch {old} is marker {new}" for old, new in renamed.items()]
        if len(mesh.zones) > 1:
            lost.append("SU2 numbers its zones; the names " + short_list(z.name for z in mesh.zones) + " are lost")
        if mesh.plane and mesh.points[:, 2].any():
            lost.append(f"SU2 has no z in a plane mesh; z = {mesh.points[0, 2]:g} is lost")
        return (*lost, *unwritten(mesh.periodic))


class Su2Pieces(TablePieces):
    """See `Pieces`: the numbers are in tables beside the text, which alone is needed for writing."""

    __slots__ = ()

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        source = Path(self.source)
        with about(source), source.open("rb") as file:
            text = Su2File.opened(file, lambda _: None)
            everything = points_of(text, _points(text))
        everything[nodes] = points
        Su2().rewrite(source, everything, out, progress)


def _layout(
    path: Path, source: Su2File, name: str, own: Sequence[KeywordBlock], scratch: Path | None = None
) -> MeshInPieces:
    """Return a zone of a file.

    MeshFileError or ValueError if a section is missing, damaged or contradicts another.
    """
    found = zone_of(source, own, scratch)
    pieces = Su2Pieces(str(path), found.points, found.ranges, found.cells)
    patches = patches_of(source, own, found.points)
    return MeshInPieces(path.name, pieces, patches, (Zone(name, 0, found.points),), notes_of(source.sections))


def _points(source: Su2File) -> list[KeywordBlock]:
    return [section for section in source.sections if section.keyword == "NPOIN"]


def write_mesh(mesh: Mesh, out: BinaryIO, report: Callable[[float], None]) -> dict[str, str]:
    """Write a mesh of shapes that SU2 has; return the markers of patches whose names SU2 cannot read.

    MeshFileError if it has polyhedra, or boundary faces of more than four corners.
    """
    from .zones import part

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

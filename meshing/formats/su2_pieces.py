"""SU2 files in pieces: their text is read once, and its numbers are put into tables on the disk."""

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, Zone
from sdm_deflect.deform.mesh.pieces import HERE, MeshInPieces, Runner
from sdm_deflect.meshing.files.staged import written
from sdm_deflect.meshing.formats.format import MeshFileError, about
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.formats.su2_read import (
    CHUNK,
    SOLIDS,
    Section,
    Su2File,
    notes_of,
    only,
    patches_of,
    points_of,
    zones_of,
)
from sdm_deflect.meshing.formats.tables import CellTable, PointRange, Table, TablePieces


class Su2Pieces(TablePieces):
    """See `Pieces`: the numbers are in tables beside the text, which alone is needed for writing."""

    __slots__ = ()

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """See `Pieces.rewrite`."""
        source = Path(self.source)
        with about(source), source.open("rb") as file:
            everything = points_of(*_points(Su2File.opened(file, lambda _: None)))
        everything[nodes] = points
        Su2().rewrite(source, everything, out, progress)


def in_pieces(path: Path, scratch: Path, progress: Progress = silent) -> MeshInPieces | None:
    """Return a mesh of one zone in space, with tables in an empty folder `scratch`; None for others.

    Errors are those of `read_zones`, or a MeshFileError if the tables cannot be written.
    """
    with about(path), path.open("rb") as file:
        source = Su2File.opened(file, partial(progress, f"reading {path.name}"))
        zones = zones_of(source.sections)
        if source.dimension != 3 or len(zones) > 1:
            return None
        ((name, own),) = zones.items()
        points = points_of(*_points(source))
        place = Table(scratch / "points", 0, points.dtype.str, len(points), 3)
        with written(scratch):
            points.tofile(place.path)
        cells = _tables(source, only(own, "NELEM"), len(points), scratch)
        pieces = Su2Pieces(str(path.resolve()), len(points), (PointRange(0, len(points), (place,)),), cells)
        patches = patches_of(source, own, len(points))
        zone = Zone(name, 0, len(points))
        return MeshInPieces(path.resolve().name, pieces.oriented(), patches, (zone,), notes_of(source.sections))


def points_of_copy(source: Path, copy: Path) -> FloatArray:
    """Return the points (N, 3) of a copy of a file; MeshFileError if another byte of it is not that of the source.

    Its cells are those of the source, then, and need not be made numbers of again.
    """
    with about(copy), copy.open("rb") as new, source.open("rb") as old:
        own, other = (Su2File.opened(file, lambda _: None) for file in (new, old))
        ends = [_around(one) for one in (own, other)]
        for (begin, end), (first, last) in zip(*ends, strict=True):
            if not _same(new, old, begin, first, max(end - begin, last - first)):
                raise MeshFileError("its text is other than that of the source, not in its points alone")
        return points_of(*_points(own))


def _around(source: Su2File) -> list[tuple[int, int]]:
    """Return the bytes before and after the points."""
    _, section = _points(source)
    return [(0, section.begin), (section.end, source.sections[-1].end)]


def _same(one: BinaryIO, other: BinaryIO, begin: int, first: int, size: int) -> bool:
    one.seek(begin)
    other.seek(first)
    return all(one.read(min(CHUNK, size - at)) == other.read(min(CHUNK, size - at)) for at in range(0, size, CHUNK))


def _points(source: Su2File) -> tuple[Su2File, Section]:
    (own,) = zones_of(source.sections).values()
    return source, only(own, "NPOIN")


def _tables(source: Su2File, section: Section, points: int, scratch: Path) -> tuple[CellTable, ...]:
    """Put the nodes of cells into a file for each shape, in the order in which shapes first appear."""
    kind = np.dtype(np.int32 if points <= np.iinfo(np.int32).max else np.int64)
    counts: dict[str, int] = {}
    with ExitStack() as stack:
        files = {}
        for shape, nodes in source.elements(section, SOLIDS, points):
            with written(scratch):
                if shape not in files:
                    files[shape] = stack.enter_context((scratch / shape).open("wb"))
                files[shape].write(nodes.astype(kind).tobytes())
            counts[shape] = counts.get(shape, 0) + len(nodes)
    return tuple(
        CellTable(shape, Table(scratch / shape, 0, kind.str, count, CORNERS[shape]), 0)
        for shape, count in counts.items()
    )

"""What a mesh format is: the layout of its files, and what follows from that."""

import re
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about, check_points, only_rewritten
from sdm_deflect.meshing.mesh.cells import PLANE, Cells, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.precision import DOUBLE

from .conforming_zones import simple, true_shapes
from .coordinates import ByteColumns, Coordinates
from .shapes import check_faces, orient
from .table_pieces import ROWS, TablePieces


class Format:
    """Reads, rewrites and writes the files of one format.

    A format defines where the numbers of a file are (`layout`), and how a mesh is written (`write`). The rest follows;
    formats without tables of numbers override it.

    Attributes
    ----------
    name : its name, such as ``"su2"``; `REGISTERED` repeats this and the next two.
    suffixes : the suffixes of its files, such as ``(".su2",)``.
    written : whether a mesh from elsewhere can be written; else files can only be rewritten.
    folder : whether a mesh is a folder.
    zoned : whether a file can hold zones that do not fit together.
    for_workers : describes the files of which other processes can read parts; empty if there are none.
    """

    name: ClassVar[str] = ""
    suffixes: ClassVar[tuple[str, ...]] = ()
    written: ClassVar[bool] = True
    folder: ClassVar[bool] = False
    zoned: ClassVar[bool] = False
    for_workers: ClassVar[str] = ""

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        """Return a mesh whose boundary is read, and the places of its points and cells in the file.

        Parameters
        ----------
        path : The file.
        scratch : An empty folder for tables of the numbers that stand in the file as text, because the mesh may be
            larger than memory. None: these tables may be in memory.
        progress : Called with what is being done.

        Returns None where the file must be read as a whole. MeshFileError if it is damaged.
        """
        return None

    def coordinates(self, path: Path) -> Coordinates:
        """Return where the coordinates are in the file; reads less than `layout` where possible."""
        mesh = self.layout(path)
        assert mesh is not None
        assert isinstance(mesh.pieces, TablePieces)
        return ByteColumns(mesh.pieces)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """Return the mesh in a file, with all of its layout's tables read into arrays.

        Raises MeshFileError if the file is missing, truncated, damaged, or not of this format.
        """
        with about(path):
            mesh = self.layout(path, None, progress)
            assert mesh is not None
            return whole(mesh, partial(progress, f"reading {path.name}"))

    def points(self, path: Path, progress: Progress = silent) -> tuple[FloatArray, tuple[Zone, ...]]:
        """Return the points (N, 3) of a mesh and its zones; reads cells only if necessary."""
        with about(path):
            layout = self.layout(path, None, progress)
        if layout is None:
            mesh = self.read(path, progress)
            return mesh.points, mesh.zones
        return layout.pieces.coordinates(0, layout.pieces.points), layout.zones

    def read_copy(self, path: Path, source: Path) -> Mesh:
        """Return the mesh in a copy of a file; files beside the source, such as names, count for the copy."""
        return self.read(path)

    def points_of_copy(self, path: Path, source: Path) -> FloatArray | None:
        """Return the points (N, 3) of a copy of a file of text that was read in pieces.

        None for other formats. MeshFileError if something besides the points differs.
        """
        return None

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """Return the type of the coordinates in a new file `out`: a copy of `source`, or a mesh from elsewhere.

        Of several types the one with the fewest bits counts. Numbers in text have all digits that they need.
        """
        if source is None:
            return DOUBLE
        with about(source):
            return self.coordinates(source).kind

    def finer(self, out: Path, mesh: Mesh) -> str:
        """Return the suffix of a file that keeps more digits of a mesh than `out` does."""
        return ".cgns"

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """Write a copy of the file `source` with coordinates `points` (N, 3); all other bytes stay.

        `out` appears whole or not at all, and is never `source`. Coordinates that did not change keep their bytes.
        """
        with about(source):
            stored = self.coordinates(source)
            check_points(points, stored.count)
        stored.copy(points, out, progress)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """Write a mesh that came from elsewhere; return a sentence for each thing that the format cannot hold."""
        raise only_rewritten(out)

    def write_moved(self, mesh: Mesh, points: FloatArray, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """Write a mesh that came from elsewhere with its points moved to `points` (N, 3)."""
        return self.write(mesh.with_points(points), out, progress)

    def files(self, path: Path) -> Iterable[Path]:
        """Return every file that is read for a mesh."""
        return (path,)

    def size(self, path: Path) -> int:
        """Return the size of a mesh's files in bytes."""
        return path.stat().st_size

    def holds(self, path: Path) -> bool:
        """Return whether a file of any name has the content of this format; False if its content does not show it."""
        return False

    def place(self, path: Path) -> Path:
        """Return the file, or the folder, that a path means."""
        return path

    def ending(self, path: Path) -> str:
        """Return the suffix of a file, with a word before it that belongs to the suffix."""
        return path.suffix

    def name_files(self, path: Path) -> tuple[Path, ...]:
        """Return the files beside a mesh that name its patches, and are written with it."""
        return ()

    def check_named(self, mesh: Mesh, out: Path) -> None:
        """Raise MeshFileError if a file of names beside `out` has other names than this mesh."""

    def named_otherwise(self, source: Path, out: Path) -> bool:
        """Return whether a file of names beside `out` differs from that beside `source`."""
        return False


def whole(mesh: MeshOnDisk, report: Callable[[float], None]) -> Mesh:
    """Return a mesh with all its points and cells in memory.

    Raises MeshFileError for indices of missing points, for a face of no cell, and for a mesh without cells.
    """
    pieces = mesh.pieces
    assert isinstance(pieces, TablePieces)
    total, done = max(1, pieces.points + sum(count for _, count in pieces.blocks)), 0

    def passed(count: int) -> None:
        nonlocal done
        done += count
        report(done / total)

    points, blocks = np.empty((pieces.points, 3)), []
    for start in range(0, len(points), ROWS):
        pieces.coordinates_into(points[start : start + ROWS], start)
        passed(len(points[start : start + ROWS]))
    for table in pieces.cells:
        for cells in true_shapes(Cells(table.shape, table.everything(len(points), passed))):
            blocks.append(orient(points, cells) if cells.shape in PLANE else cells)
    patches = tuple(replace(patch, faces=tuple(simple(patch.faces))) for patch in mesh.patches)
    complete = Mesh(points, tuple(blocks), patches, mesh.zones, notes=mesh.notes, periodic=mesh.periodic)
    check_faces(complete)
    return complete


def fitting_names(names: Sequence[str], unfit: str, reserved: Container[str] = ()) -> dict[str, str]:
    """Return the name of each patch in a file: its own if nothing in it matches `unfit`, else a new one."""
    fitted: dict[str, str] = {}
    for name in names:
        fitting = re.sub(unfit, "_", name) or "_"
        while fitting in reserved or (fitting != name and (fitting in names or fitting in fitted.values())):
            fitting += "_"
        fitted[name] = fitting
    return fitted

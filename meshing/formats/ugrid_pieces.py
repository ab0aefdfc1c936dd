"""Binary UGRID files read in pieces: they store every number as it is."""

from dataclasses import dataclass
from pathlib import Path

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Zone
from sdm_deflect.deform.mesh.pieces import HERE, MeshInPieces, Runner
from sdm_deflect.meshing.formats.format import about
from sdm_deflect.meshing.formats.tables import CellTable, PointRange, Table, TablePieces
from sdm_deflect.meshing.formats.ugrid import (
    FACES,
    SOLIDS,
    TO_VTK,
    count_from_zero,
    names_copied,
    patches,
    surface_names,
)
from sdm_deflect.meshing.formats.ugrid_file import ENCODINGS, POINTS, SURFACE, UgridFile, encoding_of


@dataclass(frozen=True, slots=True)
class UgridPieces(TablePieces):
    """See `Pieces`; a copy comes with the names of its surfaces, which are beside the file as it was `given`."""

    given: Path

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """See `Pieces.rewrite`; MeshFileError as for `Ugrid.rewrite`."""
        with names_copied(self.given, out):
            TablePieces.rewrite(self, nodes, points, out, progress, runner)


def in_pieces(path: Path) -> MeshInPieces | None:
    """Return the mesh of a file; None if it is text.

    MeshFileError if the file, or its ``.mapbc``, is damaged.
    """
    if not encoding_of(path):
        return None
    with about(path):
        tables = _tables(path.resolve(), encoding_of(path))
        count = tables[POINTS].rows
        stored = {name: tables[name].integers() for name in (*FACES, SURFACE)}
        for shape in FACES:
            count_from_zero(stored[shape], shape, count)
        border = patches(stored, surface_names(path))
        cells = tuple(CellTable(name, tables[name], 1, TO_VTK.get(name, ())) for name in SOLIDS if tables[name].rows)
        points = (PointRange(0, count, (tables[POINTS],)),)
        pieces = UgridPieces(str(path.resolve()), count, points, cells, path.absolute()).oriented()
    return MeshInPieces(path.resolve().name, pieces, border, (Zone("", 0, count),))


def _tables(path: Path, encoding: str) -> dict[str, Table]:
    """Return the table of each array."""
    own = ENCODINGS[encoding]
    with path.open("rb") as file:
        shapes = UgridFile.opened(file, encoding, lambda _: None).shapes
    found, begin = {}, own.begin
    for name, (rows, width) in shapes.items():
        found[name] = Table(path, begin, own.kind(name).str, rows, width)
        begin += rows * found[name].step
    return found

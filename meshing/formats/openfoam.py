"""OpenFOAM cases: the mesh in the folder ``constant/polyMesh``."""

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.cells import Polyhedra, Zone
from sdm_deflect.deform.mesh.mesh import Mesh, MeshInPieces
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files import fresh_folder
from sdm_deflect.meshing.formats.format import about, fewest_bits
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.openfoam_case import (
    case_copied,
    case_folder,
    mesh_folder,
    meshes_beside,
    move_points,
    patches_of,
    points_folder,
    stored,
)
from sdm_deflect.meshing.formats.openfoam_files import HEAD, MESH, faces, headed, labels, parse, vectors
from sdm_deflect.meshing.formats.openfoam_pairs import pairs_of
from sdm_deflect.meshing.formats.openfoam_pieces import in_pieces
from sdm_deflect.meshing.formats.openfoam_write import BARE, write_files, write_mesh
from sdm_deflect.meshing.formats.polyhedra import check_cells
from sdm_deflect.meshing.formats.shapes import refuse_plane


@registered("openfoam", ".foam")
class OpenFoam(Format):
    """A case folder, its folder ``polyMesh``, or a file such as ``case.foam`` in the case folder.

    Cells are polyhedra, patches are polygons. Files may be text or binary (labels of 32 or 64 bits) and packed
    (.gz). Of the types of patches the mesh has those that bind nodes, see `openfoam_pairs`; zones and sets are no part
    of it. A rewritten case keeps them, as it keeps every file but `points`; only the parts of a decomposed case
    (``processor0`` and so on) are not copied. Meshes of time folders are not looked at. Output is a folder that must
    not exist, or be empty.
    """

    folder = True
    for_workers = "OpenFOAM cases in binary"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshInPieces | None:
        """See `Format.layout`."""
        return in_pieces(path)

    def files(self, path: Path) -> list[Path]:
        """See `Format.files`: those in the folder of a case's mesh."""
        return [file for file in sorted(mesh_folder(path).iterdir()) if file.is_file()]

    def size(self, path: Path) -> int:
        """See `Format.size`."""
        lists = ("points", "faces", "owner", "neighbour")
        return sum(file.stat().st_size for name in lists for file in mesh_folder(path).glob(f"{name}*"))

    def place(self, path: Path) -> Path:
        """See `Format.place`: the folder of a case."""
        return case_folder(path)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        folder = mesh_folder(path)
        points = stored(folder, "points", vectors).values
        progress("reading faces", 0.3)
        polygons, owner = stored(folder, "faces", faces), stored(folder, "owner", labels)
        neighbour = stored(folder, "neighbour", labels)[: len(owner)]
        progress("reading patches", 0.8)
        patches = stored(folder, "boundary", lambda file: parse(file.text()))
        with about(folder):
            cells = Polyhedra(polygons, owner, neighbour[neighbour >= 0])
            check_cells(cells)
            named = patches_of(patches, len(polygons), len(cells.neighbour), polygons.rows)
            mesh = Mesh(points, (cells,), named, notes=meshes_beside(case_folder(path)))
            return replace(mesh, periodic=pairs_of(patches, named, lambda nodes: points[nodes]))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        if source is None:
            return DOUBLE
        plain = points_folder(source) / "points"
        with about(plain), plain.open("rb") if plain.is_file() else gzip.open(f"{plain}.gz") as file:
            head = headed(file.read(HEAD), plain.name, HEAD)
        return fewest_bits([head.kind("scalar")] if head.binary else [])

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; `out` is a copy of the case (of the folder ``polyMesh`` if `source` is one)."""
        with case_copied(source, out, progress) as mesh:
            move_points(mesh_folder(source), mesh, points)

    def points(self, path: Path, progress: Progress = silent) -> tuple[FloatArray, tuple[Zone, ...]]:
        """See `Format.points`; `path` may be a part of a decomposed case."""
        return stored(points_folder(path), "points", vectors).values, ()

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; types of patches follow from their names, the case can be read by checkMesh.

        A name that begins with ``sym`` is a plane of symmetry; one with ``far``, ``inlet``, ``outlet``,
        ``chimera`` or ``overset`` in it a ``patch``; all others are walls.
        """
        refuse_plane(mesh, "OpenFOAM")
        with fresh_folder(case_folder(out)) as beside, about(out):
            progress(f"writing {out.name}", 0.0)
            lost = write_mesh(mesh, beside / MESH)
            write_files(beside, BARE)
            (beside / "case.foam").touch()
        return lost

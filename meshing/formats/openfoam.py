"""OpenFOAM cases: the mesh in the folder ``constant/polyMesh``."""

import gzip
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from sdm_deflect.deform.mesh import Mesh, Patch, Polyhedra
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.meshing.files import copied, fresh_folder
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.openfoam_files import FoamFile, faces, labels, open_foam, parse, vectors
from sdm_deflect.meshing.formats.openfoam_write import write_mesh, write_system
from sdm_deflect.meshing.formats.polyhedra import check_cells
from sdm_deflect.meshing.formats.shapes import refuse_plane
from sdm_deflect.meshing.mesh import FloatArray

MESH = Path("constant", "polyMesh")
Read = TypeVar("Read")
STALE = ("processor*",)
"""Parts of a decomposed case: their meshes would be the old ones, so they are not copied."""


@dataclass(frozen=True, slots=True)
class OpenFoam:
    """A case folder, its folder ``polyMesh``, or a file such as ``case.foam`` in the case folder.

    Cells are polyhedra, patches are polygons. Files may be text or binary (labels of 32 or 64 bits) and packed
    (.gz). Types of patches, zones and sets are no part of the mesh; a rewritten case keeps them, as it keeps every
    file but `points`; only the parts of a decomposed case (``processor0`` and so on) are not copied. Meshes of time
    folders are not looked at. Output is a folder that must not exist, or be empty.
    """

    name: str = "openfoam"
    suffixes: tuple[str, ...] = (".foam",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        folder = mesh_folder(path)
        points = _stored(folder, "points", vectors).values
        progress("reading faces", 0.3)
        polygons, owner = _stored(folder, "faces", faces), _stored(folder, "owner", labels)
        neighbour = _stored(folder, "neighbour", labels)[: len(owner)]
        progress("reading patches", 0.8)
        patches = _stored(folder, "boundary", lambda file: parse(file.text()))
        with about(folder):
            cells = Polyhedra(polygons, owner, neighbour[neighbour >= 0])
            check_cells(cells)
            named, count = [], len(polygons)
            for patch in patches:
                first, end = patch.start, patch.start + patch.count
                if not 0 <= first <= end <= count:
                    raise MeshFileError(f"patch {patch.name} has the faces {first} to {end - 1}, but there are {count}")
                if first < end and first < len(cells.neighbour):
                    raise MeshFileError(
                        f"patch {patch.name} begins at face {first}, but the faces before {len(cells.neighbour)} are "
                        "inside the mesh"
                    )
                named.append(Patch(patch.name, (polygons.rows(first, end),)))
            return Mesh(points, (cells,), tuple(named))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; `out` is a copy of the case (of the folder ``polyMesh`` if `source` is one)."""
        mesh = mesh_folder(source)
        case = mesh if mesh.resolve() == source.resolve() else mesh.parent.parent
        with fresh_folder(case_folder(out), case) as beside:
            copied(case, beside, STALE)
            progress(f"writing {out.name}", 0.5)
            _move(mesh, points, beside / mesh.relative_to(case))

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; types of patches follow from their names, the case can be read by checkMesh.

        A name that begins with ``sym`` is a plane of symmetry; one with ``far``, ``inlet``, ``outlet``,
        ``chimera`` or ``overset`` in it a ``patch``; all others are walls.
        """
        refuse_plane(mesh, "OpenFOAM")
        with fresh_folder(case_folder(out)) as beside, about(out):
            progress(f"writing {out.name}", 0.0)
            lost = write_mesh(mesh, beside / MESH)
            write_system(beside)
            (beside / "case.foam").touch()
        return lost


def case_folder(out: Path) -> Path:
    """Return the folder to write: `out`, or the folder that a file ``case.foam`` would lie in."""
    return out.parent if out.suffix == ".foam" else out


def mesh_folder(path: Path) -> Path:
    """Return the folder with the points of a case; MeshFileError if there is none."""
    case = path.parent if path.suffix == ".foam" else path
    for folder in (case / MESH, case):
        if any((folder / name).is_file() for name in ("points", "points.gz")):
            return folder
    if not path.exists():
        raise MeshFileError(f"{path}: No such file or directory")
    raise MeshFileError(f"{path}: is not an OpenFOAM case; it has no file {MESH / 'points'}")


def _stored(folder: Path, name: str, read: Callable[[FoamFile], Read]) -> Read:
    with about(folder / name):
        return read(open_foam(folder, name))


def _move(mesh: Path, points: FloatArray, out: Path) -> None:
    """Write the file `points` of the folder `out`, as it is in the folder `mesh` but for coordinates that changed."""
    with about(mesh / "points"):
        file = open_foam(mesh, "points")
        old = vectors(file)
        check_points(points, len(old.values))
        data = old.replaced(file.data, points, file.kind("scalar") if file.binary else None)
    if (mesh / "points").is_file():
        (out / "points").write_bytes(data)
    else:
        (out / "points.gz").write_bytes(gzip.compress(data, mtime=0))

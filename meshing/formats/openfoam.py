"""OpenFOAM cases: the mesh in the folder ``constant/polyMesh``."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh, Patch, Polygons, Polyhedra, Warned
from sdm_deflect.deform.mesh.pieces import MeshInPieces
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files.staged import copied, fresh_folder
from sdm_deflect.meshing.formats.format import MeshFileError, about, fewest_bits
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.openfoam_decomposed import Home, homes, is_part, move_points, read_parts, rewrite_parts
from sdm_deflect.meshing.formats.openfoam_files import (
    MESH,
    FoamFile,
    FoamPatch,
    faces,
    labels,
    open_foam,
    parse,
    vectors,
)
from sdm_deflect.meshing.formats.openfoam_pairs import constraint_of, pairs_of
from sdm_deflect.meshing.formats.openfoam_parts import BETWEEN, CYCLIC
from sdm_deflect.meshing.formats.openfoam_write import BARE, write_files, write_mesh
from sdm_deflect.meshing.formats.polyhedra import check_cells
from sdm_deflect.meshing.formats.shapes import refuse_plane

Read = TypeVar("Read")
STALE = ("processor*",)
"""Parts of a decomposed case: their meshes would be the old ones, so they are not copied."""
OF_TIMES = (
    "{} is not deflected, and a solver that starts at that time reads it in place of constant/polyMesh: remove it, or "
    "move it to constant/polyMesh and deflect that"
)
OF_REGIONS = "the meshes of the regions {} are not deflected: name one as constant/{}/polyMesh to deflect it by itself"
BESIDE = "the parts of the case are neither read nor copied; name {} in place of the case to deflect them"


@registered("openfoam", ".foam")
class OpenFoam(Format):
    """A case folder, its folder ``polyMesh``, or a file such as ``case.foam`` in the case folder.

    Cells are polyhedra, patches are polygons. Files may be text or binary (labels of 32 or 64 bits) and packed
    (.gz). Of the types of patches the mesh has those that bind nodes, see `openfoam_pairs`; zones and sets are no part
    of it. A rewritten case keeps them, as it keeps every file but `points`; only the parts of a decomposed case
    (``processor0`` and so on) are not copied. Meshes of time folders are not looked at. Output is a folder that must
    not exist, or be empty.

    Where a case has nothing but parts, or a path names one of them (``case/processor0``), all parts are read and
    rewritten as one mesh, see `openfoam_decomposed`.
    """

    folder = True
    for_workers = "OpenFOAM cases in binary"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshInPieces | None:
        """See `Format.layout`."""
        from sdm_deflect.meshing.formats.openfoam_pieces import in_pieces

        return in_pieces(path)

    def files(self, path: Path) -> list[Path]:
        """See `Format.files`: those in the folder of a case's mesh, and of those of its parts where these are read."""
        case = case_folder(path)
        folders = [*(home.folder for home in homes(case)), case / MESH] if has_parts(path) else [mesh_folder(path)]
        return [file for folder in folders if folder.is_dir() for file in sorted(folder.iterdir()) if file.is_file()]

    def size(self, path: Path) -> int:
        """See `Format.size`; 0 if the case is decomposed. MeshFileError if there is none."""
        if has_parts(path):
            return 0
        lists = ("points", "faces", "owner", "neighbour")
        return sum(file.stat().st_size for name in lists for file in mesh_folder(path).glob(f"{name}*"))

    def place(self, path: Path) -> Path:
        """See `Format.place`: the folder of a case."""
        return case_folder(path)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        if has_parts(path):
            return read_parts(case_folder(path), progress)
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
        where = homes(case_folder(source)) if has_parts(source) else (Home(mesh_folder(source), 0, None),)
        return fewest_bits(file.kind("scalar") for home in where for file in home.heads("points") if file.binary)

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; `out` is a copy of the case (of the folder ``polyMesh`` if `source` is one)."""
        if has_parts(source):
            rewrite_parts(case_folder(source), points, case_folder(out), progress)
            return
        with case_copied(source, out, progress) as mesh:
            move_points(mesh_folder(source), mesh, [points])

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


@contextmanager
def case_copied(source: Path, out: Path, progress: Progress) -> Iterator[Path]:
    """Give the folder of the mesh in a copy of a case (of the folder ``polyMesh`` if `source` is one).

    The copy becomes `out` once the block has ended well; errors as of `fresh_folder`.
    """
    mesh = mesh_folder(source)
    case = mesh if mesh.resolve() == source.resolve() else mesh.parent.parent
    with fresh_folder(case_folder(out), case) as beside:
        copied(case, beside, STALE)
        progress(f"writing {out.name}", 0.5)
        yield beside / mesh.relative_to(case)


def patches_of(
    patches: Sequence[FoamPatch], count: int, inner: int, rows: Callable[[int, int], Polygons]
) -> tuple[Patch, ...]:
    """Return patches with their faces, of so many faces with the inner ones first; MeshFileError if one has others.

    `rows` gives faces, from one on and up to another.
    """
    named = []
    for patch in patches:
        if patch.type in (BETWEEN, CYCLIC):
            raise MeshFileError(
                f"patch {patch.name} joins it to other parts of a decomposed case; name the case, or its "
                "folder processor0, to read all parts"
            )
        first, end = patch.start, patch.start + patch.count
        if not 0 <= first <= end <= count:
            raise MeshFileError(f"patch {patch.name} has the faces {first} to {end - 1}, but there are {count}")
        if first < end and first < inner:
            raise MeshFileError(
                f"patch {patch.name} begins at face {first}, but the faces before {inner} are inside the mesh"
            )
        named.append(Patch(patch.name, (rows(first, end),), constraint=constraint_of(patch)))
    return tuple(named)


def case_folder(path: Path) -> Path:
    """Return the folder of a case: `path`, or the one that a file ``case.foam`` or a part ``processor0`` lies in."""
    return path.parent if path.suffix == ".foam" or is_part(path) else path


def has_parts(path: Path) -> bool:
    """Whether a path means the parts of a case: it names one, or the case has no mesh beside them."""
    case = case_folder(path)
    alone = not any((folder / name).is_file() for folder in (case / MESH, case) for name in ("points", "points.gz"))
    return (is_part(path) or alone) and bool(homes(case))


def meshes_beside(case: Path) -> tuple[str, ...]:
    """Notes on other meshes of a case: those of parts, of times, which a solver reads first, and of regions."""
    parts = sorted(folder for folder in case.glob(STALE[0]) if is_part(folder) and (folder / MESH).is_dir())
    others = sorted({points.parent.parent for points in case.glob("*/polyMesh/points*")} - {case / MESH.parent})
    times = [one.name for one in others if one.name.replace(".", "", 1).replace("e-", "", 1).isdecimal()]
    regions = sorted({points.parents[1].name for points in case.glob("constant/*/polyMesh/points*")})
    notes = [BESIDE.format(parts[0])] if parts else []
    notes += [Warned(OF_TIMES.format(", ".join(f"{name}/polyMesh" for name in times)))] if times else []
    notes += [Warned(OF_REGIONS.format(", ".join(regions), regions[0]))] if regions else []
    return tuple(notes)


def mesh_folder(path: Path) -> Path:
    """Return the folder with the points of a case; MeshFileError if there is none."""
    case = path.parent if path.suffix == ".foam" else path
    for folder in (case / MESH, case):
        if any((folder / name).is_file() for name in ("points", "points.gz")):
            return folder
    if not path.exists():
        raise MeshFileError(f"{path}: No such file or directory")
    regions = sorted(points.parent for points in case.glob("constant/*/polyMesh/points*"))
    help = f"; a mesh of its regions is in {regions[0].relative_to(case)}: name that path" if regions else ""
    raise MeshFileError(f"{path}: is not an OpenFOAM case; it has no file {MESH / 'points'}{help}")


def stored(folder: Path, name: str, read: Callable[[FoamFile], Read]) -> Read:
    """Return what a file of a mesh's folder holds; a MeshFileError names the file."""
    with about(folder / name):
        return read(open_foam(folder, name))

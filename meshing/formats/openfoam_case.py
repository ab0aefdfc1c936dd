"""The folders of an OpenFOAM case: where its mesh is, copies, and the parts of a decomposed one."""

import gzip
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.progress import Progress
from sdm_deflect.deform.mesh.cells import Patch, Polygons
from sdm_deflect.deform.mesh.mesh import Warned
from sdm_deflect.meshing.files import fresh_folder
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.openfoam_files import MESH, FoamFile, FoamPatch, open_foam, vectors
from sdm_deflect.meshing.formats.openfoam_pairs import constraint_of

Read = TypeVar("Read")
PART = re.compile(r"processor(0|[1-9]\d{0,8})")
COLLATED = re.compile(r"processors\d{0,9}(_\d{1,9}-\d{1,9})?")
BETWEEN = ("processor", "processorCyclic")
"""Types of patches between the parts of a decomposed case."""
STALE = ("processor*",)
"""Parts of a decomposed case: their meshes would be the old ones, so they are not copied."""
OF_PARTS = (
    "is decomposed: join it by `reconstructParMesh -constant`, deflect the whole with --field FILE, and move the parts "
    "by `sdm apply FILE {}/processor*`"
)
OF_COLLATED = "is collated: decompose it with `-fileHandler uncollated`"
OF_TIMES = (
    "{} is not deflected, and a solver that starts at that time reads it in place of constant/polyMesh: remove it, or "
    "move it to constant/polyMesh and deflect that"
)
OF_REGIONS = "the meshes of the regions {} are not deflected: name one as constant/{}/polyMesh to deflect it by itself"
BESIDE = "the parts of the case are neither read nor copied; `sdm apply` moves them by the field of --field FILE"


@contextmanager
def case_copied(source: Path, out: Path, progress: Progress) -> Iterator[Path]:
    """Give the folder of the mesh in a copy of a case (of the folder ``polyMesh`` if `source` is one).

    The copy becomes `out` once the block has ended well; errors as of `fresh_folder`.
    """
    mesh = mesh_folder(source)
    case = mesh if mesh.resolve() == source.resolve() else mesh.parent.parent
    with fresh_folder(case_folder(out), case) as beside:
        _copy(case, beside, STALE)
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
        if patch.type in BETWEEN:
            raise MeshFileError(f"patch {patch.name} joins it to other parts: it {OF_PARTS.format('CASE')}")
        first, end = patch.start, patch.start + patch.count
        if not 0 <= first <= end <= count:
            raise MeshFileError(f"patch {patch.name} has the faces {first} to {end - 1}, but there are {count}")
        if first < end and first < inner:
            raise MeshFileError(
                f"patch {patch.name} begins at face {first}, but the faces before {inner} are inside the mesh"
            )
        named.append(Patch(patch.name, (rows(first, end),), constraint=constraint_of(patch)))
    return tuple(named)


@contextmanager
def parts_moved(case: Path, out: Path) -> Iterator[Callable[[Path, FloatArray], tuple[Path, Path]]]:
    """Give a function that writes a part of a decomposed case with other points (N, 3) into a copy `out` of the case.

    It returns where the part is, and where it will be. The copy has all files of the case but other parts and the mesh
    of the whole. All files of a part but its points are links to those of the case. Errors as of `fresh_folder`.
    """
    with fresh_folder(out, case) as beside:
        _copy(case, beside, (*STALE, MESH.name))

        def move(part: Path, points: FloatArray) -> tuple[Path, Path]:
            source, copy = part.resolve(), beside / part.name
            for folder, _, files in os.walk(source):
                here = copy / Path(folder).relative_to(source)
                here.mkdir(parents=True)
                for file in {*files} - ({"points", "points.gz"} if here == copy / MESH else set()):
                    (here / file).symlink_to(Path(folder, file))
            move_points(source / MESH, copy / MESH, points)
            return copy, out / part.name

        yield move


def _copy(case: Path, out: Path, without: Sequence[str]) -> None:
    """Copy all that a case holds but names of the patterns `without`; links become what they point to."""
    ignored = shutil.ignore_patterns(*without)
    with about(case):
        for name, folders, files in os.walk(case, followlinks=True):
            folders[:] = {*folders} - ignored(name, folders)
            here = out / Path(name).relative_to(case)
            here.mkdir(exist_ok=True)
            shutil.copymode(name, here)
            for path in (Path(name, file) for file in files):
                if path.exists():
                    shutil.copy2(path, here)


def move_points(folder: Path, out: Path, points: FloatArray) -> None:
    """Write `points` (N, 3) of a mesh into the folder `out` as the file is in `folder`, but for what changed."""
    with about(folder / "points"):
        file = open_foam(folder, "points")
        old = vectors(file)
        check_points(points, len(old.values))
        data = old.replaced(file.data, points, file.kind("scalar") if file.binary else None)
    if (folder / "points").is_file():
        (out / "points").write_bytes(data)
    else:
        (out / "points.gz").write_bytes(gzip.compress(data, mtime=0))


def is_part(path: Path) -> bool:
    """Whether a folder is a part of a decomposed case, such as ``processor0``; MeshFileError if it is collated."""
    if COLLATED.fullmatch(path.name) and (path / MESH).is_dir():
        raise MeshFileError(f"{path}: {OF_COLLATED}")
    return bool(PART.fullmatch(path.name)) and (path / MESH).is_dir()


def case_folder(path: Path) -> Path:
    """Return the folder of a case: `path`, or the one that a file ``case.foam`` lies in."""
    return path.parent if path.suffix == ".foam" else path


def meshes_beside(case: Path) -> tuple[str, ...]:
    """Notes on other meshes of a case: those of parts, of times, which a solver reads first, and of regions."""
    others = sorted({points.parent.parent for points in case.glob("*/polyMesh/points*")} - {case / MESH.parent})
    times = [one.name for one in others if one.name.replace(".", "", 1).replace("e-", "", 1).isdecimal()]
    regions = sorted({points.parents[1].name for points in case.glob("constant/*/polyMesh/points*")})
    notes = [BESIDE] if any((folder / MESH).is_dir() for folder in case.glob(STALE[0])) else []
    notes += [Warned(OF_TIMES.format(", ".join(f"{name}/polyMesh" for name in times)))] if times else []
    notes += [Warned(OF_REGIONS.format(", ".join(regions), regions[0]))] if regions else []
    return tuple(notes)


def mesh_folder(path: Path) -> Path:
    """Return the folder with the points of a case; MeshFileError if there is none, or if it is a part of one."""
    if is_part(path):
        raise MeshFileError(f"{path.parent}: {OF_PARTS.format(path.parent)}")
    return points_folder(path)


def points_folder(path: Path) -> Path:
    """Return the folder with the points of a case or of a part; MeshFileError if there is none."""
    case = case_folder(path)
    for folder in (case / MESH, case):
        if any((folder / name).is_file() for name in ("points", "points.gz")):
            return folder
    if any(is_part(folder) for folder in sorted(case.glob(STALE[0]))):
        raise MeshFileError(f"{case}: {OF_PARTS.format(case)}")
    if not path.exists():
        raise MeshFileError(f"{path}: No such file or directory")
    regions = sorted(points.parent for points in case.glob("constant/*/polyMesh/points*"))
    help = f"; a mesh of its regions is in {regions[0].relative_to(case)}: name that path" if regions else ""
    raise MeshFileError(f"{path}: is not an OpenFOAM case; it has no file {MESH / 'points'}{help}")


def stored(folder: Path, name: str, read: Callable[[FoamFile], Read]) -> Read:
    """Return what a file of a mesh's folder holds; a MeshFileError names the file."""
    with about(folder / name):
        return read(open_foam(folder, name))

"""Decomposed OpenFOAM cases: ``processor0``, ``processor1`` and so on, or all parts in the files of ``processors4``.

Where the case has parts alone, they are read and written as one mesh. The lists with which decomposePar says what each
part is in the whole give the whole's own order; without them parts are joined at the patches between them.
"""

import gzip
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh, Polyhedra
from sdm_deflect.meshing.files.staged import copied, fresh_folder
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.openfoam_files import (
    HEAD,
    MESH,
    FoamFile,
    blocks,
    faces,
    headed,
    labels,
    open_foam,
    parse,
    vectors,
    with_blocks,
)
from sdm_deflect.meshing.formats.openfoam_parts import (
    APART,
    FIT,
    Place,
    ProcessorMesh,
    patch_names,
    placed_by_patches,
    whole,
    whole_points,
)
from sdm_deflect.meshing.formats.polyhedra import check_cells

ONE, SEVERAL = re.compile(r"processor(0|[1-9]\d{0,8})"), re.compile(r"processors(\d{0,9})(?:_(\d{1,9})-(\d{1,9}))?")
JOINED = (
    "the parts have no files that say what they are in a whole (pointProcAddressing); they are joined at the patches "
    "between them, and nodes and cells are numbered part by part"
)
Read = TypeVar("Read")


@dataclass(frozen=True, slots=True)
class Home:
    """A folder with the mesh of one part, or, where files are collated, of several.

    Parameters
    ----------
    folder : Such as ``case/processor0/constant/polyMesh``.
    first : Number of its first part.
    count : How many parts there are in a collated file, if the folder's name says so; None for one part.
    """

    folder: Path
    first: int
    count: int | None

    @property
    def collated(self) -> bool:
        """Whether its files hold several parts."""
        return self.count is not None

    def files(self, name: str) -> list[FoamFile]:
        """Return the file `name` of each part."""
        with about(self.folder / name):
            file = open_foam(self.folder, name)
            if not self.collated:
                return [file]
            found = blocks(file)
            if self.count and len(found) != self.count:
                raise MeshFileError(f"holds {len(found)} parts where there should be {self.count}; it is truncated")
            return found

    def heads(self, name: str) -> list[FoamFile]:
        """Return no more than the beginning of the file `name` of each part, where it can be had without the rest."""
        plain = self.folder / name
        if self.collated or not plain.is_file():
            return self.files(name)
        with about(plain), plain.open("rb") as file:
            return [headed(file.read(HEAD), name, HEAD)]

    def has(self, name: str) -> bool:
        """Whether there is a file `name`."""
        return any((self.folder / f"{name}{end}").is_file() for end in ("", ".gz"))


def is_part(folder: Path) -> bool:
    """Whether a folder has the name of a part, or of all parts, of a case."""
    return bool(ONE.fullmatch(folder.name) or SEVERAL.fullmatch(folder.name))


def homes(case: Path) -> tuple[Home, ...]:
    """Return where the parts of a case lie, in order; none if it is not decomposed.

    MeshFileError if a part is missing, or if there are parts of two decompositions.
    """
    if not case.is_dir():
        return ()
    with about(case):
        folders = [folder for folder in sorted(case.iterdir()) if is_part(folder) and (folder / MESH).is_dir()]
        single = {int(found[1]): folder for folder in folders if (found := ONE.fullmatch(folder.name))}
        several = [folder for folder in folders if SEVERAL.fullmatch(folder.name)]
        if single and several:
            raise MeshFileError(
                f"has a mesh in {next(iter(single.values())).name} and in {several[0].name}; delete the one that is old"
            )
        if single:
            return _single(single)
        return _collated(several)


def _single(folders: dict[int, Path]) -> tuple[Home, ...]:
    if missing := set(range(max(folders) + 1)[: len(folders) + 1]) - folders.keys():
        there = ", ".join(folders[i].name for i in sorted(folders)[:5])
        raise MeshFileError(f"there is {there}, but no mesh in processor{min(missing)}; a part is missing")
    return tuple(Home(folders[i] / MESH, i, None) for i in sorted(folders))


def _collated(folders: list[Path]) -> tuple[Home, ...]:
    found = sorted(map(_home_of_several, folders), key=lambda pair: pair[1].first)
    _check_of_one(folders, found)
    after = 0
    for _, home in found:
        if home.first != after:
            raise MeshFileError(f"the mesh of processor{min(after, home.first)} is missing, or there twice")
        after += home.count or 0
    total = found[-1][0] if found else None
    if total and after != int(total):
        raise MeshFileError(f"there are {after} parts, but {int(total)} by the name of their folder")
    return tuple(home for _, home in found)


def _check_of_one(folders: Sequence[Path], found: Sequence[tuple[str | None, Home]]) -> None:
    """Refuse folders that cannot be of one decomposition."""
    if len({total for total, _ in found}) > 1 or (len(found) > 1 and not all(home.count for _, home in found)):
        names = " and ".join(folder.name for folder in folders)
        raise MeshFileError(f"has meshes in {names}; delete the ones that are old")


def _home_of_several(folder: Path) -> tuple[str | None, Home]:
    """Return how many parts there are by the name of a folder of several, and where it has which."""
    name = SEVERAL.fullmatch(folder.name)
    assert name
    first, last = int(name[2] or 0), int(name[3] or int(name[1] or 0) - 1)
    return name[1], Home(folder / MESH, first, max(0, last + 1 - first))


def read_parts(case: Path, progress: Progress = silent) -> Mesh:
    """Return the mesh of all parts of a case; errors as of `Format.read`."""
    where = homes(case)
    parts = _parts(where)
    progress("joining parts", 0.7)
    ranks, listed = _ranks(where, parts), _listed(where)
    places = _places(where, parts) if listed else None
    with about(case):
        names = patch_names(parts, ranks)
        mesh = whole(parts, places or placed_by_patches(parts, names), names)
    return mesh if listed else replace(mesh, notes=(JOINED,))


def rewrite_parts(case: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
    """Write a copy `out` of a case with coordinates `points` (N, 3) of the whole in each part.

    A mesh of the whole beside the parts gets them, too, if it is the one that the parts are parts of.
    """
    where = homes(case)
    old = _stored(where, "points", lambda file: vectors(file).values)
    places = _point_places(case, where, old)
    with about(case):
        before = whole_points(old, places)
        check_points(points, len(before))
    with fresh_folder(out, case) as beside:
        copied(case, beside, ())
        progress(f"writing {out.name}", 0.5)
        rest = [points[place] for place in places]
        for home in where:
            count = (home.count or len(rest)) if home.collated else 1
            move_points(home.folder, beside / home.folder.relative_to(case), rest[:count], home.collated)
            rest = rest[count:]
        if _listed(where) and _is_at(case / MESH, before):
            move_points(case / MESH, beside / MESH, [points])


def _listed(where: tuple[Home, ...]) -> bool:
    return any(home.has("pointProcAddressing") for home in where)


def _stored(where: tuple[Home, ...], name: str, read: Callable[[FoamFile], Read]) -> list[Read]:
    found = []
    for home in where:
        for number, file in enumerate(home.files(name), home.first):
            with about(home.folder / name), _of_block(number if home.collated else None):
                found.append(read(file))
    return found


@contextmanager
def _of_block(number: int | None) -> Iterator[None]:
    """Name the part in errors of a collated file."""
    try:
        yield
    except (MeshFileError, ValueError) as error:
        if number is None:
            raise
        raise MeshFileError(f"processor{number}: {error}") from error


def _home(where: tuple[Home, ...], number: int) -> Home:
    return next(home for home in reversed(where) if home.first <= number)


def _parts(where: tuple[Home, ...]) -> list[ProcessorMesh]:
    points = _stored(where, "points", lambda file: vectors(file).values)
    polygons = _of_parts(where, "faces", faces, len(points))
    owner = _of_parts(where, "owner", labels, len(points))
    neighbour = _of_parts(where, "neighbour", labels, len(points))
    patches = _of_parts(where, "boundary", lambda file: parse(file.text()), len(points))
    found = []
    for i, given in enumerate(points):
        home = _home(where, i)
        with about(home.folder), _of_block(i if home.collated else None):
            cells = Polyhedra(polygons[i], owner[i], neighbour[i][neighbour[i] >= 0])
            check_cells(cells)
            part = ProcessorMesh(f"processor{i}", given, cells, patches[i])
            part.check(i, len(points))
        found.append(part)
    return found


def _of_parts(where: tuple[Home, ...], name: str, read: Callable[[FoamFile], Read], count: int) -> list[Read]:
    """Return what each of so many parts has in a file; MeshFileError if a collated one has other parts."""
    found = _stored(where, name, read)
    if len(found) != count:
        raise MeshFileError(f"{where[0].folder / name}: holds {len(found)} parts, but points are of {count}; {FIT}")
    return found


def _places(where: tuple[Home, ...], parts: list[ProcessorMesh]) -> list[Place]:
    points = _lists(where, "point", [len(part.points) for part in parts])
    sides = _lists(where, "face", [len(part.cells.faces) for part in parts])
    cells = _lists(where, "cell", [len(part.cells) for part in parts])
    return [Place(*lists) for lists in zip(points, sides, cells, strict=True)]


def _ranks(where: tuple[Home, ...], parts: list[ProcessorMesh]) -> list[IntArray]:
    """Index in the whole of each patch of each part; nothing if the parts do not say."""
    if not all(home.has("boundaryProcAddressing") for home in where):
        return []
    return _lists(where, "boundary", [len(part.patches) for part in parts])


def _lists(where: tuple[Home, ...], what: str, counts: list[int]) -> list[IntArray]:
    """Return what the points, faces, cells or patches of each part are in the whole; it has so many of them."""
    name = f"{what}ProcAddressing"
    found = _of_parts(where, name, labels, len(counts))
    for i, (given, count) in enumerate(zip(found, counts, strict=True)):
        if len(given) != count:
            raise MeshFileError(
                f"{_home(where, i).folder / name}: has {len(given)} numbers for {count} in processor{i}; {FIT}, where "
                "it is to be deleted"
            )
    return found


def _point_places(case: Path, where: tuple[Home, ...], points: list[FloatArray]) -> list[IntArray]:
    """Index in the whole of each point of each part."""
    if _listed(where):
        return _lists(where, "point", [len(each) for each in points])
    parts = _parts(where)
    with about(case):
        return [place.points for place in placed_by_patches(parts, patch_names(parts))]


def _is_at(mesh: Path, points: FloatArray) -> bool:
    """Whether a mesh of the whole has these points."""
    if not Home(mesh, 0, None).has("points"):
        return False
    with about(mesh / "points"):
        found = vectors(open_foam(mesh, "points")).values
    near = APART * np.abs(points).max(initial=0.0)
    return found.shape == points.shape and bool((np.abs(found - points) <= near).all())


def move_points(folder: Path, out: Path, rows: Sequence[FloatArray], collated: bool = False) -> None:
    """Write `points` of a mesh into the folder `out` as it is in `folder` but for coordinates that changed.

    Parameters
    ----------
    rows : New coordinates (N, 3); of a collated file those of each part.
    """
    with about(folder / "points"):
        file = open_foam(folder, "points")
        moved = []
        for part, new in zip(blocks(file) if collated else [file], rows, strict=True):
            old = vectors(part)
            check_points(new, len(old.values))
            moved.append(old.replaced(part.data, new, part.kind("scalar") if part.binary else None))
        data = with_blocks(file, moved) if collated else moved[0]
    if (folder / "points").is_file():
        (out / "points").write_bytes(data)
    else:
        (out / "points.gz").write_bytes(gzip.compress(data, mtime=0))

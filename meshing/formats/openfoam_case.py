"""The folders of an OpenFOAM case: where its mesh is, copies, and the parts of a decomposed one.

Types of patches bind nodes: in cyclic pairs, and on both sides of a case one cell thick.

Nodes are matched by their places. A pair's motion brings all nodes of one side to those of the other. The first that
does so counts: a translation or rotation of the faces in their order, the rotation about the axis that the case names,
a translation.
"""

import gzip
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct, union
from sdm_deflect.base.errors import InputError, MeshFileError, short_list
from sdm_deflect.base.files import fresh_folder
from sdm_deflect.base.threads import Progress
from sdm_deflect.meshing.errors import about, check_points
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Constraint, Patch, Periodic, Polygons, take_faces
from sdm_deflect.meshing.mesh.edges import polygons_of
from sdm_deflect.meshing.mesh.images import (
    RigidMotion,
    images_of_faces,
    nearest_rotation,
    rotation_between,
    rotation_of,
    translation_between,
)
from sdm_deflect.meshing.mesh.mesh import Warned
from sdm_deflect.meshing.mesh.sliding import Plane

from .openfoam_files import MESH, FoamFile, FoamPatch, open_foam, parse, vectors

CONSTRAINTS: dict[str, Constraint] = {
    "symmetry": "symmetry",
    "symmetryPlane": "symmetry",
    "empty": "empty",
    "wedge": "wedge",
}
# Types of patches whose faces match those of another, one by one, in their order.
MATCHED = ("cyclic", "cyclicSlip")
COUPLED = (*MATCHED, "cyclicAMI", "cyclicACMI", "cyclicPeriodicAMI")
# Largest distance of a node from an image, as a share of the side's extent: for text of six digits.
NEAR = 1e-5
# Lengths below this share of the largest coordinate are zero.
EXACT = 1e-12
Places = Callable[[IntArray], FloatArray]
# Pairs of nodes (K, 2), and the motion from one to the other.
Sides = tuple[IntArray, FloatArray, FloatArray]
Read = TypeVar("Read")
POINTS = ("points", "points.gz")
PART = re.compile(r"processor(0|[1-9]\d{0,8})")
COLLATED = re.compile(r"processors\d{0,9}(_\d{1,9}-\d{1,9})?")
# Types of patches between the parts of a decomposed case.
BETWEEN = ("processor", "processorCyclic")
# Parts of a decomposed case: their meshes would be the old ones, so they are not copied.
STALE = ("processor*",)
OF_PARTS = (
    "is decomposed: join it by `reconstructParMesh -constant`, deflect the whole with --plan FILE, and move the parts "
    "by `sdm apply FILE --angle A {}/processor* --out CASE`"
)
OF_COLLATED = "is collated: decompose it with `-fileHandler uncollated`"
OF_TIMES = (
    "{} is not deflected, and a solver that starts at that time reads it in place of constant/polyMesh: remove it, or "
    "move it to constant/polyMesh and deflect that"
)
OF_REGIONS = "the meshes of the regions {} are not deflected: name one as constant/{}/polyMesh to deflect it by itself"
OF_HOLDERS = (
    "beside points there is {}, which is not deflected: what takes it for points, such as a mesh motion or a script, "
    "undoes the deflection; copy the deflected points over it"
)
BESIDE = "the parts of the case are neither read nor copied; `sdm apply` moves them by a plan of --plan FILE"


def pairs_of(foam: Sequence[FoamPatch], patches: Sequence[Patch], places: Places) -> tuple[Periodic, ...]:
    """Return the pairs of nodes among the patches of a case.

    Parameters
    ----------
    foam : The patches in the case's dictionaries.
    patches : Their faces, by name.
    places : Coordinates (K, 3) of nodes (K,).
    """
    faces = {patch.name: polygons_of(patch.faces) for patch in patches}
    pairs = []
    for entry in foam:
        partner = entry.entries.get("neighbourPatch", "")
        if (
            entry.type in COUPLED
            and partner in faces
            and (entry.name < partner or not _names(foam, partner, entry.name))
        ):
            pairs.append(_pair(entry, (entry.name, partner), faces[entry.name], faces[partner], places))
        elif entry.type in MATCHED and not partner:  # of old: one patch with both sides
            both, half = faces[entry.name], len(faces[entry.name]) // 2
            sides = both.rows(0, half), both.rows(half, len(both))
            pairs.append(_pair(entry, (entry.name, entry.name), *sides, places))
    return (*pairs, *_sides(patches, "empty", places), *_sides(patches, "wedge", places))


def constraint_of(patch: FoamPatch) -> Constraint:
    """Return how a patch constrains its nodes.

    If a cyclic patch names no transformation, OpenFOAM derives it from the normals of single faces. So plane sides of a
    rotation have to stay plane.
    """
    guessed = patch.type in MATCHED and patch.entries.get("transform", "unknown") == "unknown"
    return "symmetry" if guessed else CONSTRAINTS.get(patch.type, "")


def _names(foam: Sequence[FoamPatch], name: str, neighbour: str) -> bool:
    return any(patch.name == name and patch.entries.get("neighbourPatch") == neighbour for patch in foam)


def _pair(patch: FoamPatch, names: tuple[str, str], first: Polygons, second: Polygons, places: Places) -> Periodic:
    """Return a pair with the first motion that brings one side's nodes to the other's; without nodes if none does."""
    nodes = union(first.nodes), union(second.nodes)
    points = places(nodes[0]), places(nodes[1])
    if len(nodes[0]) == len(nodes[1]) and len(nodes[0]) and np.isfinite(points).all():
        for rotation, shift in _motions(patch, first, second, points, places):
            matched = _match(first, second, (rotation, shift), places)
            if matched is not None:
                here, there = (places(side) for side in matched.T)
                if not np.array_equal(rotation, np.eye(3)):
                    rotation = rotation_of(here - here.mean(axis=0), there - there.mean(axis=0))
                shift = _shift(here @ rotation.T, there)
                return Periodic(patch.name, names, matched, rotation, shift)
    return Periodic(patch.name, names, np.empty((0, 2), dtype=np.intp))


def _motions(
    patch: FoamPatch, first_side: Polygons, second_side: Polygons, points: tuple[FloatArray, FloatArray], places: Places
) -> Iterator[RigidMotion]:
    """Yield possible motions from one side to the other, the likeliest first; `points` are the nodes of both."""
    if patch.type in MATCHED and len(first_side) == len(second_side):
        yield from _in_order(first_side, second_side, places)
    axis, centre = (_vector(patch.entries.get(key, "")) for key in ("rotationAxis", "rotationCentre"))
    if axis is not None and axis.any():
        with suppress(InputError):  # a side whose centre is on the axis
            yield rotation_between(*points, Axis(np.zeros(3) if centre is None else centre, axis))
    yield translation_between(*points)


def _in_order(one: Polygons, other: Polygons, places: Places) -> Iterator[RigidMotion]:
    """Yield motions that bring each face to the face of the same number: a translation, or else the best rotation."""
    centres, near = [_centres(side, places) for side in (one, other)], NEAR * np.ptp(places(other.nodes), axis=0).max()
    motions = [translation_between(*centres)]
    if np.array_equal(one.offsets, other.offsets):
        first, size = (np.repeat(values, np.diff(one.offsets)) for values in (one.offsets[:-1], np.diff(one.offsets)))
        back = first - (np.arange(len(one.nodes)) - first)  # in opposite sense from the same corner on
        back[back < first] += size[back < first]
        motions.append(_rigid(places(one.nodes), places(other.nodes[back])))
    for rotation, shift in (*motions, _rigid(*centres)):
        off = centres[0] @ rotation.T + shift - centres[1]
        if np.abs(off).max(initial=0.0) <= near:
            yield rotation, shift


def _vector(text: str) -> FloatArray | None:
    """Return three numbers in parentheses; None if there are none."""
    try:
        vector = np.array(text.strip("() ").split(), dtype=np.float64)
    except ValueError:
        return None
    return vector if vector.shape == (3,) and np.isfinite(vector).all() else None


def _shift(points: FloatArray, others: FloatArray) -> FloatArray:
    """Return the median translation (3,) from points (K, 3) to their partners; tiny components are set to zero."""
    shift = np.median(others - points, axis=0)
    return np.asarray(np.where(np.abs(shift) <= EXACT * np.abs(others).max(), 0.0, shift))


def _rigid(points: FloatArray, others: FloatArray) -> RigidMotion:
    """Return the rotation and shift that bring points (K, 3) nearest to their partners."""
    start, end = points.mean(axis=0), others.mean(axis=0)
    rotation = nearest_rotation(points - start, others - end)
    return rotation, end - rotation @ start


def _centres(faces: Polygons, places: Places) -> FloatArray:
    sums = np.add.reduceat(places(faces.nodes), faces.offsets[:-1], axis=0)
    return np.asarray(sums / np.diff(faces.offsets)[:, None])


def _match(first: Polygons, second: Polygons, motion: RigidMotion, places: Places) -> IntArray | None:
    """Return pairs (K, 2) of nodes of faces and images among the nodes of other faces; None if they do not match.

    Different faces, as on a sliding interface, may still have nodes at the same places.
    """
    nodes, rotation, shift = (union(first.nodes), union(second.nodes)), *motion
    there = places(nodes[1])
    near = NEAR * float(np.ptp(there, axis=0).max())
    pairs = images_of_faces(first, second, places(first.nodes) @ rotation.T + shift, places(second.nodes), near)
    if pairs is not None:
        return pairs
    distance, rows = cKDTree(there).query(places(nodes[0]) @ rotation.T + shift)
    same = len(nodes[0]) == len(there) and distance.max() <= near and len(distinct(rows)) == len(rows)
    return np.column_stack([nodes[0], nodes[1][rows]]) if same else None


def _sides(patches: Sequence[Patch], kind: Constraint, places: Places) -> Iterator[Periodic]:
    """Yield the two sides of a case one cell thick as a pair; the pair has no nodes if these do not match."""
    sides = [patch for patch in patches if patch.constraint == kind and len(patch)]
    if not sides:
        return
    names, faces = (sides[0].name, sides[-1].name), polygons_of([block for patch in sides for block in patch.faces])
    matched: Sides | None = None
    if kind == "empty" and np.isfinite(places(faces.nodes)).all():
        matched = _flat_sides(faces, places)
    elif kind == "wedge" and len(sides) == 2:
        matched = _wedge_sides(polygons_of(sides[0].faces), polygons_of(sides[1].faces), places)
    name = "_".join(dict.fromkeys(names))
    nodes, rotation, shift = matched or (np.empty((0, 2), dtype=np.intp), np.eye(3), np.zeros(3))
    yield Periodic(name, names, nodes, rotation, shift, thin=True)


def _flat_sides(faces: Polygons, places: Places) -> Sides | None:
    """Return the nodes of both sides and the motion between them; None if they are not in two planes across an axis."""
    points = places(faces.nodes)
    near = NEAR * float(np.ptp(points, axis=0).max())
    for axis in np.argsort(np.ptp(points, axis=0)).tolist():
        low = points[faces.offsets[:-1], axis] < 0.5 * (points[:, axis].min() + points[:, axis].max())
        front, back = take_faces(faces, np.flatnonzero(low)), take_faces(faces, np.flatnonzero(~low))
        heights = [places(union(side.nodes))[:, axis] for side in (front, back)]
        if len(heights[0]) == len(heights[1]) and max(map(np.ptp, heights)) <= near:
            shift = np.zeros(3)
            shift[axis] = np.median(heights[1]) - np.median(heights[0])
            if (pairs := _match(front, back, (np.eye(3), shift), places)) is not None:
                return pairs, np.eye(3), shift
    return None


def _wedge_sides(front_faces: Polygons, back_faces: Polygons, places: Places) -> Sides | None:
    """Return the nodes of both sides of a wedge, which meet on its axis, and the motion; None without a wedge."""
    points = places(union(front_faces.nodes)), places(union(back_faces.nodes))
    if len(points[0]) != len(points[1]) or len(points[0]) < 3 or not np.isfinite(points).all():
        return None
    front, back = (Plane.fitted(side) for side in points)
    n, m = front.normal, back.normal
    axis = np.cross(n, m)
    if not axis.any():
        return None
    axis /= np.linalg.norm(axis)
    axis = np.where(np.abs(axis - np.round(axis)) < NEAR, np.round(axis), axis)
    centre = np.linalg.solve(np.vstack([n, m, axis]), np.array([n @ front.point, m @ back.point, 0.0]))
    size = np.abs(np.vstack(points)).max()
    hinge = Axis(np.where(np.abs(centre) < EXACT * size, 0.0, centre), axis)
    motion = rotation_between(*points, hinge)
    pairs = _match(front_faces, back_faces, motion, places)
    return None if pairs is None else (pairs, *motion)


@contextmanager
def copy_case(source: Path, out: Path, progress: Progress) -> Iterator[Path]:
    """Give the folder of the mesh in a copy of a case (of the folder ``polyMesh`` if `source` is one).

    The copy becomes `out` once the block has ended well; errors as of `fresh_folder`.
    """
    mesh = mesh_folder(source)
    case = mesh if mesh.resolve() == source.resolve() else mesh.parent.parent
    with fresh_folder(case_folder(out), case) as beside:
        _copy(case, beside, STALE, mesh)
        progress(f"writing {out.name}", 0.5)
        yield beside / mesh.relative_to(case)


def patches_of(
    patches: Sequence[FoamPatch], count: int, inner: int, rows: Callable[[int, int], Polygons]
) -> tuple[Patch, ...]:
    """Return the patches with their faces; MeshFileError if faces are missing.

    `rows` returns faces start to stop - 1; faces between cells come first.
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
def move_parts(case: Path, out: Path) -> Iterator[Callable[[Path, FloatArray], tuple[Path, Path]]]:
    """Yield a function that writes a part of a decomposed case with other points (N, 3) to a copy `out` of the case.

    The function returns the part's folder, now and once the block has ended. The copy has all files of the case except
    other parts and the mesh of the whole. All files of a part but its points are links to those of the case. Errors as
    of `fresh_folder`.
    """
    with fresh_folder(out, case) as beside:
        _copy(case, beside, (*STALE, MESH.name), case / MESH)

        def move(part: Path, points: FloatArray) -> tuple[Path, Path]:
            source, copy = part.resolve(), beside / part.name
            _copy(source, copy, (), source / MESH, lambda file, place: place.symlink_to(file))
            move_points(source / MESH, copy / MESH, points)
            return copy, out / part.name

        yield move


def _copy(
    case: Path, out: Path, without: Sequence[str], mesh: Path, copy: Callable[[Path, Path], Any] = shutil.copy2
) -> None:
    """Copy a case without the folders that match `without`; links stay links with the same targets.

    The folders that lead to `mesh`, and its points, are always copies: new points are written there.
    """
    ignored, followed = shutil.ignore_patterns(*without), {mesh, *mesh.parents}
    with about(case):
        for name, folders, files in os.walk(case, followlinks=True):
            here, place = Path(name), out / Path(name).relative_to(case)
            if here.is_symlink() and here.parent.resolve().is_relative_to(here.resolve()):
                raise MeshFileError(f"{here.relative_to(case)} is a link to a folder that it lies in; remove it")
            place.mkdir(exist_ok=True)
            shutil.copymode(name, place)
            folders[:] = {*folders} - ignored(name, folders)
            links = [folder for folder in folders if (here / folder).is_symlink() and here / folder not in followed]
            folders[:] = {*folders}.difference(links)
            for path in (here / relative for relative in (*links, *files)):
                if path.is_symlink() and not (here == mesh and path.name in POINTS):
                    (place / path.name).symlink_to(_target(path, case))
                else:
                    copy(path, place / path.name)


def _target(link: Path, case: Path) -> str:
    """Return the target of a copied link: the same text if it lies in the case, else the absolute path."""
    text, here = str(link.readlink()), link.parent.resolve()
    target, home = Path(os.path.normpath(here / text)), case.resolve()
    within = here == home / link.parent.relative_to(case) and target.is_relative_to(home)
    return text if within else str(target)


def move_points(folder: Path, out: Path, points: FloatArray) -> None:
    """Copy the file of points from `folder` to `out`, with new `points` (N, 3) where they changed."""
    with about(folder / "points"):
        file = open_foam(folder, "points")
        old = vectors(file)
        check_points(points, len(old.values))
        data = old.with_values(file.data, points, file.kind("scalar") if file.binary else None)
    plain = (folder / "points").is_file()
    new = out / POINTS[0 if plain else 1]
    new.unlink(missing_ok=True)  # a link to the points of the source
    new.write_bytes(data if plain else gzip.compress(data, mtime=0))


def is_part(path: Path) -> bool:
    """Whether a folder is a part of a decomposed case, such as ``processor0``; MeshFileError if it is collated."""
    if COLLATED.fullmatch(path.name) and (path / MESH).is_dir():
        raise MeshFileError(f"{path}: {OF_COLLATED}")
    return bool(PART.fullmatch(path.name)) and (path / MESH).is_dir()


def are_all_parts(parts: Sequence[Path]) -> bool:
    """Return whether these parts of a decomposed case are all parts: the neighbours of each are among them."""
    given, named = {part.name for part in parts}, set[str]()
    for part in parts:
        try:
            patches = read_foam(part / MESH, "boundary", lambda file: parse(file.text()))
        except (MeshFileError, OSError):
            return False
        named |= {f"processor{patch.entries.get('neighbProcNo')}" for patch in patches if patch.type in BETWEEN}
    return named <= given


def case_folder(path: Path) -> Path:
    """Return the folder of a case: `path`, or the one that a file ``case.foam`` lies in."""
    return path.parent if path.suffix == ".foam" else path


def meshes_beside(case: Path) -> tuple[str, ...]:
    """Return notes on other meshes of a case: of parts, of regions, and of times, which a solver prefers."""
    others = sorted({points.parent.parent for points in case.glob("*/polyMesh/points*")} - {case / MESH.parent})
    times = [other.name for other in others if other.name.replace(".", "", 1).replace("e-", "", 1).isdecimal()]
    regions = sorted({points.parents[1].name for points in case.glob("constant/*/polyMesh/points*")})
    notes = [BESIDE] if any((folder / MESH).is_dir() for folder in case.glob(STALE[0])) else []
    notes += [Warned(OF_TIMES.format(short_list(f"{name}/polyMesh" for name in times)))] if times else []
    notes += _holders(case)
    notes += [Warned(OF_REGIONS.format(short_list(regions), regions[0]))] if regions else []
    return tuple(notes)


def _holders(case: Path) -> list[Warned]:
    """Return a warning of other files with points beside those of the mesh."""
    mesh = case / MESH if (case / MESH).is_dir() else case
    names = sorted(file.name for file in mesh.glob("points?*") if file.name not in POINTS)
    return [Warned(OF_HOLDERS.format(short_list(names)))] if names else []


def mesh_folder(path: Path) -> Path:
    """Return the folder with the points of a case; MeshFileError without one, and for a part of a decomposed case."""
    if is_part(path):
        raise MeshFileError(f"{path.parent}: {OF_PARTS.format(path.parent)}")
    return points_folder(path)


def points_folder(path: Path) -> Path:
    """Return the folder with the points of a case or of a part; MeshFileError if there is none."""
    case = case_folder(path)
    for folder in (case / MESH, case):
        if any((folder / name).is_file() for name in POINTS):
            return folder
        if (folder / "faces").is_file() and (others := sorted(file.name for file in folder.glob("points*"))):
            copy = f"copy it to points{'.gz' * others[0].endswith('.gz')}"
            raise MeshFileError(f"{folder} has no points; there is {short_list(others)}: {copy}")
    if any(is_part(folder) for folder in sorted(case.glob(STALE[0]))):
        raise MeshFileError(f"{case}: {OF_PARTS.format(case)}")
    if not path.exists():
        raise MeshFileError(f"{path}: No such file or directory")
    regions = sorted(points.parent for points in case.glob("constant/*/polyMesh/points*"))
    help = f"; a mesh of its regions is in {regions[0].relative_to(case)}: name that path" if regions else ""
    raise MeshFileError(f"{path}: is not an OpenFOAM case; it has no file {MESH / 'points'}{help}")


def read_foam(folder: Path, name: str, read: Callable[[FoamFile], Read]) -> Read:
    """Return what a file of a mesh's folder holds; a MeshFileError names the file."""
    with about(folder / name):
        return read(open_foam(folder, name))

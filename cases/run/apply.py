"""`sdm apply`: a saved plan moves the points of mesh files, or of the parts of a decomposed case of OpenFOAM."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, MeshFileError, short_list
from sdm_deflect.base.files import permitted_as
from sdm_deflect.base.states import check_unchanged, states_of
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.deform.checks import in_words
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.meshing.formats.openfoam_case import are_all_parts, is_part, move_parts
from sdm_deflect.meshing.formats.registry import files_of, format_of
from sdm_deflect.meshing.mesh.cells import Zone, bounded
from sdm_deflect.meshing.mesh.precision import DOUBLE

from .mesh_files import OutputFiles
from .output import output_files

# Writes a mesh with other points (N, 3); returns where it is, and where it will be.
Write = Callable[[Path, FloatArray], tuple[Path, Path]]


@dataclass(frozen=True, slots=True)
class Applied:
    """The result of applying a plan.

    Attributes
    ----------
    files : for each file the number of its points and of those that moved.
    places, missing : number of the plan's places, and of those that are in none of the meshes.
    amounts, ranges, passed : of each surface by its name; the amounts that passed are None if none did.
    faults : sentences on amounts that did not pass.
    reservations : what was not good around these amounts, although checks passed.
    measured : whether at most one surface is away from its base amount, as in all measurements.
    """

    files: tuple[tuple[Path, int, int], ...]
    places: int
    missing: int
    amounts: dict[str, Any]
    ranges: dict[str, Any]
    passed: dict[str, tuple[float, float] | None]
    faults: tuple[str, ...]
    reservations: tuple[str, ...]
    measured: bool

    @property
    def verdict(self) -> str:
        """The verdict on the amounts, as it was measured when the plan was made."""
        if not self.faults and not self.measured:
            return "not measured: the surfaces were measured one at a time; sdm quality judges the cells"
        return in_words("; ".join(self.faults), self.reservations)


def apply_plan(
    path: Path,
    amounts: Mapping[str, float] | float,
    meshes: Sequence[Path],
    out: Path | None = None,
    zones: Sequence[str] = (),
    progress: Progress = silent,
) -> Applied:
    """Move the points of meshes by the plan in the file `path`; all files appear, or none.

    Parameters
    ----------
    path : A file of `MeshMotion.save`.
    amounts : Amount of the only surface, or amounts by the surfaces' names.
    meshes : Mesh files; or folders ``processor0`` and so on of a decomposed OpenFOAM case. Parts get the bits of the
        whole.
    out : The file to write, or the folder of the case; NAME-deflected beside the mesh, or the case, if None.
    zones : Further zones that deform, as in a job.
    progress : Called with what is being done.

    Raises
    ------
    InputError
        If an amount is outside its range. If the meshes are not the one on which the plan was measured, or have
        rounded coordinates; some parts of a case may be missing. If a mesh has coordinates of 32 bits, or would be
        overwritten.
    MeshFileError
        If a mesh cannot be read or written.
    """
    motion = MeshMotion.load(path)
    pose = motion.in_order(amounts)
    states = states_of(file for mesh in meshes for file in _files(mesh))
    places, missing = compare(motion, path, meshes, zones, progress)
    files = []
    with _writers(meshes, out) as writers:
        for mesh, write in zip(meshes, writers, strict=True):
            points, zones_of_mesh = points_of(mesh)
            moved = move(motion, pose, mesh, points, zones_of_mesh, zones)
            progress(f"writing {mesh.name}", 0.5)
            beside, target = write(mesh, moved)
            if not np.array_equal(points_of(beside)[0], moved):
                raise MeshFileError(f"{target}: does not read back as it was written")
            files.append((target, len(points), int(np.count_nonzero((moved != points).any(axis=1)))))
        check_unchanged(states)
    ranges = {control.name: (control.low, control.high) for control in motion.controls}
    named = dict(zip(ranges, pose, strict=True))
    passed = {name: motion.passed(i) for i, name in enumerate(ranges)}
    judged = motion.faults(pose), motion.reservations(pose), motion.is_measured(pose)
    return Applied(tuple(files), places, missing, named, ranges, passed, *judged)


def plan_to_case(path: Path, case: Path, progress: Progress = silent) -> tuple[Path, ...]:
    """Write the plan in the file `path` as fields into a case of OpenFOAM; return the files; errors as `apply_plan`."""
    motion = MeshMotion.load(path)
    compare(motion, path, [case], (), progress)
    return motion.save_openfoam(case, points_of(case)[0])


def move(
    motion: MeshMotion, pose: Amounts, mesh: Path, points: FloatArray, zones: Sequence[Zone], names: Sequence[str] = ()
) -> FloatArray:
    """Return where a plan moves the points (N, 3) of a mesh; `names` are further zones that deform.

    Raises InputError if a point would be beyond what a mesh may have.
    """
    moved = motion.taken(points, located(motion, mesh, points, zones, names)).at(pose)
    return bounded(moved, f"{mesh.name}, moved by the plan")


def _files(mesh: Path) -> Sequence[Path]:
    return sorted((mesh / "constant" / "polyMesh").iterdir()) if is_part(mesh) else files_of(mesh)


def compare(
    motion: MeshMotion, path: Path, meshes: Sequence[Path], zones: Sequence[str], progress: Progress
) -> tuple[int, int]:
    """Compare mesh files, or parts of a case, with the mesh of the plan in the file `path`.

    Return the number of the plan's places, and of those that are in none of the meshes. Errors as of `compare_points`
    and `points_of`.
    """

    def read() -> Iterator[tuple[Path, FloatArray, Sequence[Zone]]]:
        for mesh in meshes:
            progress(f"reading {mesh.name}", 0.0)
            yield mesh, *points_of(mesh)

    try:
        return compare_points(motion, read(), zones)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def compare_points(
    motion: MeshMotion, meshes: Iterable[tuple[Path, FloatArray, Sequence[Zone]]], zones: Sequence[str] = ()
) -> tuple[int, int]:
    """Compare meshes, given by their paths, points (N, 3) and zones, with that of a plan; return as `compare`.

    `zones` are further zones that deform. Raises InputError if a place of the plan is no point, but parts of a case may
    be missing; if a point in a box is no place; or if points were rounded.
    """
    table, paths, hint = motion.places, list[Path](), ""
    seen, near, strangers = np.zeros(len(table.places), dtype=np.bool_), 0, 0
    for mesh, points, mesh_zones in meshes:
        paths.append(mesh)
        place = located(motion, mesh, points, mesh_zones, zones)
        seen[place[place >= 0]] = True
        for i, box in enumerate(table.boxes):
            named = {name for zone in mesh_zones for name in (zone.name, *zone.blocks)} & {*box.zones}
            for rows in deforming(mesh, mesh_zones, box.zones, () if named else zones):
                others = points[rows][place[rows] < 0]
                near += table.nearly(others)
                strangers += int(table.contains(others, [i]).sum())
        hint = hint or ("" if seen.any() else table.unit_hint(points))
    if 2 * near > strangers:  # of a rounded mesh all are near; of a deflected one a few are by chance
        raise InputError(f"{near} of its places are nearly points of {_names(paths)}: write all digits")
    count, places, parts = int(seen.sum()), len(seen), all(map(is_part, paths))
    if not count or (count < places and not (parts and not are_all_parts(paths))):
        text = f"is of another mesh: {count} of its {places} places are points of {_names(paths)}"
        raise InputError("; ".join(filter(None, [text, hint])))
    if strangers:
        raise InputError(f"is of another mesh: {strangers} points of {_names(paths)} in its box are no places of it")
    return places, places - count


def located(
    motion: MeshMotion, mesh: Path, points: FloatArray, zones: Sequence[Zone], further: Sequence[str] = ()
) -> IntArray:
    """Return the index (N,) of the place of each point (N, 3) in a plan; -1 for those that stay.

    Points stay in zones that do not deform; `further` are names of zones that do. InputError as of `deforming`.
    """
    table = motion.places
    place = table.find(points)
    for i, box in enumerate(table.boxes):
        stays = np.ones(len(points), dtype=np.bool_)
        for rows in deforming(mesh, zones, box.zones, further):
            stays[rows] = False
        there = place >= 0
        there[there] = table.box[place[there]] == i
        place[there & stays] = -1
    return place


def points_of(mesh: Path) -> tuple[FloatArray, tuple[Zone, ...]]:
    """Return the points (N, 3) of a mesh file and its zones; InputError for coordinates of 32 bits."""
    form = format_of(mesh)
    if form.real(mesh, mesh) != DOUBLE:
        raise InputError(f"{mesh}: has coordinates of 32 bits; a plan moves a mesh in double precision")
    return form.points(mesh)


def deforming(mesh: Path, zones: Sequence[Zone], names: Sequence[str], further: Sequence[str]) -> Iterator[slice]:
    """Yield the points of the zones that deform; InputError for several zones and none of these."""
    if len(zones) < 2:
        yield slice(None)
        return
    wanted = {*names, *further}
    deforming_zones = [zone for zone in zones if "*" in wanted or wanted & {zone.name, *zone.blocks}]
    if not deforming_zones:
        names = short_list(zone.name for zone in zones)
        raise InputError(f"{mesh}: none of its zones {names} is one that deforms: {short_list(sorted(wanted))}")
    yield from (slice(zone.start, zone.stop) for zone in deforming_zones)


@contextmanager
def _writers(meshes: Sequence[Path], out: Path | None) -> Iterator[list[Write]]:
    """Yield a function for each mesh that writes it; the files appear once the block has ended well."""
    cases = {mesh.resolve().parent for mesh in meshes if is_part(mesh)}
    if len(cases) > 1 or (cases and not all(map(is_part, meshes))):
        raise InputError("name mesh files, or parts of one case, in one command")
    if out and not cases and len(meshes) > 1:
        raise InputError(f"--out {out} is one place, and there are {len(meshes)} meshes; leave it out")
    with ExitStack() as stack:
        if cases:
            (case,) = cases
            move = stack.enter_context(move_parts(case, out or case.with_name(f"{case.name}-deflected")))
            yield [move] * len(meshes)
        else:
            yield [stack.enter_context(_writer(mesh, out)) for mesh in meshes]


@contextmanager
def _writer(mesh: Path, out: Path | None) -> Iterator[Write]:
    wanted = OutputFiles.of(mesh, out, ((0.0,),))
    form = wanted.source_form
    wanted.check()
    if wanted.form is not form:
        raise InputError(f"{wanted.out}: a plan is applied to a copy; name a file {form.suffixes[0]}")
    with permitted_as(mesh), output_files(wanted.out.parent) as scratch:

        def write(mesh: Path, points: FloatArray) -> tuple[Path, Path]:
            form.rewrite(mesh, points, scratch / wanted.out.name)
            return scratch / wanted.out.name, wanted.out

        yield write


def _names(meshes: Sequence[Path]) -> str:
    return meshes[0].name if len(meshes) == 1 else f"{meshes[0].name} to {meshes[-1].name}"

"""`sdm apply`: a saved plan moves the points of mesh files, or of the parts of a decomposed case of OpenFOAM."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError, short_list
from sdm_deflect.deform.base.states import check_unchanged, states_of
from sdm_deflect.deform.base.threads import Progress, silent
from sdm_deflect.deform.held import HeldPlan
from sdm_deflect.deform.mesh.cells import Zone
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.meshing.files import permitted_as
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam_case import is_part, move_parts
from sdm_deflect.meshing.formats.registry import files_of, format_of

from .mesh_files import Targets
from .output import output_files

Write = Callable[[Path, FloatArray], tuple[Path, Path]]
"""Writes a mesh with other points (N, 3); returns where it is, and where it will be."""


@dataclass(frozen=True, slots=True)
class Applied:
    """What a plan moved.

    Attributes
    ----------
    files : each file with its points and how many of them moved.
    places, missing : of the plan, and those that are in none of the parts of a case.
    amounts, ranges, passed : of each surface by its name; the amounts that passed are None if none did.
    faults : sentences on amounts that did not pass.
    measured : whether at most one surface is away from where it stood while the others were measured.
    """

    files: tuple[tuple[Path, int, int], ...]
    places: int
    missing: int
    amounts: dict[str, Any]
    ranges: dict[str, Any]
    passed: dict[str, tuple[float, float] | None]
    faults: tuple[str, ...]
    measured: bool


def apply_plan(
    path: Path,
    amounts: Mapping[str, float] | float,
    meshes: Sequence[Path],
    out: Path | None = None,
    zones: Sequence[str] = (),
    progress: Progress = silent,
) -> Applied:
    """Move the points of meshes by the plan in the file `path`, to the bits of the whole; all appear, or none.

    Parameters
    ----------
    path : A file of `HeldPlan.save`.
    amounts : Of the only surface, or by the surfaces' names.
    meshes : Mesh files; or folders ``processor0`` and so on of one decomposed case of OpenFOAM.
    out : The file to write, or the folder of the case; NAME-deflected beside the mesh, or the case, if None.
    zones : Further zones that deform, as in a job.
    progress : Called with what is being done.

    Raises
    ------
    InputError
        If an amount is outside its range. If a place of the plan is no point of the meshes, but some parts of a case
        may be missing; or one is nearly a point: coordinates were rounded. If a mesh has coordinates of 32 bits, or
        would be overwritten.
    MeshFileError
        If a mesh cannot be read or written.
    """
    held = HeldPlan.load(path)
    pose = held.in_order(amounts)
    held.check_ranges(pose)
    states = states_of(file for mesh in meshes for file in _files(mesh))
    places, found = check_places(held, path, meshes, zones, progress)
    files = []
    with _writers(meshes, out) as writers:
        for mesh, write in zip(meshes, writers, strict=True):
            points, moved = _move(held, pose, mesh, zones)
            progress(f"writing {mesh.name}", 0.5)
            beside, target = write(mesh, moved)
            if not np.array_equal(points_of(beside)[0], moved):
                raise MeshFileError(f"{target}: does not read back as it was written")
            files.append((target, len(points), int(np.count_nonzero((moved != points).any(axis=1)))))
        check_unchanged(states)
    ranges = {control.name: (control.low, control.high) for control in held.controls}
    named = dict(zip(ranges, pose, strict=True))
    passed = {name: held.passed(i) for i, name in enumerate(ranges)}
    return Applied(
        tuple(files), places, places - found, named, ranges, passed, held.faults(pose), held.is_measured(pose)
    )


def plan_to_case(path: Path, case: Path, progress: Progress = silent) -> tuple[Path, ...]:
    """Write the plan in the file `path` as fields into a case of OpenFOAM; return the files; errors as `apply_plan`."""
    held = HeldPlan.load(path)
    check_places(held, path, [case], (), progress)
    return held.save_openfoam(case, points_of(case)[0])


def _move(held: HeldPlan, pose: Sequence[float], mesh: Path, zones: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the points (N, 3) of a mesh, and where a plan moves them."""
    points, own = points_of(mesh)
    moved = points.copy()
    for placed, control, amount in zip(held.by_place, held.controls, pose, strict=True):
        for rows in deforming(mesh, own, placed.zones, zones) if amount and placed.fields else ():
            placed.move(points[rows], control.functions.values(amount), moved[rows])
    return points, moved


def _files(mesh: Path) -> Sequence[Path]:
    return sorted((mesh / "constant" / "polyMesh").iterdir()) if is_part(mesh) else files_of(mesh)


def check_places(
    held: HeldPlan, path: Path, meshes: Sequence[Path], zones: Sequence[str], progress: Progress
) -> tuple[int, int]:
    """Return how many places a plan has, and how many of them are points of meshes.

    InputError if none is, or if points were rounded.
    """
    boxes = [box for own in held.by_place for one in own.fields[:1] for box in one.boxes]
    known = [np.zeros((2, len(box.places)), dtype=np.bool_) for box in boxes]
    for mesh in meshes:
        progress(f"reading {mesh.name}", 0.0)
        points, own = points_of(mesh)
        for box, found in zip(boxes, known, strict=True):
            for rows in deforming(mesh, own, box.zones, zones):
                found |= box.matches(points[rows])
    exact, near = np.concatenate(known, axis=1)
    if rounded := int((near & ~exact).sum()):
        raise InputError(f"{path}: {rounded} of its places are nearly points of {_names(meshes)}: write all digits")
    count, places = int(exact.sum()), len(exact)
    if not count or (count < places and not all(map(is_part, meshes))):
        raise InputError(f"{path}: is of another mesh: {count} of its {places} places are points of {_names(meshes)}")
    return places, count


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
    own = [zone for zone in zones if "*" in wanted or wanted & {zone.name, *zone.blocks}]
    if not own:
        names = short_list(zone.name for zone in zones)
        raise InputError(f"{mesh}: none of its zones {names} is one that deforms: {short_list(sorted(wanted))}")
    yield from (slice(zone.start, zone.stop) for zone in own)


@contextmanager
def _writers(meshes: Sequence[Path], out: Path | None) -> Iterator[list[Write]]:
    """Give a function for each mesh that writes it; what was written appears once the block has ended well."""
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
    wanted, form = Targets.of(mesh, out, ((0.0,),)), format_of(mesh)
    wanted.check()
    if format_of(wanted.out) is not form:
        raise InputError(f"{wanted.out}: a plan is applied to a copy; name a file {form.suffixes[0]}")
    with permitted_as(mesh), output_files(wanted.out.parent) as scratch:

        def write(mesh: Path, points: FloatArray) -> tuple[Path, Path]:
            form.rewrite(mesh, points, scratch / wanted.out.name)
            return scratch / wanted.out.name, wanted.out

        yield write


def _names(meshes: Sequence[Path]) -> str:
    return meshes[0].name if len(meshes) == 1 else f"{meshes[0].name} to {meshes[-1].name}"

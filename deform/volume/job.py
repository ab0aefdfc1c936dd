"""A job: what to deflect in a mesh, and how, as one frozen value."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import islice
from operator import is_
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray, distinct
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Automatic, BoxRule
from sdm_deflect.deform.options import JobOptions
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import TRACK_UNIT, Motion, Moving, Rotation, SoughtHinge
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.surface.tail_root import Root
from sdm_deflect.meshing.mesh.faces import inner_patches
from sdm_deflect.meshing.mesh.images import PeriodicPatches, pair_patches, plane_of
from sdm_deflect.meshing.mesh.mesh import MARK, Mesh, meant
from sdm_deflect.meshing.mesh.quality import one_hand
from sdm_deflect.meshing.mesh.sliding import NAMES, SHAPES

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.selection import Selection


# A pose: the amount of each moving surface, in degrees or as a share of a table.
Amounts = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Sliding:
    """A patch whose nodes stay on its shape.

    Attributes
    ----------
    patch : name or wildcard.
    shape : a key of `sliding.SHAPES`.
    """

    patch: str
    shape: str

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(f"slide = {self.patch}:{self.shape}: the shape must be {NAMES}")


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A face of an overlapping block that cuts the box (section 5.2).

    Attributes
    ----------
    patch : its name.
    point : (3,) any point of the plane.
    component : 0, 1 or 2: the axis along its normal.
    slides : whether its nodes slide in the plane; if not, they stay.
    """

    patch: str
    point: FloatArray
    component: int
    slides: bool = True


@dataclass(frozen=True, slots=True)
class Job(JobOptions):
    """What moves, stays and slides, in which box, with the settings of `JobOptions`.

    Attributes
    ----------
    surfaces : the moving surfaces.
    slides : patches that stay on a plane, a cylinder, or their own surface.
    box : rule for the confining hexahedron.
    sections : faces of an overlapping block that cut the box.
    repair_slides : further patches on which a repair may slide nodes, moving patches too. ``"plane"`` means each plane
        face of the patch.
    selections : parts of patches that become patches first of all.
    periodic : pairs of patches that are images of each other, where the file does not say so.
    image_of : index of the job whose reflection in y = 0 this one is; -1 for none.
    """

    surfaces: tuple[Moving, ...]
    slides: tuple[Sliding, ...] = ()
    box: BoxRule = field(default_factory=Automatic)
    sections: tuple[Section, ...] = ()
    repair_slides: tuple[Sliding, ...] = ()
    selections: "tuple[Selection, ...]" = ()
    periodic: tuple[PeriodicPatches, ...] = ()
    image_of: int = -1

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise InputError("no surface to move: name one")

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.surfaces[0].amount

    @property
    def names(self) -> tuple[str, ...]:
        """Every patch name and wildcard in the job."""
        return (
            *(name for moving in self.surfaces for name in moving.patches),
            *self.fixed,
            *(sliding.patch for sliding in (*self.slides, *self.repair_slides)),
            *(section.patch for section in self.sections),
            *(name for pair in self.periodic for name in (pair.first, pair.second)),
            *(name for moving in self.surfaces for name in _named_by(moving.motion)),
        )

    @property
    def amounts(self) -> Amounts:
        """Amount of each surface."""
        return tuple(moving.amount for moving in self.surfaces)

    def ends(self, poses: Sequence[Amounts]) -> tuple[Amounts, ...]:
        """Return the poses at which a surface's amount is the least or the largest; `poses` are the job's own.

        A surface with a range adds the ends of the range, with the others at rest.
        """
        columns = [amounts for amounts in zip(*poses, strict=True) if len({*amounts}) > 1]
        ends = [poses[column.index(end(column))] for column in columns for end in (min, max)] or [poses[0]]
        for i, surface in enumerate(self.surfaces):
            ends += [
                tuple(end * (i == j) + 0.0 for j in range(len(self.surfaces))) for end in surface.range or () if end
            ]
        return tuple(dict.fromkeys(ends))

    def over(self, poses: Sequence[Amounts]) -> "Job":
        """Return the job with ranges that contain the amounts of its own `poses`."""
        ranges = [(min(0.0, *amounts), max(0.0, *amounts)) for amounts in zip(*poses, strict=True)]
        pairs = zip(self.surfaces, ranges, strict=True)
        surfaces = (
            replace(surface, range=surface.range or amounts) if any(amounts) else surface for surface, amounts in pairs
        )
        return replace(self, surfaces=tuple(surfaces))

    def at(self, amounts: Amounts) -> "Job":
        """Return the job with other amounts of its surfaces."""
        moved = (replace(surface, amount=amount) for surface, amount in zip(self.surfaces, amounts, strict=True))
        return replace(self, surfaces=tuple(moved))


def pose_of(jobs: Sequence[Job]) -> Amounts:
    """Return the amount of every surface of all jobs."""
    return tuple(amount for job in jobs for amount in job.amounts)


def by_job(jobs: Sequence[Job], pose: Amounts) -> tuple[Amounts, ...]:
    """Return the amounts of each job's surfaces, given those of all."""
    rest = iter(pose)
    return tuple(tuple(islice(rest, len(job.surfaces))) for job in jobs)


def poses_of(jobs: Sequence[Job], poses: Sequence[Amounts]) -> list[tuple[Amounts, ...]]:
    """Return the poses that the box of each job must hold: its own, and those of its reflection."""
    parts = list(zip(*(by_job(jobs, pose) for pose in poses), strict=True))
    images = [(job.image_of, part) for job, part in zip(jobs, parts, strict=True)]
    return [(*part, *(pose for of, other in images if of == i for pose in other)) for i, part in enumerate(parts)]


def in_proportion(jobs: Sequence[Job], angles: Sequence[float]) -> tuple[Amounts, ...]:
    """Return a pose for each angle of the first surface; the others keep their proportion to it.

    Raises InputError if the first surface's own amount is zero, but another one's is not.
    """
    pose = pose_of(jobs)
    return tuple(pose if angle == pose[0] else tuple(angle * ratio for ratio in _ratios(jobs)) for angle in angles)


def _ratios(jobs: Sequence[Job]) -> Amounts:
    pose, surfaces = pose_of(jobs), [surface for job in jobs for surface in job.surfaces]
    moves = next((surface for surface in surfaces if surface.amount), surfaces[0])
    if pose[0] or moves is surfaces[0]:
        return tuple(amount / pose[0] if pose[0] else 1.0 for amount in pose)
    raise InputError(
        f"angle = 0 of {', '.join(surfaces[0].patches)}, the first surface: the others cannot be in proportion to it; "
        f"put {', '.join(moves.patches)} first, or give rows of amounts"
    )


def prepare(mesh: Mesh, jobs: Sequence[Job]) -> tuple[Mesh, tuple[Job, ...]]:
    """Return the mesh with the jobs' selections as patches and their periodic patches paired; all jobs have the same.

    Devices get their hinge, and the selection that cuts them out.

    A patch that slides in its plane but is not plane is cut into plane parts, if it has such parts. Both sides of a
    mesh one cell thick become a pair if they slide in their planes. Cells numbered in the opposite sense to most of
    their block are reversed.

    Raises InputError if a selection or a pair does not suit the mesh.
    """
    mesh, jobs = _with_devices(mesh, jobs)
    names = tuple(dict.fromkeys(name for job in jobs for name in (*job.names, *_in_planes(mesh, job))))
    if jobs[0].selections or any(MARK in name for name in names):
        from sdm_deflect.meshing.mesh.selection import with_selections

        mesh = with_selections(mesh, jobs[0].selections, names)
    mesh = pair_patches(mesh, jobs[0].periodic) if jobs[0].periodic or mesh.periodic else mesh
    mesh = _with_panels(mesh, jobs)
    planes = set.intersection(*(_planes(mesh, job) for job in jobs))
    if len(planes) > 1:
        from sdm_deflect.meshing.mesh.thin import with_sides

        mesh = with_sides(mesh, planes)
    return mesh if mesh.is_part else _of_one_hand(_without_inner(mesh, jobs)), jobs


def _with_devices(mesh: Mesh, jobs: Sequence[Job]) -> tuple[Mesh, tuple[Job, ...]]:
    """Return the jobs with the hinges of their devices, and all with the selections that cut these from a wing.

    Notes of the mesh say which end of a wing is the first station.
    """
    cuts, prepared, notes = [*jobs[0].selections], [], []
    for job in jobs:
        surfaces = []
        for surface in job.surfaces:
            motion = surface.motion
            base = motion.base if isinstance(motion, Blended) else motion
            if isinstance(base, SoughtHinge) and base.device:
                from sdm_deflect.deform.surface.hinges import device, rise

                wall, first, second, share = base.device
                hinge, cut, note = device(mesh, surface.patches[0], wall, (first, second), share)
                cuts.append(cut)
                notes.append(note)
                turn = Rotation.about(*hinge)
                if base.vertical is not None:
                    rise(turn.axis.direction, base.vertical)
                surface = replace(surface, motion=replace(motion, base=turn) if isinstance(motion, Blended) else turn)
            surfaces.append(surface)
        prepared.append(replace(job, surfaces=tuple(surfaces)))
    mesh = replace(mesh, notes=(*mesh.notes, *notes)) if notes else mesh
    return mesh, tuple(replace(job, selections=tuple(cuts)) for job in prepared)


def _with_panels(mesh: Mesh, jobs: Sequence[Job]) -> Mesh:
    roots = (surface.motion for job in jobs for surface in job.surfaces if isinstance(surface.motion, Root))
    return reduce(lambda cut, root: root.cut(cut), roots, mesh)


def _without_inner(mesh: Mesh, jobs: Sequence[Job]) -> Mesh:
    """Return the mesh without the patches between cells, whose nodes follow it; those that a job names stay patches."""
    inner = inner_patches(mesh.patches, lambda: mesh.cells, len(mesh.points))
    return mesh.without(unnamed(inner, mesh, jobs))


def unnamed(inner: Collection[str], mesh: Mesh, jobs: Sequence[Job]) -> list[str]:
    """Return the patches between cells (`found`) that no job names, in the mesh's order.

    Raises InputError for one with a role that has nodes of a moving surface.
    """
    named = {name for job in jobs for name in job.names}
    moving = {name for job in jobs for surface in job.surfaces for name in surface.patches}
    surfaces = mesh.on(*(name for name in mesh.names if any(meant(text, name) or text == name for text in moving)))
    for name in (name for name in mesh.names if name in named - moving and name in inner):
        if len(np.intersect1d(mesh.patch(name).nodes, surfaces, assume_unique=True)):
            raise InputError(
                f"{mesh.name}: {name} lies between cells and has nodes of the moving surface: give it no role, and it "
                "follows the mesh"
            )
    return [name for name in mesh.names if name in inner and name not in named]


def _of_one_hand(mesh: Mesh) -> Mesh:
    cells = tuple(one_hand(mesh.points, block) for block in mesh.cells)
    return mesh if all(map(is_, cells, mesh.cells)) else replace(mesh, cells=cells)


def _in_planes(mesh: Mesh, job: Job) -> Iterator[str]:
    """Yield ``NAME#*`` for each patch that shall slide in its plane and consists of several plane parts."""
    slide = [slide.patch for slide in job.slides if slide.shape == "plane"]
    for patch in mesh.patches:
        wanted = any(meant(text, patch.name) for text in slide) or patch.constraint == "symmetry"
        if wanted and len(patch) and not plane_of(mesh, patch.nodes):
            from sdm_deflect.meshing.mesh.selection import Part

            whole = Part.of(mesh, patch)
            parts = whole.cut(whole.components(), MARK)
            if all(plane_of(mesh, distinct(part.faces.nodes)) for part in parts):
                yield f"{patch.name}{MARK}*"


def _planes(mesh: Mesh, job: Job) -> set[str]:
    """Return the patches that slide in their plane: as the job says, else as the file says."""
    moving = [patch for surface in job.surfaces for patch in surface.patches]
    parts = ((moving, "the surface"), (job.fixed, "fixed"), ([slide.patch for slide in job.slides], "slide"))
    named = {name for patches, what in parts for name in mesh.expand(patches, what)}
    planes = mesh.expand([slide.patch for slide in job.slides if slide.shape == "plane"], "slide")
    return {*planes, *(p.name for p in mesh.patches if p.constraint == "symmetry" and p.name not in named)}


def _named_by(motion: Motion) -> tuple[str, ...]:
    if motion.unit == TRACK_UNIT:
        return tuple(filter(None, (getattr(motion, "beside", ""),)))
    sets = (motion.held, motion.driven) if isinstance(motion, Blended) else ()
    return tuple(name for nodes in sets if isinstance(nodes, OnPatches) for name in nodes.names)

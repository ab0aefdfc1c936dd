"""A plan: all that is decided before the first fit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.base.ties import clearly_less
from sdm_deflect.deform.around.modifier import Modifier
from sdm_deflect.deform.around.near_wall import RIGID, Nearby
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.confined import Choice
from sdm_deflect.deform.rbf.rules import GreedyOptions
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.faces import BoundaryGaps
from sdm_deflect.meshing.mesh.layers import LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import EVERY_BIT, Precision
from sdm_deflect.meshing.mesh.quality import Quality
from sdm_deflect.meshing.mesh.sliding import SlidingSurface
from sdm_deflect.meshing.repair.freedom import FreeNodes

from .boundary import PrescribedMotion
from .job import Amounts, Job, by_job, pose_of, poses_of, prepare
from .region import ON_FACE, BoxNodes, check_disjoint, squeezed
from .sites import Sites
from .step import Start

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.orthogonality import AffectedFaces

    from .mirror import Mirror
    from .room import Crowding


@dataclass(frozen=True, eq=False)
class BoxPlan:
    """Known nodes, box, sites and affected cells of one box, for all poses of a job.

    Attributes
    ----------
    boundary, region, sites : the known nodes, the box and the nodes in it, the data sites.
    affected : the cells that may change.
    more : modifiers beyond those of the job.
    runner : evaluates the interpolant.
    precision : how the file to be written rounds coordinates.
    margin : factor by which fits are more accurate than the tolerance.
    mirror : nodes whose places are reflected from the box of another job; None without.
    gap : diameter of the largest part of the moved walls without a centre; 0 for fits to a tolerance.
    """

    boundary: PrescribedMotion
    region: BoxNodes
    sites: Sites
    affected: AffectedCells = field(repr=False)
    more: tuple[Modifier, ...] = ()
    runner: Runner = HERE
    precision: Precision = EVERY_BIT
    margin: float = 1.0
    mirror: "Mirror | None" = None
    gap: float = 0.0

    @classmethod
    def of(
        cls, mesh: Mesh, job: Job, poses: Sequence[Amounts], progress: Progress = silent, more: Sequence[Modifier] = ()
    ) -> "BoxPlan":
        """Plan a job for several poses in a mesh that `prepare` returned for it; `more` are further modifiers.

        Raises InputError if the job does not suit the mesh.
        """
        progress("surfaces", nan)
        boundary, ends = PrescribedMotion.of(mesh, job), job.ends(poses)
        progress("box", nan)
        try:
            boundary = boundary.knowing({*ends, job.amounts})
            region = BoxNodes.of(boundary, ends)
        except InputError as error:
            raise InputError("; ".join([str(error), *boundary.warnings])) from None
        sites = Sites.of(boundary, region, more)
        progress("cells", nan)
        affected = AffectedCells.of(mesh, boundary.both(union(region.inside, sites.moving)), boundary.mesh.points)
        affected.check(job.allow_inverted)
        return cls(boundary, region, sites, affected, tuple(more))

    @property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.affected.mesh

    @property
    def job(self) -> Job:
        """Job of the box."""
        return self.boundary.job

    @property
    def moving(self) -> tuple[tuple[Moving, Surface], ...]:
        """Each moving surface, with its motion and amount."""
        return tuple(zip(self.job.surfaces, self.boundary.surfaces, strict=True))

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the moving patches, those of the first surface first."""
        return self.boundary.moving

    @property
    def surface(self) -> str:
        """Name of the first moving patch."""
        return self.patches[0]

    @property
    def hexahedron(self) -> Hexahedron:
        """The box; in a mesh one cell thick extended to the height of that cell."""
        box, thin = self.region.hexahedron, self.boundary.thin
        if not thin:
            return box
        corners, across, station = box.corners.copy(), thin.halfway.component, thin.halfway.station
        heights, thick = corners[:, across] - station, float(np.ptp(thin.points[:, across]))
        corners[:, across] = station + max(1.0, thick / float(np.abs(heights).max())) * heights
        return Hexahedron(corners)

    @property
    def inside(self) -> IntArray:
        """Sorted indices of the nodes inside that may be interpolated."""
        return self.boundary.both(self.region.inside)

    @property
    def movable(self) -> IntArray:
        """Sorted indices of all nodes that may move."""
        return self.boundary.both(union(self.region.inside, self.sites.moving))

    @property
    def walls(self) -> IntArray:
        """Sorted indices of the moving and fixed nodes inside."""
        return self.boundary.both(union(self.sites.moving, self.sites.fixed))

    @cached_property
    def uncovered(self) -> BoundaryGaps:
        """Boundary faces near moving nodes that are on no patch, and patch faces that are no boundary."""
        return BoundaryGaps.of(self.affected, self.movable, self.patches)

    @cached_property
    def twins(self) -> IntArray:
        """Pairs (P, 2) of boundary nodes that may move, both at one place; nodes of periodic patches are left out."""
        mesh, paired = self.mesh, [pair.nodes for pair in self.mesh.periodic]
        nodes = np.setdiff1d(np.intersect1d(mesh.on(*mesh.names), self.movable, True), union(*paired))
        order = nodes[np.lexsort(mesh.points[nodes].T)]
        same = (mesh.points[order[1:]] == mesh.points[order[:-1]]).all(axis=1)
        return np.column_stack([order[:-1][same], order[1:][same]])

    def freedom(self, points: FloatArray) -> FreeNodes:
        """Return the nodes that a repair may move, with the mesh at `points` (N, 3), and their shapes.

        Boundary nodes at one place stay, so that they stay together. Nodes of boundary faces on no patch stay, because
        other zones may join there; so do nodes of moving patches outside the box. Layers keep their heights, and images
        move alike.
        """
        mesh, job = self.mesh, self.job
        shapes: dict[str, SlidingSurface | str] = {}
        for slide in job.repair_slides:
            shapes |= dict.fromkeys(mesh.expand([slide.patch], "repair_slides"), slide.shape)
        kept = [shape for modifier in self.modifiers for shape in modifier.shapes()]
        shapes |= {part.name: part.shape for part in kept if part.of_patch}
        inside = np.zeros(len(mesh.points), dtype=np.bool_)
        both, images, size = self.boundary.both, (self.boundary.thin or self.boundary).images, self.boundary.size
        moving, fixed = both(self.sites.moving), both(self.sites.fixed)
        inside[self.inside] = True
        inside[moving] = self.region.hexahedron.contains(self.affected.places[moving], ON_FACE * size)
        inside[np.setdiff1d(fixed, mesh.on(*shapes), assume_unique=True)] = inside[self.uncovered.nodes] = False
        inside[self.twins] = False
        free = inside.copy()
        others = {*mesh.names}.difference(self.boundary.pairs, self.boundary.sides)
        free[mesh.on(*others)] = False
        if len(images.nodes):
            free = images.complete(free)
            bound = images.within(free)
            inside[np.setdiff1d(images.nodes, bound.nodes, assume_unique=True)] = False
            images = bound
        within = [(part.nodes, part.shape) for part in kept if not isinstance(part.shape, str) and not part.of_patch]
        freedom = FreeNodes.of(mesh, points, inside, np.flatnonzero(free), shapes, images, within)
        return freedom.with_columns(self.layers, both(self._rigid), mesh.points, points)

    @cached_property
    def parts(self) -> list[IntArray]:
        """Rows of the known nodes in each part of the boundary (`Sites.parts`); the last one stays."""
        return self.sites.parts(self.boundary)

    @cached_property
    def layers(self) -> LayerColumns:
        """Layers over the moving and fixed nodes inside."""
        return LayerColumns.of(self.affected, self.walls)

    @cached_property
    def moved_walls(self) -> BoolArray:
        """Which nodes (N,) are on a wall that is joined with a moving surface."""
        moved, certain = np.zeros(len(self.mesh.points), dtype=np.bool_), len(self.sites.moving) + len(self.sites.fixed)
        rows = union(*self.parts[:-1])
        moved[self.boundary.both(self.sites.known[rows[rows < certain]])] = True
        return moved

    @cached_property
    def reach(self) -> float:
        """Distance up to which nodes follow walls, if there is room: an edge, a gap, or what thick layers need."""
        return max(self.edge, self.gap, self.layers.first_height(self.affected.places, self.moved_walls) / RIGID)

    @cached_property
    def edge(self) -> float:
        """Median edge of the moving surfaces, or of the walls with which they are joined if that is smaller."""
        return self.sites.finer_edge(self.boundary, self.parts)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Signs that a setting is wrong, or that something has no room, as sentences."""
        crowded = (str(self.crowding),) if self.crowding else ()
        return (*self.boundary.warnings, *squeezed(self.boundary, self.region.zones), *crowded)

    @cached_property
    def crowding(self) -> "Crowding | None":
        """Measured layers that have no room in a gap; None if all have."""
        from .room import Crowding

        nodes = np.intersect1d(self.layers.measured, self.region.inside, assume_unique=True)
        if not len(nodes) or not self.job.near_wall:
            return None
        mesh, names = self.boundary.mesh, (*self.boundary.moving, *self.boundary.mesh.names)
        return Crowding.of(mesh, self.layers, nodes, self.nearby(nodes), self.sites.known, self.reach, names)

    def nearby(self, nodes: IntArray) -> Nearby:
        """Return the moving and fixed nodes that are nearest to some nodes (M,), and the next part."""
        points, certain = self.boundary.mesh.points, len(self.sites.moving) + len(self.sites.fixed)
        parts = [part[part < certain] for part in self.parts]
        return Nearby.of(points[nodes], points[self.sites.known], parts)

    @cached_property
    def _rigid(self) -> IntArray:
        """Sorted nodes inside the flow that follow a wall rigidly; without near-wall following all of them."""
        certain = len(self.sites.moving) + len(self.sites.fixed)
        nodes = np.setdiff1d(self.region.inside, self.sites.known[:certain], assume_unique=True)
        if not self.job.near_wall:
            return nodes
        nearby = self.nearby(nodes)
        shares = nearby.rigid(np.isin(nodes, self.layers.measured), self.reach)
        beyond: BoolArray = clearly_less(shares * nearby.limits(self.reach), nearby.first)
        return nodes[~beyond]

    def to_whole_mesh(self, places: FloatArray) -> FloatArray:
        """Return the moved nodes (N, 3) of the whole mesh, given those of the mesh that is interpolated."""
        return self.boundary.thin.to_whole_mesh(places) if self.boundary.thin else places

    @cached_property
    def modifiers(self) -> tuple[Modifier, ...]:
        """Modifiers in the order in which they act; those that are off are not loaded."""
        job, sites = self.job, self.sites
        modifiers: list[Modifier] = []
        if job.near_wall:
            from sdm_deflect.deform.around.near_wall import FollowWalls

            certain, sheared = len(sites.moving) + len(sites.fixed), np.flatnonzero(sites.sheared)
            near = (sites.edges, sheared, self.layers.measured, self.edge, self.reach, self.boundary.mesh.normal)
            modifiers.append(FollowWalls(sites.known, certain, tuple(self.parts), *near, self.boundary.components))
        if self.region.sections:
            from sdm_deflect.deform.around.sections import StayInFaces

            faces = ((section.patch, nodes, section.component) for section, nodes in self.region.sections)
            modifiers.append(StayInFaces(tuple(faces)))
        return (*modifiers, *self.more, *([sites.bind] if sites.bind else []))

    @property
    def choice(self) -> Choice:
        """How centres are chosen."""
        fitting, sites = self.job.fitting, self.sites
        error = sites.tolerance / self.margin
        options = GreedyOptions(
            n_add=fitting.n_add, tol_add=error, tol_stop=error, max_centers=fitting.max_centers,
            polynomial=fitting.polynomial,
        )  # fmt: skip
        initial = fitting.initial_surface, fitting.initial_hexahedron
        return Choice(sites.kernel, fitting.strategy, fitting.rule, initial, options, fitting.processor)

    def start(self, points: FloatArray) -> Start:
        """Return the start of a step, with the interpolated mesh at `points` (N, 3)."""
        sites = self.sites
        if self.job.fitting.processor == "gpu":
            from sdm_deflect.deform.rbf.gpu import check_card  # before the fits, which take a while

            check_card()
        free = np.setdiff1d(self.region.inside, sites.known, assume_unique=True)
        rows = np.concatenate([sites.distinct, len(sites.moving) + sites.sampled])
        modifiers = tuple(modifier.at(points, free) for modifier in self.modifiers)
        return Start(
            points, sites.known, len(sites.slid), rows, len(sites.distinct), free, sites.zero, self.boundary.components,
            self.choice, modifiers, sites.bind.directions if sites.bind else None,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Plan:
    """Plans of disjoint boxes in one mesh.

    Attributes
    ----------
    boxes : the plan of each box; at least one.
    poses : amounts of all surfaces, box by box, that the boxes contain.
    """

    boxes: tuple[BoxPlan, ...]
    poses: tuple[Amounts, ...]

    @classmethod
    def of(cls, mesh: Mesh, jobs: Sequence[Job], poses: Sequence[Amounts] = (), progress: Progress = silent) -> "Plan":
        """Plan every job, for its own amounts or for several poses of all jobs' surfaces.

        The plan's mesh has the jobs' selections as patches. Raises InputError if a job does not suit the mesh, or two
        boxes overlap.
        """
        wanted = tuple(poses) or (pose_of(jobs),)
        mesh, jobs = prepare(mesh, jobs)
        boxes: list[BoxPlan] = []
        for job, own in zip(jobs, poses_of(jobs, wanted), strict=True):
            if job.image_of < 0:
                boxes.append(BoxPlan.of(mesh, job, own, progress))
                continue
            from .mirror import Mirror, with_box_of

            first = boxes[job.image_of]
            box = BoxPlan.of(mesh, with_box_of(job, first.region.hexahedron), own, progress)
            boxes.append(replace(box, mirror=Mirror.of(mesh, box.movable, first.movable)))
        check_disjoint([(box.surface, box.region.hexahedron) for box in boxes], jobs[0].box.settings)
        return cls(tuple(boxes), wanted)

    @property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.boxes[0].mesh

    @property
    def job(self) -> Job:
        """Job of the first box."""
        return self.boxes[0].job

    @property
    def reflections(self) -> tuple[str, ...]:
        """A note on each reflected surface that is no reflection to the bit; a warning if it is another shape."""
        alone = [box for box in self.boxes if box.job.image_of >= 0 and not box.mirror]
        if not alone:
            return ()
        from .mirror import reflection_note

        return tuple(reflection_note(self.mesh, box.patches, self.boxes[box.job.image_of].patches) for box in alone)

    @property
    def pose(self) -> Amounts:
        """Amount of each surface, as the jobs have it."""
        return pose_of([box.job for box in self.boxes])

    @property
    def largest(self) -> Amounts:
        """The pose with the largest amount; if nothing moves in any, the farther ends of the ranges."""
        most = max(self.poses, key=lambda pose: max(map(abs, pose)))
        return most if any(most) else tuple(max(moving.ends, key=abs) for moving, _ in self.moving)

    @property
    def unit(self) -> str:
        """Unit of the first surface's amount."""
        return self.job.surfaces[0].motion.unit

    @property
    def runner(self) -> Runner:
        """Evaluates the interpolants."""
        return self.boxes[0].runner

    @property
    def precision(self) -> Precision:
        """How the file to be written rounds coordinates."""
        return self.boxes[0].precision

    def keeping(self, precision: Precision, runner: Runner | None = None) -> "Plan":
        """Return the plan for a file of another precision, and for another runner if one is given."""
        runner = runner or self.runner
        return replace(self, boxes=tuple(replace(box, precision=precision, runner=runner) for box in self.boxes))

    @property
    def moving(self) -> tuple[tuple[Moving, Surface], ...]:
        """Each moving surface, with its motion and amount."""
        return tuple(pair for box in self.boxes for pair in box.moving)

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the moving patches, those of the first surface first."""
        return tuple(dict.fromkeys(name for box in self.boxes for name in box.patches))

    @property
    def surface(self) -> str:
        """Name of the first moving patch."""
        return self.patches[0]

    @property
    def stays(self) -> tuple[str, ...]:
        """Names of the patches that stay in every box."""
        moving = self.patches
        names = dict.fromkeys(name for box in self.boxes for name in box.boundary.fixed)
        return tuple(name for name in names if name not in moving)

    @property
    def movable(self) -> IntArray:
        """Sorted indices of all nodes that may move."""
        return union(*(box.movable for box in self.boxes))

    @property
    def fixed(self) -> IntArray:
        """Sorted indices of the fixed nodes inside the boxes."""
        return union(*(box.boundary.both(box.sites.fixed) for box in self.boxes))

    @property
    def walls(self) -> IntArray:
        """Sorted indices of the moving and fixed nodes inside."""
        return union(*(box.walls for box in self.boxes))

    def by_box(self, pose: Amounts) -> Iterator[tuple[BoxPlan, Amounts]]:
        """Yield each box with the amounts of its surfaces, given those of all."""
        yield from zip(self.boxes, by_job([box.job for box in self.boxes], pose), strict=True)

    @cached_property
    def undeflected_points(self) -> FloatArray:
        """Coordinates (N, 3) of the undeflected mesh, rounded as the file rounds them."""
        return self.precision.rounded(self.mesh.points, self.mesh.points)

    @cached_property
    def affected(self) -> AffectedCells:
        """The cells that may change."""
        return AffectedCells.together([box.affected for box in self.boxes])

    @property
    def before(self) -> tuple[Quality, ...]:
        """Quality of the affected cells before, by type."""
        return self.affected.quality_before

    @cached_property
    def faces(self) -> "AffectedFaces | None":
        """Faces of affected cells, measured as OpenFOAM's checkMesh does; None without polyhedra."""
        if not any(isinstance(block, Polyhedra) for block in self.mesh.cells):
            return None
        from sdm_deflect.meshing.mesh.orthogonality import AffectedFaces

        return AffectedFaces.of(self.affected)

"""A plan: all that is decided before anything is fitted, of one box or of several."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.sets import union
from sdm_deflect.deform.mesh.faces import BoundaryGaps
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.orthogonality import TouchedFaces
from sdm_deflect.deform.mesh.pieces import HERE, Runner
from sdm_deflect.deform.mesh.precision import EVERY_BIT, Precision
from sdm_deflect.deform.mesh.quality import Quality
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.mesh.touched import Least, TouchedCells
from sdm_deflect.deform.repair.columns import Columns
from sdm_deflect.deform.repair.freedom import FreeNodes
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.volume.boundary import Amounts, PrescribedNodes
from sdm_deflect.deform.volume.job import Job, prepared
from sdm_deflect.deform.volume.region import ON_FACE, BoxNodes, check_disjoint
from sdm_deflect.deform.volume.sites import Sites
from sdm_deflect.deform.volume.step import StepStart


class Planned:
    """What is decided before anything is fitted: of one box (`Plan`), or of several (`Plans`)."""

    if TYPE_CHECKING:  # of both, as fields or as properties

        @property
        def boxes(self) -> "tuple[Plan, ...]": ...  # noqa: D102
        @property
        def touched(self) -> TouchedCells: ...  # noqa: D102
        @property
        def before(self) -> tuple[Quality, ...]: ...  # noqa: D102
        @property
        def angles(self) -> tuple[float, ...]: ...  # noqa: D102
        @property
        def runner(self) -> Runner: ...  # noqa: D102
        @property
        def precision(self) -> Precision: ...  # noqa: D102
        def keeping(self, precision: Precision, runner: Runner | None = None) -> "Planned": ...  # noqa: D102

    @property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.touched.mesh

    @property
    def job(self) -> Job:
        """What is asked of the first box."""
        return self.boxes[0].boundary.job

    @property
    def angle(self) -> float:
        """Amount of the first surface."""
        return self.job.angle

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the moving patches, the control surface's first."""
        return tuple(name for _, surface in self.moving for name in surface.patches)

    @property
    def moving(self) -> tuple[tuple[Moving, Surface], ...]:
        """What is asked of each moving surface, and the surface."""
        pairs = (zip(box.boundary.job.surfaces, box.boundary.surfaces, strict=True) for box in self.boxes)
        return tuple(pair for some in pairs for pair in some)

    @property
    def surface(self) -> str:
        """Name of the first moving patch: the control surface."""
        return self.patches[0]

    @property
    def stays(self) -> tuple[str, ...]:
        """Names of the patches that stay, whatever box they are in."""
        moving = self.patches
        names = dict.fromkeys(name for box in self.boxes for name in box.boundary.fixed)
        return tuple(name for name in names if name not in moving)

    @property
    def changed(self) -> IntArray:
        """Sorted indices of all nodes that may move."""
        return union(*(nodes for box in self.boxes for nodes in (box.region.inside, box.sites.moving)))

    @property
    def fixed(self) -> IntArray:
        """Sorted indices of the fixed nodes inside."""
        return union(*(box.sites.fixed for box in self.boxes))

    @property
    def walls(self) -> IntArray:
        """Sorted indices of the moving and fixed nodes inside."""
        return union(*(nodes for box in self.boxes for nodes in (box.sites.moving, box.sites.fixed)))

    def amounts_at(self, angle: float) -> Amounts:
        """Return the amount of each moving surface of all boxes when the first one's is `angle`."""
        return tuple(amount for box in self.boxes for amount in box.job.amounts_at(self.angle_of(box, angle)))

    def angle_of(self, box: "Plan", angle: float) -> float:
        """Return the amount of the first surface of a box when that of all is `angle`."""
        return box.job.beside(self.job, angle)

    @cached_property
    def undeflected(self) -> FloatArray:
        """Coordinates (N, 3) of the mesh before, as the file that is to be written holds them."""
        return self.precision.rounded(self.mesh.points, self.mesh.points)

    def least(self, points: FloatArray, quality: Sequence[Quality]) -> tuple[Least, ...]:
        """Return, by type, the least quality of the touched cells that are good in the undeflected mesh.

        Parameters
        ----------
        points : (N, 3) where the nodes are.
        quality : By type, of all touched cells there.
        """
        if all(one.min > 0.0 and not one.inverted for one in self.before):
            return tuple(Least(one.min, one.cells) for one in quality)
        return self.touched.least(points)

    @cached_property
    def unheld(self) -> BoundaryGaps:
        """What patches miss of the boundary where nodes may move, and what they hold beside it."""
        return BoundaryGaps.of(self.touched, self.changed, self.patches)

    @cached_property
    def faces(self) -> TouchedFaces | None:
        """The faces of touched cells as OpenFOAM's checkMesh measures them; None without polyhedra."""
        return TouchedFaces.of(self.touched)


@dataclass(frozen=True, eq=False)
class Plan(Planned):
    """The nodes that move, the box, the sites and the cells touched, for all angles of a job.

    Attributes
    ----------
    boundary, region, sites : nodes of known displacement, the box, and where displacements are interpolated.
    touched : the cells that may change.
    before : their quality, by type, as the mesh is.
    angles : amounts of the job's first surface that the box holds.
    runner : who evaluates the interpolant.
    precision : how the file that is to be written keeps coordinates.
    """

    boundary: PrescribedNodes
    region: BoxNodes
    sites: Sites
    touched: TouchedCells = field(repr=False)
    before: tuple[Quality, ...]
    angles: tuple[float, ...]
    runner: Runner = HERE
    precision: Precision = EVERY_BIT

    @classmethod
    def of(cls, mesh: Mesh, job: Job, angles: Sequence[float] = (), progress: Progress = silent) -> "Plan":
        """Decide motion, box and sites for the job's own angle, or for several, and judge the mesh as it is.

        The plan's mesh has the selections of the job as patches. Raises InputError if the job does not suit the mesh.
        """
        return cls.on(prepared(mesh, (job,)), job, angles, progress)

    @classmethod
    def on(cls, mesh: Mesh, job: Job, angles: Sequence[float] = (), progress: Progress = silent) -> "Plan":
        """Return the plan for a mesh which has the selections of the job as patches already (`prepared`)."""
        wanted = tuple(angles) or (job.angle,)
        progress("surfaces", nan)
        boundary = PrescribedNodes.of(mesh, job)
        progress("box", nan)
        try:
            region = BoxNodes.of(boundary, job.ends(wanted))
        except InputError as error:
            raise InputError("; ".join([str(error), *boundary.warnings])) from None
        sites = Sites.of(boundary, region)
        progress("cells", nan)
        touched = TouchedCells.of(boundary.mesh, union(region.inside, sites.moving))
        touched.check(job.allow_inverted)
        return cls(boundary, region, sites, touched, touched.quality(mesh.points), wanted)

    @property
    def boxes(self) -> "tuple[Plan, ...]":
        """The plan alone: it is of one box."""
        return (self,)

    def keeping(self, precision: Precision, runner: Runner | None = None) -> "Plan":
        """Return it for a file that keeps coordinates so, and perhaps with others to evaluate the interpolants."""
        return replace(self, precision=precision, runner=runner or self.runner)

    def freedom(self, points: FloatArray) -> FreeNodes:
        """Return which nodes a repair may move, with the mesh at `points` (N, 3), and on what they stay.

        Nodes on a face of a cell that is on no patch stay, for other zones may fit to them, and so do nodes of moving
        patches beyond the box. Layers keep their heights, and images of one another move alike.
        """
        mesh, job = self.mesh, self.job
        shapes: dict[str, SlidingSurface | str] = {}
        for one in job.repair_slides:
            shapes |= dict.fromkeys(mesh.named([one.patch], "repair_slides"), one.shape)
        for section in job.sections:
            if section.slides:
                shapes[section.patch] = "plane"
        shapes |= {one.patch: one.surface for one in self.boundary.sliding}
        inside = np.zeros(len(mesh.points), dtype=np.bool_)
        moving, size = self.sites.moving, self.boundary.size
        inside[self.region.inside] = True
        inside[moving] = self.region.hexahedron.contains(mesh.points[moving], ON_FACE * size)
        inside[np.setdiff1d(self.sites.fixed, mesh.on(*shapes), assume_unique=True)] = inside[self.unheld.nodes] = False
        bound = (*self.boundary.pairs, *self.boundary.sides)
        free = inside.copy()
        free[mesh.on(*(name for name in mesh.names if name not in bound))] = False
        free = self.boundary.images.complete(free)
        images = self.boundary.images.within(free)
        inside[np.setdiff1d(self.boundary.images.nodes, images.nodes, assume_unique=True)] = False
        found = FreeNodes.of(mesh, points, inside, np.flatnonzero(free), shapes, images)
        return found.with_columns(Columns.of(self.touched, self.walls), points)

    def share(self, angle: float, k: int, count: int) -> Amounts:
        """Return the amounts after k of so many equal steps to an angle."""
        return tuple(amount * k / count for amount in self.job.amounts_at(angle))

    def state(self, points: FloatArray) -> StepStart:
        """Return the start of a step with the mesh at `points` (N, 3)."""
        return StepStart.of(self.boundary, self.region, self.sites, points)


@dataclass(frozen=True, eq=False)
class Plans(Planned):
    """The plans of several boxes of one mesh, which do not overlap: each starts from the undeflected mesh.

    Attributes
    ----------
    boxes : the plan of each box; at least one.
    """

    boxes: tuple[Plan, ...]

    @classmethod
    def of(cls, mesh: Mesh, jobs: Sequence[Job], angles: Sequence[float] = (), progress: Progress = silent) -> Planned:
        """Plan every job, for its own angle or for what it is at several of the first one's; of one job its plan.

        Raises InputError if a job does not suit the mesh, or two boxes overlap.
        """
        mesh, first = prepared(mesh, jobs), jobs[0]
        shares = [[job.beside(first, angle) for angle in angles] for job in jobs]
        boxes = tuple(Plan.on(mesh, job, own, progress) for job, own in zip(jobs, shares, strict=True))
        check_disjoint([(box.surface, box.region.hexahedron) for box in boxes], first.box.settings)
        return cls(boxes) if len(boxes) > 1 else boxes[0]

    @cached_property
    def touched(self) -> TouchedCells:
        """The cells that may change."""
        rows = zip(*(box.touched.rows for box in self.boxes), strict=True)
        return replace(self.boxes[0].touched, rows=tuple(union(*own) for own in rows))

    @cached_property
    def before(self) -> tuple[Quality, ...]:
        """Their quality, by type, as the mesh is."""
        return self.touched.quality(self.mesh.points)

    @property
    def angles(self) -> tuple[float, ...]:
        """Amounts of the first surface that its box holds."""
        return self.boxes[0].angles

    @property
    def runner(self) -> Runner:
        """Who evaluates the interpolants."""
        return self.boxes[0].runner

    @property
    def precision(self) -> Precision:
        """How the file that is to be written keeps coordinates."""
        return self.boxes[0].precision

    def keeping(self, precision: Precision, runner: Runner | None = None) -> "Plans":
        """Return it for a file that keeps coordinates so, and perhaps with others to evaluate the interpolants."""
        return Plans(tuple(box.keeping(precision, runner) for box in self.boxes))

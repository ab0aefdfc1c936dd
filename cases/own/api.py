"""Deflect a surface of any mesh from Python: one angle, or many from the same centres."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.cases.own.accept import accepted
from sdm_deflect.cases.own.box import Automatic, BoxRule, Given
from sdm_deflect.cases.own.course import Course, followed, sensitivity
from sdm_deflect.cases.own.job import Fitting, Job, Sliding
from sdm_deflect.cases.own.motion import Motion, Moving, Rotation
from sdm_deflect.cases.own.plan import Plan, planned
from sdm_deflect.cases.own.report import Report, reported
from sdm_deflect.cases.progress import Display, Silent, Stopwatch
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import FloatArray


class Options(TypedDict, total=False):
    """What `deflect` takes beside surface, hinge and angle; see `Job` and `Fitting`.

    `box` is a rule, corners (8, 3), or two opposite corners (2, 3); `slide` maps patches to ``"plane"`` or
    ``"cylinder"``; `motion` replaces the rigid rotation about the hinge.
    """

    motion: Motion
    fixed: Sequence[str]
    slide: Mapping[str, str]
    box: BoxRule | ArrayLike
    zones: Sequence[str]
    fitting: Fitting
    allow_inverted: bool
    display: Display


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A deflected mesh.

    Attributes
    ----------
    points : (N, 3) new coordinates, in the order of the old.
    mesh : the same kind of mesh as was given, with these points.
    report : figures and checks.
    plan, course : the box and sites, and the fits of every step.
    """

    points: FloatArray = field(repr=False)
    mesh: Any = field(repr=False)
    report: Report
    plan: Plan = field(repr=False)
    course: Course = field(repr=False)

    @property
    def interpolants(self) -> tuple[Interpolant, ...]:
        """The displacement of each step as a function of the points at its start; zero outside the box."""
        return tuple(solution.fits.interpolant for solution in self.course.solutions)

    @property
    def sensitivity(self) -> FloatArray:
        """d(points)/d(angle) (N, 3), in length units per degree."""
        return sensitivity(self.plan, self.course)


def deflect(
    mesh: Any, surfaces: Sequence[str], hinge: ArrayLike, angle: float, **options: Unpack[Options]
) -> Result:
    """Turn patches of a mesh about a hinge, and let the mesh around them follow.

    Parameters
    ----------
    mesh
        Mesh, TetMesh, meshio or pyvista mesh, or (points, {patch: node indices}).
    surfaces
        Names of the moving patches; wildcards allowed.
    hinge
        (2, 3) two points of the hinge line; positive angles are right-handed from the first to the second.
    angle
        Degrees.
    **options
        See `Options`.

    Raises
    ------
    InputError
        If names, hinge, angle or box do not suit the mesh: one sentence with patch and count.
    """
    return next(sweep(mesh, surfaces, hinge, (angle,), **options))


def sweep(
    mesh: Any, surfaces: Sequence[str], hinge: ArrayLike, angles: Sequence[float], **options: Unpack[Options]
) -> Iterator[Result]:
    """Deflect to several angles, the largest first: centres and factors serve for all of them.

    Each angle is checked at every data site; centres are added where one is off by more than the tolerance.
    """
    job = job_of(surfaces, hinge, max(angles, key=abs), options)
    yield from deflect_job(mesh, job, angles, options.get("display"))


def deflect_job(
    mesh: Any, job: Job, angles: Sequence[float] = (), display: Display | None = None
) -> Iterator[Result]:
    """Carry out a job, which may move several surfaces, at its own angle or at several of its first surface."""
    subject, with_points = accepted(mesh)
    watch = Stopwatch(display or Silent())
    for plan, course, report in run(subject, job, tuple(angles) or (job.angle,), watch):
        yield Result(course.points, with_points(course.points), report, plan, course)


def run(
    subject: Mesh, job: Job, angles: Sequence[float], watch: Stopwatch
) -> Iterator[tuple[Plan, Course, Report]]:
    """Plan a job for all angles, and bring the mesh to each: the largest first, the others in their order."""
    plan = planned(subject, job, tuple(angles), watch)
    with watch.stage("quality") as progress:
        progress("before", float("nan"))
        before = plan.touched.quality(subject.points)
    largest, reusable = max(angles, key=abs), None
    for angle in (largest, *(angle for angle in angles if angle != largest)):
        begin = perf_counter()
        with watch.stage(f"{angle:+g} {job.surfaces[0].motion.unit}") as progress:
            course = followed(plan, angle, progress, reusable)
        reusable = course if len(course.solutions) == 1 else reusable
        seconds = perf_counter() - begin
        with watch.stage("quality") as progress:
            progress(f"at {angle:+g}", float("nan"))
            report = reported(plan, course, before, seconds)
        yield plan, course, report


def job_of(surfaces: Sequence[str], hinge: ArrayLike, angle: float, options: Options) -> Job:
    """Return the job that arguments of `deflect` describe."""
    motion = options.get("motion") or Rotation.about(*np.asarray(hinge, dtype=np.float64).reshape(2, 3))
    box = options.get("box", Automatic())
    rule = cast(BoxRule, box) if hasattr(box, "choose") else Given.at(np.asarray(box, dtype=np.float64))
    return Job(
        surfaces=(Moving(tuple(surfaces), motion, float(angle)),),
        fixed=tuple(options.get("fixed", ())),
        slides=tuple(Sliding(patch, shape) for patch, shape in options.get("slide", {}).items()),
        box=rule,
        zones=tuple(options.get("zones", ())),
        fitting=options.get("fitting", Fitting()),
        allow_inverted=options.get("allow_inverted", False),
    )

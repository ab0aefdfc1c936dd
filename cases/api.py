"""The whole method from Python: read a mesh, deflect it, look at it, save it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.cases.job_settings import settings_of
from sdm_deflect.cases.metrics import Json, deflection_figures, mesh_figures, notes_of, verdict_figures
from sdm_deflect.deform.checks import MIN_QUALITY, Check, checks_of
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.mesh import FloatArray, Mesh
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.deform.quality import Quality
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.volume.deflection import Deflection, Plan
from sdm_deflect.deform.volume.deflection import sweep as swept
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.meshing.adapters import Accepted, accepted


def read(path: str | Path) -> Mesh:
    """Read a mesh file: SU2, CGNS, Gmsh, OpenFOAM, VTK.

    Parameters
    ----------
    path
        A file; for OpenFOAM the case's folder. The suffix says the format.

    Raises
    ------
    InputError, MeshFileError
        If the format is unknown, or the file is missing or damaged.
    """
    from sdm_deflect.meshing.formats.registry import read as read_file

    return read_file(path)


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A deflected mesh.

    Attributes
    ----------
    deflection : the plan, the fits of every step, and the points.
    mesh : the same kind of mesh as was given, with the new points.
    checks : what must hold.
    """

    deflection: Deflection = field(repr=False)
    mesh: Any = field(repr=False)
    checks: tuple[Check, ...]

    @property
    def angle(self) -> float:
        """Angle of the first surface, degrees; or the share of a table."""
        return self.deflection.angle

    @property
    def points(self) -> FloatArray:
        """Deflected coordinates (N, 3), in the mesh's unit of length and the order of the old ones."""
        return self.deflection.points

    @property
    def displacement(self) -> FloatArray:
        """How far each node (N, 3) moved, in the mesh's unit of length."""
        return self.points - self.plan.mesh.points

    @property
    def plan(self) -> Plan:
        """What was decided before the fit: box, sites, cells."""
        return self.deflection.plan

    @property
    def passed(self) -> bool:
        """True if every check holds."""
        return all(check.passed for check in self.checks)

    @property
    def quality(self) -> tuple[Quality, ...]:
        """Quality of the cells with a node in the box, by type."""
        return self.deflection.quality

    @property
    def interpolants(self) -> tuple[Interpolant, ...]:
        """The displacement of each step as a function of the points at its start; zero outside the box."""
        return tuple(step.fits.interpolant for step in self.deflection.steps)

    @property
    def sensitivity(self) -> FloatArray:
        """d(points)/d(angle) (N, 3), in length units per degree."""
        return self.deflection.sensitivity()

    def figures(self) -> Json:
        """Return all figures under the names of metrics.json."""
        return {
            "mesh": mesh_figures(self.plan),
            "angle": self.angle,
            "unit": self.plan.job.surfaces[0].motion.unit,
            **deflection_figures(self.deflection),
            "validation": verdict_figures(self.checks),
            "notes": list(notes_of(self.plan)),
        }

    def save(self, path: str | Path) -> tuple[str, ...]:
        """Write the mesh; in the format of the file it was read from, only coordinates change.

        Parameters
        ----------
        path
            The file to write; its suffix says the format.

        Returns
        -------
        Sentences on what that format cannot hold; none if it holds everything.

        Raises
        ------
        InputError
            If the format is unknown, the file is the one that was read, or it cannot be written.
        """
        from sdm_deflect.cases.mesh_files import Targets, write_mesh

        mesh, out = self.plan.mesh, Path(path)
        if not mesh.source:
            return write_mesh(None, mesh, self.points, out)
        wanted = Targets.of(Path(mesh.source), out, (self.angle,))
        wanted.check()
        return write_mesh(wanted.source, mesh, self.points, wanted.out)

    def to_pyvista(self) -> Any:
        """Return a pyvista UnstructuredGrid: cells and faces with ``displacement``, ``quality`` and ``patch``."""
        from sdm_deflect.meshing.adapters import to_pyvista

        return to_pyvista(self.plan.mesh.with_points(self.points), self.displacement, self.plan.touched.orientation)

    def to_meshio(self) -> Any:
        """Return a meshio Mesh: cells and faces with ``displacement``, one cell set for each patch."""
        from sdm_deflect.meshing.adapters import to_meshio

        return to_meshio(self.plan.mesh.with_points(self.points), self.displacement)

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        rows = "".join(
            f"<tr><td>{escape(c.name)}</td><td>{c.value:.4g}</td><td>{c.limit:.4g}</td><td>{escape(c.verdict)}</td></tr>"
            for c in self.checks
        )
        title = f"{', '.join(self.plan.patches)} of {self.plan.mesh.name}: {self.angle:+g}"
        head = "<tr><th>check</th><th>value</th><th>limit</th><th></th></tr>"
        return f"<table><caption>{escape(title)}</caption>{head}{rows}</table>"


def deflect(
    mesh: Any,
    surfaces: str | Sequence[str],
    hinge: ArrayLike | None = None,
    angle: float | None = None,
    *,
    min_quality: float = MIN_QUALITY,
    progress: Progress = silent,
    **options: Any,
) -> Result:
    """Turn patches of a mesh about a hinge, and let the mesh around them follow.

    Parameters
    ----------
    mesh
        From `read`; a meshio or pyvista mesh; or (points, {patch: node indices}).
    surfaces
        Name of the moving patch, or several; wildcards allowed.
    hinge
        (2, 3) two points of the hinge line; positive angles are right-handed from the first to the second.
    angle
        Degrees.
    min_quality
        Share of the undeflected mesh's least quality that the cells of each type must keep; 0: no such check.
    progress
        Called with what is being done and the fraction done.
    **options
        Settings by the names that `sdm deflect` has in its TOML file: `motion` (``"rigid"``, ``"blended"`` or a
        motion such as `Blended`), `fixed`, `slide`, `box`, `margin`, `zones`, `allow_inverted`, `held`, `driven`,
        `strip`, `table`, and the numbers of the interpolation: `strategy`, `tolerance`, `max_centers`, ...

    Raises
    ------
    InputError
        If an argument is unknown or of a wrong type, or names, hinge, angle or box do not suit the mesh: one sentence.
    """
    settings = settings_of(surfaces, hinge, angle, {**options, "min_quality": min_quality})
    job = settings.job()
    return run_job(accepted(mesh), job, (job.angle,), settings.min_quality, progress)[0]


def sweep(
    mesh: Any,
    surfaces: str | Sequence[str],
    hinge: ArrayLike | None,
    angles: Sequence[float],
    *,
    min_quality: float = MIN_QUALITY,
    progress: Progress = silent,
    **options: Any,
) -> tuple[Result, ...]:
    """Deflect to several angles; centres and factors of the largest serve for all of them.

    Each angle is checked at every data site; centres are added where one is off by more than the tolerance.

    Parameters
    ----------
    angles
        Degrees, in any order.
    mesh, surfaces, hinge, min_quality, progress, **options
        As for `deflect`.

    Returns
    -------
    One result for each angle, in the order of `angles`.
    """
    wanted = _angles(angles)
    settings = settings_of(surfaces, hinge, max(wanted, key=abs), {**options, "min_quality": min_quality})
    return run_job(accepted(mesh), settings.job(), wanted, settings.min_quality, progress)


def deflect_job(mesh: Any, job: Job, angles: Sequence[float] = (), progress: Progress = silent) -> tuple[Result, ...]:
    """Carry out a job, which may move several surfaces, at its own angle or at several of its first surface."""
    return run_job(accepted(mesh), job, tuple(angles) or (job.angle,), MIN_QUALITY, progress)


def run_job(
    given: Accepted, job: Job, angles: Sequence[float], min_quality: float, progress: Progress
) -> tuple[Result, ...]:
    """Plan a job for all angles and bring the mesh to each; results in the order of the angles."""
    plan = Plan.of(given.mesh, job, angles, progress)
    found: dict[int, Result] = {}
    for i, one in swept(plan, angles, progress):
        found[i] = Result(one, given.with_points(one.points), checks_of(one, min_quality))
    return tuple(found[i] for i in range(len(angles)))


def _angles(angles: Sequence[float]) -> tuple[float, ...]:
    try:
        wanted = tuple(float(angle) for angle in angles)
    except (TypeError, ValueError):
        raise InputError(f"angles = {angles!r}: must be numbers, in degrees") from None
    if not wanted or not np.isfinite(wanted).all():
        raise InputError(f"angles = {angles!r}: must be at least one number, all finite")
    return wanted

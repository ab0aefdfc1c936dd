"""The whole method from Python: read a mesh, deflect it, look at it, save it."""

from __future__ import annotations

import warnings
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from html import escape
from numbers import Real
from os import PathLike
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, MeshFileError, shortened
from sdm_deflect.base.schema import describe
from sdm_deflect.base.states import check_unchanged
from sdm_deflect.base.threads import Progress, Threads, silent
from sdm_deflect.cases.run.metrics import notes_of, short_turns, warnings_of
from sdm_deflect.cases.run.progress import in_notebook, of_notebook
from sdm_deflect.cases.settings.job_settings import BY_NAME, IN_PYTHON, settings_of
from sdm_deflect.cases.settings.jobs import jobs_of, swept
from sdm_deflect.cases.settings.keywords import Options
from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.checks import Check, Grade, checks_of, grade, verdict
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.surface.shapes import AnyShape
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.job import Amounts, Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.submesh import submesh
from sdm_deflect.meshing.formats import adapters
from sdm_deflect.meshing.mesh.cells import LARGEST
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import Quality

from .file_mesh import FileMesh, about_files, path_of, save_mesh

if TYPE_CHECKING:
    from sdm_deflect.deform.mesh_motion import MeshMotion
    from sdm_deflect.deform.surface_map import SurfaceMap

# Settings that a surface map has a use for.
OF_MAPS = (
    "largest", "fixed", "slide", "periodic", "select", "zones", "box", "margin", "near_wall", "spacing",
    "spacing_edges", "kernel", "kernel_radius", "polynomial", "allow_inverted", "min_quality",
)  # fmt: skip
F = TypeVar("F", bound=Callable[..., Any])


def read(path: str | PathLike[str], progress: Progress = silent) -> FileMesh:
    """Read a mesh file: SU2, CGNS, Gmsh, UGRID, TAU, Fluent, PLOT3D, OpenFOAM, VTK.

    Parameters
    ----------
    path : A file; for OpenFOAM the case's folder. The suffix says the format.
    progress : Called with what is being done and the fraction done (0 to 1, or nan).

    Returns
    -------
    The mesh, in the file's unit of length and order of nodes. `print` shows its patches; `mesh["flap"]` is one of them.

    Raises
    ------
    InputError : if the format is unknown, or the file is missing or damaged.
    """
    from sdm_deflect.meshing.formats.registry import read as read_file

    with about_files():
        return FileMesh.of(read_file(path_of(path), progress))


@dataclass(frozen=True, slots=True, repr=False)
class Frame:
    """A page that a notebook shows in a frame."""

    html: str

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" style="width: 100%; height: 46rem; border: 0"></iframe>'


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Result:
    """A deflected mesh and its checks, which can be plotted, saved and reported. A notebook shows it as tables.

    Attributes
    ----------
    deflection : the plan, the fits of every step, and the points.
    mesh : the same kind of mesh as was given, with the new points.
    checks : the checks, with value, limit and verdict each.
    """

    deflection: Deflection
    mesh: Any
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
        """Displacement (N, 3) of each node, in the mesh's unit of length."""
        return self.points - self.plan.mesh.points

    @property
    def plan(self) -> Plan:
        """Decisions before the fit: sites, cells, the box; of several boxes, `boxes` has the plan of each."""
        return self.deflection.plan

    @property
    def passed(self) -> bool:
        """True if every check holds: the mesh can be used."""
        return self.grade != "FAILED"

    @property
    def quality(self) -> tuple[Quality, ...]:
        """Quality of the cells with a node in the box, by type; `plan.before` is the quality before."""
        return self.deflection.quality

    @property
    def interpolants(self) -> tuple[Interpolant, ...]:
        """The displacement of each step, box by box, as a function of points at its start; zero outside the box."""
        return tuple(step.fits.interpolant for box in self.deflection.boxes for step in box.steps)

    @property
    def sensitivity(self) -> FloatArray:
        """d(points)/d(amount) (N, 3), in lengths per degree or whole table; (n, N, 3) by each of several amounts."""
        rates = [*self.deflection.sensitivity().values()]
        return rates[0] if len(rates) == 1 else np.stack(rates)

    def figures(self) -> dict[str, Any]:
        """Return all figures as dictionaries with the names of metrics.json."""
        from sdm_deflect.cases.report.folder import metrics_of

        return metrics_of(self.deflection, self.checks, None, {})

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the mesh; in the format that was read, only coordinates change.

        A warning says what the format cannot hold.

        Parameters
        ----------
        path : The file to write, or the folder of an OpenFOAM case; its suffix says the format.

        Returns
        -------
        The path of what was written.

        Raises
        ------
        InputError : if the format is unknown, or the file cannot be written or is the one that was read. If that file
            has changed since. If a check fails once coordinates are rounded to what the file keeps;
            `stored_in(path).save(path)` writes it all the same.
        """
        stored = self.stored_in(path)
        failed = {check.name for check in self.checks if not check.passed}
        for check in stored.checks:
            if not check.passed and check.name not in failed:
                raise InputError(
                    f"{path}: {check.name} is {check.value:.3g} there, limit {check.limit:.3g}; {check.where}"
                )
        return save_mesh(self.plan.mesh, stored.points, path)

    def stored_in(self, path: str | PathLike[str]) -> Result:
        """Return the result with the precision of a file at `path`, judged again: some formats have 32 bits.

        Raises InputError if the format is unknown, or the coordinates are beyond its numbers.
        """
        from sdm_deflect.cases.run.mesh_files import precision_of

        mesh = self.plan.mesh
        with about_files():
            precision = precision_of(Path(mesh.source) if mesh.source else None, path_of(path), mesh)
        if precision == self.plan.precision:
            return self
        deflection = self.deflection.rounded(precision)
        return replace(self, deflection=deflection, checks=checks_of(deflection))

    def report(self, folder: str | PathLike[str]) -> Path:
        """Write a report of one self-contained page, with its pictures, figures and settings.

        Parameters
        ----------
        folder : The folder; it is made if it does not exist.

        Returns
        -------
        The page, ``report.html``.

        Raises InputError if the folder cannot be written, or holds other files than those of a report; if libraries are
        not installed that the extra ``report`` brings.
        """
        from sdm_deflect.base.files import permitted_as
        from sdm_deflect.cases.report.folder import plan_around, write_run_folder
        from sdm_deflect.cases.run.output import OutputError, check_installed, output_folder

        check_installed("report")
        place = path_of(folder)
        try:
            if place.exists() and any(place.iterdir()) and not (place / "report.html").exists():
                raise InputError(f"{place} holds other files already: name a new folder")
            with permitted_as(self.plan.mesh.source), output_folder(place) as scratch:
                motion = plan_around(self.deflection)
                write_run_folder(scratch, self.deflection, self.checks, None, {}, place, motion)
        except (OSError, OutputError, MeshFileError) as error:
            raise InputError(str(error)) from None
        return place / "report.html"

    def plot(self) -> Frame:
        """Show the mesh as a picture that can be turned: in a frame of a notebook, elsewhere in the browser.

        Returns
        -------
        The page, as text in `html`; a notebook shows it.

        Raises InputError if libraries are not installed that the extra ``report`` brings.
        """
        from sdm_deflect.cases.run.output import check_installed

        check_installed("report")
        from sdm_deflect.cases.report.folder import data_of
        from sdm_deflect.cases.report.page import page
        from sdm_deflect.cases.report.pictures import Gallery

        shown = Frame(page(data_of(self.deflection).with_verdict(self.checks, self.figures()), Gallery(())))
        if not in_notebook():
            with NamedTemporaryFile("w", suffix=".html", delete=False, encoding="utf-8") as file:
                file.write(shown.html)
            webbrowser.open(Path(file.name).as_uri())
        return shown

    def to_pyvista(self) -> Any:
        """Return a pyvista UnstructuredGrid: cells and faces with ``displacement``, ``quality`` and ``patch``.

        ``displacement`` (N, 3) is on the nodes; ``quality`` (nan on faces) and ``patch`` are on cells, then faces. The
        field array ``patch_names`` names the patches, its first item ``volume`` the cells.
        """
        mesh = self.plan.mesh.with_points(self.points).for_file()
        return adapters.to_pyvista(mesh, self.displacement, self.plan.affected.orientation)

    def to_meshio(self) -> Any:
        """Return a meshio Mesh: cells and faces, ``displacement`` (N, 3) on the nodes, one cell set for each patch.

        Raises InputError for polyhedra that are no tetrahedra, pyramids, wedges or hexahedra: meshio has no form for
        them.
        """
        return adapters.to_meshio(self.plan.mesh.with_points(self.points).for_file(), self.displacement)

    @property
    def title(self) -> str:
        """Surface, mesh, angle and verdict, and the reached share of the angle if it is less than all."""
        text = "; ".join([verdict(self.checks), *short_turns(self.plan, self.deflection.amounts)])
        return f"{', '.join(self.plan.patches)} of {self.plan.mesh.name} at {self.angle:+g} {self.plan.unit}: {text}"

    @property
    def grade(self) -> Grade:
        """The verdict in a word: passed; usable, which `checks` say why; or FAILED."""
        return grade(self.checks)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of probable mistakes although every check holds, reached shares of the angle, and notes."""
        return (*warnings_of(self.plan), *short_turns(self.plan, self.deflection.amounts), *notes_of(self.plan))

    def __repr__(self) -> str:
        return "\n".join([f"<Result: {self.title}>", *(f"warning: {text}" for text in warnings_of(self.plan))])

    def _repr_html_(self) -> str:
        """Return the checks and the quality before and after, as tables for notebooks."""
        checks = [
            (c.name, f"{c.value:.4g}" if c.over else "", f"{c.judgement} {c.limit:.4g} {c.unit}".strip(), c.verdict)
            for c in self.checks
        ]
        quality = [
            (new.shape, new.measure, str(new.cells), *(f"{one.min:.3f} / {one.mean:.3f}" for one in (old, new)))
            for old, new in zip(self.plan.before, self.quality, strict=True)
        ]
        warned = "".join(f"<p>&#9888; {escape(text)}</p>" for text in warnings_of(self.plan))
        return (
            warned
            + _table(self.title, ("check", "value", "limit", "verdict"), checks)
            + _table("Cells in the box: least / mean quality", ("type", "measure", "cells", "before", "after"), quality)
        )


def _with_settings(function: F) -> F:
    settings = (
        setting for name, setting in BY_NAME.items() if name not in IN_PYTHON and name not in ("hinge", "angle")
    )
    if function.__doc__:  # not with python -OO
        function.__doc__ = function.__doc__.replace("{settings}", describe(list(settings), " " * 8))
    return function


@_with_settings
def deflect(
    mesh: Any,
    surfaces: str | Sequence[Any],
    hinge: ArrayLike | None = None,
    angle: float | None = None,
    *,
    progress: Progress = silent,
    **options: Unpack[Options],
) -> Result:
    """Turn patches of a mesh about a hinge, and let the mesh around them follow inside a box.

    Parameters
    ----------
    mesh : From `read`, the path of a file, or arrays ``(points (N, 3), {patch: node indices (K,)})``. Or a meshio mesh
        with a cell set or a physical group for each patch. Or a pyvista grid whose faces have the cell array ``patch``,
        named by the field array ``patch_names``.
    surfaces : Name of the moving patch, or several; ``*`` stands for any letters. For several surfaces with different
        hinges and angles, a list of dictionaries with ``patches``, ``hinge``, ``angle`` and, if needed, ``motion`` and
        its settings.
    hinge : (2, 3) two points of the hinge line, in the mesh's unit of length; in a plane mesh one point (2,).
    angle : Degrees, right-handed from the first hinge point to the second, at most 90 either way; of a `table` its
        share.
    progress : Called with what is being done and the fraction done (0 to 1, or nan); a notebook shows it by itself.
    **options : Settings by the names that they have in the TOML file of ``sdm deflect``.

        {settings}

    Returns
    -------
    The deflected mesh with its checks. A check that fails is no error; `passed` of the result tells.

    Raises
    ------
    InputError : if an argument is unknown, without effect or of a wrong type, or names, hinge, angle or box do not suit
        the mesh: one sentence.

    Examples
    --------
    ::

        result = deflect("naca.su2", "flap", hinge=[[0.7, 0.6, 0], [0.7, 1.4, 0]], angle=15,
                         motion="blended", fixed="wing", slide="symmetry:plane")
        result.save("naca-15.su2")
    """
    jobs = jobs_of(settings_of(surfaces, hinge, angle, options))
    return _run(mesh, jobs, (), progress)[0]


def plan(
    mesh: Any,
    surfaces: str | Sequence[Any] | Mapping[str, Any],
    hinge: ArrayLike | None = None,
    angle: float | None = None,
    *,
    progress: Progress = silent,
    **options: Unpack[Options],
) -> MeshMotion:
    """Return a plan that moves a mesh to any amounts within a range, by sums of fixed fields.

    With a `range`, the meshes at its ends are those of `deflect`, and amounts between are judged. With an `angle` alone
    the plan holds for that angle. Of a large file that can be read in pieces, only the boundary, the box and the
    coordinates of all nodes are read.

    Parameters
    ----------
    mesh, hinge, angle, progress, **options : As for `deflect`.
    surfaces : As for `deflect`; or tables by the surfaces' names, each with its own ``hinge`` and ``range``.

    Returns
    -------
    The plan: `at` returns coordinates, `jvp` and `vjp` derivatives, `check` all checks; `on` moves any part of the
    mesh.

    Raises
    ------
    InputError : as for `deflect`; or if sums of fields would miss a deflection, as on a triangulated slide. For a plan
        of one amount, if a check of the mesh fails, which it names.
    """
    from sdm_deflect.deform.mesh_motion import MeshMotion

    jobs = jobs_of(settings_of(surfaces, hinge, angle, options), by_range=True)
    mesh = _read_needed(path_of(mesh), jobs, progress) if isinstance(mesh, str | PathLike) else mesh
    if any(moving.range for job in jobs for moving in job.surfaces):
        motion = MeshMotion.of(_plan_jobs(mesh, jobs, (), progress)[0], progress).judged(progress)
    else:
        (result,) = _run(mesh, jobs, (), progress)
        if not result.passed:
            raise InputError(result.title)
        motion = MeshMotion.of_one_amount(result.deflection, result.checks)
    whole = motion.plan.mesh if motion.plan else None
    return motion.of_whole(_coordinates(whole)) if whole and whole.whole else motion


def sweep(
    mesh: Any,
    surfaces: str | Sequence[Any],
    hinge: ArrayLike | None,
    angles: str | PathLike[str] | Sequence[float] | Sequence[Sequence[float]],
    *,
    progress: Progress = silent,
    **options: Unpack[Options],
) -> tuple[Result, ...]:
    """Deflect to several angles, with the centres and factors of the largest for all of them.

    Each angle is checked at every data site; centres are added if a site is off by more than the tolerance. The box
    holds the surface at all angles. Of several surfaces with angles of their own, `angles` are those of the first, and
    the others keep their proportion to it; or `angles` has the amounts of all.

    Parameters
    ----------
    mesh, surfaces, hinge : As for `deflect`.
    angles : Degrees, in any order; or text, ``"-30:30:5"`` with both ends included. Or rows with the amounts of all
        surfaces, or a .csv of them with a title line that names the surfaces.
    progress, **options : As for `deflect`.

    Returns
    -------
    One result for each angle or row, in the order of `angles`.

    Raises
    ------
    InputError : as for `deflect`, or if there is no angle.
    """
    jobs, poses = swept(settings_of(surfaces, hinge, None, options), angles)
    return _run(mesh, jobs, poses, progress)


def surface_map(
    mesh: Any, surfaces: str | Sequence[str], *, progress: Progress = silent, **options: Unpack[Options]
) -> SurfaceMap:
    """Return the coordinates of a mesh as a function of the places of its surface's nodes, with both derivatives.

    Any shape can follow: bending, a parametrised geometry, steps of a coupled structure. All of it is one function on
    centres that never change, without steps and repair; `check` of the map judges a shape. Of a large file that can be
    read in pieces, only the boundary, the box and the coordinates of all nodes are read.

    Parameters
    ----------
    mesh, progress : As for `deflect`.
    surfaces : Name or wildcard of the surface's patches, or several.
    **options : `largest`, the largest displacement to come in the mesh's unit of length, which the box holds; or a
        `box`. Further settings of `deflect` on what stays and slides, on patches, and on the kernel.

    Returns
    -------
    The map: `nodes` and `start` are the surface's nodes and their places, `at` returns coordinates, `jvp` and `vjp`
    derivatives, `check` all checks; `on` moves any part of the mesh.

    Raises
    ------
    InputError : as for `deflect`; for a setting without effect on a map; or if `largest` and `box` are missing.

    Examples
    --------
    ::

        warp = surface_map("wing.su2", "wing*", largest=0.1, fixed="body", slide="symmetry:plane")
        points = warp.at(warp.start + displacement)
    """
    from sdm_deflect.deform.surface_map import SurfaceMap

    for name in options:
        if name in BY_NAME and name not in OF_MAPS:
            raise InputError(f"{name}: a surface map has no use for it; it takes {', '.join(OF_MAPS)}")
    largest = options.get("largest")
    if largest is None and "box" not in options:
        raise InputError("largest is missing: give the largest displacement to come, a length, or a box")
    if largest is not None and not (isinstance(largest, Real) and 0.0 < largest < LARGEST):
        raise InputError(f"largest = {shortened(largest)} must be a length above 0: the largest displacement to come")
    surface = {"patches": surfaces, "motion": AnyShape(), "amount": 1.0}
    others = {name: value for name, value in options.items() if name != "largest"}
    (job,) = jobs_of(settings_of([surface], None, None, others))
    if isinstance(job.box, Automatic):
        job = replace(job, box=replace(job.box, largest=float(largest or 0.0)))
    needed = _read_needed(path_of(mesh), [job], progress) if isinstance(mesh, str | PathLike) else mesh
    given = adapters.accept(needed).mesh
    return SurfaceMap.of(given, job, _coordinates(given) if given.whole else None, progress=progress)


def _read_needed(path: Path, jobs: Sequence[Job], progress: Progress) -> Mesh:
    """Read a mesh file; of a large one that can be read in pieces only the parts that jobs need."""
    from sdm_deflect.meshing.formats.registry import in_pieces, size_of

    with about_files():
        if path.exists() and size_of(path) >= threads.LIMITS.file:
            with in_pieces(path, progress) as large:
                if large:
                    return submesh(large, jobs, (), Threads(), progress)
        return read(path, progress)


def _coordinates(mesh: Mesh) -> FloatArray:
    """Read the undeflected coordinates (N, 3) of the file of a mesh; InputError if it has changed."""
    from sdm_deflect.meshing.formats.registry import format_of

    with about_files():
        check_unchanged(mesh.files)
        return format_of(mesh.source).points(Path(mesh.source))[0]


def _run(mesh: Any, jobs: Sequence[Job], poses: Sequence[Amounts], progress: Progress) -> tuple[Result, ...]:
    if not callable(progress):
        raise InputError(f"progress = {shortened(progress)} must be a function of a text and a fraction")
    progress = of_notebook() if progress is silent else progress
    plan, given = _plan_jobs(mesh, jobs, poses, progress)
    judged = run(plan, lambda _: nullcontext(progress))
    results = {
        deflection.amounts: Result(deflection, given.with_points(deflection.points), checks)
        for deflection, checks in judged
    }
    return tuple(results[pose] for pose in plan.poses)


def _plan_jobs(mesh: Any, jobs: Sequence[Job], poses: Sequence[Amounts], progress: Progress) -> tuple[Plan, Any]:
    """Plan jobs for all poses, warn of probable mistakes and short turns, and return also the mesh as given."""
    given = adapters.accept(read(mesh, progress) if isinstance(mesh, str | PathLike) else mesh)
    plan = Plan.of(given.mesh, jobs, poses, progress)
    for text in (*warnings_of(plan), *short_turns(plan, plan.largest)):
        warnings.warn(text, stacklevel=4)
    return plan, given


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"<tr><th>{'</th><th>'.join(head)}</th></tr>"] if rows else []
    lines += [f"<tr><td>{'</td><td>'.join(map(escape, row))}</td></tr>" for row in rows]
    return f"<table><caption>{escape(title)}</caption>{''.join(lines)}</table>" if rows else ""

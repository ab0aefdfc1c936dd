"""A finished run, read from its folder, with its checks and its report made again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tomllib import loads
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.unpacking import damaged
from sdm_deflect.cases.run.mesh_files import SETTINGS, difference, precision_of
from sdm_deflect.cases.run.output import PAGE, output_files
from sdm_deflect.cases.settings.job_settings import job_settings, read_job
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.checks import Check, checks_of
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.formats.registry import format_of, read
from sdm_deflect.meshing.formats.vtu import vtu_arrays
from sdm_deflect.meshing.mesh.mesh import Mesh

from .data import RUN, FitRows, ReportData, read_figures, read_json, stored_checks
from .folder import PLAN, job_data, part_of

if TYPE_CHECKING:
    from .pictures import Exhibit

STORED = "the checks and their values are those of the run, and there are no maps of distances from the CAD"


class Validation(Protocol):
    """Additions of a case to a finished run: page, checks against CAD and their pictures, background mesh."""

    @property
    def lacks(self) -> str:
        """Sentence naming the libraries without which some checks cannot be made again; empty if none is missing."""
        ...

    @property
    def background(self) -> Mesh | None:
        """The mesh around a Chimera block; None without one."""
        ...

    def page(self, plan: Plan, points: FloatArray, fits: Sequence[FitRows], repair: FloatArray | None) -> ReportData:
        """Return the content of the report, without the verdict."""
        ...

    def checks(self, deflection: Deflection, cache: bool) -> tuple[Check, ...]:
        """Return all checks of the deflected mesh; with `cache` the CAD may come from the cache."""
        ...

    def undeflected_checks(self, mesh: Mesh) -> tuple[Check, ...]:
        """Return the checks of the meshes before the deflection against newly built CAD."""
        ...

    def draw(self, data: ReportData, folder: Path) -> "Sequence[Exhibit]":
        """Draw the distances from the CAD into `folder`."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FinishedRun:
    """A finished run of a deflected mesh or of a case, read from its folder.

    Attributes
    ----------
    folder : its folder.
    plan : decisions before the fit, from its settings and its undeflected mesh.
    points : (N, 3) deflected coordinates.
    repair : (N, 3) displacement by the repair; None without one.
    settings : content of settings.toml, or of case.toml.
    validation : additions of a case; None for a mesh.
    """

    folder: Path
    plan: Plan = field(repr=False)
    points: FloatArray = field(repr=False)
    repair: FloatArray | None = field(repr=False)
    settings: str = field(repr=False)
    validation: Validation | None = field(default=None, repr=False)

    @classmethod
    def of(cls, folder: Path) -> "FinishedRun":
        """Read the folder beside a mesh; InputError if a file is missing or damaged, or the mesh is another."""
        with damaged(folder, RUN):
            settings = (folder / SETTINGS).read_text(encoding="utf-8")
            path, count = loads(settings).get("mesh", ""), read_json(folder)["mesh"]["points"]
        if not path or not isinstance(path, str):
            raise InputError(f"{folder / SETTINGS} names no mesh: this deflection was of no file")
        source = (folder / path).resolve()
        mesh = read(source)
        if len(mesh.points) != count:
            raise InputError(f"{source} has {len(mesh.points)} points, but {count} when it was deflected")
        plan = Plan.of(mesh, jobs_of(job_settings(read_job(folder / SETTINGS))))
        points = _read_points(folder / "deflected.vtu", plan)
        return cls(folder, plan, points, moved_by_repair(folder / "deflected.vtu", len(points)), settings)

    def report_data(self) -> ReportData:
        """Return the content of its report, with the checks that the run made; InputError if a file is damaged."""
        figures, checks, fits = read_figures(self.folder)
        with damaged(self.folder, RUN):
            if self.validation:
                data = self.validation.page(self.plan, self.points, fits, self.repair)
            else:
                stored = self.settings, self.folder.resolve().name
                data = job_data(self.plan, self.plan.pose, self.points, stored, fits, self.repair)
        return replace(data, motion=self.motion).with_verdict(checks, figures)

    @property
    def motion(self) -> MeshMotion | None:
        """Plan that moves its mesh to other amounts; None if its folder has none."""
        path = self.folder / PLAN
        return MeshMotion.load(path) if path.exists() else None

    def recheck(self) -> tuple[Check, ...]:
        """Return its checks, made again from its files, and the checks that the run made.

        All files are read before any CAD is built. Raises InputError or MeshFileError if a file is missing or damaged,
        or the files do not belong together.
        """
        figures, stored, _ = read_figures(self.folder)
        if self.validation:
            deflection = Deflection.at(self.plan, self.points, self.repair)
            fresh = self.validation.checks(deflection, cache=False), self.validation.undeflected_checks(self.plan.mesh)
            return (*fresh[0], *stored_checks(stored), *fresh[1])
        with damaged(self.folder, RUN):
            names = [Path(name).name for name in figures["files"]]
        if not names:
            return (*checks_of(Deflection.at(self.plan, self.points, self.repair)), *stored_checks(stored))
        out = self.folder.resolve().with_name(names[0])
        plan = self.plan.keeping(precision_of(Path(self.plan.mesh.source), out, self.plan.mesh))
        text = difference(self.plan.mesh, self.points, out) if out.exists() else "it is not there"
        whole = Check("mesh_file", float(bool(text)), 0.0, "faults", f"{out.name}: {text}" if text else out.name)
        return (*checks_of(Deflection.at(plan, self.points, self.repair)), *stored_checks(stored), whole)

    def not_repeated(self, checks: Sequence[Check]) -> tuple[str, ...]:
        """Return the names of the run's checks that were not made again."""
        names = {check.name for check in checks}
        return tuple(check.name for check in read_figures(self.folder)[1] if check.name not in names)

    def rejudged_data(self) -> ReportData:
        """Return the content of its report, with all checks made again but those of the fits, which are stored."""
        data = self.report_data()
        if not self.validation:
            return data
        if lacking := self.validation.lacks:
            notes = [*data.figures.get("notes", ()), f"{STORED}; {lacking}"]
            return replace(data, figures={**data.figures, "notes": notes})
        deflection = Deflection.at(self.plan, self.points, self.repair)
        fresh = {check.name: check for check in self.validation.checks(deflection, cache=True)}
        return replace(data, checks=(*(fresh.pop(check.name, check) for check in data.checks), *fresh.values()))

    def report(self, form: str = "") -> ReportData:
        """Write report.html and the figures again, the figures also as pdf, svg or png for a paper."""
        from .page import write_report
        from .pictures import draw_pictures

        data = self.rejudged_data()
        with output_files(self.folder, PAGE) as scratch:
            figures = scratch / "figures"
            gallery = draw_pictures(data, figures)
            if self.validation:
                gallery = gallery.with_more(self.validation.draw(data, figures))
            write_report(data, gallery, scratch)
            for exhibit in gallery.exhibits if form else ():
                exhibit.write(form)
        return data


def _read_points(path: Path, plan: Plan) -> FloatArray:
    """Read the deflected coordinates (N, 3) from a file that may hold only what moves; InputError if sizes differ."""
    points, out = format_of(path).read(path).points, plan.mesh.points.copy()
    node = np.arange(len(out))
    if len(points) != len(out):
        node = part_of(plan.mesh, plan.affected.rows, plan.movable)[1]
    if len(points) != len(node):
        raise InputError(f"{path} does not belong to the mesh {plan.mesh.name}")
    out[node] = points
    return out


def moved_by_repair(path: Path, count: int) -> FloatArray | None:
    """Return the repair's displacement (N, 3) from a run's deflected.vtu; None without a repair.

    Raises InputError if the array is damaged.
    """
    arrays, out = vtu_arrays(path), np.zeros((count, 3))
    node, moved = arrays.get("node", np.arange(count)), arrays.get("repair")
    if moved is None:
        return None
    if moved.shape != (len(node), 3) or not np.isfinite(moved).all():
        raise InputError(f"{path}: its array repair is not {len(node)} finite vectors")
    out[node] = moved
    return out

"""`sdm deflect` carried out: read, deflect, write, all files or none."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sdm_deflect.cases.output import output_folder
from sdm_deflect.cases.own import files
from sdm_deflect.cases.own.api import run
from sdm_deflect.cases.own.course import sensitivity
from sdm_deflect.cases.own.job import Job
from sdm_deflect.cases.own.plan import Plan, planned
from sdm_deflect.cases.own.report import Report, notes_of, plan_figures
from sdm_deflect.cases.progress import Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """What was done, for the table at the end."""

    plan: Plan
    reports: tuple[Report, ...] = field(repr=False)
    files: tuple[Path, ...]
    lost: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """True if every check of every angle holds."""
        return all(report.passed for report in self.reports)


def dry_run(source: Path, job: Job, angles: Sequence[float], watch: Stopwatch) -> Plan:
    """Read the mesh and decide everything, but fit and write nothing."""
    with watch.stage("read") as progress:
        mesh = files.read(source, progress)
    return planned(replace(mesh, name=source.name), job, tuple(angles), watch)


def carry_out(wanted: files.Targets, job: Job, watch: Stopwatch) -> Done:
    """Deflect a mesh file to each angle; the files appear together at the end, or none of them."""
    with watch.stage("read") as progress:
        mesh = files.read(wanted.source, progress)
    reports: list[Report] = []
    names: list[Path] = []
    lost: tuple[str, ...] = ()
    with output_folder(wanted.out.parent) as scratch:
        for plan, course, report in run(replace(mesh, name=wanted.source.name), job, wanted.angles, watch):
            name = wanted.mesh(report.angle)
            beside = scratch / name.name
            with watch.stage("write") as progress:
                lost = files.write_mesh(wanted.source, mesh, course.points, beside, progress)
            if "sensitivity" in wanted.extras:
                unit = f"mesh length per {report.unit}"
                with watch.stage("sensitivity"):
                    arrays, picture = (scratch / path.name for path in wanted.sensitivity(report.angle))
                    rates = sensitivity(plan, course)
                    files.write_sensitivity(mesh, course.points, rates, (arrays, picture), unit)
            reports.append(report)
            names.append(name)
        done = Done(plan, tuple(reports), tuple(names), lost)
        if "json" in wanted.extras:
            files.write_report(figures(done, watch), scratch / wanted.report.name)
    return done


def figures(done: Done, watch: Stopwatch) -> dict[str, Any]:
    """Return the JSON report of a job."""
    return {
        **plan_figures(done.plan),
        "angles": [report.as_dict() for report in done.reports],
        "files": [str(path) for path in done.files],
        "lost": list(done.lost),
        "notes": list(notes_of(done.plan)),
        "passed": done.passed,
        "timings": watch.seconds,
    }

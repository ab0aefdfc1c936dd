"""The work of `sdm deflect`: read, deflect, write; all files appear, or none."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sdm_deflect.base import threads
from sdm_deflect.base.errors import InputError, short_list
from sdm_deflect.base.files import permitted_as
from sdm_deflect.base.states import check_unchanged, hold_open
from sdm_deflect.base.threads import HERE, Progress, Runner, Stage
from sdm_deflect.deform.checks import Check, Grade, grade, verdict
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.job import Amounts, Job
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.formats.registry import FORMATS, files_of, format_of, in_pieces, read, size_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import Quality

from .mesh_files import OutputFiles, check_written, write_mesh, write_sensitivity
from .metrics import (
    Json,
    deflection_figures,
    farthest_figures,
    figures_by_box,
    mesh_figures,
    motion_figures,
    notes_of,
    short_turns,
    surface_figures,
    verdict_figures,
    warnings_of,
)
from .output import lacks, output_files, write_table
from .progress import Stopwatch

if TYPE_CHECKING:
    from sdm_deflect.deform.mesh_motion import MeshMotion


@dataclass(frozen=True, slots=True, eq=False)
class PoseSummary:
    """One pose of a job, without the mesh: amounts of the surfaces, figures, quality by type, checks."""

    amounts: Amounts
    figures: Json = field(repr=False)
    quality: tuple[Quality, ...]
    checks: tuple[Check, ...]
    seconds: float

    @classmethod
    def of(cls, deflection: Deflection, checks: tuple[Check, ...]) -> "PoseSummary":
        """Collect the figures of a deflection."""
        by_box = {"deflections": figures_by_box(deflection)} if len(deflection.boxes) > 1 else {}
        figures = {**deflection_figures(deflection), **by_box}
        return cls(deflection.amounts, figures, deflection.quality, checks, deflection.seconds)

    @property
    def passed(self) -> bool:
        """True if every check holds."""
        return self.grade != "FAILED"

    @property
    def grade(self) -> Grade:
        """The verdict in a word."""
        return grade(self.checks)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The results for the table at the end; poses are in the order of computation.

    `notes` are sentences on what remains to do; `motion` is the plan that moved the meshes, if there is one.
    """

    plan: Plan
    poses: tuple[PoseSummary, ...] = field(repr=False)
    files: tuple[Path, ...]
    reports: tuple[Path, ...]
    lost: tuple[str, ...]
    notes: tuple[str, ...] = ()
    motion: "MeshMotion | None" = None

    @property
    def passed(self) -> bool:
        """True if every check of every pose holds; of a plan alone, if it does so over its whole range."""
        return self.grade != "FAILED"

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """Parts of the plan's ranges that did not pass."""
        return self.motion.shortfalls if self.motion else ()

    @property
    def verdict(self) -> str:
        """The verdict on all meshes, and on the plan if it did not pass over its whole range."""
        bad = [file.name for file, summary in zip(self.files, self.poses, strict=False) if not summary.passed]
        checks = [check for summary in self.poses for check in summary.checks]
        of_meshes = verdict(checks, short_list(bad) if len(self.poses) > 1 else "this mesh")
        if not self.shortfalls:
            return of_meshes
        of_plan = f"plan: {'; '.join(self.shortfalls)}"
        if not self.poses:
            return f"FAILED: {of_plan}"
        return f"{'the mesh passed' if self.grade == 'passed' else of_meshes}; {of_plan}"

    @property
    def grade(self) -> Grade:
        """The verdict in a word: of all meshes, or of a plan alone."""
        of_meshes = grade([check for summary in self.poses for check in summary.checks])
        return of_meshes if self.poses or not self.shortfalls else "FAILED"


def read_needed(wanted: OutputFiles, jobs: Sequence[Job], progress: Progress, runner: Runner = HERE) -> Mesh:
    """Read a mesh, or only the submesh that jobs need if the file is large and can be read in pieces.

    Raises InputError if other processes are to work on it but cannot read it.
    """
    source, sent = wanted.source, not runner.shares_memory
    if sent and not format_of(source).for_workers:
        raise InputError(f"{source}: workers need {_sendable()}; leave out --workers and --scheduler, or convert it")
    if sent and not wanted.is_copy:
        raise InputError(f"{wanted.out}: workers write copies of {source.name} alone, and no sensitivity")
    if wanted.is_copy and (sent or size_of(source) >= threads.LIMITS.file):
        with in_pieces(source, progress) as mesh:
            if mesh:
                from sdm_deflect.deform.volume.submesh import submesh

                return submesh(mesh, jobs, wanted.poses, runner, progress)
    if sent:
        raise InputError(f"{source}: workers need {_sendable()}, and this file is something else")
    return read(source, progress)


def _sendable() -> str:
    *first, last = (form.for_workers for form in FORMATS.values() if form.for_workers)
    return f"{', '.join(first)}, or {last}"


def plan_file(wanted: OutputFiles, jobs: Sequence[Job], watch: Stopwatch, runner: Runner = HERE) -> Plan:
    """Read the mesh and plan the deflection for all poses that are wanted."""
    with watch.stage("read") as progress:
        mesh = read_needed(wanted, jobs, progress, runner)
    with watch.stage("plan") as progress:
        plan = Plan.of(mesh, jobs, wanted.poses, progress)
        return plan.keeping(wanted.precision(plan.mesh), runner)


def deflect_file(wanted: OutputFiles, jobs: Sequence[Job], watch: Stopwatch, runner: Runner = HERE) -> Outcome:
    """Deflect a mesh file to each pose; the files appear together at the end, or none of them.

    Raises InputError if an input file changes meanwhile, MeshFileError if a written file differs from the judged mesh.
    """
    with hold_open(files_of(wanted.source)):
        return _deflect(wanted, jobs, watch, runner)


def _deflect(wanted: OutputFiles, jobs: Sequence[Job], watch: Stopwatch, runner: Runner) -> Outcome:
    plan = plan_file(wanted, jobs, watch, runner)
    wanted.check_names(plan.mesh)
    summaries: list[PoseSummary] = []
    names: list[Path] = []
    lost: tuple[str, ...] = ()
    motion = motion_within_ranges(plan, watch.stage)
    older = [path.name for path in wanted.written if path.exists()]
    with permitted_as(wanted.source), output_files(wanted.out.parent) as scratch:
        for deflection, checks in run(plan, watch.stage, motion=motion) if wanted.written else ():
            summaries.append(PoseSummary.of(deflection, checks))
            mesh = wanted.mesh(deflection.amounts)
            with watch.stage("write") as progress:
                lost = write_pose(wanted, deflection, scratch / mesh.name, progress)
                names.append(mesh)
            _write_beside(wanted, deflection, checks, scratch, watch, motion)
        if wanted.plan:
            saved = motion or _of_one_amount(deflection, checks)
            saved.save(scratch / wanted.plan.name)
            names.append(wanted.plan)
        if wanted.summary and summaries:
            write_table(scratch / wanted.summary.name, _rows(plan, wanted, summaries))
            names.append(wanted.summary)
        check_unchanged(plan.mesh.files)
        wanted.keep_tables(scratch)
    return Outcome(
        plan, tuple(summaries), tuple(names), wanted.reports, lost, tuple(_notes(wanted, motion, older)), motion
    )


def _rows(plan: Plan, wanted: OutputFiles, summaries: Sequence[PoseSummary]) -> list[list[object]]:
    rows: list[dict[str, object]] = []
    for summary in sorted(summaries, key=lambda summary: summary.amounts):
        row: dict[str, object] = {"file": wanted.mesh(summary.amounts).name, "verdict": verdict(summary.checks)}
        row["least_quality"] = min((quality.min for quality in summary.quality), default="")
        for name, figures in surface_figures(plan, summary.amounts).items():
            row |= {name: figures["amount"], f"{name}_share": "" if figures["mean"] is None else figures["mean"]}
            places = zip(("first", "second"), figures["hinge"] or (), strict=False)
            row |= {f"{name}_{end}_{axis}": x for end, place in places for axis, x in zip("xyz", place, strict=True)}
        rows.append(row)
    return [list(rows[0]), *(list(row.values()) for row in rows)]


def _of_one_amount(deflection: Deflection, checks: Sequence[Check]) -> "MeshMotion":
    from sdm_deflect.deform.mesh_motion import MeshMotion

    return MeshMotion.of_one_amount(deflection, checks)


def _notes(wanted: OutputFiles, motion: "MeshMotion | None", older: Sequence[str]) -> list[str]:
    """Return notes: on the range of a plan that passed, a missing report, or replaced files."""
    plan = [f"plan: {text}" for text in motion.lines] if motion else []
    lacking = lacks("report") if wanted.reports else ""
    notes = [f"there is no report.html: {lacking}"] * bool(lacking)
    return plan + notes + [f"an older {short_list(older)} was replaced"] * bool(older)


def _write_beside(
    wanted: OutputFiles, deflection: Deflection, checks: tuple[Check, ...], scratch: Path, watch: Stopwatch,
    motion: "MeshMotion | None",
) -> None:  # fmt: skip
    """Write report and sensitivity of one pose, if requested."""
    plan, pose = deflection.plan, deflection.amounts
    if wanted.reported:
        from sdm_deflect.cases.report.folder import plan_around, write_run_folder

        with watch.stage("report") as progress:
            place, seconds = scratch / wanted.report(pose).name, {**watch.seconds}
            around = motion or (plan_around(deflection, progress) if len(wanted.poses) == 1 else None)
            write_run_folder(place, deflection, checks, wanted.mesh(pose), seconds, motion=around)
    if wanted.sensitive:
        with watch.stage("sensitivity"):
            arrays, picture = (scratch / path.name for path in wanted.sensitivity(pose))
            rates = motion.rates(pose) if motion else deflection.sensitivity()
            unit = f"mesh length per {plan.unit}"
            write_sensitivity(plan.mesh, deflection.points, rates, (arrays, picture), unit)


def motion_within_ranges(plan: Plan, stage: Stage) -> "MeshMotion | None":
    """Return the plan for the ranges of surfaces, judged at some amounts; None without a range."""
    if not any(moving.range for moving, _ in plan.moving):
        return None
    from sdm_deflect.deform.mesh_motion import MeshMotion

    with stage("plan") as progress:
        motion = MeshMotion.of(plan, progress)
    with stage("judge") as progress:
        return motion.judged(progress)


def write_pose(wanted: OutputFiles, deflection: Deflection, out: Path, progress: Progress) -> tuple[str, ...]:
    """Write the mesh at one pose; return a sentence for each thing that its format cannot hold.

    Raises MeshFileError if the file read back differs from the judged mesh.
    """
    mesh = deflection.plan.mesh
    points, source = deflection.points, wanted.source if mesh.source else None
    lost = write_mesh(source, mesh, points, out, progress, deflection.plan.runner)
    check_written(mesh, points, out, wanted.mesh(deflection.amounts))
    return lost


def plan_figures(plan: Plan) -> Json:
    """Return the decisions before the fit, for JSON.

    Box and sites are those of the first box; of several boxes all are in `boxes`.
    """
    boxes = [_box_figures(box) for box in plan.boxes]
    return {
        "mesh": mesh_figures(plan),
        **boxes[0],
        **({"boxes": dict(zip((box.surface for box in plan.boxes), boxes, strict=True))} if boxes[1:] else {}),
        "cells_touched": plan.affected.count,
        "farthest": farthest_figures(plan, plan.largest),
        "motion": motion_figures(plan, plan.largest),
        "warnings": list(warnings_of(plan)),
        "short_turns": list(short_turns(plan, plan.largest)),
        "notes": list(notes_of(plan)),
    }


def _box_figures(plan: BoxPlan) -> Json:
    region, sites = plan.region, plan.sites
    return {
        "box": {"corners": region.hexahedron.corners.tolist(), "why": region.box.why, "inside": len(plan.inside)},
        "sites": {"surface": len(sites.distinct), "fixed": len(sites.sampled), "tolerance": sites.tolerance},
    }


def figures(done: Outcome, watch: Stopwatch) -> Json:
    """Return the figures of a job for JSON."""
    return {
        **plan_figures(done.plan),
        "notes": [*notes_of(done.plan), *done.notes],
        "angles": [
            {
                "angle": summary.amounts[0],
                "unit": done.plan.unit,
                **summary.figures,
                "validation": verdict_figures(summary.checks),
            }
            for summary in sorted(done.poses, key=lambda summary: summary.amounts)
        ],
        **({"plan": {"surfaces": done.motion.figures()}} if done.motion else {}),
        "files": [str(path) for path in done.files],
        "reports": [str(path) for path in done.reports],
        "lost": list(done.lost),
        "passed": done.passed,
        "verdict": done.verdict,
        "timings": watch.seconds,
    }

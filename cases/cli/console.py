"""Tables and sentences that commands print at the end."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console, ConsoleOptions, Group
from rich.table import Table
from rich.text import Text

from sdm_deflect.base.arrays import union
from sdm_deflect.base.errors import printable, short_list
from sdm_deflect.cases.run.advice import advice, wider_settings
from sdm_deflect.cases.run.metrics import (
    Json,
    amounts,
    cuts,
    face_rows,
    fit_text,
    kernel_figures,
    kernel_text,
    motions,
    notes_of,
    repair_text,
    short_turns,
    signed,
    surface_figures,
    travels,
    warnings_of,
    way_of,
)
from sdm_deflect.deform.checks import Check, Verdict, verdict
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.mesh.quality import PLURALS, Quality

if TYPE_CHECKING:
    from sdm_deflect.cases.run.deflect_file import Outcome, PoseSummary

    from .examination import Finding

ARROW = "\N{RIGHTWARDS ARROW}"
# Most letters of a label with the space behind it, in the lines below a table.
INDENT = 16
# With what a note may begin.
LABELS = ("plan", "case", "mesh", "CAD", "checks")
# Width of a table in a file or a pipe, unless the environment variable COLUMNS gives another.
WIDTH = 160


def console() -> Console:
    """Return a console on standard output; if that is no terminal, it is wide enough for a table.

    Only terminals get colours and bold letters, and none if the environment variable NO_COLOR is set.
    """
    out = Console()
    return out if out.is_terminal or os.environ.get("COLUMNS", "").isdecimal() else Console(width=WIDTH)


def check_table(checks: Sequence[Check], title: str) -> Table:
    """Return the checks as one table."""
    table = _table(title, ("check",), ("value", "limit"), ("verdict", "measured over"))
    for check in checks:
        sign, unit = "<=" if check.judgement == "at most" else ">=", check.unit.removeprefix("-")
        value, limit = f"{check.value:.4g}", f"{sign} {check.limit:.4g} {unit}".rstrip()
        limit = "" if check.verdict == "information" else limit
        table.add_row(plain(check.name), value, limit, _word(check.verdict), plain(check.where))
    return table


def outcome(checks: Sequence[Check], warned: Sequence[str] = ()) -> str:
    """Return the verdict and the number of warnings."""
    return verdict(checks) + counted(warned)


def counted(warned: Sequence[str]) -> str:
    """Return the number of warnings as text after a verdict."""
    return f", {len(warned)} warning{'s' if len(warned) > 1 else ''}" if warned else ""


def warning_texts(warned: Sequence[str], *before: str) -> list[Text]:
    """Return warnings in yellow, after an empty line; nothing without warnings."""
    lines = [plain(f"warning: {text}") for text in warned]
    for line in lines:
        line.stylize("yellow")
    return [*map(plain, before), *lines] if lines else []


def rigid_lines(checks: Sequence[Check]) -> list[str]:
    """Return a line on the distance of each of the aircraft's surfaces from rigid CAD."""
    rigid = (check for check in checks if check.name.partition(":")[0] == "surface_to_rigid_cad")
    return [check.where.rpartition("; ")[0] for check in rigid]


def findings(results: Sequence["Finding"]) -> Group:
    """Return a table of a machine's findings, with advice."""
    table = _table("", ("",), (), ("found", " "))
    for finding in results:
        mark = Text("well") if finding.well else Text("NOT WELL", style="bold")
        table.add_row(plain(finding.name), plain(finding.text), mark)
    ill = [f"{finding.name}: {finding.remedy}" for finding in results if not finding.well]
    return Group(table, *_texts(ill or ["all is well"]))


def plan_table(plan: Plan) -> Group:
    """Return tables of patches and their roles, the box, and the planned computation."""
    table = _table(f"{plan.mesh.name}: what would be done", ("patch", "part"), ("nodes", "in the box"))
    inside = union(*(box.inside for box in plan.boxes))
    for patch in plan.mesh.patches:
        count = len(np.intersect1d(patch.nodes, inside, assume_unique=True))
        table.add_row(plain(patch.name), plain(_part(plan, patch.name)), str(len(patch.nodes)), str(count))
    turns = [f"{name} by {text}" for name, text in amounts(plan, plan.largest)]
    texts = [*turns, *_lines(plan), *short_turns(plan, plan.largest)]
    return Group(
        *warning_texts(warnings_of(plan)), table, Labelled(list(_motion_rows(plan, whole=True))), *_texts(texts)
    )


def result_table(done: "Outcome", whole: bool) -> Group:
    """Return warnings, motion, quality, files and the verdict; with `whole` also all checks, the box and the fit."""
    ordered, plan = sorted(done.poses, key=lambda summary: summary.amounts), done.plan
    tables, rows = _of_one_pose(done, ordered[0], whole) if len(ordered) == 1 else _of_many_poses(done, ordered)
    texts = _lines(plan) if whole else []
    if whole and ordered:
        further = [summary.seconds for summary in done.poses[1:]]
        mean = f", {sum(further) / len(further):.2f} s for each further one" if further else ""
        texts.append(f"deflected in {done.poses[0].seconds:.2f} s{mean}")
    rows = [*_motion_rows(plan, whole), *rows, *map(_noted, done.notes)]
    rows += [("lost", f"in this format: {text}") for text in done.lost]
    rows += [("wrote", short_list(map(str, done.files)))] if done.files else []
    rows += [("report", short_list(map(str, map(page_of, done.reports))))] if done.reports else []
    checks, turns = [check for summary in ordered for check in summary.checks], short_turns(plan, plan.largest)
    advised = advice(checks, wider_settings(plan), any(plan.largest))
    rows += [("advice", text) for text in ([] if done.grade == "passed" else advised)]
    warned = warnings_of(plan)
    last = "; ".join([done.verdict + counted(warned), *(_turns(turns) if done.grade == "passed" else ())])
    last += "" if done.passed else _made_at(plan)
    return Group(*warning_texts(warned, last), *tables, *_texts(texts), Labelled(rows), Labelled([("", last)]))


def _noted(note: str) -> tuple[str, str]:
    """Return a note with the label that it begins with, or else its own."""
    label, colon, text = note.partition(": ")
    return (label, text) if colon and label in LABELS else ("note", note)


def page_of(folder: Path) -> Path:
    """Return the page in the folder of a report."""
    return folder / "report.html"


def _turns(sentences: Sequence[str]) -> Sequence[str]:
    """Return a sentence on the surfaces that turn by less than their angle, if there are any."""
    several = f"{len(sentences)} surfaces turn by less than their angle on average"
    return [several] if len(sentences) > 1 else sentences


@dataclass(frozen=True, slots=True)
class Labelled:
    """Rows of a label and a text, whose further lines are indented as the first."""

    rows: Sequence[tuple[str, str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        indent = min(max((len(label) + 2 for label, _ in self.rows if label), default=0), INDENT)
        for label, text in self.rows:
            room = max(options.max_width - indent, INDENT)
            bound = text.replace(" %", "\N{NO-BREAK SPACE}%")  # a number stays with its sign
            lines = wrap(bound, room, break_on_hyphens=False, break_long_words=False)
            if len(label) + 2 > indent and label:
                yield _unwrapped(label)
                label = ""
            for i, line in enumerate(lines):
                yield _unwrapped(f"{'' if i else label:<{indent}}{line}".replace("\N{NO-BREAK SPACE}", " "))


def _unwrapped(line: str) -> Text:
    text = plain(line)
    text.no_wrap, text.overflow = True, "ignore"
    return text


def _motion_rows(plan: Plan, whole: bool) -> Iterator[tuple[str, str]]:
    """Yield for each surface how far it moves, what share of its angle it reaches, and how it was cut out."""
    reached = dict(motions(plan, plan.largest, whole))
    cut, at = dict(cuts(plan, plan.largest)), dict(_slot_rows(plan))
    surfaces = surface_figures(plan, plan.largest)
    for name, travel in travels(plan, plan.largest):
        amount = signed(surfaces[name]["amount"], surfaces[name]["unit"])
        texts = [f"{amount}: moves by up to {travel}", *(some[name] for some in (reached, cut, at) if name in some)]
        yield from zip([name] + [""] * len(texts), texts, strict=False)


def _made_at(plan: Plan) -> str:
    """Return a sentence on the setting of a slot in the mesh; nothing without a slot."""
    from sdm_deflect.deform.surface.slots import SlotSetting

    slots = (moving.motion.slot(surface) for moving, surface in plan.moving if isinstance(moving.motion, SlotSetting))
    made = (f"gap {slot.setting.gap:.4g}, overlap {slot.setting.overlap:.4g}" for slot in slots)
    return "".join(f"; the mesh was made at {text}" for text in made)


def _of_one_pose(done: "Outcome", summary: "PoseSummary", whole: bool) -> tuple[list[Table], list[tuple[str, str]]]:
    """Return the checks of a single pose, or those that failed, and rows on quality, repair and fit."""
    title, repair = f"{_title(done)}, {_amounts(summary.amounts)} {_unit(done)}", repair_text(summary.figures)
    rows = [("repair", repair)] if repair else []
    if not whole:
        failed = failed_checks(summary)
        return [check_table(failed, title)] * bool(failed), [*_quality_rows(done.plan.before, summary.quality), *rows]
    fits = [(name, fit_text(figures)) for name, figures in summary.figures.get("deflections", {}).items()]
    tables = [check_table(summary.checks, title), quality_table(done.plan.before, summary.quality)]
    return [*tables, *face_table(summary.figures)], [*rows, *(fits or [("fit", fit_text(summary.figures))])]


def failed_checks(summary: "PoseSummary") -> list[Check]:
    """Return the checks of a pose that failed."""
    return [check for check in summary.checks if not check.passed]


def _of_many_poses(done: "Outcome", ordered: Sequence["PoseSummary"]) -> tuple[list[Table], list[tuple[str, str]]]:
    """Return a table with a row for each pose, the checks of those that failed, and rows on repairs."""
    named = [(f"{_amounts(summary.amounts)} {_unit(done)}", summary) for summary in ordered]
    failed = [check_table(failed_checks(summary), name) for name, summary in named if not summary.passed]
    repairs = [("repair", f"{name}: {text}") for name, summary in named if (text := repair_text(summary.figures))]
    return [sweep_table(ordered, _title(done), done.plan.mesh.plane), *failed] if ordered else [], repairs


def _title(done: "Outcome") -> str:
    return f"{done.plan.moving[0][1].label} of {done.plan.mesh.name}"


def _amounts(pose: Sequence[float]) -> str:
    return ", ".join(f"{amount:+g}" for amount in pose)


def _unit(done: "Outcome") -> str:
    return done.plan.unit


def quality_table(before: Sequence[Quality], after: Sequence[Quality]) -> Table:
    """Return the quality of the affected cells before and after, by type."""
    headings = ("cells", "min", "1 %", "mean", "inverted")
    table = _table("cells with a node in the box: before, after", ("type", "measure"), headings)
    for old, new in zip(before, after, strict=True):
        pairs = [f"{a:.3f}, {b:.3f}" for a, b in ((old.min, new.min), (old.p01, new.p01), (old.mean, new.mean))]
        table.add_row(PLURALS[old.shape], old.measure, str(old.cells), *pairs, f"{old.inverted}, {new.inverted}")
    return table


def _quality_rows(before: Sequence[Quality], after: Sequence[Quality]) -> Iterator[tuple[str, str]]:
    """Yield the quality of the affected cells before and after: a heading, and a row for each type."""
    if after:
        yield "", f"{'worst':<15}{'1 %':<15}{'mean':<15}"
    for i, (old, new) in enumerate(zip(before, after, strict=True)):
        pairs = (f"{a:.3f} {ARROW} {b:.3f}" for a, b in ((old.min, new.min), (old.p01, new.p01), (old.mean, new.mean)))
        counted = f"{new.cells:,} {PLURALS[new.shape]}{f', {new.inverted} inverted' if new.inverted else ''}"
        yield "" if i else "cells", "".join(f"{pair:<15}" for pair in pairs) + counted


def face_table(figures: Json) -> list[Table]:
    """Return checkMesh's figures of polyhedra's faces before and after; no table without polyhedra."""
    of, rows = face_rows(figures)
    table = _table("", (f"{of} (checkMesh)",), ("before", "after"))
    for row in rows:
        table.add_row(*row)
    return [table] if rows else []


def comparison_tables(names: Sequence[str], tables: Mapping[str, Sequence[Sequence[str]]]) -> list[Table]:
    """Return tables by title, with a row for each name and a column for each run; none without rows."""
    out = []
    for title, rows in tables.items():
        table = _table(title, ("",), (), names)
        for row in rows:
            table.add_row(*map(plain, row))
        out += [table] if rows else []
    return out


def sweep_table(poses: Sequence["PoseSummary"], title: str, plane: bool) -> Table:
    """Return one row for each pose; "moves by up to" has each surface's largest displacement and where it points."""
    numbers = ("least quality", "site error", "steps")
    table = _table(title, ("angle",), numbers, ("verdict", "moves by up to"))
    for pose in poses:
        moves = (np.array(far["move"]) for far in pose.figures["farthest"].values())
        moved = ", ".join(
            f"{np.linalg.norm(move):.4g} to {way_of(move, plane)}" if move.any() else "0" for move in moves
        )
        boxes = pose.figures.get("deflections", {"": pose.figures}).values()
        error = max(fit["max_error"] for box in boxes for fit in box["adaptation"].values())
        least = min((quality.min for quality in pose.quality), default=float("nan"))
        figures = (f"{least:.3f}", f"{error:.1e}", f"{pose.figures['steps']}")
        table.add_row(_amounts(pose.amounts), *figures, _word(pose.grade), moved)
    return table


def plain(text: str) -> Text:
    """Return text without markup; characters that would control the terminal are shown as escapes."""
    return Text("\n".join(map(printable, text.split("\n"))))


def _texts(lines: Iterable[str]) -> list[Text]:
    return [plain(line) for line in lines]


def _table(title: str, left: Sequence[str], right: Sequence[str], rest: Sequence[str] = ()) -> Table:
    """Return an empty table; columns in `rest` break their lines if there is no room."""
    table = Table(title=plain(title) if title else None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in (*left, *right, *rest):
        table.add_column(heading, justify="right" if heading in right else "left", no_wrap=heading not in rest)
    return table


def _word(verdict: Verdict) -> Text:
    return Text(verdict, style="bold" if verdict == "FAILED" else "")


def _lines(plan: Plan) -> list[str]:
    boxes = (line for box in plan.boxes for line in _box_lines(box))
    return [*boxes, *(f"note: {note}" for note in notes_of(plan))]


def _slot_rows(plan: Plan) -> list[tuple[str, str]]:
    """Return surfaces with the settings of their slots as rows of a track, for a sweep over them."""
    tracks = ((name, figures.get("track")) for name, figures in surface_figures(plan, plan.largest).items())
    rows = ((name, ",".join(f"{value:.9g}" for value in row)) for name, row in tracks if row)
    return [(name, f"as a row of --track (parameter,angle,dx,dy): {row}") for name, row in rows]


def _box_lines(plan: BoxPlan) -> list[str]:
    """Return lines on the box of a plan, its content, and the interpolation."""
    sites, region = plan.sites, plan.region
    low, high = (", ".join(f"{x:.4g}" for x in region.hexahedron.corners[i]) for i in (0, 7))
    return [
        f"box {region.box.why}; from ({low}) to ({high})",
        f"{len(plan.inside)} of {plan.mesh.point_count} nodes inside, {plan.affected.count} cells affected",
        f"data sites: {len(sites.distinct)} moving, {len(sites.sampled)} fixed, {len(sites.sampled_sliding)} sliding, "
        f"{sum(map(len, sites.zero))} on the box {sites.spacing:.3g} apart; tolerance {sites.tolerance:.3g}",
        f"kernel: {kernel_text(kernel_figures(plan))}",
    ]


def _part(plan: Plan, name: str) -> str:
    for moving, surface in plan.moving:
        if name in surface.patches:
            return f"moves by {moving.amount:+g} {moving.motion.unit}"
    if name in plan.stays:
        return "fixed"
    if any(name in (*box.boundary.pairs, *box.boundary.sides) for box in plan.boxes):
        return "moves as its image"
    return "slides" if any(name in box.boundary.declared_patches for box in plan.boxes) else "outside"

"""What `sdm deflect` prints: the plan, and how each angle came out."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from sdm_deflect.cases.console import verdict
from sdm_deflect.cases.own.plan import Plan
from sdm_deflect.cases.own.report import Report, notes_of


def plan_table(plan: Plan) -> Group:
    """Return patches with their part, the box, and what will be computed."""
    table = _table(f"{plan.subject.name}: what would be done", ("patch", "part"), ("nodes", "in the box"))
    inside = plan.region.inside
    for patch in plan.subject.patches:
        name, nodes = patch.name, patch.nodes
        count = len(np.intersect1d(nodes, inside, assume_unique=True))
        table.add_row(Text(name), Text(_part(plan, name)), str(len(nodes)), str(count))
    return Group(table, *_texts(_lines(plan)))


def result_table(plan: Plan, reports: Sequence[Report], files: Sequence[Path], lost: Sequence[str]) -> Group:
    """Return the checks of a single angle, or a row for each of many, and what was written."""
    ordered = sorted(reports, key=lambda report: report.angle)
    title = f"{', '.join(plan.boundary.surfaces[0].patches)} of {plan.subject.name}"
    if len(ordered) == 1:
        only = ordered[0]
        body = [verdict(only.checks, f"{title}, {only.angle:+g} {only.unit}"), quality_table(only)]
    else:
        failed = [report for report in ordered if not report.passed]
        body = [sweep_table(ordered, title), *(verdict(r.checks, f"{r.angle:+g} {r.unit}") for r in failed)]
    extra = [report.seconds for report in reports[1:]]
    speed = f"first angle {reports[0].seconds:.2f} s"
    if extra:
        speed += f", {sum(extra) / len(extra):.2f} s for each further one"
    passed = all(report.passed for report in reports)
    wrote = [f"wrote {', '.join(str(path) for path in files)}"] if files else []
    last = "all validations passed" if passed else "A VALIDATION FAILED"
    losses = [f"not held by this format: {text}" for text in lost]
    return Group(*body, *_texts([*_lines(plan), *losses, speed, *wrote, last]))


def quality_table(report: Report) -> Table:
    """Return the quality of the touched cells before and after, by type."""
    title = "cells with a node in the box: quality before, after"
    table = _table(title, ("type", "measure"), ("cells", "min", "1 %", "mean", "inverted"))
    for old, new in zip(report.before, report.after, strict=True):
        pairs = [f"{a:.3f}, {b:.3f}" for a, b in ((old.min, new.min), (old.p01, new.p01), (old.mean, new.mean))]
        table.add_row(old.shape, old.measure, str(old.cells), *pairs, f"{old.inverted}, {new.inverted}")
    return table


def sweep_table(reports: Sequence[Report], title: str) -> Table:
    """Return one row for each angle."""
    headings = ("angle", "steps", "centres", "site error", "smallest quality", "seconds", "verdict")
    table = _table(title, (), headings)
    for one in reports:
        centers = ", ".join(f"{name}: {count}" for name, (count, _) in one.centers.items())
        error = max(value for _, value in one.centers.values())
        least = min((quality.min for quality in one.after), default=float("nan"))
        table.add_row(
            f"{one.angle:+g}", str(one.steps), centers, f"{error:.1e}", f"{least:.3f}", f"{one.seconds:.2f}",
            Text("passed") if one.passed else Text("FAILED", style="bold"),
        )  # fmt: skip
    return table


def _table(title: str, left: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in (*left, *right):
        table.add_column(heading, justify="left" if heading in left else "right", no_wrap=True)
    return table


def _texts(lines: Sequence[str]) -> list[Text]:
    """Return lines in which brackets are brackets."""
    return [Text(line) for line in lines]


def _lines(plan: Plan) -> list[str]:
    sites, region = plan.sites, plan.region
    corners = region.hexahedron.corners
    return [
        f"box {region.why}; from {_point(corners[0])} to {_point(corners[7])}",
        f"{len(region.inside)} of {len(plan.subject.points)} nodes inside, {plan.touched.count} cells touched",
        f"data sites: {len(sites.distinct)} moving, {len(sites.sampled)} fixed, {len(sites.carried)} sliding, "
        f"{len(sites.zero)} on the box {sites.spacing:.3g} apart; tolerance {sites.tolerance:.3g}",
        *(f"note: {note}" for note in notes_of(plan)),
    ]


def _point(corner: Sequence[float]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in corner) + ")"


def _part(plan: Plan, name: str) -> str:
    for moving, surface in zip(plan.job.surfaces, plan.boundary.surfaces, strict=True):
        if name in surface.patches:
            return f"moves by {moving.amount:+g} {moving.motion.unit}"
    if name in plan.boundary.fixed:
        return "fixed"
    return "slides" if name in plan.boundary.declared else "outside"

"""What a run prints: one calm table at the end."""

import os
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from sdm_deflect.cases.metrics import Json
from sdm_deflect.cases.sdm.metrics import Run, metrics
from sdm_deflect.deform.checks import Check

if TYPE_CHECKING:
    from sdm_deflect.cases.doctor import Finding

WIDTH = 160
"""Columns of a table that goes to a file or a pipe, unless the environment variable COLUMNS says otherwise."""


def console() -> Console:
    """Return the standard output, wide enough for a table where it is no terminal.

    Colours and bold letters are for terminals only, and for none if the environment variable NO_COLOR is set.
    """
    out = Console()
    return out if out.is_terminal or os.environ.get("COLUMNS", "").isdecimal() else Console(width=WIDTH)


def check_figures(check: Check) -> Json:
    """Return a check as JSON has it."""
    value = check.value if isfinite(check.value) else None
    return {
        "name": check.name,
        "value": value,
        "limit": check.limit,
        "passed": check.passed,
        "unit": check.unit,
        "where": check.where,
    }


def verdict(checks: Sequence[Check], title: str) -> Table:
    """Return the checks as one calm table."""
    table = _table(title, value="right", limit="right", verdict="left")
    for check in checks:
        sign, unit = "<=" if check.judgement == "at most" else ">=", check.unit.removeprefix("-")
        table.add_row(
            Text(check.name), f"{check.value:.4g}", f"{sign} {check.limit:.4g} {unit}".rstrip(),
            Text("passed") if check.passed else Text("FAILED", style="bold"), Text(check.where),
        )  # fmt: skip
    return table


def findings(found: Sequence["Finding"]) -> Group:
    """Return what was found on a machine, and what would help."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("", "found", ""):
        table.add_column(heading, no_wrap=not heading)
    for one in found:
        mark = Text("well") if one.well else Text("NOT WELL", style="bold")
        table.add_row(Text(one.name), Text(one.text), mark)
    ill = [one for one in found if not one.well]
    lines = [Text(f"{one.name}: {one.remedy}") for one in ill] or [Text("all is well")]
    return Group(table, *lines)


def summary(run: Run, folder: Path) -> Group:
    """Return the verdict, what was run and how long it took."""
    case = run.case
    title = f"{case.name} {case.angle:+g} deg, {case.scale}, {case.strategy}"
    return Group(verdict(run.checks, title), *(Text(line) for line in _lines(run, metrics(run), folder)))


def _lines(run: Run, figures: Json, folder: Path) -> Iterator[str]:
    before, after = (figures["quality"][state]["min"] for state in ("before", "after"))
    yield (
        f"mesh: {figures['mesh']['points']} points, {figures['mesh']['cells']} tetrahedra, "
        f"quality min {before:.3f} before, {after:.3f} after"
    )
    for name, one in figures["deflections"].items():
        fits = ", ".join(f"{d}: {fit['centers']} ({fit['max_error']:.1e} m)" for d, fit in one["adaptation"].items())
        yield (
            f"{name} {one['angle_deg']:+g} deg: {one['confinement']['inside']} nodes inside, centres {fits}, "
            f"{one['steps']} step{'s' if one['steps'] > 1 else ''}"
        )
    if run.pinned:
        states = [kinds["tetra"] for kinds in figures["quality_inside"].values()][1:]
        for state, q in zip(("sliding", "pinned"), states, strict=True):
            yield (
                f"Chimera face {state}: smallest quality inside {q['min']:.3f}, {q['below_0_4']:.3%} below 0.4, "
                f"{q['inverted']} inverted"
            )
    stages = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in run.seconds.items())
    yield f"{stages}; results in {folder}"
    yield "all validations passed" if run.passed else "A VALIDATION FAILED"


def _table(title: str, **columns: str) -> Table:
    """Return a table of checks: the name, these columns by their alignment, and what was measured over."""
    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("check", no_wrap=True)
    for heading, justify in columns.items():
        table.add_column(heading, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    table.add_column("measured over")
    return table

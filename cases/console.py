"""The table at the end of a run."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, Group
from rich.table import Table

from cases.metrics import metrics
from cases.run import Run
from cases.validation import Check

WIDTH = 160
"""Columns of a table that goes to a file or a pipe."""


def console() -> Console:
    """Return the standard output, wide enough for a table where it is no terminal."""
    out = Console()
    return out if out.is_terminal else Console(width=WIDTH)


def verdict(checks: Sequence[Check], title: str) -> Table:
    """Return the checks as one calm table."""
    table = Table(title=title, title_justify="left")
    for heading in ("check", "value", "limit", "", "measured over"):
        number = heading in ("value", "limit")
        table.add_column(heading, justify="right" if number else "left", no_wrap=heading != "measured over")
    for check in checks:
        sign = "<=" if check.judgement == "at most" else ">="
        table.add_row(
            check.name, f"{check.value:.4g}", f"{sign} {check.limit:.4g} {check.unit}",
            "passed" if check.passed else "[bold]FAILED[/bold]", check.where,
        )  # fmt: skip
    return table


def summary(run: Run, folder: Path) -> Group:
    """Return the verdict, what was run and how long it took."""
    case, figures = run.case, metrics(run)
    before, after = (figures["quality"][state]["min"] for state in ("before", "after"))
    lines = [
        f"mesh: {figures['mesh']['points']} points, {figures['mesh']['cells']} tetrahedra, "
        f"quality min {before:.3f} before, {after:.3f} after"
    ]
    for name, one in figures["deflections"].items():
        fits = ", ".join(
            f"{d}: {fit['centers']} ({fit['max_error']:.1e} m)" for d, fit in one["adaptation"].items()
        )
        lines.append(
            f"{name} {one['angle_deg']:+g} deg: {one['confinement']['inside']} nodes inside, centres {fits}, "
            f"{one['steps']} step{'s' if one['steps'] > 1 else ''}"
        )
    lines += [
        f"Chimera face {state}: smallest quality inside {q['min']:.3f}, {q['below_0_4']:.3%} below 0.4, "
        f"{q['inverted']} inverted"
        for state, q in zip(("sliding", "pinned"), list(figures["quality_inside"].values())[1:], strict=False)
        if run.pinned
    ]
    stages = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in run.seconds.items())
    lines += [f"{stages}; results in {folder}", "all validations passed" if run.passed else "A VALIDATION FAILED"]
    return Group(verdict(run.checks, f"{case.name} {case.angle:+g} deg, {case.scale}, {case.strategy}"), *lines)

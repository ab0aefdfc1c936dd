"""The table at the end of a run."""

from pathlib import Path

from rich.console import Group
from rich.table import Table

from cases.confine import DIRECTIONS
from cases.metrics import metrics
from cases.run import Run


def summary(run: Run, folder: Path) -> Group:
    """Return one calm table of what was run and what the validation says."""
    case, figures = run.case, metrics(run)
    table = Table(title=f"{case.name} {case.angle:+g} deg, {case.scale}, {case.strategy}", title_justify="left")
    for heading in ("check", "value", "limit", "", "measured over"):
        number = heading in ("value", "limit")
        table.add_column(heading, justify="right" if number else "left", no_wrap=heading != "measured over")
    for check in run.checks:
        sign = "<=" if check.judgement == "at most" else ">="
        table.add_row(
            check.name, f"{check.value:.4g}", f"{sign} {check.limit:.4g} {check.unit}",
            "passed" if check.passed else "[bold]FAILED[/bold]", check.where,
        )  # fmt: skip
    lines = [
        f"mesh: {figures['mesh']['points']} points, {figures['mesh']['cells']} tetrahedra, "
        f"quality min {figures['quality']['before']['min']:.3f} before, {figures['quality']['after']['min']:.3f} after"
    ]
    for name, one in figures["deflections"].items():
        fits = ", ".join(
            f"{d}: {one['adaptation'][d]['centers']} ({one['adaptation'][d]['max_error']:.1e} m)" for d in DIRECTIONS
        )
        lines.append(
            f"{name} {one['angle_deg']:+g} deg: {one['confinement']['inside']} nodes inside, centres {fits}, "
            f"{one['steps']} step{'s' if one['steps'] > 1 else ''}"
        )
    stages = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in run.seconds.items())
    lines.append(f"{stages}; results in {folder}")
    verdict = "all validations passed" if run.passed else "A VALIDATION FAILED"
    return Group(table, *lines, verdict)

"""The largest deflection of each sign that keeps every cell positive and of acceptable shape."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

from matplotlib.figure import Figure
from rich.table import Table

from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import deflected, plans_of
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.fitting import LARGEST_ANGLE
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.progress import Progress


@dataclass(frozen=True, slots=True)
class Trial:
    """One angle tried: the smallest mean ratio (0 where a cell is inverted or there is no mesh) and the steps.

    `reason` says why there is no mesh: the surface leaves its hexahedron, or a tail's root misses the fuselage.
    """

    angle: float
    quality_min: float
    steps: int
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest acceptable angle of one sign and every angle tried, ascending by magnitude."""

    angle: float
    trials: tuple[Trial, ...]


def find_limits(case: Case, mesh: Mesh, threshold: float, resolution: float, progress: Progress) -> tuple[Limit, Limit]:
    """Bisect the angle for both signs on a given mesh.

    Parameters
    ----------
    threshold : smallest acceptable mean ratio.
    resolution : the bracket (deg) at which the bisection ends.
    """
    below, above = (_find(case, mesh, threshold, resolution, sign, progress) for sign in (-1.0, 1.0))
    return below, above


def _find(case: Case, mesh: Mesh, threshold: float, resolution: float, sign: float, progress: Progress) -> Limit:
    trials: list[Trial] = []
    largest = LARGEST_ANGLE / max(abs(one.factor) for one in case.deflections)

    def acceptable(magnitude: float) -> bool:
        progress(f"{sign * magnitude:+.2f} deg", float("nan"))
        trials.append(attempt(case, mesh, sign * magnitude))
        return trials[-1].quality_min >= threshold

    good, bad = (largest if acceptable(largest) else 0.0), largest
    while good < largest and bad - good > resolution:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if acceptable(middle) else (good, middle)
    return Limit(sign * good, tuple(sorted(trials, key=lambda trial: abs(trial.angle))))


def attempt(case: Case, mesh: Mesh, angle: float) -> Trial:
    """Deflect every surface of the case by its share of the angle; judge the worst cell."""
    turned = replace(case, angle=angle)
    try:
        results = deflected(turned, plans_of(turned, mesh))
    except InputError as error:
        return Trial(angle, 0.0, 0, str(error))
    worst = min(quality.min for one in results for quality in one.quality)
    return Trial(angle, worst, max(len(one.steps) for one in results))


def write_limits(limits: tuple[Limit, Limit], case: Case, threshold: float, folder: Path) -> Table:
    """Write limit.csv and limit.png and return the limits as a table."""
    trials = sorted((trial for limit in limits for trial in limit.trials), key=lambda trial: trial.angle)
    with (folder / "limit.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["angle_deg", "quality_min", "steps", "reason"])
        rows.writerows([f"{t.angle:g}", f"{t.quality_min:.4f}", t.steps, t.reason] for t in trials)
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([t.angle for t in trials], [t.quality_min for t in trials], "o-", color="#0072b2")
    axes.axhline(threshold, color="0.4", lw=1, label=f"threshold {threshold:g}")
    axes.set(xlabel="deflection, deg", ylabel="smallest mean ratio (0: inverted cells)", title=case.title)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(folder / "limit.png", dpi=110, metadata={"Software": None})
    table = Table(title=f"{case.name}: largest deflections with quality >= {threshold:g}", title_justify="left")
    for heading in ("sign", "largest angle, deg", "smallest quality there", "steps", "angles tried"):
        table.add_column(heading, justify="right")
    for sign, limit in zip(("-", "+"), limits, strict=True):
        at = next((t for t in limit.trials if t.angle == limit.angle), Trial(0.0, float("nan"), 0))
        table.add_row(sign, f"{limit.angle:+.2f}", f"{at.quality_min:.3f}", str(at.steps), str(len(limit.trials)))
    return table

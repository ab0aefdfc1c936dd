"""The largest deflection of each sign that keeps every cell positive and of acceptable shape, and what ends it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress
from sdm_deflect.deform.mesh.cells import Cells
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import judged
from sdm_deflect.deform.rbf.fitting import RepairMode
from sdm_deflect.deform.volume.deflection import BoxDeflection, deflect
from sdm_deflect.geometry.parameters import LARGEST_TURN

STEPS = 3
"""Angles of the curve are so many times the resolution apart."""
COLOURS = ("#0072b2", "#d55e00")
"""Of the curves: without repair, and with it."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One angle tried: the smallest mean ratio (0 where a cell is inverted or there is no mesh) and the steps.

    `where` says at what the worst cell is. `reason` says why there is no mesh: the surface leaves its hexahedron, or a
    tail's root leaves the fuselage.
    """

    angle: float
    quality_min: float
    steps: int
    where: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest acceptable angle of one sign, from zero outwards.

    Attributes
    ----------
    repair : how cells were repaired.
    angle : the limit; every angle tried below is acceptable.
    end : what is next beyond it: a cell that is too bad, or why there is no mesh; empty if nothing ends it.
    trials : every angle tried, ascending by magnitude.
    """

    repair: RepairMode
    angle: float
    end: str
    trials: tuple[Trial, ...]

    @property
    def at(self) -> Trial:
        """The trial at the limit."""
        return next(trial for trial in self.trials if trial.angle == self.angle)


def find_limits(case: Case, mesh: Mesh, threshold: float, resolution: float, progress: Progress) -> tuple[Limit, ...]:
    """Turn to both signs on a given mesh: without repair and, unless the case has that off, with it.

    Parameters
    ----------
    threshold : smallest acceptable mean ratio.
    resolution : degrees to which the limits, and the ends of what can be meshed, are found.
    """
    modes: tuple[RepairMode, ...] = ("off",) if case.repair == "off" else ("off", case.repair)
    return tuple(
        _find(replace(case, repair=mode), mesh, threshold, resolution, sign, progress)
        for mode in modes
        for sign in (-1.0, 1.0)
    )


def _find(case: Case, mesh: Mesh, threshold: float, resolution: float, sign: float, progress: Progress) -> Limit:
    """Turn in steps until a cell is inverted or there is no mesh; bisect where the quality passes the threshold."""
    trials: dict[float, Trial] = {}
    largest = LARGEST_TURN / max(abs(one.factor) for one in case.deflections)

    def at(size: float) -> Trial:
        if size not in trials:
            progress(f"repair {case.repair}: {sign * size:+.2f} deg", float("nan"))
            trials[size] = attempt(case, mesh, sign * size if size else 0.0)
        return trials[size]

    def last(holds: Callable[[Trial], bool]) -> float:
        """Return the size before the first at which something does not hold, to the resolution."""
        known = sorted(trials)
        bad = next((k for k, size in enumerate(known) if not holds(trials[size])), len(known))
        if bad in (0, len(known)):
            return known[bad - 1] if bad else 0.0
        low, high = known[bad - 1], known[bad]
        while high - low > resolution:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if holds(at(middle)) else (low, middle)
        return low

    step = STEPS * resolution
    for k in range(ceil(largest / step) + 1):
        if not at(min(k * step, largest)).quality_min > 0.0:
            break
    last(lambda trial: not trial.reason)
    limit = last(lambda trial: trial.quality_min >= threshold)
    beyond = next((trials[size] for size in sorted(trials) if size > limit), None)
    found = tuple(trials[size] for size in sorted(trials))
    end = (beyond.reason or f"mean ratio {beyond.quality_min:.3f} {beyond.where}") if beyond else ""
    return Limit(case.repair, trials[limit].angle, end, found)


def attempt(case: Case, mesh: Mesh, angle: float) -> Trial:
    """Deflect every surface of the case by its share of the angle; judge the worst cell."""
    turned = replace(case, angle=angle)
    try:
        plan = plan_of(turned, mesh)
        results = deflect(plan, plan.angle).boxes
    except InputError as error:
        return Trial(angle, 0.0, 0, reason=str(error))
    worst = min(results, key=lambda one: min(quality.min for quality in one.quality))
    least = min(quality.min for quality in worst.quality)
    return Trial(angle, least, max(len(one.steps) for one in results), where_worst(worst))


def where_worst(one: BoxDeflection) -> str:
    """Say at which patches the worst cell is."""
    mesh, touched = one.plan.mesh, one.plan.touched
    found = []
    for block, rows, orientation in zip(mesh.cells, touched.rows, touched.orientation, strict=True):
        if isinstance(block, Cells) and len(rows):
            quality, _ = judged(one.points, block, rows, orientation)
            found.append((float(quality.min()), block.nodes[rows[np.argmin(quality)]]))
    _, nodes = min(found, key=lambda pair: pair[0])
    names = [patch.name for patch in mesh.patches if np.isin(nodes, patch.nodes).any()]
    if not names:
        return "of a cell within the flow"
    all_on = np.isin(nodes, mesh.on(*mesh.names)).all()
    return ("of a cell with every node on " if all_on else "of a cell at ") + ", ".join(names)


def write_limits(limits: tuple[Limit, ...], case: Case, threshold: float, folder: Path) -> Table:
    """Write limit.csv and limit.png and return the limits as a table."""
    rows: list[Sequence[object]] = [("repair", "angle_deg", "quality_min", "steps", "where", "reason")]
    for mode, trials in _curves(limits).items():
        rows += [(mode, f"{t.angle:g}", f"{t.quality_min:.4f}", t.steps, t.where, t.reason) for t in trials]
    write_table(folder / "limit.csv", rows)
    _draw(limits, case, threshold).savefig(folder / "limit.png", dpi=110, metadata={"Software": None})
    table = Table(title=f"{case.name}: largest deflections with quality >= {threshold:g}", title_justify="left")
    for heading in ("repair", "largest angle, deg", "smallest quality there", "steps", "angles tried"):
        table.add_column(heading, justify="right")
    table.add_column("what ends it")
    for one in limits:
        least, tried = f"{one.at.quality_min:.3f}", str(len(one.trials))
        end = one.end or "nothing: no surface turns farther"
        table.add_row(one.repair, f"{one.angle:+.2f}", least, str(one.at.steps), tried, end)
    return table


def _curves(limits: tuple[Limit, ...]) -> dict[RepairMode, list[Trial]]:
    """Return the trials of both signs by the mode of repair, ascending by angle; zero is in there once."""
    curves: dict[RepairMode, dict[float, Trial]] = {}
    for one in limits:
        curves.setdefault(one.repair, {}).update({trial.angle: trial for trial in one.trials})
    return {mode: [trials[angle] for angle in sorted(trials)] for mode, trials in curves.items()}


def _ends(limits: tuple[Limit, ...]) -> list[float]:
    """Return the least angles on either side that the geometry refuses."""
    refused = [trial.angle for trials in _curves(limits).values() for trial in trials if trial.reason]
    sides = ([angle for angle in refused if angle < 0.0], [angle for angle in refused if angle > 0.0])
    return [min(side, key=abs) for side in sides if side]


def _draw(limits: tuple[Limit, ...], case: Case, threshold: float) -> Figure:
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    curves = _curves(limits)
    for (mode, trials), colour in zip(curves.items(), COLOURS, strict=False):
        seen = [t for t in trials if not t.reason]
        label = "without repair" if mode == "off" else f"with repair ({mode})"
        axes.plot([t.angle for t in seen], [t.quality_min for t in seen], "o-", ms=4, color=colour, label=label)
    for end in _ends(limits):
        axes.axvline(end, color="0.4", lw=1, ls=":", label="no mesh beyond: geometry")
    axes.axhline(threshold, color="0.4", lw=1, label=f"threshold {threshold:g}")
    axes.set(xlabel="deflection, deg", ylabel="smallest mean ratio (0: inverted cells)", title=case.title)
    axes.grid(alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.legend(once.values(), once.keys(), fontsize="small", loc="lower center")
    return figure

"""Search for the largest deflection of each sign at which every check holds."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from sdm_deflect.base.errors import InputError, printable, short_list
from sdm_deflect.base.threads import Progress
from sdm_deflect.deform.checks import verdict
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.options import LARGEST_ANGLE, RepairMode
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.job import Job, by_job, in_proportion
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import EVERY_BIT, Precision

from .output import lacks, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Largest factor by which a table's amount is scaled.
BEYOND = 3.0
# Spacing of the curve's amounts, in units of the resolution.
STEPS = 3
# Colours of the curves without and with repair.
COLOURS = ("#1a73c9", "#d1350f")


@dataclass(frozen=True, slots=True)
class Trial:
    """One tried amount of the first surface.

    Attributes
    ----------
    angle : the amount: degrees, or the share of a table.
    quality_min : least quality of the affected cells; 0 where one is inverted or there is no mesh.
    steps : of the deflection.
    where : patches at the worst cell, as text.
    reason : why there is no mesh: a surface leaves its box, or a tail's root leaves the fuselage.
    fault : why the mesh is not acceptable; empty if it is.
    failed : names of all checks that fail.
    verdict : on the mesh, as text; empty without a mesh.
    """

    angle: float
    quality_min: float
    steps: int
    where: str = ""
    reason: str = ""
    fault: str = ""
    failed: tuple[str, ...] = ()
    verdict: str = ""


# Is called with each trial, as soon as it is made.
Told = Callable[[RepairMode, Trial], None]


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest acceptable amount of one sign.

    Attributes
    ----------
    repair : how cells were repaired.
    angle : the limit; every tried amount below it is acceptable.
    end : reason why larger amounts fail: a cell that is too bad, or no mesh; empty if none was found.
    trials : all trials, ascending by magnitude.
    """

    repair: RepairMode
    angle: float
    end: str
    trials: tuple[Trial, ...]

    @property
    def at(self) -> Trial:
        """The trial at the limit."""
        return next(trial for trial in self.trials if trial.angle == self.angle)


@dataclass(frozen=True, slots=True)
class Search:
    """A search: how amounts are tried, and which meshes are acceptable.

    Attributes
    ----------
    title : name of the surfaces and the mesh.
    unit : of the amounts.
    plan : function that plans one amount of the first surface with a mode of repair; InputError if impossible.
    largest : amount that is never exceeded.
    resolution : largest error of a limit.
    threshold : least acceptable quality in addition to the checks; 0 for the checks alone.
    """

    title: str
    unit: str
    plan: Callable[[float, RepairMode], Plan]
    largest: float
    resolution: float
    threshold: float = 0.0

    def limits(
        self, repair: RepairMode, progress: Progress, tried: Callable[[str], None] = lambda text: None
    ) -> tuple[Limit, ...]:
        """Find the limits of both signs, without repair and, unless it is off, with it; InputError if nothing moves.

        `tried` is called with a line on each trial; if the search is stopped, with a summary.
        """
        still = self.trial(0.0, "off")
        if still.reason:
            raise InputError(still.reason)
        modes: tuple[RepairMode, ...] = ("off",) if repair == "off" else ("off", repair)
        made: list[tuple[RepairMode, Trial]] = []

        def told(mode: RepairMode, trial: Trial) -> None:
            made.append((mode, trial))
            said = trial.fault or f"{trial.verdict}; least quality {trial.quality_min:.3f}"
            tried(f"repair {mode}, {trial.angle:+.4g} {self.unit}: {said}")

        try:
            return tuple(self._limit(mode, sign, still, progress, told) for mode in modes for sign in (-1.0, 1.0))
        except BaseException:
            for line in self._known(made):
                tried(line)
            raise

    def _known(self, made: Sequence[tuple[RepairMode, Trial]]) -> Iterator[str]:
        """Yield for each mode of repair and sign the amounts that hold and the first that fails, as text."""
        for mode, sign in dict.fromkeys((mode, np.sign(trial.angle)) for mode, trial in made):
            trials = [trial for of, trial in made if of == mode and np.sign(trial.angle) == sign]
            bad = min((abs(trial.angle) for trial in trials if trial.fault), default=np.inf)
            good = max((abs(trial.angle) for trial in trials if abs(trial.angle) < bad), default=0.0)
            fails = f", and not at {sign * bad:+.4g}" if bad < np.inf else ""
            yield f"known when stopped: repair {mode}: all checks hold up to {sign * good:+.4g} {self.unit}{fails}"

    def trial(self, angle: float, repair: RepairMode) -> Trial:
        """Deflect by an amount and judge the mesh; a trial without a mesh has the reason."""
        try:
            plan = self.plan(angle, repair)
            if not plan.affected.count:
                raise InputError(f"{plan.mesh.name} has no cells that move: there is no quality to keep")
            (judged,) = run(plan)
        except InputError as error:
            return Trial(angle, 0.0, 0, reason=str(error), fault=str(error))
        worst = min(judged.deflection.parts, key=lambda part: min(quality.min for quality in part.quality))
        least = min(quality.min for quality in worst.quality)
        steps = max(len(box.steps) for box in judged.deflection.boxes)
        where, failed = where_worst(worst), [check for check in judged.checks if not check.passed]
        faults = [f"{check.name} {check.value:.3g}, limit {check.limit:.3g}: {check.where}" for check in failed]
        if faults or least < self.threshold:
            faults.append(f"least quality {least:.3f} {where}")
        return Trial(
            angle, least, steps, where, "", "; ".join(faults), tuple(check.name for check in failed),
            verdict(judged.checks),
        )  # fmt: skip

    def _limit(self, repair: RepairMode, sign: float, still: Trial, progress: Progress, told: Told) -> Limit:
        """Increase the amount in steps until cells invert or there is no mesh; then bisect between good and bad ones.

        `still` is the trial of amount 0, where no cell is repaired.
        """
        trials = {0.0: still}

        def at(size: float) -> Trial:
            if size not in trials:
                progress(f"repair {repair}: {sign * size:+.4g} {self.unit}", float("nan"))
                made = trials[size] = self.trial(sign * size, repair)
                told(repair, made)
            return trials[size]

        def last(holds: Callable[[Trial], bool]) -> float:
            """Return the largest size below the first at which `holds` fails, to the resolution."""
            known = sorted(trials)
            bad = next((k for k, size in enumerate(known) if not holds(trials[size])), len(known))
            if bad in (0, len(known)):
                return known[bad - 1] if bad else 0.0
            low, high = known[bad - 1], known[bad]
            while high - low > self.resolution:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if holds(at(middle)) else (low, middle)
            return low

        step = STEPS * self.resolution
        for k in range(ceil(self.largest / step) + 1):
            trial = at(min(k * step, self.largest))
            if trial.reason or "inverted_cells" in trial.failed:
                break
        last(lambda trial: not trial.reason)
        limit = last(lambda trial: not trial.fault)
        ordered = tuple(trials[size] for size in sorted(trials))
        end = next((trials[size].fault for size in sorted(trials) if size > limit), "")
        return Limit(repair, trials[limit].angle, end, ordered)


def search_of(mesh: Mesh, jobs: Sequence[Job], resolution: float = 0.0, precision: Precision = EVERY_BIT) -> Search:
    """Return the search for the limits of surfaces of any mesh; several keep their proportion to the first.

    Parameters
    ----------
    jobs : One for each box.
    resolution : Of the limits; 0: a degree, or a fiftieth of a table.
    precision : Precision of coordinates in the file of a deflected mesh.
    """
    first, unit = jobs[0], jobs[0].surfaces[0].motion.unit
    whole = abs(first.angle) or 1.0

    def plan(angle: float, repair: RepairMode) -> Plan:
        (pose,) = in_proportion(jobs, (angle,))
        turned = (job.at(amounts) for job, amounts in zip(jobs, by_job(jobs, pose), strict=True))
        repaired = [replace(job, repair=replace(job.repair, mode=repair)) for job in turned]
        return Plan.of(mesh, repaired).keeping(precision)

    title = f"{', '.join(first.surfaces[0].patches)} of {mesh.name}"
    if unit != "deg":
        return Search(title, unit, plan, BEYOND * whole, resolution or whole / 50.0)
    return Search(title, unit, plan, LARGEST_ANGLE / max(map(abs, *in_proportion(jobs, (1.0,)))), resolution or 1.0)


def where_worst(deflection: Deflection) -> str:
    """Return the patches at the worst cell of a single box, as text."""
    mesh, nodes = deflection.plan.mesh, deflection.plan.affected.worst(deflection.points)
    names = [patch.name for patch in mesh.patches if np.isin(nodes, patch.nodes).any()]
    if not names:
        return "of a cell within the flow"
    all_on = np.isin(nodes, mesh.on(*mesh.names)).all()
    return ("of a cell with every node on " if all_on else "of a cell at ") + short_list(names)


def write_limits(limits: tuple[Limit, ...], search: Search, folder: Path) -> Group:
    """Write limit.csv and, where Matplotlib is installed, limit.png; return the limits in words."""
    rows: list[Sequence[object]] = [("repair", "angle_deg", "quality_min", "steps", "where", "reason")]
    for mode, trials in _curves(limits).items():
        rows += [(mode, f"{t.angle:g}", f"{t.quality_min:.4f}", t.steps, t.where, t.reason) for t in trials]
    write_table(folder / "limit.csv", rows)
    if not lacks("report"):
        _draw(limits, search).savefig(folder / "limit.png", dpi=110, metadata={"Software": None})
    asked = f", and the least quality is {search.threshold:g} or more" if search.threshold else ""
    title = f"{search.title}: largest deflections at which no check fails{asked}"
    table = Table(title=Text(printable(title)), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("repair", f"largest, {search.unit}", "worst there", "steps", "tried"):
        table.add_column(heading, justify="right")
    table.add_column("verdict there")
    for limit in limits:
        least, tried = f"{limit.at.quality_min:.3f}", str(len(limit.trials))
        table.add_row(limit.repair, f"{limit.angle:+.4g}", least, str(limit.at.steps), tried, limit.at.verdict)
    ends = (limit.end or "nothing ends it: no surface turns farther" for limit in limits)
    beyond = (f"repair {limit.repair}, beyond {limit.angle:+.4g} {search.unit}: " for limit in limits)
    return Group(table, *(Text(printable(f"{place}{end}")) for place, end in zip(beyond, ends, strict=True)))


def _curves(limits: tuple[Limit, ...]) -> dict[RepairMode, list[Trial]]:
    """Return the trials of both signs by the mode of repair, ascending by angle, with zero once."""
    curves: dict[RepairMode, dict[float, Trial]] = {}
    for limit in limits:
        curves.setdefault(limit.repair, {}).update({trial.angle: trial for trial in limit.trials})
    return {mode: [trials[angle] for angle in sorted(trials)] for mode, trials in curves.items()}


def _ends(limits: tuple[Limit, ...]) -> list[float]:
    refused = [trial.angle for trials in _curves(limits).values() for trial in trials if trial.reason]
    sides = ([angle for angle in refused if angle < 0.0], [angle for angle in refused if angle > 0.0])
    return [min(side, key=abs) for side in sides if side]


def _draw(limits: tuple[Limit, ...], search: Search) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    curves = _curves(limits)
    for (mode, trials), colour in zip(curves.items(), COLOURS, strict=False):
        seen = [t for t in trials if not t.reason]
        label = "without repair" if mode == "off" else f"with repair ({mode})"
        axes.plot([t.angle for t in seen], [t.quality_min for t in seen], "o-", ms=4, color=colour, label=label)
    for end in _ends(limits):
        axes.axvline(end, color="0.4", lw=1, ls=":", label="no mesh beyond: geometry")
    if search.threshold:
        axes.axhline(search.threshold, color="0.4", lw=1, label=f"threshold {search.threshold:g}")
    axes.set(xlabel=f"deflection, {search.unit}", ylabel="smallest quality (0: inverted cells)", title=search.title)
    axes.grid(alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.legend(once.values(), once.keys(), fontsize="small", loc="lower center")
    return figure

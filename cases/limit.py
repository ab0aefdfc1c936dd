"""The largest deflection of each sign that keeps every cell positive and of acceptable shape."""

from dataclasses import dataclass, replace

from cases.case import Case
from cases.deflect import deflect
from cases.progress import Report
from meshing.mesh import TetMesh
from meshing.quality import mean_ratio

LARGEST = 60.0
"""Angles (deg) beyond this are not tried: a case allows no more."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One angle tried: the smallest mean ratio (0 where a cell is inverted) and the steps it took."""

    angle: float
    quality_min: float
    steps: int


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest acceptable angle of one sign and every angle tried, ascending by magnitude."""

    angle: float
    trials: tuple[Trial, ...]


def find_limits(case: Case, mesh: TetMesh, threshold: float, resolution: float, report: Report) -> tuple[Limit, Limit]:
    """Bisect the angle for both signs on a given mesh.

    Parameters
    ----------
    threshold : smallest acceptable mean ratio.
    resolution : the bracket (deg) at which the bisection ends.
    """
    return (
        _find(case, mesh, threshold, resolution, -1.0, report),
        _find(case, mesh, threshold, resolution, 1.0, report),
    )


def _find(case: Case, mesh: TetMesh, threshold: float, resolution: float, sign: float, report: Report) -> Limit:
    trials: list[Trial] = []

    def acceptable(magnitude: float) -> bool:
        report(f"{sign * magnitude:+.2f} deg", float("nan"))
        trials.append(attempt(case, mesh, sign * magnitude))
        return trials[-1].quality_min >= threshold

    good, bad = 0.0, LARGEST
    if acceptable(LARGEST):
        good = LARGEST
    while good < LARGEST and bad - good > resolution:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if acceptable(middle) else (good, middle)
    return Limit(sign * good, tuple(sorted(trials, key=lambda trial: abs(trial.angle))))


def attempt(case: Case, mesh: TetMesh, angle: float) -> Trial:
    """Deflect every surface of the case by its share of the angle; judge the worst cell."""
    turned = replace(case, angle=angle)
    worst, steps = 1.0, 1
    for one in case.deflections:
        result = deflect(mesh, turned, one, lambda text, fraction: None)
        worst = min(worst, float(mean_ratio(result.points, mesh.tets).min()))
        steps = max(steps, len(result.steps))
    return Trial(angle, worst, steps)

"""What a deflection did: figures, checks that can fail, and notes."""

from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

from sdm_deflect.cases.confine import DIRECTIONS
from sdm_deflect.cases.own.checks import checks_of
from sdm_deflect.cases.own.course import Course
from sdm_deflect.cases.own.plan import Plan
from sdm_deflect.cases.validation import Check
from sdm_deflect.deform.quality import Quality
from sdm_deflect.deform.touched import Layers, first_layer

Json = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """Figures of one angle.

    Attributes
    ----------
    angle, unit : the first surface's amount.
    steps : number of steps taken.
    centers : number of centres and largest error at the data sites, for each group of directions.
    stops : why each adaptation ended.
    before, after : quality of the touched cells by type.
    layers : change of the first prism layer's height, where there is one.
    checks : what must hold.
    seconds : time for this angle.
    """

    angle: float
    unit: str
    steps: int
    centers: dict[str, tuple[int, float]]
    stops: dict[str, str]
    before: tuple[Quality, ...]
    after: tuple[Quality, ...]
    layers: Layers | None
    checks: tuple[Check, ...] = field(repr=False)
    seconds: float

    @property
    def passed(self) -> bool:
        """True if every check holds."""
        return all(check.passed for check in self.checks)

    def as_dict(self) -> Json:
        """Return the figures as JSON has them."""
        checks = [
            {"name": c.name, "value": c.value if isfinite(c.value) else None, "limit": c.limit, "unit": c.unit,
             "passed": c.passed, "where": c.where} for c in self.checks
        ]  # fmt: skip
        return {
            "angle": self.angle, "unit": self.unit, "steps": self.steps, "seconds": self.seconds,
            "adaptation": {
                name: {"centers": count, "max_error": error, "stop": self.stops[name]}
                for name, (count, error) in self.centers.items()
            },
            "quality": {"before": [asdict(q) for q in self.before], "after": [asdict(q) for q in self.after]},
            "first_layer": asdict(self.layers) if self.layers else None,
            "validation": {"checks": checks, "passed": self.passed},
        }  # fmt: skip


def reported(plan: Plan, course: Course, before: tuple[Quality, ...], seconds: float) -> Report:
    """Judge the mesh at one angle."""
    fits = course.solutions[-1].fits.adaptations
    names = ["".join(DIRECTIONS[c] for c in fit.components) for fit in fits]
    layers = first_layer(plan.touched, plan.walls, course.points)
    return Report(
        course.angle,
        plan.job.surfaces[0].motion.unit,
        len(course.solutions),
        {name: (len(fit.chosen), fit.max_error) for name, fit in zip(names, fits, strict=True)},
        {name: fit.stop.value for name, fit in zip(names, fits, strict=True)},
        before,
        plan.touched.quality(course.points),
        layers,
        tuple(checks_of(plan, course, layers)),
        seconds,
    )


def plan_figures(plan: Plan) -> Json:
    """Return what was decided before the fit, as JSON has it."""
    sites, region = plan.sites, plan.region
    return {
        "mesh": {
            "name": plan.subject.name, "points": len(plan.subject.points),
            "cells": sum(len(block) for block in plan.subject.cells),
            "patches": {patch.name: len(patch.nodes) for patch in plan.subject.patches},
            "zones": list(region.zones),
        },
        "box": {"corners": region.hexahedron.corners.tolist(), "why": region.why, "inside": len(region.inside)},
        "sites": {
            "moving": len(sites.distinct), "fixed": len(sites.sampled), "sliding": len(sites.carried),
            "zero": len(sites.zero), "spacing": sites.spacing, "median_edge": sites.edge,
            "tolerance": sites.tolerance, "coincident": sites.coincident,
        },
        "cells_touched": plan.touched.count,
    }  # fmt: skip


def notes_of(plan: Plan) -> tuple[str, ...]:
    """Return sentences on what a user may not expect."""
    notes = []
    if plan.sites.coincident:
        notes.append(f"{plan.sites.coincident} moving nodes coincide with others; they move as one")
    if min(plan.touched.orientation, default=1.0) < 0.0:
        notes.append("the file counts the nodes of cells left-handed; judged accordingly")
    inverted = sum(plan.touched.inverted)
    if inverted:
        notes.append(f"{inverted} cells were inverted in the file already")
    return tuple(notes)

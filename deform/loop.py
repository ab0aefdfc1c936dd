"""The loop over angles: deflect the mesh and judge it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

from sdm_deflect.deform.mesh.precision import Precision

from .base.threads import Stage, unseen
from .checks import Check, checks_of
from .volume.deflection import Deflection, deflect
from .volume.plan import Plan


class Judged(NamedTuple):
    """The mesh at one angle, and its checks."""

    deflection: Deflection
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True if every check passes."""
        return all(check.passed for check in self.checks)


class Turnable(Protocol):
    """Brings a mesh to any angle of the first surface without a fit."""

    def turned(self, angle: float, precision: Precision) -> Deflection:
        """Return the mesh at an angle of the first surface, rounded for a file."""


def run(
    plan: Plan, angles: Sequence[float], stage: Stage = unseen, unit: str = "", held: Turnable | None = None
) -> Iterator[Judged]:
    """Deflect the mesh to several angles, the largest first: the other angles reuse its centres and factors.

    Every angle is checked at all data sites; centres are added where the error exceeds the tolerance.

    Parameters
    ----------
    plan : The plan, whose boxes contain the motion at all angles.
    angles : Amounts of the first surface.
    stage : Shows the current stage.
    unit : Unit of lengths, if it is known.
    held : Brings the mesh to the angles instead of fits.
    """
    largest, earlier = max(angles, key=abs), None
    for angle in dict.fromkeys((largest, *angles)):
        with stage("deflect") as progress:
            deflection = held.turned(angle, plan.precision) if held else deflect(plan, angle, progress, earlier)
            progress(f"{angle:+g} {plan.unit}", 1.0)
        pairs = zip(deflection.boxes, (earlier or deflection).boxes, strict=True)
        earlier = replace(deflection, boxes=tuple(new if len(new.steps) == 1 else old for new, old in pairs))
        with stage("quality"):
            checks = checks_of(deflection, unit)
        yield Judged(deflection, checks)

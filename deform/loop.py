"""The loop over angles: each mesh is deflected and judged."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

from sdm_deflect.deform.mesh.precision import Precision

from .base.threads import Stage, unseen
from .checks import Check, checks_of
from .volume.deflection import Deflection, deflect
from .volume.plan import Plan


class Judged(NamedTuple):
    """The mesh at one angle, and the verdict on it."""

    deflection: Deflection
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True if every check holds."""
        return all(check.passed for check in self.checks)


class Turnable(Protocol):
    """What brings a mesh to any angle of the first surface by itself."""

    def turned(self, angle: float, precision: Precision) -> Deflection:
        """Return the mesh at an angle of the first surface, for a file that keeps coordinates so."""


def run(
    plan: Plan, angles: Sequence[float], stage: Stage = unseen, unit: str = "", held: Turnable | None = None
) -> Iterator[Judged]:
    """Bring the mesh to several angles, the largest first: its centres and factors serve for all of them.

    Each angle is checked at every data site; centres are added where one is off by more than the tolerance.

    Parameters
    ----------
    plan : What moves, and the box that holds it at all angles.
    angles : Amounts of the first surface.
    stage : Shows what is done.
    unit : Of lengths, where the mesh's is known.
    held : Brings the mesh to the angles in place of fits.
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

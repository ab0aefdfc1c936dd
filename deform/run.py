"""The one loop of a deflection: a plan, carried out for one angle after another, each of them judged."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from sdm_deflect.deform.base.threads import Stage, unseen
from sdm_deflect.deform.checks import Check, checks_of
from sdm_deflect.deform.volume.deflection import Deflection, deflect
from sdm_deflect.deform.volume.plan import Plan


class Judged(NamedTuple):
    """The mesh at one angle, and the verdict on it."""

    deflection: Deflection
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True if every check holds."""
        return all(check.passed for check in self.checks)


def run(plan: Plan, angles: Sequence[float], stage: Stage = unseen, unit: str = "") -> Iterator[Judged]:
    """Bring the mesh to several angles, the largest first: its centres and factors serve for all of them.

    Each angle is checked at every data site; centres are added where one is off by more than the tolerance.

    Parameters
    ----------
    plan : What moves, and the box that holds it at all angles.
    angles : Amounts of the first surface.
    stage : Shows what is done.
    unit : Of lengths, where the mesh's is known.
    """
    largest, earlier = max(angles, key=abs), None
    for angle in dict.fromkeys((largest, *angles)):
        with stage("deflect") as progress:
            one = deflect(plan, angle, progress, earlier)
            progress(f"{angle:+g} {plan.unit}", 1.0)
        pairs = zip(one.boxes, (earlier or one).boxes, strict=True)
        earlier = replace(one, boxes=tuple(new if len(new.steps) == 1 else old for new, old in pairs))
        with stage("quality"):
            checks = checks_of(one, unit)
        yield Judged(one, checks)

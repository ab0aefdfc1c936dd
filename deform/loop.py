"""The loop over poses: deflect the mesh and judge it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, Protocol

from sdm_deflect.base.threads import Stage, unseen
from sdm_deflect.meshing.mesh.precision import Precision

from .checks import Check, checks_of
from .volume.deflection import Deflection, deflect
from .volume.job import Amounts
from .volume.plan import Plan


class Judged(NamedTuple):
    """The mesh at one pose, and its checks."""

    deflection: Deflection
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True if every check passes."""
        return all(check.passed for check in self.checks)


class Turnable(Protocol):
    """Brings a mesh to any pose without a fit."""

    def at_pose(self, pose: Amounts, precision: Precision) -> Deflection:
        """Return the mesh at a pose of all surfaces, rounded for a file."""


def run(plan: Plan, stage: Stage = unseen, unit: str = "", held: Turnable | None = None) -> Iterator[Judged]:
    """Deflect the mesh to the poses of a plan, the largest first: the other poses reuse its centres and factors.

    Every pose is checked at all data sites; centres are added where the error exceeds the tolerance.

    Parameters
    ----------
    plan : The plan.
    stage : Shows the current stage.
    unit : Unit of lengths, if it is known.
    held : Brings the mesh to the poses instead of fits.
    """
    earlier = None
    for pose in dict.fromkeys((plan.largest, *plan.poses)):
        with stage("deflect") as progress:
            deflection = held.at_pose(pose, plan.precision) if held else deflect(plan, pose, progress, earlier)
            progress(f"{deflection.angle:+g} {plan.unit}", 1.0)
        pairs = zip(deflection.boxes, (earlier or deflection).boxes, strict=True)
        earlier = replace(deflection, boxes=tuple(new if len(new.steps) == 1 else old for new, old in pairs))
        with stage("quality"):
            checks = checks_of(deflection, unit)
        yield Judged(deflection, checks)

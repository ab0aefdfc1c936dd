"""The loop over poses: deflect the mesh and judge it."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from sdm_deflect.base.threads import Stage, unseen

from .checks import Check, checks_of
from .volume.deflection import Deflection, deflect
from .volume.plan import Plan

if TYPE_CHECKING:
    from .mesh_motion import MeshMotion


class Judged(NamedTuple):
    """The mesh at one pose, and its checks."""

    deflection: Deflection
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True if every check passes."""
        return all(check.passed for check in self.checks)


def run(plan: Plan, stage: Stage = unseen, unit: str = "", motion: "MeshMotion | None" = None) -> Iterator[Judged]:
    """Deflect the mesh to the poses of a plan, the largest first: the other poses reuse its centres and factors.

    Every pose is checked at all data sites; centres are added where the error exceeds the tolerance.

    Parameters
    ----------
    plan : The plan.
    stage : Shows the current stage.
    unit : Unit of lengths, if it is known.
    motion : Motion that brings the mesh to the poses; None to fit at each pose.
    """
    earlier = None
    for pose in dict.fromkeys((plan.largest, *plan.poses)):
        with stage("deflect") as progress:
            deflection = motion.at_pose(pose, plan.precision) if motion else deflect(plan, pose, progress, earlier)
            progress(f"{deflection.angle:+g} {plan.unit}", 1.0)
        pairs = zip(deflection.boxes, (earlier or deflection).boxes, strict=True)
        earlier = replace(deflection, boxes=tuple(new if len(new.steps) == 1 else old for new, old in pairs))
        with stage("quality"):
            checks = checks_of(deflection, unit)
        yield Judged(deflection, checks)

"""A further addition to the paper's method: what a new one has to write, and that all others leave it be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.around.modifier import Modifier, ModifierAtStep, NodesOnShape
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.volume.deflection import Deflection, deflect_box
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.mesh.sliding import Plane
from tests.deform.jobs import FLAP, blended, job


@dataclass(frozen=True)
class StayInPlane(Modifier):
    """Nodes (K,) within the flow stay in a plane."""

    nodes: IntArray
    plane: Plane

    def at(self, points: FloatArray, free: IntArray) -> "StayingInPlane":
        return StayingInPlane(np.isin(free, self.nodes, assume_unique=True), points[free], self.plane)

    def shapes(self) -> Sequence[NodesOnShape]:
        return [NodesOnShape("plane_within", self.nodes, self.plane)]


@dataclass(frozen=True)
class StayingInPlane(ModifierAtStep):
    rows: IntArray
    points: FloatArray
    plane: Plane

    def correct(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        if last:
            u[self.rows] = self.plane.projected(self.points[self.rows], u[self.rows])
        return u


@pytest.mark.parametrize("mode", ["off", "always"])
def test_nodes_stay_in_a_given_plane_beside_near_walls_sliding_and_repair(mode, inboard_wing):
    w = inboard_wing
    wanted = job(FLAP, w.hinge, angle=10.0, **blended(w, repair=mode))
    plain = BoxPlan.of(w.mesh, wanted, [(10.0,)])
    free, points = plain.start(w.mesh.points).free, w.mesh.points
    levels, counts = np.unique(np.round(points[free, 1], 9), return_counts=True)
    level = levels[np.argmax(np.where((levels > 0.1) & (levels < 0.5), counts, 0))]
    nodes = np.sort(free[np.abs(points[free, 1] - level) < 1e-9])
    plane = Plane(np.array([0.0, level, 0.0]), np.array([0.0, 1.0, 0.0]))
    box = BoxPlan.of(w.mesh, wanted, [(10.0,)], more=(StayInPlane(nodes, plane),))
    assert [type(one).__name__ for one in box.modifiers] == ["FollowWalls", "StayInPlane", "ConstrainedNodes"]
    found = deflect_box(box, (10.0,))
    assert bool(found.repaired) == (mode == "always")
    assert len(nodes) > 50
    assert np.abs(found.points[nodes, 1] - points[nodes, 1]).max() <= 1e-12
    assert np.any(found.points[nodes] != points[nodes], axis=1).mean() > 0.5
    assert np.abs((deflect_box(plain, (10.0,)).points - points)[nodes, 1]).max() > 1e-5
    checks = {one.name: one for one in checks_of(Deflection(Plan((box,), (10.0,)), (found,)))}
    assert checks["on_plane_within"].passed
    assert checks["on_plane_within"].over == len(nodes)
    off = replace(found, exact=found.exact + np.array([0.0, 1e-3, 0.0]))
    drifted = {one.name: one for one in checks_of(Deflection(Plan((box,), (10.0,)), (off,)))}
    assert not drifted["on_plane_within"].passed

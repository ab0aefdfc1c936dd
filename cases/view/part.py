"""One control surface of a finished run, ready to turn by any angle."""

from dataclasses import dataclass
from math import ceil
from typing import Self

import numpy as np

from sdm_deflect.cases.case import Case, Deflection
from sdm_deflect.cases.confine import GROUPINGS, Region, check_inside
from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.motions import Move, mover
from sdm_deflect.cases.turn import turn_of
from sdm_deflect.cases.view.stage import Group, Moved, Stage
from sdm_deflect.cases.view.stored import Stored
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.geometry import datum
from sdm_deflect.meshing.mesh import TetMesh


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A control surface with the stages of its run.

    A run in n steps has n stages: the k-th starts from the mesh that the steps before it left, and serves the
    angles of the k-th n-th of the run's angle. The last also serves all larger angles, the first those of the
    other sign.

    Attributes
    ----------
    surface, factor : the control surface, which turns by `factor` times the angle of the case.
    angle : the run's angle of this surface, degrees.
    patches : names of the patches that move.
    trailing : the node nearest to the middle of the trailing edge.
    nodes, changed : (K,) nodes that the surface motion decides; (L,) all nodes that may move.
    """

    surface: str
    factor: float
    angle: float
    mesh: TetMesh
    region: Region
    patches: tuple[str, ...]
    trailing: int
    nodes: IndexArray
    changed: IndexArray
    move: Move
    stages: tuple[Stage, ...]

    @classmethod
    def of(cls, stored: Stored, deflection: Deflection) -> Self:
        """Find the run's centres among its data sites and factorise, step by step."""
        case, mesh = stored.case, stored.mesh
        turn, move = turn_of(case, mesh, deflection), mover(case, mesh, deflection.surface)
        nodes, region = turn.motion.nodes, turn.region
        tag = "" if deflection == case.deflections[0] else f"_{deflection.surface}"
        count, base, stages = stored.steps(tag), mesh.points, []
        for k in range(1, count + 1):
            stages.append(prepared(stored, region, nodes, base, tag + (f"_step{k}" if k > 1 else "")))
            target = mesh.points[nodes] + move(turn.angle * k / count).displacements
            base = stages[-1].moved(target).points
        changed = np.union1d(region.inside, nodes)
        trailing = trailing_edge_node(case, mesh, deflection.surface)
        return cls(
            deflection.surface, deflection.factor, turn.angle, mesh, region, turn.motion.patches, trailing, nodes,
            changed, move, tuple(stages),
        )  # fmt: skip

    def target(self, angle: float) -> FloatArray:
        """Return where the surface's nodes (K, 3) are at an angle (deg) of this surface.

        Raises
        ------
        ConfinementError
            If they leave the hexahedron, or a tail's root misses the fuselage.
        """
        motion = self.move(angle)
        check_inside(self.mesh, self.region.hexahedron, motion)
        return np.asarray(self.mesh.points[self.nodes] + motion.displacements)

    def moved(self, angle: float) -> Moved:
        """Turn the surface to an angle (deg); at zero nothing is interpolated."""
        if angle == 0.0:
            return Moved(self.mesh.points, 0.0)
        return self.stage(angle).moved(self.target(angle))

    def stage(self, angle: float) -> Stage:
        """Return the stage that serves an angle (deg) of this surface."""
        share = angle / self.angle if self.angle else 0.0
        place = min(max(ceil(share * len(self.stages) - 1e-9), 1), len(self.stages))
        return self.stages[place - 1]

    def centres(self, points: FloatArray, angle: float) -> FloatArray:
        """Return the centres (C, 3) that serve an angle (deg) of this surface, with the mesh at points (N, 3)."""
        return self.stage(angle).centres(points)


def prepared(stored: Stored, region: Region, nodes: IndexArray, base: FloatArray, suffix: str) -> Stage:
    """Prepare one step of a run that starts from base (N, 3)."""
    still = DataSites(base[nodes], np.zeros((len(nodes), 3)))
    groups = GROUPINGS[stored.case.strategy]([still, *region.zero])
    ready = tuple(Group.of(sites, stored.chosen(sites, suffix), base[region.inside]) for sites in groups)
    return Stage(base, nodes, region, stored.mesh.points[region.held], ready)


def trailing_edge_node(case: Case, mesh: TetMesh, surface: str) -> int:
    """Return the node of a surface that is nearest to the middle of its trailing edge."""
    nodes, middle = mesh.on(surface), datum.trailing_edge(case.fighter, surface).mean(axis=0)
    return int(nodes[np.argmin(np.linalg.norm(mesh.points[nodes] - middle, axis=1))])

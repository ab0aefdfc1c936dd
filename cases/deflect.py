"""Deflect one control surface inside its hexahedron, in as few steps as keep every cell positive."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from sdm_deflect.cases.case import Case, Deflection
from sdm_deflect.cases.confine import GROUPINGS, Region
from sdm_deflect.cases.fitting import fit_group
from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.motions import mover
from sdm_deflect.cases.progress import Report
from sdm_deflect.cases.turn import Turn, turn_of
from sdm_deflect.deform.quality import Quality, mean_ratio, signed_volumes, summarise
from sdm_deflect.deform.rbf.greedy import Adaptation
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.volume.fused import fused
from sdm_deflect.meshing.mesh import TetMesh

MAX_STEPS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One solve: the fitted groups and how far the surface was from its prescribed positions."""

    fits: tuple[Adaptation, ...]
    correction: float  # largest distance (m) by which a prescribed node was put right
    evaluation_seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Deflected:
    """One control surface deflected.

    Attributes
    ----------
    turn : what it was to do.
    points : (N, 3) deflected coordinates of every mesh node, metres; same bits as before outside the region.
    steps : the solves, one unless a single step inverted cells.
    inverted : number of inverted cells that remain.
    """

    turn: Turn
    points: FloatArray
    steps: tuple[Step, ...]
    inverted: int


def deflect(mesh: TetMesh, case: Case, deflection: Deflection, report: Report) -> Deflected:
    """Deflect one surface; the angle is halved into steps while cells are inverted, up to `MAX_STEPS`."""
    return carried_out(mesh, case, turn_of(case, mesh, deflection), report)


def carried_out(mesh: TetMesh, case: Case, turn: Turn, report: Report) -> Deflected:
    """Carry out what one surface is to do, in as many steps as `deflect` says."""
    move, start = mover(case, mesh, turn.surface), mesh.points[turn.motion.nodes]
    cells, count = mesh.tets[mesh.touching(turn.region.inside)], 1
    while True:
        between = [start + move(turn.angle * k / count).displacements for k in range(1, count)]
        targets = [*between, start + turn.motion.displacements]
        points, steps = follow(mesh, case, turn.region, turn.motion.nodes, targets, report)
        inverted = int(np.count_nonzero(signed_volumes(points, cells) <= 0.0))
        if not inverted or 2 * count > MAX_STEPS:
            return Deflected(turn, points, steps, inverted)
        count *= 2


def inside_quality(mesh: TetMesh, region: Region, points: FloatArray) -> Quality:
    """Quality of the cells that touch the hexahedron, with the nodes of the mesh at `points` (N, 3)."""
    return summarise(mean_ratio(points, mesh.tets[mesh.touching(region.inside)]))


def follow(
    mesh: TetMesh, case: Case, region: Region, nodes: IndexArray, targets: list[FloatArray], report: Report
) -> tuple[FloatArray, tuple[Step, ...]]:
    """Bring the surface nodes (K,) to each of the targets (K, 3) in turn, hexahedron and zero sites fixed."""
    points, steps = mesh.points.copy(), []
    held = mesh.points[region.held]
    for target in targets:
        moving = DataSites(points[nodes], target - points[nodes])
        groups = GROUPINGS[case.strategy]([moving, *region.zero])
        fits = tuple(fit_group(group, len(nodes), case.adaptation, report) for group in groups)
        start, before = perf_counter(), points[region.inside]
        points[region.inside] += fused(fits)(before)
        seconds = perf_counter() - start
        off = np.where(region.held_components, points[region.held] - held, 0.0)
        correction = np.linalg.norm(np.vstack([points[nodes] - target, off]), axis=1).max()
        points[nodes] = target
        points[region.held] = np.where(region.held_components, held, points[region.held])
        steps.append(Step(fits, float(correction), seconds))
    return points, tuple(steps)

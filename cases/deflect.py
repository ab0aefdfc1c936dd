"""Deflect one control surface inside its hexahedron, in as few steps as keep every cell positive."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from cases.case import AdaptationSettings, Case, Deflection
from cases.confine import DIRECTIONS, Region, confine
from cases.motion import FloatArray, IndexArray, SurfaceMotion
from cases.progress import Report
from deform.greedy import Adaptation, adapt
from deform.kernels import ThinPlateSpline
from deform.reduction import farthest
from deform.sites import DataSites
from meshing.mesh import TetMesh
from meshing.quality import signed_volumes

MAX_STEPS = 8
Move = Callable[[float], SurfaceMotion]
"""The surface motion at a deflection angle in degrees."""


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
    region, motion : its confinement and the prescribed displacements of the whole angle.
    angle : degrees.
    points : (N, 3) deflected coordinates of every mesh node, metres; same bits as before outside the region.
    steps : the solves, one unless a single step inverted cells.
    inverted : number of inverted cells that remain.
    """

    region: Region
    motion: SurfaceMotion
    angle: float
    points: FloatArray
    steps: tuple[Step, ...]
    inverted: int


def deflect(mesh: TetMesh, case: Case, deflection: Deflection, move: Move, report: Report) -> Deflected:
    """Deflect one surface; the angle is halved into steps while cells are inverted, up to `MAX_STEPS`."""
    angle = deflection.factor * case.angle
    motion = move(angle)
    region = confine(mesh, case.fighter, motion, case.confinement)
    cells = mesh.tets[np.isin(mesh.tets, region.inside).any(axis=1)]
    count = 1
    while True:
        targets = _targets(mesh, region, motion, [move(angle * k / count) for k in range(1, count)])
        points, steps = _follow(mesh, case, region, targets, report)
        inverted = int(np.count_nonzero(signed_volumes(points, cells) <= 0.0))
        if not inverted or 2 * count > MAX_STEPS:
            return Deflected(region, motion, angle, points, steps, inverted)
        count *= 2


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Positions (steps, K, 3) that the prescribed nodes (K,) take one after the other; `moving` of them are sites."""

    nodes: IndexArray
    positions: FloatArray
    moving: int


def _targets(mesh: TetMesh, region: Region, motion: SurfaceMotion, parts: list[SurfaceMotion]) -> Targets:
    """The moving surface at each part of the angle, then the held nodes, which stay."""
    nodes = np.concatenate([motion.nodes, region.held])
    steps = [part.displacements for part in [*parts, motion]]
    zero = np.zeros((len(region.held), 3))
    positions = np.stack([mesh.points[nodes] + np.vstack([step, zero]) for step in steps])
    return Targets(nodes, positions, len(motion.nodes))


def _follow(
    mesh: TetMesh, case: Case, region: Region, targets: Targets, report: Report
) -> tuple[FloatArray, tuple[Step, ...]]:
    """Follow the targets one after the other, hexahedron and zero sites fixed."""
    points, steps = mesh.points.copy(), []
    for target in targets.positions:
        surface = targets.nodes[: targets.moving]
        groups = region.groups(points[surface], target[: targets.moving] - points[surface], case.strategy)
        fits = tuple(fit_group(group, targets.moving, case.adaptation, report) for group in groups)
        start = perf_counter()
        before = points[region.inside]
        for fit in fits:
            points[np.ix_(region.inside, fit.components)] += fit.interpolant(before)
        correction = float(np.linalg.norm(points[targets.nodes] - target, axis=1).max())
        points[targets.nodes] = target
        steps.append(Step(fits, correction, perf_counter() - start))
    return points, tuple(steps)


def fit_group(sites: DataSites, surface: int, settings: AdaptationSettings, report: Report) -> Adaptation:
    """Adapt the centres of one group; its first `surface` sites are on the control surface, the rest pinned."""
    initial = [farthest(sites.points[:surface], min(settings.initial_surface, surface))]
    zero = sites.points[surface:]
    initial.append(surface + farthest(zero, min(settings.initial_hexahedron, len(zero))))
    names = "".join(DIRECTIONS[c] for c in sites.components)

    def tell(centers: int, residual: float) -> None:
        report(f"{names}: {centers} centres, largest residual {residual:.1e} m", float("nan"))

    return adapt(sites, ThinPlateSpline(), np.concatenate(initial), settings.options, tell)

"""The repair: nodes in regions around spoiled cells move until these cells are good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf, nan
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numba.core.event import TimingListener, install_listener

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.mesh.affected import AffectedCells, CellScores

from .elements import CellCorners
from .freedom import FreeNodes
from .region import QualityGoal, RepairRegion, RepairResult, improve

# Sizes of regions in rings of cells around spoiled ones; the last size is all nodes.
RINGS = (3, 6, 12, 24)
# Ratio of spoiled cells to moving nodes, above which the next larger size is taken at once.
MANY = 0.2
# Nodes for each cell below a level, beyond which nodes are too far to help (unless the cell is inverted), and number of
# nodes that is always allowed. A larger region is tried once, with care; without a gain the level is given up.
FAR, SMALL = 500, 10_000
# Shares of the least quality before, to which cells are brought in turn, up to the required share. The first share that
# is not reached is the last; the worst cell is then no worse.
LEVELS = (0.5, 0.7, 0.8, 0.85)
# Levels beyond the required share, and the number of region sizes tried for them.
BEYOND, NEAR = (0.95, 1.0), 2
# Relative loss of the worst cell that is allowed if fewer cells are below the level, and its gain required if not.
LOSS, GAIN = 0.02, 0.02
# Ratio of a region's nodes to those of the last one that was too small.
LARGER = 1.1
# Share of its floor that the worst cell may have reached, for all nodes to move at once from the start as well.
POOR = 0.7
# Number of regions without a gain, after which a level is given up.
VAIN = 2
# Share of inverted or spoiled cells left, at which a region is left for a smaller one.
REST = 0.1
# Share of spoiled cells left, up to which the next region begins at the smallest size again.
FEWER = 0.5


def repair_cells(
    points: FloatArray,
    affected: AffectedCells,
    freedom: FreeNodes,
    share: float,
    limit: float = 0.0,
    progress: Progress = silent,
) -> RepairResult:
    """Repair cells that are inverted, or whose quality is below a share of their type's least quality before.

    Nodes around them move until all cells of the region are as good as the worst was before, or nothing more is gained.
    Nodes of the first layers stay. Those around cells that are inverted then may move, if fewer are afterwards.
    While cells miss the share, the next region is larger. Once no cell is inverted or misses the limit, no type of
    cells may lose more than `LOST` of its mean quality and of its 1st percentile in the whole repair.

    Parameters
    ----------
    points : (N, 3) deflected mesh.
    affected : the affected cells, and the undeflected mesh.
    freedom : the nodes that may move.
    share, limit : shares of the least quality of their type before, which cells should reach and must reach.
    """
    begin = perf_counter()
    with install_listener("numba:compile", TimingListener()) as compiling:
        made = _repair(points, affected, freedom, share, limit, progress)
    return replace(made, seconds=perf_counter() - begin - (compiling.duration if compiling.done else 0.0))


def _repair(
    points: FloatArray, affected: AffectedCells, freedom: FreeNodes, share: float, limit: float, progress: Progress
) -> RepairResult:
    parts = zip(affected.mesh.cells, affected.rows, affected.orientation, strict=True)
    corners = CellCorners(affected.mesh.points, parts, ~affected.before.inverted)
    wanted, kept = (share, limit, progress), freedom.columns.kept
    here, steps = _reach_levels(points, affected, corners, freedom.without_nodes(kept), wanted)
    if len(kept):
        goal = QualityGoal.of(affected, freedom)
        inverted = goal.misses(goal.scores(here), 0.0)
        if inverted.any():
            movable = np.bincount(freedom.nodes, minlength=len(points)) > 0
            around = freedom.closure(corners.around(inverted, movable, RINGS[0]), len(points))
            freed = freedom.without_nodes(np.setdiff1d(kept, around, assume_unique=True))
            there, more = _reach_levels(here, affected, corners, freed, wanted)
            steps += more
            if goal.misses(goal.scores(there), 0.0).sum() < inverted.sum():
                here = there
    if len(freedom.images.nodes):
        here = points + freedom.images.projected(here - points)
    made = RepairResult.of(points, here, affected, freedom, share)
    return replace(made, steps=steps)


def _reach_levels(
    points: FloatArray, affected: AffectedCells, corners: CellCorners, freedom: FreeNodes,
    wanted: tuple[float, float, Progress],
) -> tuple[FloatArray, int]:  # fmt: skip
    """Bring cells to one level after the other; return the points (N, 3) and the steps.

    `wanted` is the share and the limit of `repair_cells`, and what is called with the progress.
    """
    share, limit, progress = wanted
    goal = QualityGoal.of(affected, freedom)
    here, scores, steps, kept = points, goal.scores(points), 0, None
    start = scores
    for level, sizes, far in _levels(share, limit, len(points)):
        if level > limit and kept is None:
            kept = np.minimum(goal.spread(start), goal.spread(scores))
        target = Target(level, sizes, far, kept, progress)
        there, new_scores, count = _raise_quality(here, scores, corners, freedom, goal, target)
        steps += count
        reached = not goal.misses(new_scores, level).any()
        if reached or goal.least(new_scores) >= goal.least(scores):
            here, scores = there, new_scores
        if not reached:
            break
    if goal.least(scores) < POOR and len(freedom.nodes) < SMALL:
        whole = Target(share, (len(points),), FAR, kept, progress)
        there, new_scores, count = _raise_quality(points, start, corners, freedom, goal, whole)
        steps += count
        if goal.rank(new_scores) > goal.rank(scores):
            here = there
    return here, steps


class Target(NamedTuple):
    """A share of their floor that cells should reach, and the regions for it.

    Attributes
    ----------
    share, rings : the share, and the sizes of regions in rings.
    far : largest number of a region's nodes for each cell below the share, for regions of more than `SMALL` nodes.
    spread : (T, 2) spread to keep (`QualityGoal.spread`), or None.
    progress : called with the name of the work and the share done.
    """

    share: float
    rings: tuple[int, ...]
    far: float
    spread: FloatArray | None
    progress: Progress


def _levels(share: float, limit: float, points: int) -> Iterator[tuple[float, tuple[int, ...], float]]:
    """Yield the levels in turn, with the sizes of their regions and their reach; at the first no cell is inverted.

    `points` is the number of points.
    """
    for level in sorted({0.0, limit, share, *LEVELS, *BEYOND}):
        if level <= max(share, limit):
            yield level, (*RINGS, points), FAR if level else inf
        elif level in BEYOND:
            yield level, RINGS[:NEAR], 0.0


def _raise_quality(
    points: FloatArray, scores: CellScores, corners: CellCorners, freedom: FreeNodes, goal: QualityGoal, wanted: Target
) -> tuple[FloatArray, CellScores, int]:
    """Bring all cells to a level if possible; return all points (N, 3), the scores and the steps.

    A region is as small as the number of cells below the level allows. It grows while that number does not halve, until
    nothing more is gained. To keep a spread, each region is first repaired with weights for all its cells, and without
    them if that gains nothing. If a node leaves its plane face, the region is repaired again with this face's nodes
    fixed.
    """
    level, sizes, far, spread, progress = wanted
    size, last, steps, vain, careful = 0, 0, 0, 0, spread is not None
    below = goal.misses(scores, level)
    while below.any() and vain < VAIN:
        count = int(below.sum())
        size, unknown = _region_nodes(corners, below, freedom, len(points), sizes, (size, last))
        large = len(unknown) > SMALL
        if not len(unknown) or (large and len(unknown) > far * count):
            break
        progress(f"repair: {count} cells, {len(unknown)} nodes", nan)
        region = RepairRegion.of(
            points, corners.at_nodes(unknown), unknown, freedom, goal.with_weights(scores, careful)
        )
        new, taken = improve(region, level, REST * (size > 0))
        beyond = freedom.slides_left_by(points, new)
        if beyond:
            freedom, last, steps = freedom.without(beyond), 0, steps + taken
            continue
        after = scores.with_scores(region.cells, region.goal.scores(new))
        steps, left = steps + taken, goal.misses(after, level)
        if _is_better(left.sum() < count, goal.least(after) - goal.least(scores), level) and goal.keeps(after, spread):
            points, scores, below, vain = new, after, left, 0
            size = (size + 1) * int(left.sum() > FEWER * count)
        elif careful and not large:
            careful, last = False, 0
            continue
        else:
            size, vain = size + 1, vain + (VAIN if large else 1)
        careful = spread is not None
        last = len(unknown) * (size > 0)
    return points, scores, steps


def _region_nodes(
    corners: CellCorners,
    spoiled: BoolArray,
    freedom: FreeNodes,
    points: int,
    sizes: tuple[int, ...],
    after: tuple[int, int],
) -> tuple[int, IntArray]:
    """Return the next size of regions, and its nodes (U,); no nodes if no size is left.

    Sizes hardly larger than the last region, and sizes full of spoiled cells, are skipped. `points` is the number of
    points; `after` is the first allowed size, and the number of nodes of the last region.
    """
    movable = np.bincount(freedom.nodes, minlength=points) > 0
    for size in range(after[0], len(sizes)):
        nodes = freedom.closure(corners.around(spoiled, movable, sizes[size]), len(movable))
        crowded = sizes[size] < len(movable) and spoiled.sum() > MANY * len(nodes)
        if len(nodes) > LARGER * after[1] and not crowded:
            return size, nodes
    return len(sizes), np.empty(0, dtype=np.intp)


def _is_better(fewer: bool, gain: float, level: float) -> bool:
    """Return whether a region's result is better: fewer cells below the level, or enough gain of its worst cell."""
    return (fewer and gain >= -LOSS) or gain > GAIN if level else fewer

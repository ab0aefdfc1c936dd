"""The repair: patches of nodes around spoiled cells, as large as need be, go to where these cells are good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf, nan
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numba.core.event import TimingListener, install_listener

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.threads import Progress, silent
from sdm_deflect.deform.mesh.touched import CellScores, TouchedCells

from .elements import Tetrahedra
from .freedom import FreeNodes
from .patch import QualityGoal, RepairPatch, RepairResult, improved

RINGS = (3, 6, 12, 24)
"""Rings of cells around spoiled ones whose nodes move; then all that may."""
MANY = 0.2
"""Spoiled cells over nodes that move, above which the next larger patch is taken at once."""
FAR, SMALL = 500, 10_000
"""Nodes for each cell below a level, beyond which they are too far away to help, unless it is inverted; so many nodes
are never too many. A larger patch is tried once, with care, and if that wins nothing the level is given up."""
LEVELS = (0.5, 0.7, 0.8, 0.85)
"""Shares of the least quality before to which all cells are brought, one after another, up to the one that is asked
for. The first that is not reached is the last, and the worst cell is no worse for it."""
BEYOND, NEAR = (0.95, 1.0), 2
"""Levels beyond that share, of which so many sizes of patches alone are tried."""
LOSS, GAIN = 0.02, 0.02
"""Share of its floor that the worst cell may lose where fewer cells are below the level, and has to win where not."""
LARGER = 1.1
"""Nodes of a patch over those of the last one that was too small."""
POOR = 0.7
"""Share of its floor that the worst cell may have reached for all nodes to be moved at once from the start, too."""
VAIN = 2
"""Patches without a gain after which a level is given up."""
REST = 0.1
"""Share of inverted or spoiled cells at which a patch that could be smaller around them is left."""
FEWER = 0.5
"""Share of the spoiled cells that may be left for the next patch to be as small as can be again, not larger."""


def repaired(
    points: FloatArray,
    touched: TouchedCells,
    freedom: FreeNodes,
    share: float,
    limit: float = 0.0,
    progress: Progress = silent,
) -> RepairResult:
    """Mend the cells that are inverted, or whose quality is below a share of their type's least before.

    Around them nodes move until all cells of the patch are as good as the worst was before, or nothing more is won.
    While cells miss their share, the next patch is larger. Once none is inverted or misses the limit, no type of cell
    loses more than `LOST`, in all, of its mean quality and of what 99 % of it exceed.

    Parameters
    ----------
    points : (N, 3) the deflected mesh.
    touched : the cells that may change, and the mesh before.
    freedom : the nodes that may move.
    share, limit : shares of their type's least quality before that cells shall have, and that they must have.
    """
    begin = perf_counter()
    with install_listener("numba:compile", TimingListener()) as compiling:
        made = _repaired(points, touched, freedom, share, limit, progress)
    return replace(made, seconds=perf_counter() - begin - (compiling.duration if compiling.done else 0.0))


def _repaired(
    points: FloatArray, touched: TouchedCells, freedom: FreeNodes, share: float, limit: float, progress: Progress
) -> RepairResult:
    goal = QualityGoal.of(touched, freedom)
    parts = zip(touched.mesh.cells, touched.rows, touched.orientation, strict=True)
    tetrahedra = Tetrahedra.of(touched.mesh.points, parts).of_cells(~touched.before.inverted)
    here, found, steps, kept = points, goal.scores(points), 0, None
    start = found
    for level, sizes, far in _levels(share, limit, len(points)):
        if level > limit and kept is None:
            kept = np.minimum(goal.spread(start), goal.spread(found))
        wanted = Target(level, sizes, far, kept, progress)
        there, other, count = _raised(here, found, tetrahedra, freedom, goal, wanted)
        steps += count
        reached = not goal.missed(other, level).any()
        if reached or goal.least(other) >= goal.least(found):
            here, found = there, other
        if not reached:
            break
    if goal.least(found) < POOR and len(freedom.nodes) < SMALL:
        whole = Target(share, (len(points),), FAR, kept, progress)
        there, other, count = _raised(points, start, tetrahedra, freedom, goal, whole)
        steps += count
        if goal.rank(other) > goal.rank(found):
            here, found = there, other
    if len(freedom.images.nodes):
        here = points + freedom.images.projected(here - points)
    made = RepairResult.of(points, here, touched, freedom, share)
    return replace(made, steps=steps)


class Target(NamedTuple):
    """A share of their floor that cells shall reach, and how.

    Attributes
    ----------
    share, rings : that share, and the sizes of patches in rings that are tried.
    far : nodes of a patch for each cell below that share, beyond which a patch of more than `SMALL` is not tried.
    spread : (T, 2) what the cells of each type keep, by `QualityGoal.spread`; None: whatever it costs.
    progress : told the name of the work and the share of it that is done.
    """

    share: float
    rings: tuple[int, ...]
    far: float
    spread: FloatArray | None
    progress: Progress


def _levels(share: float, limit: float, points: int) -> Iterator[tuple[float, tuple[int, ...], float]]:
    """Yield the shares of their floor that cells are brought to one after another; first none is inverted.

    With each come the sizes of its patches, and how far they may reach. `points` is the number of points.
    """
    for level in sorted({0.0, limit, share, *LEVELS, *BEYOND}):
        if level <= max(share, limit):
            yield level, (*RINGS, points), FAR if level else inf
        elif level in BEYOND:
            yield level, RINGS[:NEAR], 0.0


def _raised(
    points: FloatArray, found: CellScores, tetrahedra: Tetrahedra, freedom: FreeNodes, goal: QualityGoal, wanted: Target
) -> tuple[FloatArray, CellScores, int]:
    """Bring all cells to a level if that can be done; return all points (N, 3), their cells, and the steps.

    The patch is as small as it may be for the number of cells below the level. It grows while that number does not
    fall by half, until nothing is won any more. Where a spread is to be kept, each is mended with care for all its
    cells first, and without if that wins nothing. If a node leaves the plane face that it slides on, it is mended
    again with the nodes of this face where they are.
    """
    level, sizes, far, spread, progress = wanted
    size, last, steps, vain, careful = 0, 0, 0, 0, spread is not None
    below = goal.missed(found, level)
    while below.any() and vain < VAIN:
        count = int(below.sum())
        size, unknown = _patch_nodes(tetrahedra, below, freedom, len(points), sizes, (size, last))
        large = len(unknown) > SMALL
        if not len(unknown) or (large and len(unknown) > far * count):
            break
        progress(f"repair: {count} cells, {len(unknown)} nodes", nan)
        patch = RepairPatch.of(points, tetrahedra, unknown, freedom, goal.weighted(found, careful))
        new, taken = improved(patch, level, REST * (size > 0))
        beyond = freedom.left_by(points, new)
        if beyond:
            freedom, last, steps = freedom.without(beyond), 0, steps + taken
            continue
        after = found.replaced(patch.cells, patch.goal.scores(new))
        steps, left = steps + taken, goal.missed(after, level)
        if _is_better(left.sum() < count, goal.least(after) - goal.least(found), level) and goal.keeps(after, spread):
            points, found, below, vain = new, after, left, 0
            size = (size + 1) * int(left.sum() > FEWER * count)
        elif careful and not large:
            careful, last = False, 0
            continue
        else:
            size, vain = size + 1, vain + (VAIN if large else 1)
        careful = spread is not None
        last = len(unknown) * (size > 0)
    return points, found, steps


def _patch_nodes(
    tetrahedra: Tetrahedra,
    spoiled: BoolArray,
    freedom: FreeNodes,
    points: int,
    sizes: tuple[int, ...],
    after: tuple[int, int],
) -> tuple[int, IntArray]:
    """Return the next size of patches, and its nodes (U,); none if no size is left.

    Sizes that are hardly larger than the last patch, or have rings full of spoiled cells, are left out. `points` is
    the number of points; `after` is the first size that may be, and the number of nodes of the last patch.
    """
    movable = np.bincount(freedom.nodes, minlength=points) > 0
    for size in range(after[0], len(sizes)):
        nodes = freedom.closed(_around(tetrahedra, spoiled, movable, sizes[size]), len(movable))
        crowded = sizes[size] < len(movable) and spoiled.sum() > MANY * len(nodes)
        if len(nodes) > LARGER * after[1] and not crowded:
            return size, nodes
    return len(sizes), np.empty(0, dtype=np.intp)


def _is_better(fewer: bool, gain: float, level: float) -> bool:
    """Return whether a patch is kept: fewer cells are below the level, or the worst one gained, and lost nothing."""
    return (fewer and gain >= -LOSS) or gain > GAIN if level else fewer


def _around(tetrahedra: Tetrahedra, spoiled: BoolArray, movable: BoolArray, rings: int) -> IntArray:
    """Return the sorted nodes (U,) that may move within so many rings of cells around spoiled ones."""
    if rings >= len(movable):
        return np.flatnonzero(movable)
    near = np.zeros(len(movable), dtype=np.bool_)
    near[tetrahedra.nodes[spoiled[tetrahedra.cells]]] = True
    for _ in range(rings - 1):
        near[tetrahedra.nodes[near[tetrahedra.nodes].any(axis=1)]] = True
    return np.flatnonzero(near & movable)

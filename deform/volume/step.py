"""One step: the paper's displacement, then the corrections of the modifiers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.deform.around.modifier import ModifierAtStep
from sdm_deflect.deform.confined import Choice, Confined
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.interpolant import Interpolant


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The mesh at the start of a step.

    Attributes
    ----------
    points : (N, 3) coordinates of the whole mesh.
    known : (B,) known nodes: moving, fixed, and last the `bound` ones.
    rows : rows of `known` that are data sites in both passes; the first `surface` are on the moving surface.
    free : (Q,) free nodes.
    zero : data sites on the box.
    components : directions in which nodes move.
    how : choice of centres.
    modifiers : the modifiers in the order in which they act.
    directions : (3, 3) rows in which the first pass takes displacements; None for x, y and z.
    """

    points: FloatArray = field(repr=False)
    known: IntArray = field(repr=False)
    bound: int
    rows: IntArray = field(repr=False)
    surface: int
    free: IntArray = field(repr=False)
    zero: tuple[DataSites, ...] = field(repr=False)
    components: tuple[int, ...]
    how: Choice
    modifiers: tuple[ModifierAtStep, ...] = field(repr=False)
    directions: FloatArray | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The fits of one step and the mesh at its end.

    Attributes
    ----------
    start : the mesh at its start.
    first : the fit for the bound nodes; None without any.
    fits : the fit for the free nodes.
    known : (B, 3) displacements of the known nodes, as prescribed.
    off : (B, 3) `known` less the interpolant there.
    points : (N, 3) coordinates at the end of the step.
    evaluation_seconds : time to evaluate the interpolant at the free nodes.
    """

    start: Start = field(repr=False)
    first: Confined | None
    fits: Confined
    known: FloatArray = field(repr=False)
    off: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    evaluation_seconds: float

    @property
    def correction(self) -> float:
        """Largest distance by which a known node is moved from the interpolant to its prescribed place."""
        return float(np.linalg.norm(self.off, axis=1).max())

    @property
    def error(self) -> float:
        """Largest error at any data site, of both fits."""
        return max(fits.error for fits in (self.first, self.fits) if fits)


def take(
    start: Start, moving: FloatArray, earlier: Step | None = None, keep_centers: bool = False,
    progress: Progress = silent, runner: Runner = HERE,
) -> Step:  # fmt: skip
    """Move the surface by `moving` (K, 3): interpolate at bound nodes first, if there are any, then at free nodes.

    Parameters
    ----------
    start : The mesh before.
    moving : Displacements (K, 3) of the moving nodes, the first of the known nodes.
    earlier : A step from the same start; its centres come first.
    keep_centers : Whether to add no centre to these.
    progress : Called during the fits.
    runner : Evaluates the interpolant at the free nodes.

    Raises SolveError for a system that cannot be solved.
    """
    known, first = np.zeros((len(start.known), 3)), None
    known[: len(moving)] = moving
    if start.bound:
        earlier_first = earlier.first if earlier else None
        first, bound, _ = _passed(start, known, False, earlier_first, keep_centers, progress, runner)
        known[-start.bound :] = bound
    fits, to, seconds = _passed(start, known, True, earlier.fits if earlier else None, keep_centers, progress, runner)
    points = start.points.copy()
    if known.any():
        points[start.free] += to
        points[start.known] += known
    return Step(start, first, fits, known, known - fits(start.points[start.known]), points, seconds)


def _passed(
    start: Start, known: FloatArray, last: bool, earlier: Confined | None, keep_centers: bool, progress: Progress,
    runner: Runner,
) -> tuple[Confined, FloatArray, float]:  # fmt: skip
    """Return the fit, the displacements (M, 3) of free or bound nodes, and the seconds that evaluation took."""
    further = [sites for modifier in start.modifiers for sites in modifier.sites(known, last)]
    sites = sites_of(start, known, further, last)
    if earlier and keep_centers:
        u = earlier.refit(sites, start.how.strategy)
    else:
        u = Confined.fit(sites, start.surface, start.how, earlier, progress)
    u(start.points[:1])  # loads compiled code, which is not counted as evaluation time
    begin = perf_counter()
    to = (
        evaluate(u.interpolant, start.points[start.free], runner)
        if last
        else along_axes(start, u(start.points[start.known[-start.bound :]]))
    )
    seconds = perf_counter() - begin
    for modifier in start.modifiers:
        to = modifier.correct(to, known, last)
    return u, to, seconds


def sites_of(start: Start, known: FloatArray, further: Sequence[DataSites], last: bool) -> list[DataSites]:
    """Return all data sites of a pass: known nodes with displacements `known` (B, 3), further ones, those on the box.

    Sites of a single direction are along one of the pass's directions already.
    """
    nodes, axes = start.points[start.known[start.rows]], start.components
    sites = [DataSites(nodes, known[start.rows][:, axes], axes), *further, *start.zero]
    if last or start.directions is None:
        return sites
    turn = start.directions[np.ix_(axes, axes)].T
    return [DataSites(part.points, part.values @ turn, axes) if part.components == axes else part for part in sites]


def along_axes(start: Start, u: FloatArray) -> FloatArray:
    """Return displacements (M, 3) of the first pass along x, y and z."""
    return u if start.directions is None else u @ start.directions


def evaluate(interpolant: Interpolant, points: FloatArray, runner: Runner) -> FloatArray:
    """Evaluate at points (M, 3); the bits do not depend on how the points are divided."""
    if runner.shares_memory or len(points) * len(interpolant.centers) < threads.LIMITS.sent_pairs:
        return interpolant(points)
    size = threads.LIMITS.sent
    parts = [points[start : start + size] for start in range(0, len(points), size)]
    return np.concatenate(list(runner.map(_sums, interpolant, parts)))


def _sums(interpolant: Interpolant, points: FloatArray) -> FloatArray:
    return interpolant(points, threads=1)

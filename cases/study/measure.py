"""Adaptations, filter and evaluation with the paper's settings on the data sites of a case, timed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from time import perf_counter
from typing import Self

import numpy as np

from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import job_of
from sdm_deflect.cases.study.paper import Evaluation, Row, Setting, Table
from sdm_deflect.cases.study.trends import Finding
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.deform.rbf.bases import DirectBasis
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.greedy import Adaptation, Basis, Iteration, Stop, adapt
from sdm_deflect.deform.rbf.interpolant import Interpolant, krylov
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.selection import GreedyOptions, Rule, Separated, Worst
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.volume.deflection import Plan
from sdm_deflect.deform.volume.step import DIRECTIONS, GROUPINGS, initial_centers
from sdm_deflect.meshing.mesh import TetMesh

REPETITIONS = 7
"""At most so many runs of one adaptation, of which the median time counts..."""
ENOUGH_SECONDS = 1.0
"""...and no further run once they have taken this long."""
ALIKE = 1.5
"""Time may fall short of the number of points by this factor: measured times vary that much."""


@dataclass(frozen=True, slots=True)
class Loop:
    """How the centres are chosen and how their coefficients are found.

    Attributes
    ----------
    name : short, for files and legends.
    meaning : one phrase.
    """

    name: str
    meaning: str
    rule: Rule
    basis: Callable[[Problem, IndexArray], Basis] = CholeskyBasis.of


GROWN = Loop("grown", "the paper's rule, with one factor for all directions that grows with the centres", Worst())
LAPACK = Loop(
    "lapack",
    "the paper's rule, factorised again in every iteration by LAPACK, once for all directions",
    Worst(look_ahead=1),
    DirectBasis.of,
)
GMRES = Loop(
    "gmres",
    "the paper's loop: its rule, solved again in every iteration by GMRES, for each direction anew",
    Worst(look_ahead=1),
    partial(DirectBasis.of, solve=krylov()),
)
DEFAULT = Loop("default", "what `sdm run` does: blocks of separated sites, growing factor", Separated())
ALL = (GROWN, LAPACK, GMRES, DEFAULT)
DIRECT = (GROWN, LAPACK, DEFAULT)
"""Without GMRES, which takes long where a problem is large."""


@dataclass(frozen=True, slots=True, eq=False)
class SiteGroups:
    """The data sites of one deflection of a case.

    Attributes
    ----------
    surface : number of sites on the control surface, which come first in every group.
    groups : by their directions: "x", "y", "z" for SQUV, "xyz" for MV (where all directions have the same sites).
    plan : the hexahedron and what lies in it.
    """

    surface: int
    groups: dict[str, DataSites]
    plan: Plan

    def largest_mm(self, columns: str) -> float:
        """Return the largest prescribed displacement in these directions, millimetres."""
        return 1e3 * float(np.abs(self.groups[columns].values).max())


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A row measured here.

    Attributes
    ----------
    row : as in the paper's table; its time is the median of `repetitions`.
    loop : which greedy loop.
    sites : number of data sites.
    history : the residual in every iteration.
    interpolant : in metres.
    converged : True if the tolerance was reached.
    """

    row: Row
    loop: Loop
    sites: int
    history: tuple[Iteration, ...]
    interpolant: Interpolant
    converged: bool
    repetitions: int


def sites_of(case: Case, mesh: TetMesh) -> SiteGroups:
    """Collect the data sites of a case's first control surface at its whole angle, as the paper does in one step."""
    flow = mesh.as_mesh(case.name)
    plan = Plan.of(flow, job_of(case, flow, case.deflections[0]))
    moving = DataSites(mesh.points[plan.sites.moving], plan.boundary.displacement(plan.job.amounts))
    parts = [moving, *plan.sites.zero]
    groups = [group for grouping in GROUPINGS.values() for group in grouping(parts)]
    return SiteGroups(len(moving), {"".join(DIRECTIONS[c] for c in one.components): one for one in groups}, plan)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One adaptation to be timed: what `adapt` is given."""

    setting: Setting
    loop: Loop
    group: DataSites
    first: IndexArray
    options: GreedyOptions

    @classmethod
    def of(cls, sites: SiteGroups, setting: Setting, demand: Table | Evaluation, loop: Loop) -> Self:
        """Prepare a row; `demand` says when to stop."""
        group = sites.groups[setting.columns]
        tolerance, most = demand.tolerance, demand.max_centers
        options = GreedyOptions(n_add=setting.n_add, tol_add=tolerance, tol_stop=tolerance, max_centers=most)
        return cls(setting, loop, group, initial_centers(group, sites.surface, setting.initial), options)

    def run(self) -> Adaptation:
        """Adapt the centres once."""
        rule, basis = self.loop.rule, self.loop.basis
        return adapt(self.group, ThinPlateSpline(), self.first, self.options, rule=rule, basis=basis)

    def measured(self, fit: Adaptation, seconds: list[float]) -> Measured:
        """Return the row of a fit that took these times."""
        iterations, converged = fit.history[-1].iteration, fit.stop is Stop.CONVERGED
        row = Row(self.setting, iterations, len(fit.chosen), median(seconds), fit.max_error)
        return Measured(row, self.loop, len(self.group), fit.history, fit.interpolant, converged, len(seconds))


def measure(tasks: Sequence[Task], progress: Progress = silent) -> tuple[Measured, ...]:
    """Run all tasks in turn, several times where that is cheap: a busy moment of the machine then hits all alike."""
    for loop in dict.fromkeys(task.loop for task in tasks):
        first = next(task for task in tasks if task.loop == loop)
        replace(first, options=replace(first.options, max_iterations=1)).run()  # loads compiled code: not timed
    fits: dict[int, Adaptation] = {}
    seconds: dict[int, list[float]] = {i: [] for i in range(len(tasks))}
    for turn in range(REPETITIONS):
        for i, task in enumerate(tasks):
            if sum(seconds[i]) < ENOUGH_SECONDS:
                text = f"f_{task.setting.columns} at {task.setting.angle:+g} deg, {task.loop.name}, run {turn + 1}"
                progress(text, (turn * len(tasks) + i) / (REPETITIONS * len(tasks)))
                fits[i] = task.run()
                seconds[i].append(fits[i].history[-1].seconds)
    return tuple(task.measured(fits[i], seconds[i]) for i, task in enumerate(tasks))


def timed(theirs: Evaluation, case: Case, mesh: TetMesh) -> Evaluation:
    """Find the interpolant as the paper did and time filter and evaluation, medians of several runs."""
    sites = sites_of(replace(case, angle=theirs.setting.angle), mesh)
    region, fit = sites.plan.region, measure([Task.of(sites, theirs.setting, theirs, GROWN)])[0]
    inside = mesh.points[region.inside]
    return replace(
        theirs,
        centers=fit.row.centers,
        inside=len(inside),
        filter_seconds=_median_seconds(lambda: region.hexahedron.contains(mesh.points)),
        inside_seconds=_median_seconds(lambda: fit.interpolant(inside)),
        whole_seconds=_median_seconds(lambda: fit.interpolant(mesh.points)),
    )


def savings(one: Evaluation, points: int) -> Finding:
    """Judge whether confined evaluation is faster at least by the ratio of the numbers of points."""
    time, share = one.whole_seconds / one.inside_seconds, points / one.inside
    return Finding(time * ALIKE >= share, f"{time:.3g} times faster, {share:.3g} times fewer points")


def filter_is_cheap(one: Evaluation) -> Finding:
    """Judge whether filter and evaluation inside together take less time than evaluation on the whole mesh."""
    confined = one.filter_seconds + one.inside_seconds
    return Finding(confined < one.whole_seconds, f"{confined:.3g} s against {one.whole_seconds:.3g} s")


def _median_seconds(work: Callable[[], object]) -> float:
    work()  # loads compiled code
    spent: list[float] = []
    while len(spent) < REPETITIONS and sum(spent) < ENOUGH_SECONDS:
        start = perf_counter()
        work()
        spent.append(perf_counter() - start)
    return median(spent)

"""The paper's tables, measured row by row: adaptations, filter and evaluation with its settings, timed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from time import perf_counter
from typing import Self

import numpy as np

from sdm_deflect.base.arrays import IndexArray
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.cases.aircraft.case import Case, Confinement
from sdm_deflect.cases.aircraft.job import job_of
from sdm_deflect.cases.aircraft.pipeline import mesh_of_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.confined import GROUPINGS, initial_centers
from sdm_deflect.deform.rbf.data_sites import DIRECTIONS, DataSites
from sdm_deflect.deform.rbf.factor import CholeskyBasis
from sdm_deflect.deform.rbf.greedy import Adaptation, Iteration, Stop, adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.problem import Basis, Problem
from sdm_deflect.deform.rbf.rules import GreedyOptions, Rule, Separated, Worst
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.deform.volume.sites import Sites
from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.loop import DirectBasis, Gmres
from studies.paper import Evaluation, Row, Setting, Size, Table, paper

# Number of adaptations or evaluations, of which the one of median time counts.
REPETITIONS = 3


@dataclass(frozen=True, slots=True)
class Loop:
    """How the centres are chosen and how their coefficients are found."""

    name: str
    rule: Rule
    basis: Callable[[Problem, IndexArray], Basis] = CholeskyBasis.of


# The paper's rule, with one factor for all directions that grows with the centres.
GROWN = Loop("grown", Worst())
# The paper's loop: its rule; GMRES solves each direction again in every iteration.
GMRES = Loop("gmres", Worst(look_ahead=1), partial(DirectBasis.of, solve=Gmres()))
# What `sdm run` does: blocks of separated sites, growing factor.
DEFAULT = Loop("default", Separated())
ALL = (GROWN, GMRES, DEFAULT)
# Without GMRES, which takes long where a problem is large.
DIRECT = (GROWN, DEFAULT)
# Which loops to time for the rows of a table.
LOOPS = {"table1": ALL, "table2": ALL, "table3": DIRECT, "table4": DIRECT}
# Tables for which the hexahedron is smaller than that of the case.
SMALL_BOX = ("table1", "table2")
# Its margins over those of the case: fitted to f_z of table 1 on one mesh, whose window is 0.24 to 0.28.
MARGINS = 0.25
# Distances of zero sites that are tried, over the one that is estimated.
TRIED = np.linspace(0.9, 1.1, 101)


@dataclass(frozen=True, slots=True, eq=False)
class SiteGroups:
    """The data sites of one deflection of a case.

    Attributes
    ----------
    groups : by their directions: "x", "y", "z" for SQUV, "xyz" for MV (where all directions have the same sites).
        Those on the control surface come first in every group.
    plan : the hexahedron and what lies in it.
    """

    groups: dict[str, DataSites]
    plan: BoxPlan

    def largest_mm(self) -> dict[str, float]:
        """Return the largest prescribed displacement in x, y and z, millimetres."""
        return {d: 1e3 * float(np.abs(self.groups[d].values).max()) for d in "xyz"}

    def size(self, case: str, mesh: Mesh) -> Size:
        """Return the sizes of mesh and sites."""
        x, y, z = (self.plan.sites.zero_sites(c) for c in range(3))
        return Size(case, len(mesh.points), len(tets_of(mesh)), len(self.plan.sites.moving), (x, y, z))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A row measured here.

    Attributes
    ----------
    row : as in the paper's table.
    converged : whether the tolerance was reached.
    history : the residual in every iteration.
    """

    row: Row
    loop: Loop
    converged: bool
    history: tuple[Iteration, ...]


def sites_of(case: Case, mesh: Mesh) -> SiteGroups:
    """Collect the data sites of a case's first control surface at its whole angle, as the paper does in one step."""
    plan = Plan.of(mesh, [job_of(case, mesh, case.deflections[0])]).boxes[0]
    moving = DataSites(mesh.points[plan.sites.moving], plan.boundary.displacement(plan.job.amounts))
    parts = [moving, *plan.sites.zero]
    groups = [group for grouping in GROUPINGS.values() for group in grouping(parts)]
    return SiteGroups({"".join(DIRECTIONS[c] for c in one.components): one for one in groups}, plan)


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
        return cls(setting, loop, group, initial_centers(group, len(sites.plan.sites.moving), setting.initial), options)

    def run(self) -> Adaptation:
        """Adapt the centres once."""
        rule, basis = self.loop.rule, self.loop.basis
        return adapt(self.group, ThinPlateSpline(), self.first, self.options, rule=rule, basis=basis)

    def measured(self, fit: Adaptation) -> Measured:
        """Return the row of a fit."""
        last = fit.history[-1]
        row = Row(self.setting, last.iteration, len(fit.chosen), last.seconds, len(self.group), fit.max_error)
        return Measured(row, self.loop, fit.stop is Stop.CONVERGED, fit.history)


def measure(tasks: Sequence[Task], progress: Progress = silent) -> tuple[Measured, ...]:
    """Run all tasks in turn, each several times, and keep the adaptation of median time."""
    for loop in dict.fromkeys(task.loop for task in tasks):
        first = next(task for task in tasks if task.loop == loop)
        replace(first, options=replace(first.options, max_iterations=1)).run()  # loads compiled code: not timed
    found = []
    for i, task in enumerate(tasks):
        progress(f"f_{task.setting.columns} at {task.setting.angle:+g} deg, {task.loop.name}", i / len(tasks))
        fits = sorted((task.run() for _ in range(REPETITIONS)), key=lambda fit: fit.history[-1].seconds)
        found.append(task.measured(fits[REPETITIONS // 2]))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Ground:
    """What a study was carried out on.

    Attributes
    ----------
    size : sizes of mesh and sites.
    spacing, edge : distance of zero sites and median edge of the surface, m.
    margins : those of the hexahedron, over those of the case.
    largest_mm : how far the sites go in x, y, z at each angle.
    """

    scale: str
    size: Size
    spacing: float
    edge: float
    margins: float
    largest_mm: dict[float, dict[str, float]]


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A study carried out on a mesh.

    Attributes
    ----------
    name : of the paper's table.
    measured : every row, once for each of its loops.
    """

    name: str
    ground: Ground
    measured: tuple[Measured, ...]

    @property
    def table(self) -> Table:
        """The paper's table."""
        return paper().tables[self.name]

    def by(self, loop: Loop) -> list[Row]:
        """Return the rows that one loop gave."""
        return [one.row for one in self.measured if one.loop == loop]

    @property
    def loops(self) -> tuple[Loop, ...]:
        """The loops that were timed, in a fixed order."""
        return tuple(loop for loop in ALL if self.by(loop))


def table_case(name: str, case: Case, mesh: Mesh) -> Case:
    """Return the case with the hexahedron and the zero sites that a table is measured with.

    For tables 1 and 2 a small hexahedron with the paper's number of sites (section 5.1); all others as the case is.
    """
    if name not in SMALL_BOX:
        return case
    return with_sites(replace(case, confinement=scaled(case.confinement, MARGINS)), mesh)


def scaled(confinement: Confinement, share: float) -> Confinement:
    """Return a confinement whose margins are a share of what they were."""
    names = ("aft", "outboard", "up", "down")
    return replace(confinement, **{name: share * getattr(confinement, name) for name in names})


def with_sites(case: Case, mesh: Mesh) -> Case:
    """Return the case with the distance of zero sites that gives the number nearest to the paper's in z.

    Each face has whole rows of sites, so the number jumps.
    """
    plan, wanted = sites_of(case, mesh).plan, paper().size(case.name).zero_sites[2]

    def number(spacing: float) -> int:
        fitting = replace(plan.job.fitting, spacing=spacing)
        boundary = replace(plan.boundary, job=replace(plan.job, fitting=fitting))
        return Sites.of(boundary, plan.region).zero_sites(2)

    first = plan.sites.spacing * (plan.sites.zero_sites(2) / wanted) ** 0.5
    near = first * (number(first) / wanted) ** 0.5
    best = min((near * share for share in TRIED), key=lambda spacing: abs(number(spacing) - wanted))
    return replace(case, adaptation=replace(case.adaptation, spacing=best))


def carry_out(name: str, case: Case, mesh: Mesh, progress: Progress, loops: tuple[Loop, ...] = ()) -> Result:
    """Measure every row of a table on the mesh of its case, by the loops given or by those of the table."""
    table, case = paper().tables[name], table_case(name, case, mesh)
    settings = [row.setting for row in table.rows]
    sites = {angle: sites_of(replace(case, angle=angle), mesh) for angle in dict.fromkeys(s.angle for s in settings)}
    tasks = [Task.of(sites[one.angle], one, table, loop) for one in settings for loop in (loops or LOOPS[name])]
    first = next(iter(sites.values()))
    lengths, margins = (first.plan.sites.spacing, first.plan.sites.edge), MARGINS if name in SMALL_BOX else 1.0
    largest = {angle: one.largest_mm() for angle, one in sites.items()}
    ground = Ground(case.scale, first.size(case.name, mesh), *lengths, margins, largest)
    return Result(name, ground, measure(tasks, progress))


def run_study(name: str, scale: str, watch: Stopwatch, cache: bool = True) -> Result:
    """Mesh the case of a study (or take the mesh from the cache) and measure every row.

    Raises ValueError if there is no such scale.
    """
    table = paper().tables[name]
    case = replace(case_named(table.case, scale), angle=table.rows[0].setting.angle)
    mesh, _ = mesh_of_case(case, watch, cache)
    with watch.stage(name) as progress:
        return carry_out(name, case, mesh, progress)


def timed(theirs: Evaluation, case: Case, mesh: Mesh) -> Evaluation:
    """Find the interpolant as the paper did and time filter and evaluation, medians of several runs."""
    sites = sites_of(replace(case, angle=theirs.setting.angle), mesh)
    region, fit = sites.plan.region, Task.of(sites, theirs.setting, theirs, GROWN).run()
    inside = mesh.points[region.inside]
    return replace(
        theirs,
        centers=len(fit.chosen),
        inside=len(inside),
        filter_seconds=_median_seconds(lambda: region.hexahedron.contains(mesh.points)),
        inside_seconds=_median_seconds(lambda: fit.interpolant(inside)),
        whole_seconds=_median_seconds(lambda: fit.interpolant(mesh.points)),
    )


def _median_seconds(work: Callable[[], object]) -> float:
    work()  # loads compiled code
    spent: list[float] = []
    while len(spent) < REPETITIONS:
        start = perf_counter()
        work()
        spent.append(perf_counter() - start)
    return median(spent)

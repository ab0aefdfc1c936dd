"""One adaptation with given settings on the data sites of a case, timed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from cases.case import Case
from cases.confine import DIRECTIONS, GROUPINGS, Region
from cases.study.loops import Loop
from cases.study.paper import Evaluation, Row, Setting, Table
from cases.turn import turn_of
from deform.duplicates import IndexArray
from deform.greedy import Adaptation, Step, Stop, adapt
from deform.interpolant import Interpolant
from deform.kernels import ThinPlateSpline
from deform.progress import Progress, silent
from deform.reduction import farthest
from deform.selection import GreedyOptions
from deform.sites import DataSites
from meshing.mesh import TetMesh

REPETITIONS = 5
"""At most so many runs of one adaptation, of which the median time counts..."""
ENOUGH_SECONDS = 1.0
"""...and no further run once they have taken this long."""


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """The data sites of one deflection of a case.

    Attributes
    ----------
    surface : number of sites on the control surface, which come first in every group.
    groups : by their directions: "x", "y", "z" for SQUV, "xyz" for MV (where all directions have the same sites).
    region : the hexahedron and what lies in it.
    """

    surface: int
    groups: dict[str, DataSites]
    region: Region


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
    history: tuple[Step, ...]
    interpolant: Interpolant
    converged: bool
    repetitions: int


def sites_of(case: Case, mesh: TetMesh) -> Sites:
    """Collect the data sites of a case's first control surface at its whole angle, as the paper does in one step."""
    turn = turn_of(case, mesh, case.deflections[0])
    moving = DataSites(mesh.points[turn.motion.nodes], turn.motion.displacements)
    parts = [moving, *turn.region.zero]
    groups = {_name(group): group for grouping in GROUPINGS.values() for group in grouping(parts)}
    return Sites(len(moving), groups, turn.region)


def measure(
    sites: Sites, setting: Setting, demand: Table | Evaluation, loop: Loop, report: Progress = silent
) -> Measured:
    """Run one adaptation as often as is cheap, and keep the median of its times; `demand` says when to stop."""
    group = sites.groups[setting.columns]
    options = GreedyOptions(
        n_add=setting.n_add, tol_add=demand.tolerance, tol_stop=demand.tolerance, max_centers=demand.max_centers
    )
    first = initial_centers(group, sites.surface, setting.initial)
    _adapt(group, first, replace(options, max_iterations=1), loop, silent)  # loads compiled code: not timed
    fits = list(_repeated(group, first, options, loop, report))
    seconds = median(fit.history[-1].seconds for fit in fits)
    last, history = fits[-1], fits[-1].history
    row = Row(setting, history[-1].iteration, len(last.chosen), seconds, last.max_error)
    return Measured(row, loop, len(group), history, last.interpolant, last.stop is Stop.CONVERGED, len(fits))


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IndexArray:
    """Return the rows of the initial centres: so many of the control surface's sites and of the hexahedron's."""
    own, zero = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(own, count[0]), surface + farthest(zero, count[1])])


def _repeated(
    group: DataSites, first: IndexArray, options: GreedyOptions, loop: Loop, report: Progress
) -> Iterator[Adaptation]:
    spent = 0.0
    for _ in range(REPETITIONS):
        fit = _adapt(group, first, options, loop, report)
        yield fit
        spent += fit.history[-1].seconds
        if spent > ENOUGH_SECONDS:
            return


def _adapt(
    group: DataSites, first: IndexArray, options: GreedyOptions, loop: Loop, report: Progress
) -> Adaptation:
    return adapt(
        group, ThinPlateSpline(), first, options, rule=loop.rule, basis=loop.basis, progress=report
    )


def _name(group: DataSites) -> str:
    return "".join(DIRECTIONS[c] for c in group.components)

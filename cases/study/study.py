"""One of the paper's tables, measured here row by row."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from sdm_deflect.cases.progress import Stopwatch
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.pipeline import meshed
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.study.measure import (
    DEFAULT,
    GMRES,
    GROWN,
    LAPACK,
    Loop,
    Measured,
    SiteGroups,
    Task,
    measure,
    sites_of,
)
from sdm_deflect.cases.study.paper import Row, Setting, Table, paper
from sdm_deflect.cases.study.trends import TRENDS, Finding, Trend
from sdm_deflect.deform.progress import Progress
from sdm_deflect.meshing.mesh import TetMesh

Chosen = Callable[[Table, Setting], tuple[Loop, ...]]


@dataclass(frozen=True, slots=True)
class Study:
    """Which loops to time for each row of a table."""

    name: str
    loops: Chosen

    @property
    def table(self) -> Table:
        """The paper's table."""
        return paper().tables[self.name]

    @property
    def trends(self) -> tuple[Trend, ...]:
        """What the paper reads off it."""
        return TRENDS[self.name]


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A study carried out on a mesh.

    Attributes
    ----------
    case : as it was run; its angle is that of the first row.
    points, cells : of the mesh.
    sites : the data sites at each angle.
    measured : every row, once for each of its loops.
    """

    study: Study
    case: Case
    points: int
    cells: int
    sites: dict[float, SiteGroups]
    measured: tuple[Measured, ...]

    def by(self, loop: Loop) -> list[Row]:
        """Return the rows that one loop gave."""
        return [one.row for one in self.measured if one.loop == loop]

    @property
    def loops(self) -> tuple[Loop, ...]:
        """The loops that were timed, in a fixed order."""
        return tuple(loop for loop in (GROWN, LAPACK, GMRES, DEFAULT) if self.by(loop))

    def findings(self, trend: Trend) -> dict[Loop, Finding]:
        """Judge a trend: for time by every loop with the paper's rule, for centres by the first of them."""
        alike = [loop for loop in self.loops if loop.chooses_as_paper]
        judged = {loop: trend.test(self.by(loop), self.study.table) for loop in (alike if trend.of_time else alike[:1])}
        return {loop: finding for loop, finding in judged.items() if finding is not None}


def every_loop(_table: Table, _setting: Setting) -> tuple[Loop, ...]:
    """Time all loops: for tables of small problems."""
    return GROWN, LAPACK, GMRES, DEFAULT


def gmres_once(table: Table, setting: Setting) -> tuple[Loop, ...]:
    """Time GMRES, which takes long, for the fewest initial centres only (figure 2)."""
    fewest = min(row.setting.initial for row in table.rows)
    return every_loop(table, setting) if setting.initial == fewest else direct_loops(table, setting)


def direct_loops(_table: Table, _setting: Setting) -> tuple[Loop, ...]:
    """Leave GMRES out: for tables of large problems."""
    return GROWN, LAPACK, DEFAULT


STUDIES = {
    "table1": Study("table1", gmres_once),
    "table2": Study("table2", every_loop),
    "table3": Study("table3", direct_loops),
    "table4": Study("table4", direct_loops),
}


def carry_out(study: Study, case: Case, mesh: TetMesh, progress: Progress) -> Result:
    """Measure every row of a table on the mesh of its case."""
    table = study.table
    angles = dict.fromkeys(row.setting.angle for row in table.rows)
    sites = {angle: sites_of(replace(case, angle=angle), mesh) for angle in angles}
    settings = [row.setting for row in table.rows]
    tasks = [Task.of(sites[one.angle], one, table, loop) for one in settings for loop in study.loops(table, one)]
    return Result(study, case, len(mesh.points), len(mesh.tets), sites, measure(tasks, progress))


def case_of(study: Study, scale: str) -> Case:
    """Return the case of a study at the angle of its first row.

    Raises
    ------
    ValueError
        If there is no such case or scale.
    """
    return replace(case_named(study.table.case, scale), angle=study.table.rows[0].setting.angle)


def run_study(name: str, scale: str, watch: Stopwatch, cache: bool = True) -> Result:
    """Mesh the case of a study (or take the mesh from the cache) and measure every row."""
    study = STUDIES[name]
    case = case_of(study, scale)
    mesh, _ = meshed(case, watch, cache)
    with watch.stage(name) as progress:
        return carry_out(study, case, mesh, progress)

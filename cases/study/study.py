"""One of the paper's tables, measured here row by row."""

from dataclasses import dataclass, replace

from sdm_deflect.cases.progress import Stopwatch
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.pipeline import meshed
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.study.measure import ALL, DIRECT, Loop, Measured, SiteGroups, Task, measure, sites_of
from sdm_deflect.cases.study.paper import Row, Setting, Table, paper
from sdm_deflect.cases.study.trends import TRENDS, Finding, Trend
from sdm_deflect.deform.progress import Progress
from sdm_deflect.deform.rbf.selection import Worst
from sdm_deflect.meshing.mesh import TetMesh


@dataclass(frozen=True, slots=True)
class Study:
    """Which loops to time for the rows of a table: for those with the fewest initial centres (figure 2), for others."""

    name: str
    fewest: tuple[Loop, ...]
    others: tuple[Loop, ...]

    @property
    def table(self) -> Table:
        """The paper's table."""
        return paper().tables[self.name]

    @property
    def trends(self) -> tuple[Trend, ...]:
        """What the paper reads off it."""
        return TRENDS[self.name]

    def loops(self, setting: Setting) -> tuple[Loop, ...]:
        """Return the loops to time for one row."""
        fewest = min(row.setting.initial for row in self.table.rows)
        return self.fewest if setting.initial == fewest else self.others


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
        return tuple(loop for loop in ALL if self.by(loop))

    def findings(self, trend: Trend) -> dict[Loop, Finding]:
        """Judge a trend: for time by every loop with the paper's rule, for centres by the first of them."""
        alike = [loop for loop in self.loops if isinstance(loop.rule, Worst)]
        judged = {loop: trend.test(self.by(loop), self.study.table) for loop in (alike if trend.of_time else alike[:1])}
        return {loop: finding for loop, finding in judged.items() if finding is not None}


STUDIES = {
    "table1": Study("table1", ALL, DIRECT),
    "table2": Study("table2", ALL, ALL),
    "table3": Study("table3", DIRECT, DIRECT),
    "table4": Study("table4", DIRECT, DIRECT),
}


def carry_out(study: Study, case: Case, mesh: TetMesh, progress: Progress) -> Result:
    """Measure every row of a table on the mesh of its case."""
    table = study.table
    angles = dict.fromkeys(row.setting.angle for row in table.rows)
    sites = {angle: sites_of(replace(case, angle=angle), mesh) for angle in angles}
    settings = [row.setting for row in table.rows]
    tasks = [Task.of(sites[one.angle], one, table, loop) for one in settings for loop in study.loops(one)]
    return Result(study, case, len(mesh.points), len(mesh.tets), sites, measure(tasks, progress))


def run_study(name: str, scale: str, watch: Stopwatch, cache: bool = True) -> Result:
    """Mesh the case of a study (or take the mesh from the cache) and measure every row.

    Raises
    ------
    ValueError
        If there is no such scale.
    """
    study = STUDIES[name]
    case = replace(case_named(study.table.case, scale), angle=study.table.rows[0].setting.angle)
    mesh, _ = meshed(case, watch, cache)
    with watch.stage(name) as progress:
        return carry_out(study, case, mesh, progress)

"""The page `docs/paper.md`: measures the tables and figures of the paper's section 5 and fills in `paper.md.jinja`."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure
from numba import get_num_threads

from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.cases.aircraft.pipeline import meshed, run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.report.pictures import Picture, figure_of, write_png
from sdm_deflect.cases.run.progress import Show, Stopwatch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.fitting import Strategy
from sdm_deflect.meshing.files import hidden_folder
from sdm_deflect.meshing.mesh import tets_of
from studies import centres_findings
from studies import pictures as aircraft
from studies.files import markdown, write_csv, write_plot
from studies.measure import run_study, sites_of, timed
from studies.paper import paper
from studies.stored import FILE, REASONS, Counted, Page, Reasons, Seen, Stored, read_json, read_result, write_json
from studies.trials import CASES, cell
from studies.verdicts import PLACES, because, counted, verdicts

TEMPLATE = "paper.md.jinja"


@dataclass(frozen=True, slots=True)
class Sources:
    """Meshes and runs of one scale; runs write their files into `folder`."""

    scale: str
    folder: Path
    show: Show
    cache: bool = True
    _runs: dict[tuple[str, float, Strategy], Run] = field(default_factory=dict)

    def mesh(self, name: str) -> Mesh:
        """Return the undeflected mesh of a case."""
        return meshed(case_named(name, self.scale), Stopwatch(self.show), self.cache)[0]

    def run(self, name: str, angle: float, strategy: Strategy = "squv") -> Run:
        """Return a finished run with the paper's rule of adding centres, unrepaired, validated like every run."""
        key = (name, angle, strategy)
        if key not in self._runs:
            case = case_named(name, self.scale)
            adaptation = replace(case.adaptation, rule="worst", strategy=strategy)
            case = replace(case, angle=angle, adaptation=adaptation, repair="off")
            with TemporaryDirectory(dir=self.folder) as scratch:
                self._runs[key] = run_case(case, Stopwatch(self.show), Path(scratch), self.cache)
        return self._runs[key]


Measure = Callable[[Sources, Stored, Path], None]
"""Measures what a section says into the stored results and writes its pictures and tables into a folder."""


def figure1(runs: Sources, stored: Stored, folder: Path) -> None:
    """The aircraft and the two blocks."""
    whole, block = runs.run("aileron", -12.0), runs.run("aileron-chimera", -12.0)
    for run in (whole, block):
        _sized(runs, stored, run.case.name)
    _drawn(aircraft.blocks(whole, block), "figure1", stored, folder)


def table(runs: Sources, stored: Stored, folder: Path, name: str) -> None:
    """A table of the paper; its CSV goes beside the figures."""
    result = run_study(name, runs.scale, Stopwatch(runs.show), runs.cache)
    write_csv(result, folder / "tables" / f"{name}.csv")
    stored.pictures[name] = write_plot(result, folder / "figures" / f"{name}.png")
    stored.grounds[name] = result.ground


Wanted = tuple[tuple[str, float, Strategy, str], ...]


def histograms(runs: Sources, stored: Stored, folder: Path, number: int, wanted: Wanted) -> None:
    """Histograms of some runs (case, angle, strategy, title), and the cells that the paper speaks of."""
    found = [runs.run(name, angle, strategy) for name, angle, strategy, _ in wanted]
    for run in sorted(found, key=lambda run: run.case.adaptation.strategy, reverse=True):  # SQUV first
        before, after = (mean_ratio(mesh.points, tets_of(mesh)) for mesh in (run.mesh, run.deflected))
        theirs = [one for one in paper().quality if (one.figure, one.angle) == (number, run.case.angle)]
        stored.counted.extend(Counted.of(one, run, before, after) for one in theirs)
    figure, alternative = aircraft.histograms(found, [title for *_, title in wanted])
    _shown(figure, alternative, f"figure{number}", stored, folder)


def figure5(runs: Sources, stored: Stored, folder: Path) -> None:
    """The gap at both angles."""
    pair = [runs.run("aileron-chimera", angle) for angle in (-12.0, -30.0)]
    names = ("outside_moved", "fixed_surfaces_moved", "planarity", "inverted_cells")
    _checked(5, pair, names, stored)
    _drawn(aircraft.gaps(pair), "figure5", stored, folder)


def figure6(runs: Sources, stored: Stored, folder: Path) -> None:
    """The tail with its hexahedron and sites."""
    _sized(runs, stored, "tail")
    _drawn(aircraft.confinement(runs.run("tail", 12.0)), "figure6", stored, folder)


def figure8(runs: Sources, stored: Stored, folder: Path) -> None:
    """The mesh around the tail."""
    names = ("planarity", "cylindricity", "root_on_cylinder", "fixed_surfaces_moved", "outside_moved")
    run = runs.run("tail", 12.0)
    _checked(8, [run], names, stored)
    _drawn(aircraft.around(run), "figure8", stored, folder)


def timings(runs: Sources, stored: Stored, _folder: Path) -> None:
    """Filter and evaluation times for f_x."""
    for one in paper().evaluations:
        _sized(runs, stored, one.case)
    found = [timed(one, case_named(one.case, runs.scale), runs.mesh(one.case)) for one in paper().evaluations]
    stored.evaluations.extend(found)


def _sized(runs: Sources, stored: Stored, name: str) -> None:
    """Note the sizes of the mesh and of the sites of a case."""
    if name not in stored.sizes:
        mesh = runs.mesh(name)
        stored.sizes[name] = sites_of(case_named(name, runs.scale), mesh).size(name, mesh)


def _checked(number: int, runs: list[Run], names: tuple[str, ...], stored: Stored) -> None:
    for run in runs:
        for one in run.checks:
            if one.name in names:
                figures = (one.name, one.value, one.unit, one.judgement, one.limit, one.passed, one.where)
                stored.seen.append(Seen(number, run.case.angle, *figures))


def _drawn(picture: Picture, name: str, stored: Stored, folder: Path) -> None:
    _shown(figure_of(picture), picture.alternative, name, stored, folder)


def _shown(figure: Figure, alternative: str, name: str, stored: Stored, folder: Path) -> None:
    write_png(figure, folder / "figures" / f"{name}.png")
    stored.pictures[name] = alternative


def write_page(scale: str, folder: Path, show: Show, cache: bool = True, kept: Path | None = None) -> None:
    """Write paper.md, figures/ and tables/ into `folder`. A section that cannot be made says why in its place.

    Reasons are taken from the tables/ of the folder `kept`, where `python -m studies reasons` has put them.
    """
    for name in ("figures", "tables"):
        (folder / name).mkdir()
    stored = Stored(scale, get_num_threads())
    with hidden_folder() as scratch:
        runs = Sources(scale, scratch, show, cache)
        for name, measure in SECTIONS.items():
            _measured(name, measure, runs, stored, folder)
    write_json(stored, folder / "tables" / FILE)
    write_again(folder, folder, kept or folder)


def _measured(name: str, measure: Measure, runs: Sources, stored: Stored, folder: Path) -> None:
    try:
        measure(runs, stored, folder)
    except (ValueError, RuntimeError) as error:
        if not is_reported(error):
            raise
        stored.missing[name] = str(error)


def read_page(folder: Path, kept: Path | None = None) -> Page:
    """Read stored results, reasons from the folder `kept`; InputError if there are none."""
    stored = read_json(Stored, folder / "tables" / FILE)
    reasons = (kept or folder) / "tables" / REASONS
    results = {name: read_result(stored, name, folder / "tables") for name in stored.grounds}
    return Page(stored, results, read_json(Reasons, reasons) if reasons.exists() else None)


def write_again(source: Path, folder: Path, kept: Path | None = None) -> None:
    """Write paper.md into `folder` from what is stored in `source`; nothing is measured."""
    text = text_of(read_page(source, kept))
    (folder / "paper.md").write_text(text, encoding="utf-8")


def text_of(page: Page) -> str:
    """Return the page: the template with its numbers."""
    jinja = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=False, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    jinja.filters["number"] = format
    tables = paper().tables
    titles = {name: f"Table {name[-1]}: {table.title}" for name, table in tables.items()}
    titles["table1"] = f"Table 1 and figure 2: {tables['table1'].title}"
    return jinja.get_template(TEMPLATE).render(
        stored=page.stored, results=page.results, paper=paper(), titles=titles, places=PLACES, cases=CASES, cell=cell,
        verdicts=list(verdicts(page)), counted=counted(page), centres=centres_findings.numbers(page),
        because=lambda verdict: because(verdict, page), body=lambda result: markdown(result).partition("\n\n")[2],
    )  # fmt: skip


_AILERON: Wanted = (("aileron", -12.0, "mv", "MV"), ("aileron", -12.0, "squv", "SQUV"))
_CHIMERA: Wanted = tuple(("aileron-chimera", angle, "squv", f"{angle:+g} deg") for angle in (-12.0, -30.0))
_TAIL: Wanted = (("tail", 12.0, "squv", "+12 deg"),)


SECTIONS: dict[str, Measure] = {
    "figure1": figure1,
    "table1": partial(table, name="table1"),
    "table2": partial(table, name="table2"),
    "figure3": partial(histograms, number=3, wanted=_AILERON),
    "table3": partial(table, name="table3"),
    "figure4": partial(histograms, number=4, wanted=_CHIMERA),
    "figure5": figure5,
    "figure6": figure6,
    "table4": partial(table, name="table4"),
    "figure7": partial(histograms, number=7, wanted=_TAIL),
    "figure8": figure8,
    "timings": timings,
}
"""What measures each section of the page, by the section's name in the template."""

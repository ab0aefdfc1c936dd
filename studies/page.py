"""The page `docs/paper.md`: every table and figure of the paper's section 5, every sentence from the numbers."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure
from numba import get_num_threads

from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.cases.aircraft.pipeline import meshed, run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.report.pictures import Picture, figure_of, write_png
from sdm_deflect.cases.run.progress import Display, Stopwatch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.fitting import Strategy
from sdm_deflect.meshing.files.temporary import scratch_folder
from sdm_deflect.meshing.mesh import tets_of
from studies import pictures as aircraft
from studies import sections, verdicts
from studies.centres_page import why
from studies.files import write_csv, write_plot
from studies.measure import run_study, sites_of, timed
from studies.paper import paper
from studies.sections import Page, Text
from studies.stored import FILE, REASONS, Counted, Reasons, Seen, Stored, read_json, read_result, write_json

INTRODUCTION = """# The paper's section 5, measured here

This page is made by `python -m studies page --scale {scale} --out docs`; no sentence on it is written by hand that a
measurement could contradict. Each verdict compares numbers: "holds" where the trend that the paper names is found in
ours, "does not hold" where it is not. Every trend holds on the paper's own numbers by the same tests."""
TERMS = """Our times are wall times on {threads} threads; the paper's are CPU times on {machine}.
They can be compared within a column, not across. Geometry and meshes are our own (scale `{scale}`), so numbers of
iterations and centres differ. The deformed meshes of the figures were made with the paper's settings and its rule of
adding centres. What was measured is kept in `tables`; `python -m studies page --again --out docs`
writes the page from it."""


@dataclass(frozen=True, slots=True)
class Sources:
    """Meshes and runs of one scale; runs write their files into `folder`."""

    scale: str
    folder: Path
    display: Display
    cache: bool = True
    _runs: dict[tuple[str, float, Strategy], Run] = field(default_factory=dict)

    def mesh(self, name: str) -> Mesh:
        """Return the undeflected mesh of a case."""
        return meshed(case_named(name, self.scale), Stopwatch(self.display), self.cache)[0]

    def run(self, name: str, angle: float, strategy: Strategy = "squv") -> Run:
        """Return a finished run with the paper's rule of adding centres, unrepaired, validated like every run."""
        key = (name, angle, strategy)
        if key not in self._runs:
            case = case_named(name, self.scale)
            adaptation = replace(case.adaptation, rule="worst", strategy=strategy)
            case = replace(case, angle=angle, adaptation=adaptation, repair="off")
            with TemporaryDirectory(dir=self.folder) as scratch:
                self._runs[key] = run_case(case, Stopwatch(self.display), Path(scratch), self.cache)
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
    result = run_study(name, runs.scale, Stopwatch(runs.display), runs.cache)
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


def write_page(scale: str, folder: Path, display: Display, cache: bool = True, kept: Path | None = None) -> None:
    """Write paper.md, figures/ and tables/ into `folder`. A section that cannot be made says why in its place.

    Reasons are taken from the tables/ of the folder `kept`, where `python -m studies reasons` has put them.
    """
    for name in ("figures", "tables"):
        (folder / name).mkdir()
    stored = Stored(scale, get_num_threads())
    with scratch_folder() as scratch:
        runs = Sources(scale, scratch, display, cache)
        for title, (measure, _) in SECTIONS.items():
            _measured(title, measure, runs, stored, folder)
    write_json(stored, folder / "tables" / FILE)
    write_again(folder, folder, kept or folder)


def _measured(title: str, measure: Measure, runs: Sources, stored: Stored, folder: Path) -> None:
    try:
        measure(runs, stored, folder)
    except (ValueError, RuntimeError) as error:
        if not is_reported(error):
            raise
        stored.missing[title] = str(error)


def read_page(folder: Path, kept: Path | None = None) -> Page:
    """Read stored results, reasons from the folder `kept`; InputError if there are none."""
    stored = read_json(Stored, folder / "tables" / FILE)
    reasons = (kept or folder) / "tables" / REASONS
    results = {name: read_result(stored, name, folder / "tables") for name in stored.grounds}
    return Page(stored, results, read_json(Reasons, reasons) if reasons.exists() else None)


def write_again(source: Path, folder: Path, kept: Path | None = None) -> None:
    """Write paper.md into `folder` from what is stored in `source`; nothing is measured."""
    page = read_page(source, kept)
    known = {"scale": page.stored.scale, "threads": page.stored.threads, "machine": paper().machine}
    parts = [INTRODUCTION.format(**known), verdicts.summary(page), TERMS.format(**known)]
    for title, (_, text) in SECTIONS.items():
        why_not = page.stored.missing.get(title)
        parts.append(f"## {title}\n\n{f'Not made: {why_not}.' if why_not else text(page)}")
    if page.reasons is not None:
        parts.append(why(page))
    (folder / "paper.md").write_text(sections.joined(parts) + "\n", encoding="utf-8")


_AILERON: Wanted = (("aileron", -12.0, "mv", "MV"), ("aileron", -12.0, "squv", "SQUV"))
_CHIMERA: Wanted = tuple(("aileron-chimera", angle, "squv", f"{angle:+g} deg") for angle in (-12.0, -30.0))
_TAIL: Wanted = (("tail", 12.0, "squv", "+12 deg"),)


def _table(name: str) -> tuple[Measure, Text]:
    return partial(table, name=name), partial(sections.table, name=name)


def _histograms(number: int, wanted: Wanted) -> tuple[Measure, Text]:
    return partial(histograms, number=number, wanted=wanted), partial(sections.histograms, number=number)


SECTIONS: dict[str, tuple[Measure, Text]] = {
    "Figure 1: the configuration": (figure1, sections.figure1),
    f"Table 1 and figure 2: {paper().tables['table1'].title}": _table("table1"),
    f"Table 2: {paper().tables['table2'].title}": _table("table2"),
    "Figure 3: mesh quality for the aileron without a gap, MV and SQUV": _histograms(3, _AILERON),
    f"Table 3: {paper().tables['table3'].title}": _table("table3"),
    "Figure 4: mesh quality for the aileron in the Chimera block": _histograms(4, _CHIMERA),
    "Figure 5: the mesh in the gap": (figure5, partial(sections.checks, number=5, seen=sections.GAP_SEEN)),
    "Figure 6: the tail, its hexahedron and data sites": (figure6, sections.figure6),
    f"Table 4: {paper().tables['table4'].title}": _table("table4"),
    "Figure 7: mesh quality for the tail": _histograms(7, _TAIL),
    "Figure 8: the mesh around the tail": (figure8, partial(sections.checks, number=8, seen=sections.TAIL_SEEN)),
    "Timings of section 5, for f_x": (timings, sections.timings),
}

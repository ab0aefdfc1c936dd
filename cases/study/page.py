"""The page `docs/paper.md`: every table and figure of the paper's section 5, every sentence from the numbers."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure
from numba import get_num_threads

from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.progress import Display, Stopwatch
from sdm_deflect.cases.report.offscreen import RenderError
from sdm_deflect.cases.report.pictures import Picture, figure_of, write_png
from sdm_deflect.cases.sdm import pictures as aircraft
from sdm_deflect.cases.sdm.metrics import Run
from sdm_deflect.cases.sdm.pipeline import meshed, run_case
from sdm_deflect.cases.sdm.registry import case_named
from sdm_deflect.cases.study.files import markdown, write_csv, write_plot
from sdm_deflect.cases.study.measure import filter_is_cheap, run_study, savings, timed
from sdm_deflect.cases.study.paper import QualityStatement, paper
from sdm_deflect.cases.study.trends import Finding
from sdm_deflect.deform.fitting import Strategy
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.temporary import scratch_folder

INTRODUCTION = """# The paper's section 5, measured here

This page is made by `sdm study page --scale {scale} --out docs`; no sentence on it is written by hand that a
measurement could contradict. Each verdict compares numbers: "holds" where the trend that the paper names is found in
ours, "does not hold" where it is not. Every trend holds on the paper's own numbers by the same tests.

Our times are wall times on {threads} threads; the paper's are CPU times on {machine}.
They can be compared within a column, not across. Geometry and meshes are our own (scale `{scale}`), so numbers of
iterations and centres differ. The deformed meshes of the figures were made with the paper's settings and its rule of
adding centres."""
VISIBLE = 3e-4
"""A histogram is as before if at most this share of all cells is new below the limit: a hundredth of the height of its
highest bars, which hold some 3 % of the cells each. Less is not visible."""

SAID = {
    "none": "At {:+g}° the deformed mesh has no cell below {:g}.",
    "as before": "At {:+g}° no deterioration is visible below {:g}.",
}


def judged(theirs: QualityStatement, run: Run) -> Finding:
    """Count the cells below the mean ratio that the paper names, before and after."""
    before, after = (mean_ratio(mesh.points, mesh.tets) for mesh in (run.mesh, run.deflected))
    near = run.mesh.touching(run.deflections[0].plan.region.inside)
    old, new = before < theirs.below, after < theirs.below
    holds = not new.any() if theirs.finding == "none" else new.sum() - old.sum() <= VISIBLE * len(new)
    return Finding(
        bool(holds),
        f"{old.sum()} of {len(old)} cells below {theirs.below:g} before, {new.sum()} after; of the {near.sum()} cells "
        f"that touch the hexahedron, {old[near].sum()} before, {new[near].sum()} after, the smallest "
        f"{before[near].min():.3f} before, {after[near].min():.3f} after",
    )


@dataclass(frozen=True, slots=True)
class Sources:
    """Meshes and runs of one scale; runs write their files into `folder`."""

    scale: str
    folder: Path
    display: Display
    cache: bool = True
    _runs: dict[tuple[str, float, Strategy], Run] = field(default_factory=dict)

    def mesh(self, name: str) -> TetMesh:
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


Write = Callable[[Sources, Path], str]
"""Writes the pictures of a section into a folder and returns its Markdown."""


def figure1(runs: Sources, folder: Path) -> str:
    """The aircraft and the two blocks, with the sizes of both meshes."""
    whole, block = runs.run("aileron", -12.0), runs.run("aileron-chimera", -12.0)
    lines = [_sizes("full model", whole, "aileron"), _sizes("Chimera block", block, "aileron-chimera")]
    return _drawn(aircraft.blocks(whole, block), folder / "figure1.png") + "\n\n" + "\n".join(lines)


def figure3(runs: Sources, folder: Path) -> str:
    """Histograms of MV and SQUV for the aileron."""
    squv, mv = runs.run("aileron", -12.0), runs.run("aileron", -12.0, "mv")
    found = [*_statements(3, {-12.0: squv}), *_statements(3, {-12.0: mv}, " (MV)")]
    return _histograms(3, [mv, squv], ["MV", "SQUV"], found, folder)


def histograms(runs: Sources, folder: Path, number: int, name: str, angles: tuple[float, ...]) -> str:
    """Histograms of a case at some angles."""
    found = {angle: runs.run(name, angle) for angle in angles}
    titles = [f"{angle:+g} deg" for angle in angles]
    return _histograms(number, list(found.values()), titles, _statements(number, found), folder)


def figure5(runs: Sources, folder: Path) -> str:
    """The gap at both angles, and the checks that the paper does by eye."""
    pair = [runs.run("aileron-chimera", angle) for angle in (-12.0, -30.0)]
    seen = "nothing changes outside the hexahedron, that the wing is not influenced and that the aileron stays planar"
    names = ("outside_moved", "fixed_surfaces_moved", "planarity", "inverted_cells")
    return _drawn(aircraft.gaps(pair), folder / "figure5.png") + _checks(seen, pair, names)


def figure6(runs: Sources, folder: Path) -> str:
    """The tail with its hexahedron and sites."""
    run = runs.run("tail", 12.0)
    theirs, plan = paper().size("tail"), run.deflections[0].plan
    return _drawn(aircraft.confinement(run), folder / "figure6.png") + (
        f"\n\n- Sites: here {len(plan.sites.moving)} on the surface and {plan.sites.zero_sites(0)} on the hexahedron; "
        f"the paper: {theirs.surface} and {theirs.zero_sites[0]}.\n"
        f"- Mesh points inside the hexahedron: here {len(plan.region.inside)} of {len(run.mesh.points)}; "
        f"the paper: {paper().evaluations[1].inside} of {theirs.points}."
    )


def figure8(runs: Sources, folder: Path) -> str:
    """The mesh around the tail, and the checks that the paper does by eye."""
    run = runs.run("tail", 12.0)
    seen = "the tail stays planar, the fuselage circular and closed at the root, and that only the adjacent panel moves"
    names = ("planarity", "cylindricity", "root_on_cylinder", "fixed_surfaces_moved", "outside_moved")
    return _drawn(aircraft.around(run), folder / "figure8.png") + _checks(seen, [run], names)


def timings(runs: Sources, _folder: Path) -> str:
    """Filter and evaluation times for f_x."""
    lines = [
        "| case | | N_c | points inside | filter, s | evaluation inside, s | on the whole mesh, s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    notes = []
    for theirs in paper().evaluations:
        mesh = runs.mesh(theirs.case)
        ours = timed(theirs, case_named(theirs.case, runs.scale), mesh)
        for who, one in (("paper", theirs), ("here", ours)):
            times = (one.filter_seconds, one.inside_seconds, one.whole_seconds)
            cells = (theirs.case, who, one.centers, one.inside, *(f"{seconds:.3g}" for seconds in times))
            lines.append(f"| {' | '.join(map(str, cells))} |")
        saved, cheap = savings(ours, len(mesh.points)), filter_is_cheap(ours)
        notes.append(
            f"- {theirs.case}: confined evaluation is faster at least by the ratio of the numbers of points: "
            f"**{saved.verdict}** ({saved.evidence}); filter and confined evaluation together are cheaper than the "
            f"whole mesh: **{cheap.verdict}** ({cheap.evidence})."
        )
    return "\n".join(lines) + "\n\n" + "\n".join(notes)


def _sizes(what: str, run: Run, case: str) -> str:
    theirs, mesh = paper().size(case), run.mesh
    return (
        f"- {what}: here {len(mesh.points):,} points and {len(mesh.tets):,} tetrahedra; "
        f"the paper: {theirs.points:,} and {theirs.cells:,}."
    )


def _statements(figure: int, runs: dict[float, Run], note: str = "") -> Iterator[str]:
    """Judge the paper's statements on one of its histograms."""
    for theirs in paper().quality:
        if theirs.figure == figure:
            found = judged(theirs, runs[theirs.angle])
            said = SAID[theirs.finding].format(theirs.angle, theirs.below)
            yield f"- {said} Here{note}: **{found.verdict}** ({found.evidence})."


def _histograms(number: int, runs: list[Run], titles: list[str], found: Iterable[str], folder: Path) -> str:
    figure, alternative = aircraft.histograms(runs, titles)
    return _shown(figure, alternative, folder / f"figure{number}.png") + "\n\n" + "\n".join(found)


def _checks(seen: str, runs: list[Run], names: tuple[str, ...]) -> str:
    """Say what the paper judges by eye, and what the checks of these names measured."""
    lines = [
        f"- {run.case.angle:+g}°, `{one.name}`: {one.value:.3g} {one.unit}, {one.judgement} {one.limit:.3g} demanded: "
        f"{'passed' if one.passed else '**failed**'} ({one.where})."
        for run in runs
        for one in run.checks
        if one.name in names
    ]
    return f"\n\nThe paper judges by eye that {seen}. Measured here:\n\n" + "\n".join(lines)


def _drawn(picture: Picture, path: Path) -> str:
    return _shown(figure_of(picture), picture.alternative, path)


def _shown(figure: Figure, alternative: str, path: Path) -> str:
    write_png(figure, path)
    return f"![{alternative}](figures/{path.name})"


def write_page(scale: str, folder: Path, display: Display, cache: bool = True) -> None:
    """Write paper.md, figures/ and tables/ into `folder`. A section that cannot be made says why in its place."""
    (folder / "figures").mkdir()
    (folder / "tables").mkdir()
    parts = [INTRODUCTION.format(scale=scale, threads=get_num_threads(), machine=paper().machine)]
    with scratch_folder() as scratch:
        runs = Sources(scale, scratch, display, cache)
        for title, write in SECTIONS.items():
            parts.append(f"## {title}\n\n{_written(write, runs, folder / 'figures')}")
    (folder / "paper.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _written(write: Write, runs: Sources, folder: Path) -> str:
    try:
        return write(runs, folder)
    except (ValueError, RuntimeError) as error:
        if isinstance(error, RenderError) or is_reported(error):
            return f"Not made: {error}."
        raise


def _table(name: str, runs: Sources, folder: Path) -> str:
    """Carry out a study; its CSV goes beside the figures."""
    result = run_study(name, runs.scale, Stopwatch(runs.display), runs.cache)
    write_csv(result, folder.parent / "tables" / f"{name}.csv")
    alternative = write_plot(result, folder / f"{name}.png")
    body = markdown(result).partition("\n\n")[2]
    return f"{body}\n![{alternative}](figures/{name}.png)\n\nAll numbers: [{name}.csv](tables/{name}.csv)."


SECTIONS: dict[str, Write] = {
    "Figure 1: the configuration": figure1,
    f"Table 1 and figure 2: {paper().tables['table1'].title}": partial(_table, "table1"),
    f"Table 2: {paper().tables['table2'].title}": partial(_table, "table2"),
    "Figure 3: mesh quality for the aileron without a gap, MV and SQUV": figure3,
    f"Table 3: {paper().tables['table3'].title}": partial(_table, "table3"),
    "Figure 4: mesh quality for the aileron in the Chimera block": partial(
        histograms, number=4, name="aileron-chimera", angles=(-12.0, -30.0)
    ),
    "Figure 5: the mesh in the gap": figure5,
    "Figure 6: the tail, its hexahedron and data sites": figure6,
    f"Table 4: {paper().tables['table4'].title}": partial(_table, "table4"),
    "Figure 7: mesh quality for the tail": partial(histograms, number=7, name="tail", angles=(12.0,)),
    "Figure 8: the mesh around the tail": figure8,
    "Timings of section 5, for f_x": timings,
}

"""The sections of `docs/paper.md`: what each shows of ours beside the paper's, every sentence from the numbers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from sdm_deflect.cases.report import aircraft, gap, tail
from sdm_deflect.cases.report.compose import figure_of
from sdm_deflect.cases.report.histograms import histograms
from sdm_deflect.cases.report.png import write_png
from sdm_deflect.cases.run import Run
from sdm_deflect.cases.study.paper import paper
from sdm_deflect.cases.study.quality import judged, said
from sdm_deflect.cases.study.sources import Sources
from sdm_deflect.cases.study.timings import filter_is_cheap, savings, timed
from sdm_deflect.cases.validation import Check

Write = Callable[[Sources, Path], str]
"""Writes the pictures of a section into a folder and returns its Markdown."""


@dataclass(frozen=True, slots=True)
class Section:
    """One heading of the page."""

    title: str
    write: Write


def figure1(runs: Sources, folder: Path) -> str:
    """The aircraft and the two blocks, with the sizes of both meshes."""
    whole, block = runs.run("aileron", -12.0), runs.run("aileron-chimera", -12.0)
    picture = aircraft.blocks(whole, block)
    lines = [_sizes("full model", whole, "aileron"), _sizes("Chimera block", block, "aileron-chimera")]
    return _shown(figure_of(picture), picture.alternative, folder / "figure1.png") + "\n\n" + "\n".join(lines)


def figure3(runs: Sources, folder: Path) -> str:
    """Histograms of MV and SQUV for the aileron."""
    squv, mv = runs.run("aileron", -12.0), runs.run("aileron", -12.0, "mv")
    found = [*_statements(3, {-12.0: squv}), *_statements(3, {-12.0: mv}, " (MV)")]
    return _histograms(3, [mv, squv], ["MV", "SQUV"], found, folder)


def figure4(runs: Sources, folder: Path) -> str:
    """Histograms of both angles in the Chimera block."""
    pair = {angle: runs.run("aileron-chimera", angle) for angle in (-12.0, -30.0)}
    return _histograms(4, list(pair.values()), [f"{angle:+g} deg" for angle in pair], _statements(4, pair), folder)


def figure5(runs: Sources, folder: Path) -> str:
    """The gap at both angles, and the checks that the paper does by eye."""
    pair = [runs.run("aileron-chimera", angle) for angle in (-12.0, -30.0)]
    picture = gap.gaps(pair)
    names = ("outside_moved", "fixed_surfaces_moved", "planarity", "inverted_cells")
    checks = [line for run in pair for line in _checks(run, names)]
    return _shown(figure_of(picture), picture.alternative, folder / "figure5.png") + (
        "\n\nThe paper judges by eye that nothing changes outside the hexahedron, that the wing is not influenced and "
        "that the aileron stays planar. Measured here:\n\n"
    ) + "\n".join(checks)


def figure6(runs: Sources, folder: Path) -> str:
    """The tail with its hexahedron and sites."""
    run = runs.run("tail", 12.0)
    picture, theirs, turn = tail.confinement(run), paper().size("tail"), run.deflections[0].turn
    return _shown(figure_of(picture), picture.alternative, folder / "figure6.png") + (
        f"\n\n- Sites: here {len(turn.motion.nodes)} on the surface and {turn.region.zero_sites(0)} on the hexahedron; "
        f"the paper: {theirs.surface} and {theirs.zero_sites[0]}.\n"
        f"- Mesh points inside the hexahedron: here {len(turn.region.inside)} of {len(run.mesh.points)}; "
        f"the paper: {paper().evaluations[1].inside} of {theirs.points}."
    )


def figure7(runs: Sources, folder: Path) -> str:
    """Histograms of the tail."""
    run = runs.run("tail", 12.0)
    return _histograms(7, [run], [f"{run.case.angle:+g} deg"], _statements(7, {12.0: run}), folder)


def figure8(runs: Sources, folder: Path) -> str:
    """The mesh around the tail, and the checks that the paper does by eye."""
    run = runs.run("tail", 12.0)
    picture = tail.around(run)
    names = ("planarity", "cylindricity", "root_on_cylinder", "fixed_surfaces_moved", "outside_moved")
    return _shown(figure_of(picture), picture.alternative, folder / "figure8.png") + (
        "\n\nThe paper judges by eye that the tail stays planar, the fuselage circular and closed at the root, and "
        "that only the adjacent panel moves. Measured here:\n\n"
    ) + "\n".join(_checks(run, names))


def timings(runs: Sources, _folder: Path) -> str:
    """Filter and evaluation times for f_x."""
    lines = [
        "| case | | N_c | points inside | filter, s | evaluation inside, s | on the whole mesh, s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    notes = []
    for theirs in paper().evaluations:
        mesh = runs.mesh(theirs.case)
        ours = timed(theirs, runs.case(theirs.case), mesh)
        for who, one in (("paper", theirs), ("here", ours)):
            times = (one.filter_seconds, one.inside_seconds, one.whole_seconds)
            lines.append(f"| {theirs.case} | {who} | {one.centers} | {one.inside} | "
                         + " | ".join(f"{seconds:.3g}" for seconds in times) + " |")  # fmt: skip
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
            yield f"- {said(theirs)} Here{note}: **{found.verdict}** ({found.evidence})."


def _histograms(number: int, runs: list[Run], titles: list[str], found: Iterator[str] | list[str], folder: Path) -> str:
    figure, alternative = histograms(runs, titles)
    return _shown(figure, alternative, folder / f"figure{number}.png") + "\n\n" + "\n".join(found)


def _checks(run: Run, names: tuple[str, ...]) -> Iterator[str]:
    for check in run.checks:
        if check.name in names:
            yield f"- {run.case.angle:+g}°, `{check.name}`: {_measured(check)}"


def _measured(check: Check) -> str:
    sign = "at most" if check.judgement == "at most" else "at least"
    verdict = "passed" if check.passed else "**failed**"
    return f"{check.value:.3g} {check.unit}, {sign} {check.limit:.3g} demanded: {verdict} ({check.where})."


def _shown(figure: Figure, alternative: str, path: Path) -> str:
    write_png(figure, path)
    return f"![{alternative}](figures/{path.name})"

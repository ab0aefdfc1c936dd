"""The page `docs/paper.md`: every table and figure of the paper's section 5, ours beside theirs."""

from functools import partial
from pathlib import Path

from numba import get_num_threads

from sdm_deflect.cases.errors import is_reported
from sdm_deflect.cases.progress import Display, Stopwatch
from sdm_deflect.cases.report.offscreen import RenderError
from sdm_deflect.cases.study.carried import run_study, write_study
from sdm_deflect.cases.study.paper import paper
from sdm_deflect.cases.study.sections import (
    Section,
    figure1,
    figure3,
    figure4,
    figure5,
    figure6,
    figure7,
    figure8,
    timings,
)
from sdm_deflect.cases.study.sources import Sources, sources
from sdm_deflect.cases.study.text import markdown

INTRODUCTION = """# The paper's section 5, measured here

This page is made by `sdm study page --scale {scale} --out docs`; no sentence on it is written by hand that a
measurement could contradict. Each verdict compares numbers: "holds" where the trend that the paper names is found in
ours, "does not hold" where it is not. Every trend holds on the paper's own numbers by the same tests.

Our times are wall times on {threads} threads; the paper's are CPU times on {machine}.
They can be compared within a column, not across. Geometry and meshes are our own (scale `{scale}`), so numbers of
iterations and centres differ. The deformed meshes of the figures were made with the paper's settings and its rule of
adding centres."""


def write_page(scale: str, folder: Path, display: Display, cache: bool = True) -> None:
    """Write paper.md, figures/ and tables/ into `folder`. A section that cannot be made says why in its place."""
    (folder / "figures").mkdir()
    (folder / "tables").mkdir()
    with sources(scale, display, cache) as runs:
        parts = [INTRODUCTION.format(scale=scale, threads=get_num_threads(), machine=paper().machine)]
        for section in SECTIONS:
            parts.append(f"## {section.title}\n\n{_written(section, runs, folder / 'figures')}")
    (folder / "paper.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _written(section: Section, runs: Sources, folder: Path) -> str:
    try:
        return section.write(runs, folder)
    except (ValueError, RuntimeError) as error:
        if isinstance(error, RenderError) or is_reported(error):
            return f"Not made: {error}."
        raise


def _table(name: str, runs: Sources, folder: Path) -> str:
    """Carry out a study; its CSV goes beside the figures."""
    result = run_study(name, runs.scale, Stopwatch(runs.display), runs.cache)
    alternative = write_study(result, folder)
    (folder / f"{name}.csv").replace(folder.parent / "tables" / f"{name}.csv")
    (folder / f"{name}.md").unlink()
    body = markdown(result).partition("\n\n")[2]
    return f"{body}\n![{alternative}](figures/{name}.png)\n\nAll numbers: [{name}.csv](tables/{name}.csv)."


SECTIONS = (
    Section("Figure 1: the configuration", figure1),
    Section(f"Table 1 and figure 2: {paper().tables['table1'].title}", partial(_table, "table1")),
    Section(f"Table 2: {paper().tables['table2'].title}", partial(_table, "table2")),
    Section("Figure 3: mesh quality for the aileron without a gap, MV and SQUV", figure3),
    Section(f"Table 3: {paper().tables['table3'].title}", partial(_table, "table3")),
    Section("Figure 4: mesh quality for the aileron in the Chimera block", figure4),
    Section("Figure 5: the mesh in the gap", figure5),
    Section("Figure 6: the tail, its hexahedron and data sites", figure6),
    Section(f"Table 4: {paper().tables['table4'].title}", partial(_table, "table4")),
    Section("Figure 7: mesh quality for the tail", figure7),
    Section("Figure 8: the mesh around the tail", figure8),
    Section("Timings of section 5, for f_x", timings),
)

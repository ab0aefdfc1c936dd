"""Carry out a study by name and write its files."""

from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.pipeline import meshed
from sdm_deflect.cases.progress import Stopwatch
from sdm_deflect.cases.registry import case_named
from sdm_deflect.cases.report.png import write_png
from sdm_deflect.cases.study.plots import DRAW
from sdm_deflect.cases.study.study import STUDIES, Result, Study, carry_out
from sdm_deflect.cases.study.text import markdown, write_csv


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
    with watch.stage(name) as tell:
        return carry_out(study, case, mesh, tell)


def write_study(result: Result, folder: Path) -> str:
    """Write <name>.csv, <name>.md and <name>.png into `folder`; return the text alternative of the picture."""
    name = result.study.name
    write_csv(result, folder / f"{name}.csv")
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    alternative = DRAW[name](result, figure)
    write_png(figure, folder / f"{name}.png")
    (folder / f"{name}.md").write_text(f"{markdown(result)}\n![{alternative}]({name}.png)\n", encoding="utf-8")
    return alternative

"""The page that compares runs: one self-contained file that asks no network for anything."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from sdm_deflect.cases.report.page import inline, pixels, policy, read, style
from sdm_deflect.deform.checks import verdict
from sdm_deflect.meshing.files import fresh, hidden_folder, permitted_as

from .figures import ComparedRun, FigureTable, Row, alike, differing_settings, tables
from .pictures import Shown, overlaid

HERE = "sdm_deflect.cases.compare"


def write_page(runs: Sequence[ComparedRun], out: Path) -> dict[str, Any]:
    """Write the page that compares runs, and return its numbers as JSON has them.

    Raises MeshFileError if the file cannot be written.
    """
    found, settings = tables(runs), differing_settings(runs)
    places = (run.folder for run in runs)
    with permitted_as(*places), fresh(out) as beside, hidden_folder() as folder:
        beside.write_text(page(runs, found, settings, overlaid(runs, folder)), encoding="utf-8")
    return figures_of(runs, found, settings) | {"page": str(out)}


def figures_of(runs: Sequence[ComparedRun], found: Sequence[FigureTable], settings: Sequence[Row]) -> dict[str, Any]:
    """Return what the page's tables hold, as JSON has it."""
    return {
        "runs": [
            {"name": run.name, "folder": run.folder, "title": run.data.title, "passed": run.data.passed} for run in runs
        ],
        "same_mesh": len(alike(runs)) == len(runs),
        "tables": {
            table.title: [
                {"name": row.name, "unit": row.unit, "values": row.values, "same": row.same} for row in table.rows
            ]
            for table in found
        },
        "settings": {row.name: row.values for row in settings},
    }


def page(runs: Sequence[ComparedRun], found: Sequence[FigureTable], settings: Sequence[Row], pictures: Shown) -> str:
    """Return the page; every text in it is escaped, and no script but its own can run."""
    script = read(HERE, "slider.js")
    jinja = Environment(
        loader=PackageLoader(HERE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {"inline": inline, "pixels": pixels, "verdict": verdict, "zip": zip}
    return jinja.get_template("page.html").render(
        runs=runs,
        tables=found,
        settings=settings,
        pictures=pictures,
        files=sorted({run.data.settings_file for run in runs}),
        version=version("sdm-deflect"),
        style=style() + read(HERE, "compare.css"),
        script=script,
        policy=policy([script]),
    )

"""The page of a run: one self-contained file that asks no network for anything."""

from base64 import b64encode
from collections.abc import Iterable
from dataclasses import fields, is_dataclass, replace
from gzip import compress
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from sdm_deflect.cases.report.data import ReportData
from sdm_deflect.cases.report.pictures import Exhibit, Gallery, compared
from sdm_deflect.cases.report.turnable import MOST_CELLS, turnable
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.settings import to_toml
from sdm_deflect.cases.surroundings import surroundings, versions


def write_report(data: ReportData, gallery: Gallery, folder: Path) -> None:
    """Write report.html and the figures that show the validation into `folder`; the gallery is the other figures."""
    exhibits = (*gallery.exhibits, *compared(data, folder / "figures"))
    (folder / "report.html").write_text(page(data, replace(gallery, exhibits=exhibits)), encoding="utf-8")


def page(data: ReportData, gallery: Gallery) -> str:
    """Return the page; every text in it is escaped, and no script but its own two can run."""
    library, viewer = plotly(), own("viewer.js")
    environment = Environment(
        loader=PackageLoader("sdm_deflect.cases.report", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"inline": inline, "pixels": pixels, "meaning": meaning}
    return environment.get_template("page.html").render(
        data=data,
        figures=data.figures,
        gallery=gallery,
        states=STATES,
        scene=turnable(data),
        most_cells=MOST_CELLS,
        parameters=parameter_tables(data.case),
        toml=to_toml(data.case),
        toml_file=b64encode(to_toml(data.case).encode()).decode("ascii"),
        surroundings=surroundings(),
        versions=versions(),
        style=own("style.css"),
        library=b64encode(compress(library.encode(), mtime=0)).decode("ascii"),
        viewer=viewer,
        policy=policy([library, viewer]),
    )


def policy(scripts: Iterable[str]) -> str:
    """Return the content security policy: nothing from any network, no script but these."""
    hashes = " ".join(f"'sha256-{b64encode(sha256(one.encode()).digest()).decode('ascii')}'" for one in scripts)
    return f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def own(name: str) -> Markup:
    """Return a file beside this one as it is, for a place where nothing is escaped."""
    return Markup(files("sdm_deflect.cases.report").joinpath(name).read_text(encoding="utf-8"))


def plotly() -> str:
    """Return the plotting library; it goes into the page compressed, as a third of its size."""
    return files("plotly").joinpath("package_data", "plotly.min.js").read_text(encoding="utf-8").replace("\r\n", "\n")


def inline(exhibit: Exhibit) -> str:
    """Return a picture as the address of itself."""
    return "data:image/png;base64," + b64encode(exhibit.path.read_bytes()).decode("ascii")


def pixels(exhibit: Exhibit) -> tuple[int, int]:
    """Return width and height of a picture, so that the page does not jump while it loads."""
    with Image.open(exhibit.path) as image:
        return image.size


CHECKS = {
    "outside_moved": "largest displacement outside the hexahedra",
    "inverted_cells": "cells turned inside out",
    "fixed_surfaces_moved": "largest displacement of a surface that must not move",
    "quality_min": "worst cell of the deflected mesh, by mean ratio (1 is regular)",
    "planarity": "nodes of planar CAD faces from their best plane",
    "surface_to_cad": "moved nodes from the deflected CAD",
    "trailing_edge_angle": "trailing edge from the angle that was asked",
    "hinge_offset": "blended wedge from the known offset to the rigid one at the hinge",
    "cylindricity": "nodes of the fuselage panel from the cylinder",
    "root_on_cylinder": "root line from cylinder and tail",
    "chimera_face_in_plane": "nodes of the Chimera face from its plane",
    "orphans": "nodes of the overset meshes without a donor cell",
}
STATES = {
    "before": "undeflected",
    "after": "deflected",
    "after_pinned": "deflected, Chimera face pinned instead of sliding",
}

Rows = list[tuple[str, str, str, str]]
"""Name, value, unit and meaning of parameters."""


def meaning(check: str) -> str:
    """Return what a check measures, empty for one that is not known."""
    return CHECKS.get(check.partition(":")[0], "")


def parameter_tables(case: Case) -> dict[str, Rows]:
    """Return every parameter of a case, by table as in case.toml."""
    tables: dict[str, Rows] = {"case": []}
    for name, value in _values(case):
        if name == "fighter":
            tables |= {part: _rows(component) for part, component in _values(value) if is_dataclass(component)}
        elif is_dataclass(value):
            tables[name] = _rows(value)
        else:
            tables["case"].append((name, _shown(value), *_declared(case, name)))
    return tables


def _rows(table: Any) -> Rows:
    return [(name, _shown(value), *_declared(table, name)) for name, value in _values(table)]


def _values(table: Any) -> list[tuple[str, Any]]:
    return [(one.name, getattr(table, one.name)) for one in fields(table)]


def _declared(table: Any, name: str) -> tuple[str, str]:
    """Return unit and meaning of a field that is a quantity."""
    metadata = next(one.metadata for one in fields(table) if one.name == name)
    return str(metadata.get("unit", "")).removeprefix("-"), str(metadata.get("doc", ""))


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return ", ".join(_shown(one) for one in value) or "none"
    if is_dataclass(value):
        return " ".join(_shown(one) for _, one in _values(value))
    return str(value)

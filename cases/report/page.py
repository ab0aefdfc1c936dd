"""The page of a run, one self-contained file that needs no network."""

import re
from base64 import b64encode
from collections.abc import Iterable, Iterator
from gzip import decompress
from hashlib import sha256
from importlib.resources import files
from io import BytesIO
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, TemplateError
from markupsafe import Markup, escape
from PIL import Image

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.numbers import apart, percent
from sdm_deflect.base.unpacking import damaged
from sdm_deflect.cases.run.advice import advice
from sdm_deflect.cases.run.metrics import REACHED, Json, face_rows, kernel_text, repair_text
from sdm_deflect.cases.run.output import surroundings, versions
from sdm_deflect.deform.checks import verdict
from sdm_deflect.meshing.mesh.quality import Quality

from .data import ReportData, measure_in_words
from .pictures import SHARPER, Exhibit, Gallery
from .scene3d import pack, turnable

HERE = "sdm_deflect.cases.report"
# What the picture needs of three.js, made by `npm ci && npm run build` in the folder ``.ci/three``.
LIBRARY = "three.min.js.gz"
# Bytes of a page. Of a larger one some pictures stay in the folder `figures`, and the page names them.
LARGEST = 4_000_000
CHECKS = {
    "slid_on_surfaces": "nodes of fixed surfaces that the repair moved, from the undeflected surface",
    "outside_moved": "largest displacement outside the boxes",
    "inverted_cells": "cells turned inside out",
    "surfaces_crossed": "faces that moved and now go through another surface, or through their own",
    "fixed_surfaces_moved": "largest displacement of a surface that must not move",
    "quality_min": "worst cell by its measure (1 is ideal): of a type at the box, or of the whole mesh",
    "non_orthogonality_max": "largest angle between a face's normal and the line between the centres of its two cells",
    "skewness_max": "largest distance of a face's centre from that line, over the size of the face",
    "left_behind": "nodes of the surface that were left behind",
    "nodes_parted": "pairs of boundary nodes that were at one place and no longer are",
    "held_moved": "largest displacement of a node of a moving patch that is to stay",
    "repair_elsewhere": "largest displacement by the repair of nodes that it must not move",
    "surface_kept": "nodes that the repair moved on the control surface, from its triangles",
    "planarity": "nodes of planar CAD faces from their best plane",
    "surface_to_cad": "all nodes of the surface from the deflected CAD, built again (of hinged surfaces: blended)",
    "exact_to_cad": "the same, beyond a strip beside a closed rib and a tail's root line",
    "surface_to_rigid_cad": "all nodes from the surface's CAD faces turned rigidly, and back; the limit is predicted",
    "rigid_cad_predicted": "the same in each part, from what is predicted without the mesh's own law",
    "site_error": "error at the data sites: the fit ends as soon as it is below the limit; surface nodes are exact",
    "layer_height": "first layers: largest change of a height as a share of it, or growth of the first, or tilt",
    "trailing_edge_angle": "trailing edge from the angle that was asked",
    "hinge_offset": "hinge edges from where fixed hinge edges must be beside a wedge turned rigidly",
    "cylindricity": "nodes of the fuselage panel from the cylinder",
    "root_on_cylinder": "root line from cylinder and tail",
    "chimera_face_in_plane": "nodes of the Chimera face from its plane",
    "orphans": "nodes of the overset meshes without a donor cell",
}
# What a check measures that ends with the name of a patch, or of a pair.
OF_PATCHES = {
    "on": "nodes of a sliding patch from its shape",
    "periodic": "nodes of a periodic pair from the images of their partners, over the largest coordinate",
    "plane": "nodes on the sides of a case one cell thick from their partners' images and their side, the same",
}
STATES = {
    "before": "undeflected",
    "interpolated": "deflected, before the repair",
    "after": "deflected",
    "after_pinned": "deflected, Chimera face pinned instead of sliding",
}


def write_report(data: ReportData, gallery: Gallery, folder: Path) -> None:
    """Write report.html into `folder`."""
    (folder / "report.html").write_text(page(data, gallery), encoding="utf-8")


def templates(folder: str) -> Environment:
    """Return the templates of a package, which escape every text in a page."""
    loader = PackageLoader(folder, ".")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def picture(data: ReportData, scene: Json) -> Json:
    """Return the variables of `picture.html`; no script but its two can run."""
    library = files(HERE).joinpath(LIBRARY).read_bytes()
    viewer = read(HERE, "measures.js") + read(HERE, "viewer.js")
    return {
        "data": data,
        "turn": scene["turn"],
        "scene": dict(zip(("data", "arrays"), pack(scene), strict=True)),
        "touched": sum(box.affected.count for box in data.boxes),
        "shown": scene["cells"]["shown"],
        "style": style(),
        "library": b64encode(library).decode("ascii"),
        "viewer": viewer,
        "policy": policy([decompress(library).decode(), viewer]),
    }


def page(data: ReportData, gallery: Gallery) -> str:
    """Return the page of a run; InputError if a figure that it shows is missing."""
    data = data.near
    jinja = templates(HERE)
    jinja.filters |= {"apart": apart, "degrees": degrees, "pixels": pixels, "meaning": meaning, "kernel": kernel_text}
    jinja.filters |= {"verdict": verdict, "remedies": remedies, "first_sentence": first_sentence}
    jinja.filters |= {"failures": failures, "coded": coded, "repair": repair_text}
    shown = {
        **picture(data, turnable(data)),
        "figures": data.figures,
        "gallery": gallery,
        "measure": measure_in_words(data.boxes),
        "toml_file": b64encode(data.settings.encode()).decode("ascii"),
        "surroundings": surroundings(),
        "versions": versions(),
    }
    with damaged(Path("metrics.json"), "table of a run's figures"):
        shown["qualities"], shown["turned"] = list(qualities(data)), list(turns(data))
        shown["faces"] = [(name, *face_rows(figures)) for name, figures in data.figures.get("deflections", {}).items()]
        inlined = {exhibit.path: inline(exhibit) for exhibit in gallery.exhibits}
        while True:
            jinja.filters["inline"] = lambda exhibit: inlined.get(exhibit.path, "")
            try:
                text = jinja.get_template("page.html").render(shown)
            except TemplateError as error:
                raise InputError(f"{error}") from error
            if len(text.encode()) <= LARGEST or not inlined:
                return text
            inlined.popitem()


def qualities(data: ReportData) -> Iterator[tuple[str, str, Quality | Json]]:
    """Yield box, state and quality of the affected cells of each type."""
    for box, after in zip(data.boxes, data.after, strict=True):
        figures = data.figures.get("deflections", {}).get(box.name, {})
        repaired = figures.get("repair")
        for quality, then in zip(box.affected.quality_before, after, strict=True):
            yield box.name, STATES["before"], quality
            if repaired:
                yield box.name, STATES["interpolated"], repaired["quality"][quality.shape]
            yield box.name, STATES["after"], then
        pinned = figures.get("quality_inside", {}).get("after_pinned")
        for quality in (pinned or {}).values():
            yield box.name, STATES["after_pinned"], quality


def policy(scripts: Iterable[str]) -> str:
    """Return the content security policy: nothing from any network, no script but these."""
    hashes = " ".join(f"'sha256-{b64encode(sha256(script.encode()).digest()).decode('ascii')}'" for script in scripts)
    allowed = f"script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:"
    return f"default-src 'none'; {allowed}; base-uri 'none'"


def style() -> Markup:
    """Return the style sheet of a page; colours come first."""
    return read(HERE, "palette.css") + read(HERE, "style.css")


def read(package: str, *name: str) -> Markup:
    """Return the text of a package's file, which the template does not escape."""
    return Markup(files(package).joinpath(*name).read_text(encoding="utf-8").replace("\r\n", "\n"))


def inline(exhibit: Exhibit) -> str:
    """Return a picture as a data address, as WebP without loss: lines and letters stay sharp in fewer bytes."""
    packed = BytesIO()
    with Image.open(exhibit.path) as image:
        image.convert("RGB").save(packed, "webp", lossless=True, quality=100, method=4)
    return "data:image/webp;base64," + b64encode(packed.getvalue()).decode("ascii")


def pixels(exhibit: Exhibit) -> tuple[int, int]:
    """Return width and height of a picture in the page, which does not jump then while it loads."""
    with Image.open(exhibit.path) as image:
        width, height = image.size
    return round(width / SHARPER), round(height / SHARPER)


def remedies(data: ReportData) -> Iterator[str]:
    """Return advice for checks that failed or have a reservation."""
    wider = dict.fromkeys(surface.wider for surface in data.surfaces if surface.wider)
    return advice(data.checks, tuple(wider), any(surface.amount for surface in data.surfaces))


def turns(data: ReportData) -> Iterator[str]:
    """Yield a sentence for each surface that turns by clearly less than its angle on average."""
    for surface in data.surfaces:
        reached = (data.figures.get("motion") or {}).get(surface.label) or {}
        if surface.amount and reached.get("mean", 1.0) < REACHED:
            narrower = f" Narrower ends: {surface.narrower}." if surface.narrower else ""
            where = f"{surface.amount_text} in the middle and by less towards its ends: " * bool(reached["full"])
            yield f"{surface.name} turns by {where}{percent(reached['mean'])} on average.{narrower}"


def failures(text: str) -> str:
    """Return from a verdict how many checks failed, and which."""
    return text.partition("; ")[2].replace(" checks: ", " checks failed: ")


def coded(text: str) -> Markup:
    """Return a text whose words between backticks, and options, are shown as code."""
    return Markup(re.sub(r"`([^`]+)`|(--[\w-]+(?: [\d.]+\d)?)", r"<code>\1\2</code>", str(escape(text))))


def first_sentence(text: str) -> str:
    """Return a description without its numbers, which stand in tables."""
    return text.partition(". ")[0].removesuffix(".") + "."


def degrees(text: str) -> str:
    """Return a text with amounts such as ``-12 deg`` as pages show them."""
    shown = re.sub(r"(\d) deg\b", "\\1\N{DEGREE SIGN}", text)
    return re.sub(r"-(?=\d[\d.]*\N{DEGREE SIGN})", "\N{MINUS SIGN}", shown)


def meaning(check: str) -> str:
    """Return a sentence on what a check measures; empty for an unknown check."""
    name = check.partition(":")[0]
    return CHECKS.get(name, OF_PATCHES.get(name.partition("_")[0], "") if "_" in name else "")

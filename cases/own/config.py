"""A job from text: options of the command line and tables of a TOML file, which say the same."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.blended import Blended
from sdm_deflect.cases.own.box import Automatic, BoxRule, Given
from sdm_deflect.cases.own.job import Fitting, Job, Sliding
from sdm_deflect.cases.own.motion import LARGEST_ANGLE, Motion, Moving, Rotation
from sdm_deflect.cases.own.surface import Listed, NodeSet, OnPatches, TrailingEdge
from sdm_deflect.cases.own.table import Table
from sdm_deflect.cases.own.words import check_keys, number, points, texts
from sdm_deflect.cases.settings import read_toml

Nested = dict[str, Any]
SURFACE = ("patches", "hinge", "angle", "motion", "held", "driven", "strip", "table", "amount")
FITTING = ("strategy", "tolerance", "spacing_edges", "max_centers", "max_steps")
TOP = ("surface", "fixed", "slide", "box", "margin", "zones", "allow_inverted", *FITTING)
MOST_ANGLES = 1000


def read_config(path: Path) -> Nested:
    """Read a TOML file with the keys of `TOP`, and one table ``[[surface]]`` for each moving surface."""
    try:
        nested = read_toml(path)
    except ValueError as error:
        raise InputError(str(error)) from None
    check_keys(nested, TOP, str(path))
    return nested


def job_from(nested: Mapping[str, Any], folder: Path = Path()) -> Job:
    """Return the job that nested tables describe; files in it are relative to `folder`.

    Raises
    ------
    InputError
        For keys that are unknown and values that do not fit; the message names them.
    """
    fixed = tuple(texts(nested.get("fixed", ()), "fixed"))
    tables = nested.get("surface", ())
    if not tables:
        raise InputError("no surface to move: name one with --surface, or give [[surface]] tables in --config")
    slides = nested.get("slide", {})
    if not isinstance(slides, Mapping):
        raise InputError(f"slide = {slides!r} must be a table such as {{ symmetry = 'plane' }}")
    return Job(
        surfaces=tuple(_surface(table, fixed, folder) for table in tables),
        fixed=fixed,
        slides=tuple(Sliding(patch, str(shape)) for patch, shape in slides.items()),
        box=_box(nested.get("box", "auto"), nested.get("margin", 0.0), folder),
        zones=tuple(texts(nested.get("zones", ()), "zones")),
        fitting=Fitting(**{key: nested[key] for key in FITTING if key in nested}),
        allow_inverted=bool(nested.get("allow_inverted", False)),
    )


def angles_from(text: str) -> tuple[float, ...]:
    """Return the angles of ``first:last:step``, both ends included, or of a list with commas.

    Raises
    ------
    InputError
        If the text is neither, or an angle is out of range.
    """
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = int(np.floor((last - first) / step + 1e-9)) + 1
            angles = [round(first + i * step, 12) for i in range(min(count, MOST_ANGLES + 1))]
        else:
            angles = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(f"--angles {text}: must be first:last:step, such as -30:30:5, or a list with commas") from None
    if not angles or len(angles) > MOST_ANGLES:
        raise InputError(f"--angles {text}: must be 1 to {MOST_ANGLES} angles")
    worst = max(angles, key=abs)
    if not abs(worst) <= LARGEST_ANGLE:
        raise InputError(f"--angles {text}: {worst:g} deg is out of range: at most {LARGEST_ANGLE:g} deg either way")
    return tuple(dict.fromkeys(angles))


def _surface(table: Mapping[str, Any], fixed: tuple[str, ...], folder: Path) -> Moving:
    check_keys(table, SURFACE, "[[surface]]")
    patches = tuple(texts(table.get("patches", ()), "patches"))
    amount = table.get("amount", 1.0) if "table" in table else table.get("angle")
    if amount is None:
        raise InputError(f"the angle of {', '.join(patches)} is missing: give --angle, in degrees")
    motion = _blended(_base(table, folder), table, fixed, folder)
    return Moving(patches, motion, number(amount, "angle"))


def _base(table: Mapping[str, Any], folder: Path) -> Motion:
    hinge = None
    if table.get("hinge"):
        hinge = Rotation.about(*points(table["hinge"], 2, "--hinge"))
    if "table" in table:
        return Table.read(folder / str(table["table"]), hinge.axis if hinge else None)
    if hinge is None:
        raise InputError("the hinge is missing: give --hinge x0,y0,z0 x1,y1,z1")
    return hinge


def _blended(base: Motion, table: Mapping[str, Any], fixed: tuple[str, ...], folder: Path) -> Motion:
    kind = table.get("motion", "rigid")
    if kind not in ("rigid", "blended"):
        raise InputError(f"motion = {kind!r} must be rigid or blended")
    if kind == "rigid":
        return base
    held = _nodes(table["held"], folder) if "held" in table else OnPatches(fixed)
    driven = _nodes(table["driven"], folder) if "driven" in table else TrailingEdge()
    return Blended(base, held, driven, number(table.get("strip", 0.2), "strip"))


def _nodes(value: Any, folder: Path) -> NodeSet:
    """Return a node set: ``edges`` or ``edges:40``, a .txt file of node indices, a list of them, or patches."""
    if isinstance(value, list) and all(isinstance(item, int) for item in value):
        return Listed(np.array(value, dtype=np.intp))
    names = texts(value, "a node set")
    if names[0] == "edges" or names[0].startswith("edges:"):
        return TrailingEdge(number(names[0].removeprefix("edges").removeprefix(":") or 40.0, "edges"))
    if names[0].endswith(".txt"):
        return Listed.read(folder / names[0])
    return OnPatches(tuple(names))


def _box(value: Any, margin: Any, folder: Path) -> BoxRule:
    if value == "auto":
        return Automatic(number(margin, "margin"))
    if isinstance(value, str):
        return Given.read(folder / value)
    return Given.at(points(value, len(value), "box"))

"""Pictures of several runs: histograms in one plot, and views of one mesh that fit over each other to the pixel."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from sdm_deflect.cases.report.data import Box, MovedSurface, ReportData, drawn_measure, qualities
from sdm_deflect.cases.report.figures import panels
from sdm_deflect.cases.report.pictures import Exhibit, saved
from sdm_deflect.cases.report.slices import AXES, QUALITY_MAP, QUALITY_RANGE, CutPlane, draw_slice, planes
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.mesh.quality import MEASURES

from .figures import ComparedRun, alike

BEFORE = "undeflected"
MOST = 60
"""Pictures to lay over each other in one page; surfaces that would need more are left out."""
STYLES = (
    ("#0072b2", "-"), ("#d55e00", "--"), ("#009e73", "-."), ("#aa4499", ":"),
    ("#56b4e9", (0, (5, 1, 1, 1))), ("#e69f00", (0, (1, 1))), ("#332288", (0, (7, 2))), ("#882255", (0, (3, 1, 1, 1))),
)  # fmt: skip
"""Colours and dashes of runs: they are told apart in grey, too."""
AXES_AT, BAR_AT = (0.13, 0.1, 0.68, 0.83), (0.84, 0.2, 0.03, 0.62)
"""Where a section and its bar of colours stand: in the same place in each picture."""


@dataclass(frozen=True, slots=True)
class Overlay:
    """Pictures of one view that fit over each other.

    Attributes
    ----------
    title, caption : what is seen.
    exhibits : by name, of the undeflected mesh and of each run.
    """

    title: str
    caption: str
    exhibits: dict[str, Exhibit]


@dataclass(frozen=True, slots=True)
class Shown:
    """All pictures of a comparison, and why some are missing (empty if none is)."""

    histograms: tuple[Exhibit, ...]
    overlays: tuple[Overlay, ...]
    missing: tuple[str, ...]


def overlaid(runs: Sequence[ComparedRun], folder: Path) -> Shown:
    """Draw every picture into `folder`."""
    histograms = [saved(folder, "quality", "", *found) for found in _histograms(runs)]
    same, missing = alike(runs), []
    if len(same) < len(runs):
        others = ", ".join(run.name for run in runs if run not in same)
        missing.append(f"of another mesh than {runs[0].name}, so that no pictures fit over each other: {others}")
    if len(same) < 2:
        return Shown(tuple(histograms), (), tuple(missing))
    pairs, left_out = _surfaces(same)
    missing += [f"too many pictures for one page: {name} is left out" for name in left_out]
    overlays = [
        _sections(same, pair, row, plane, folder)
        for pair in pairs
        for row, plane in enumerate(planes(runs[0].data, *pair[0]) if runs[0].data.mesh.cells else ())
    ]
    return Shown(tuple(histograms), tuple(overlays), tuple(missing))


Pair = tuple[tuple[Box, MovedSurface], ...]
"""A surface, and its box, of each run."""


def _surfaces(runs: Sequence[ComparedRun]) -> tuple[list[Pair], list[str]]:
    """Return the surfaces that all runs move, and the names of those for which there is no room."""
    own = [{s.patches: (box, s) for box in run.data.boxes for s in box.surfaces} for run in runs]
    common = [patches for patches in own[0] if all(patches in one for one in own)]
    room = max(1, MOST // (3 * (len(runs) + 1)))
    pairs = [tuple(one[patches] for one in own) for patches in common]
    return pairs[:room], [pair[0][1].name for pair in pairs[room:]]


def _histograms(runs: Sequence[ComparedRun]) -> Iterator[tuple[Figure, str]]:
    """Draw the quality of the touched cells, a panel for each type, as shares: meshes may differ in size."""
    before, after = _qualities(runs[0].data, True), [_qualities(run.data, False) for run in runs]
    shapes = dict.fromkeys(shape for qualities in after for shape in qualities)
    if not shapes:
        return
    figure, axes = panels(len(shapes))
    names = [f"{runs[0].name}, {BEFORE}", *(run.name for run in runs)]
    looks: list[dict[str, Any]] = [{"color": "black", "lw": 1.0}]
    looks += [{"color": color, "ls": dashes, "lw": 2.0} for color, dashes in STYLES]
    curves = list(zip(names, (before, *after), looks, strict=False))
    texts = [
        _histogram(panel, shape, [(name, parts[shape], look) for name, parts, look in curves if shape in parts])
        for panel, shape in zip(axes, shapes, strict=True)
    ]
    yield figure, "Histograms of the quality of the cells that touch the boxes, over each other. " + " ".join(texts)


def _histogram(panel: Axes, shape: str, curves: Sequence[tuple[str, FloatArray, dict[str, Any]]]) -> str:
    """Draw the quality of cells of a type by name of the run, and say how large the smallest is."""
    bins = np.linspace(min(0.0, *(float(values.min()) for _, values, _ in curves)), 1.0, 41)
    for name, values, look in curves:
        share = 100.0 * np.histogram(np.clip(values, bins[0], 1.0), bins)[0] / len(values)
        panel.stairs(share, bins, label=name, **look)
    panel.set(xlabel=f"{MEASURES[shape]} of a cell", ylabel="share of the cells, %", xlim=(bins[0], 1.0))
    panel.set_yscale("symlog", linthresh=0.1)
    panel.set_title(shape, fontsize="medium")
    panel.legend(loc="upper left", fontsize="small")
    panel.grid(alpha=0.3)
    least = ", ".join(f"{name} {values.min():.3f}" for name, values, _ in curves)
    return f"Smallest {MEASURES[shape]} of the {shape} cells: {least}."


def _qualities(data: ReportData, before: bool) -> dict[str, FloatArray]:
    """Quality (M,) of the cells that touch any box, by type."""
    parts: dict[str, list[FloatArray]] = {}
    points = data.mesh.points if before else data.points
    for box in data.boxes:
        for shape, values in qualities(box.touched, [points]).items():
            parts.setdefault(shape, []).append(values[0])
    return {shape: np.concatenate(own) for shape, own in parts.items()}


def _states(runs: Sequence[ComparedRun], pair: Pair) -> Iterator[tuple[str, ReportData, FloatArray, Box, MovedSurface]]:
    """Yield name, data, points (N, 3), box and surface of the undeflected mesh, and of each run."""
    yield BEFORE, runs[0].data, runs[0].data.mesh.points, *pair[0]
    for run, own in zip(runs, pair, strict=True):
        yield run.name, run.data, run.data.points, *own


def _sections(runs: Sequence[ComparedRun], pair: Pair, row: int, plane: CutPlane, folder: Path) -> Overlay:
    """Draw one of the sections of a surface in each state, with the same axes."""
    first, (_, surface) = runs[0].data, pair[0]
    measure = drawn_measure(first.boxes)
    place = f"{plane.what}, {AXES[plane.axis]} = {first.length.text(plane.station)}"
    exhibits: dict[str, Exhibit] = {}
    smallest = []
    for name, data, points, own, moved in _states(runs, pair):
        turned = "" if name == BEFORE else f", {moved.turned}"
        figure, least = _section(data, points, own, plane, measure)
        words = f"{surface.name}, {place}, {name}{turned}: smallest of its cells {least:.3f} ({measure})."
        exhibits[name] = saved(folder, f"section{row}", f"{surface.name}_{len(exhibits)}", figure, words)
        smallest.append(f"{name} {least:.3f}")
    caption = f"Smallest quality of the cells that are cut: {', '.join(smallest)}. The box is dashed."
    return Overlay(f"{surface.name}: {place}", caption, exhibits)


def _section(data: ReportData, points: FloatArray, box: Box, plane: CutPlane, measure: str) -> tuple[Figure, float]:
    """Draw a section without a title, which the line would cut, and return the smallest quality in it."""
    figure = Figure(figsize=(6.6, 5.8))
    axes = figure.add_axes(AXES_AT)
    least = draw_slice(axes, data, points, box, plane, "")
    axes.set_title("")
    shades = ScalarMappable(QUALITY_RANGE, QUALITY_MAP)
    bar = figure.colorbar(shades, cax=figure.add_axes(BAR_AT), extend="min")
    bar.set_label(f"{measure} of a cell".replace("; ", ";\n"), fontsize="small")
    return figure, least

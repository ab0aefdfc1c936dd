"""Plots of one run: convergence and quality histograms, one panel for each box and type of cell."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.deform.volume.deflection import POOR
from sdm_deflect.meshing.mesh.quality import MEASURES, PLURALS

from .colours import BAD, INK, MOVES, PALETTE, SOFT, WORSE, XYZ
from .data import Box, ReportData, qualities

# Lines of the directions x, y, z; dashes and markers tell them apart without colour.
STYLES = tuple(
    {"color": colour, "ls": dash, "marker": marker}
    for colour, dash, marker in zip(XYZ, ("-", "--", ":"), "os^", strict=True)
)
# Number of boxes and types from which on one panel has a row for each, and its inches: in all, of a row, of the axis.
MANY, ROW_WIDE, ROW, ROW_FOOT = 3, 9.2, 0.42, 1.0
STATISTICS = ("worst cell", "1 %", "mean")
# A difference of quality that a reader sees.
SEEN = 5e-4
# Inches to the left, to the right, below and above each panel.
MARGINS = 0.75, 0.12, 0.52, 0.32
# Residuals below this share of the tolerance are drawn there: an axis of logarithms has no zero.
SMALLEST = 1e-3


def panels(count: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with a number of axes, two in a row; a single one is wider."""
    columns = min(count, 2)
    rows = -(-count // columns)
    left, right, low, top = MARGINS
    width, height = (9.2 if columns > 1 else 6.9) / columns, 3.5
    across, upwards = width - left - right, height - low - top
    figure = Figure(figsize=(width * columns, height * rows))
    figure.subplots_adjust(
        left / (width * columns), low / (height * rows), 1.0 - right / (width * columns), 1.0 - top / (height * rows),
        (left + right) / across, (low + top) / upwards,
    )  # fmt: skip
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in axes[count:]:
        spare.set_axis_off()
    return figure, axes[:count]


def convergence(data: ReportData) -> tuple[Figure, str]:
    """Plot the largest residual over the number of centres, by direction (figure 2); return it with a description."""
    figure, axes = panels(len(data.boxes))
    texts, unit, clipped = [], data.length.name, False
    for panel, box in zip(axes, data.boxes, strict=True):
        first = [course for course in box.fits.convergence if course.step == 1]
        for course in first:
            style: dict[str, Any] = STYLES["xyz".index(course.directions[0])]
            errors = np.maximum(course.errors, SMALLEST * box.tolerance)
            clipped |= bool(np.any(errors > course.errors))
            panel.semilogy(course.centres, errors, label=f"$f_{{{course.directions}}}$", lw=1.8, ms=4.5, **style)
        panel.axhline(box.tolerance, color="0.4", lw=1, label=f"tolerance {box.tolerance:.3g} {unit}")
        panel.set(xlabel="centres", ylabel=f"largest residual at the data sites, {unit}", title=box.name)
        panel.legend(loc="best", fontsize="small")
        panel.grid(alpha=0.3)
        ends = ", ".join(f"{c.errors[-1]:.1e} {unit} with {c.centres[-1]} centres in {c.directions}" for c in first)
        texts.append(f"{box.name}: {ends}; tolerance {box.tolerance:.3g} {unit}.")
    if clipped:
        texts.append("Residuals below a thousandth of the tolerance are drawn there.")
    return figure, "Largest residual against the number of centres. " + " ".join(texts)


def quality(data: ReportData) -> tuple[Figure, str]:
    """Plot the quality of cells that touch each hexahedron, by type; return the figure with a description.

    Many types and boxes have a row each in one panel, few a histogram each.
    """
    states = list(data.states.values())
    parts = [(box, *pair) for box in data.boxes for pair in qualities(box.affected, states).items()]
    if len(parts) >= MANY:
        return _rows([(_named(box, shape), values[0], values[-1]) for box, shape, values in parts])
    figure, axes = panels(len(parts))
    texts = [_histogram(data, panel, *part) for panel, part in zip(axes, parts, strict=True)]
    return figure, "Histograms of the quality of cells before and after the deflection. " + " ".join(texts)


def _named(box: Box, shape: str) -> str:
    """Return the name of a box, with the type of its cells if they are no tetrahedra."""
    return box.name if shape == "tetra" else f"{box.name}, {PLURALS[shape]}"


def _rows(parts: list[tuple[str, FloatArray, FloatArray]]) -> tuple[Figure, str]:
    """Draw worst, 1 % and mean quality before and after, a row for each name; return the figure and a description."""
    least = min(0.0, *(float(values.min()) for _, *both in parts for values in both))
    figure = Figure(figsize=(ROW_WIDE, ROW * len(parts) + ROW_FOOT), layout="constrained")
    axes, texts = figure.subplots(), []
    axes.axvspan(least, POOR, color=PALETTE["warn-ground"], lw=0)
    for y, (name, *both) in enumerate(parts):
        before, after = ((values.min(), np.percentile(values, 1.0), values.mean()) for values in both)
        for k, (old, new) in enumerate(zip(before, after, strict=True)):
            colour = WORSE if k == 0 and new < old - SEEN else MOVES
            axes.plot((old, new), (y, y), color=colour, lw=2.5)
            axes.plot(old, y, "o", ms=7, mfc="white", mec=SOFT, mew=1.5)
            axes.plot(new, y, "o", ms=6, color=colour)
            if k < 2:
                shown = {"color": BAD if colour == WORSE else INK, "fontsize": 9, "ha": "right", "va": "center"}
                axes.annotate(f"{new:.3f}", (min(old, new), y), xytext=(-8, 0), textcoords="offset points", **shown)
            if not y:
                axes.annotate(
                    STATISTICS[k], (new, y), xytext=(0, 12), textcoords="offset points", ha="center", fontsize=9
                )
        texts.append(f"{name}: worst {before[0]:.3f} before, {after[0]:.3f} after.")
    axes.set_yticks(range(len(parts)), [name for name, *_ in parts], weight="bold")
    axes.set(xlim=(least, 1.0), ylim=(len(parts) - 0.5, -0.9))
    axes.set_xlabel("quality of the cells at each box (1: regular, 0: flat); open: before, filled: after; shaded: poor")
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", alpha=0.3)
    return figure, "Worst, 1 % and mean quality of the cells before and after. " + " ".join(texts)


def _histogram(data: ReportData, axes: Axes, box: Box, shape: str, values: FloatArray) -> str:
    """Draw the histograms of one type of cell, for states (2 or 3, M); return a description."""
    before, after = values[0], values[-1]
    bins = np.linspace(min(0.0, float(values.min())), 1.0, 51)
    bars(axes, after, bins, "deflected", color="#8bb8e6", fill=True)
    bars(axes, before, bins, "undeflected", color="black", lw=1.4)
    if len(values) > 2:
        bars(axes, values[1], bins, "deflected, before the repair", color=MOVES, lw=1.4, ls="--")
    if data.quality_limit is not None and shape == "tetra":
        axes.axvline(data.quality_limit, color="0.35", lw=1, ls="--", label=f"limit {data.quality_limit:g}")
    label = f"{MEASURES[shape]} of a cell"
    axes.set(xlabel=label, ylabel="cells (log above 1)", yscale="symlog", xlim=(bins[0], bins[-1]))
    axes.set_title(
        f"{_named(box, shape)}: smallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium"
    )
    axes.legend(loc="upper left", fontsize="small")
    axes.grid(alpha=0.3)
    return (
        f"{box.name}: {len(before)} {shape} cells that touch the box; smallest {MEASURES[shape]} "
        f"{before.min():.3f} before and {after.min():.3f} after, mean {before.mean():.3f} before and "
        f"{after.mean():.3f} after."
    )


def bars(axes: Axes, values: FloatArray, bins: FloatArray, label: str, **looks: Any) -> None:
    """Draw one histogram; values beyond the bins count in the last bin."""
    axes.stairs(np.histogram(np.clip(values, bins[0], bins[-1]), bins)[0], bins, label=label, **looks)

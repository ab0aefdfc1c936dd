"""Plots of one run: convergence and quality histograms, one panel for each box and type of cell."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.meshing.mesh.quality import MEASURES

from .data import Box, ReportData, qualities

# Lines of the directions x, y, z; dashes and markers tell them apart without colour.
STYLES = (
    {"color": "#1a73c9", "ls": "-", "marker": "o"},
    {"color": "#d1350f", "ls": "--", "marker": "s"},
    {"color": "#333333", "ls": ":", "marker": "^"},
)
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
    """Plot the quality of cells that touch each hexahedron, by type; return the figure with a description."""
    states = list(data.states.values())
    parts = [(box, *pair) for box in data.boxes for pair in qualities(box.affected, states).items()]
    figure, axes = panels(len(parts))
    texts = [_histogram(data, panel, *part) for panel, part in zip(axes, parts, strict=True)]
    return figure, "Histograms of the quality of cells before and after the deflection. " + " ".join(texts)


def _histogram(data: ReportData, axes: Axes, box: Box, shape: str, values: FloatArray) -> str:
    """Draw the histograms of one type of cell, for states (2 or 3, M); return a description."""
    before, after = values[0], values[-1]
    bins = np.linspace(min(0.0, float(values.min())), 1.0, 51)
    bars(axes, after, bins, "deflected", color="#8bb8e6", fill=True)
    bars(axes, before, bins, "undeflected", color="black", lw=1.4)
    if len(values) > 2:
        bars(axes, values[1], bins, "deflected, before the repair", color="#1a73c9", lw=1.4, ls="--")
    if data.quality_limit is not None and shape == "tetra":
        axes.axvline(data.quality_limit, color="0.35", lw=1, ls="--", label=f"limit {data.quality_limit:g}")
    label = f"{MEASURES[shape]} of a cell"
    axes.set(xlabel=label, ylabel="cells (log above 1)", yscale="symlog", xlim=(bins[0], bins[-1]))
    name = box.name if shape == "tetra" else f"{box.name}, {shape}"
    axes.set_title(f"{name}: smallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium")
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

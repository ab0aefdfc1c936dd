"""Plots: convergence and quality histograms, of one run's control surfaces and of several runs."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.report.data import Course, ReportData
from sdm_deflect.cases.sdm.metrics import Run
from sdm_deflect.deform.mesh import FloatArray
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Plan

STYLES = (
    {"color": "#0072b2", "ls": "-", "marker": "o"},
    {"color": "#d55e00", "ls": "--", "marker": "s"},
    {"color": "#333333", "ls": ":", "marker": "^"},
)
"""Of the directions x, y, z: told apart by dashes and markers, too."""
BINS = np.linspace(0.0, 1.0, 51)
COLUMNS = 2
SMALLEST = 1e-16
"""Residuals (m) below are drawn here: an axis of logarithms has no zero."""


def panels(count: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure of so many axes, two in a row; a single one is wider."""
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    size = (columns * width if columns > 1 else 1.5 * width, rows * height)
    figure = Figure(figsize=size, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in axes[count:]:
        spare.set_axis_off()
    return figure, axes[:count]


def convergence(data: ReportData) -> tuple[Figure, str]:
    """Largest residual against the number of centres, per direction (the paper's figure 2), and what is seen."""
    figure, axes = panels(len(data.plans), 4.6, 3.5)
    tolerance, texts = data.case.adaptation.tolerance, []
    for one, plan in zip(axes, data.plans, strict=True):
        courses = [course for course in data.courses if course.surface == plan.surface and course.step == 1]
        for course in courses:
            _course(one, course)
        one.axhline(tolerance, color="0.4", lw=1, label=f"tolerance {tolerance:g} m")
        one.set(xlabel="centres", ylabel="largest residual at the data sites, m", title=plan.surface)
        one.legend(loc="best", fontsize="small")
        one.grid(alpha=0.3)
        ends = ", ".join(f"{c.errors[-1]:.1e} m with {c.centres[-1]} centres in {c.directions}" for c in courses)
        texts.append(f"{plan.surface}: {ends}.")
    return figure, f"Largest residual against the number of centres; tolerance {tolerance:g} m. " + " ".join(texts)


def _course(axes: Axes, course: Course) -> None:
    style = STYLES["xyz".index(course.directions[0])]
    errors = np.maximum(course.errors, SMALLEST)
    axes.semilogy(course.centres, errors, label=f"$f_{{{course.directions}}}$", lw=1.8, ms=4.5, **style)


def quality(data: ReportData) -> tuple[Figure, str]:
    """Mean ratio of the cells that touch each hexahedron, before and after on common bins, and what is seen."""
    figure, axes = panels(len(data.plans), 4.6, 3.5)
    texts = [histogram(data, plan, one) for one, plan in zip(axes, data.plans, strict=True)]
    return figure, "Histograms of the mean ratio before and after the deflection. " + " ".join(texts)


def histogram(data: ReportData, plan: Plan, axes: Axes) -> str:
    """Draw the histograms of one control surface's hexahedron and say what is seen."""
    cells = data.mesh.tets[data.touching(plan)]
    before, after = (mean_ratio(mesh.points, cells) for mesh in (data.mesh, data.deflected))
    axes.stairs(np.histogram(after, BINS)[0], BINS, label="deflected", color="#e0a36a", fill=True)
    axes.stairs(np.histogram(before, BINS)[0], BINS, label="undeflected", color="black", lw=1.4)
    limit = data.case.limits.quality_min
    axes.axvline(limit, color="0.35", lw=1, ls="--", label=f"limit {limit:g}")
    axes.set(xlabel="mean ratio of a cell", ylabel="cells (log above 1)", yscale="symlog", xlim=(0.0, 1.0))
    axes.set_title(f"{plan.surface}: smallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium")
    axes.legend(loc="upper left", fontsize="small")
    axes.grid(alpha=0.3)
    return (
        f"{plan.surface}: {len(cells)} cells that touch the hexahedron; smallest {before.min():.3f} before and "
        f"{after.min():.3f} after, mean {before.mean():.3f} before and {after.mean():.3f} after."
    )


def histograms(runs: Sequence[Run], titles: Sequence[str]) -> tuple[Figure, str]:
    """Draw one pair of histograms of all cells of the mesh for each run, and say what is seen."""
    figure = Figure(figsize=(4.6 * len(runs), 3.6), layout="constrained")
    axes = figure.subplots(1, len(runs), sharey=True, squeeze=False)[0]
    texts = [pair(run, one, title) for run, one, title in zip(runs, axes, titles, strict=True)]
    axes[0].set_ylabel("cells (log above 1)")
    axes[0].legend(loc="upper left", fontsize="small")
    return figure, "Histograms of the mean ratio before and after the deflection. " + " ".join(texts)


def pair(run: Run, axes: Axes, title: str) -> str:
    """Draw the histograms of one run: of the whole mesh as in the paper, and of the cells that touch the hexahedron."""
    before, after = (mean_ratio(mesh.points, mesh.tets) for mesh in (run.mesh, run.deflected))
    region = run.deflections[0].plan.region
    near = run.mesh.touching(region.inside)
    bars(axes, after, "deflected", color="#d55e00", alpha=0.5, fill=True)
    bars(axes, before, "undeflected", color="black", lw=1.4)
    bars(axes, after[near], "deflected, at the hexahedron", color="#0072b2", lw=1.8)
    bars(axes, before[near], "undeflected, at the hexahedron", color="black", lw=1.2, ls=":")
    axes.set(xlabel="mean ratio", yscale="symlog", xlim=(0.0, 1.0), ylim=(0.0, None))
    axes.set_title(f"{title}\nsmallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium")
    axes.grid(alpha=0.3)
    return f"{title}: smallest {before.min():.3f} before and {after.min():.3f} after."


def bars(axes: Axes, quality: FloatArray, label: str, **looks: Any) -> None:
    """Draw one histogram on the common bins."""
    axes.stairs(np.histogram(quality, BINS)[0], BINS, label=label, **looks)

"""Figures 3, 4 and 7: quality histograms before and after, on common bins."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.motion import FloatArray
from sdm_deflect.cases.run import Run
from sdm_deflect.meshing.quality import mean_ratio

BINS = np.linspace(0.0, 1.0, 51)


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
    region = run.deflections[0].turn.region
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

"""Plots of one run: convergence, quality histograms, distance from the CAD."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
from matplotlib.figure import Figure

from cases.confine import DIRECTIONS
from cases.run import Run
from meshing.quality import mean_ratio

STYLES = ({"color": "#0072b2", "ls": "-"}, {"color": "#d55e00", "ls": "--"}, {"color": "#009e73", "ls": ":"})
BINS = np.linspace(0.0, 1.0, 51)


def draw_all(run: Run, folder: Path) -> dict[str, str]:
    """Draw every plot into `folder`; return file name -> text alternative."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for name, draw in (("convergence", convergence), ("quality", quality)):
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        drawn[f"{name}.png"] = draw(run, figure)
        figure.savefig(folder / f"{name}.png", dpi=110, metadata={"Software": None})
    return drawn


def convergence(run: Run, figure: Figure) -> str:
    """Largest residual against the number of centres, per direction (the paper's figure 2)."""
    axes = figure.add_subplot()
    first = run.deflections[0]
    for fit in first.steps[0].fits:
        label = "".join(DIRECTIONS[c] for c in fit.components)
        rows = fit.history
        axes.semilogy(
            [r.n_centers for r in rows], [max(r.max_residual, 1e-16) for r in rows],
            label=f"$f_{{{label}}}$", lw=2, marker="o", ms=3 if len(rows) > 1 else 7, **STYLES[fit.components[0]],
        )  # fmt: skip
    tolerance = run.case.adaptation.tolerance
    axes.axhline(tolerance, color="0.4", lw=1)
    axes.annotate(f"tolerance {tolerance:g} m", (axes.get_xlim()[0], tolerance), va="bottom", color="0.3")
    axes.set(xlabel="centres", ylabel="largest residual at the data sites, m", title=first.turn.surface)
    axes.legend()
    axes.grid(alpha=0.3)
    return "Largest residual against the number of centres for each displacement direction, falling to the tolerance."


def quality(run: Run, figure: Figure) -> str:
    """Mean ratio of the cells that touch a hexahedron, before and after, on common bins."""
    inside = np.concatenate([one.turn.region.inside for one in run.deflections])
    cells = run.mesh.tets[np.isin(run.mesh.tets, inside).any(axis=1)]
    before, after = (mean_ratio(mesh.points, cells) for mesh in (run.mesh, run.deflected))
    axes = figure.add_subplot()
    axes.stairs(np.histogram(before, BINS)[0], BINS, label="undeflected", color="black", lw=1.5)
    axes.stairs(np.histogram(after, BINS)[0], BINS, label="deflected", color="#d55e00", alpha=0.45, fill=True)
    axes.set(xlabel="mean ratio of a cell", ylabel="cells that touch a hexahedron", yscale="symlog")
    axes.set_title(f"smallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium")
    axes.legend(loc="upper left")
    axes.grid(alpha=0.3)
    return (
        f"Histogram of the mean ratio of {len(cells)} cells before and after the deflection; smallest "
        f"{before.min():.3f} before and {after.min():.3f} after."
    )

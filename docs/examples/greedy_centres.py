"""Greedy centres on a line: where the residual is largest, a site becomes a centre."""

import numpy as np
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray, farthest
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.greedy import Adaptation, adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Worst

BLUE, RED = "#1a73c9", "#d1350f"
COUNTS = (4, 8, 16)


def sites() -> DataSites:
    """Return 201 sites on the x axis: still ahead of a hinge at 0.5, a ramp behind it, and still at the far end."""
    x = np.linspace(0.0, 2.0, 201)
    ramp = 0.1 * np.interp(x, [0.0, 0.5, 1.2, 1.7, 2.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    return DataSites(np.column_stack([x, 0.0 * x, 0.0 * x]), ramp[:, None], (2,))


def adapted(count: int) -> Adaptation:
    """Add one centre in each iteration until there are `count`."""
    data = sites()
    options = GreedyOptions(n_add=1, tol_add=1e-6, tol_stop=1e-6, max_centers=count)
    return adapt(data, ThinPlateSpline(), farthest(data.points, COUNTS[0]), options, rule=Worst())


def residual(fit: Adaptation) -> FloatArray:
    """Return the residual (N,) at the sites."""
    data = sites()
    return np.abs(fit.interpolant(data.points) - data.values)[:, 0]


def draw() -> Figure:
    """Draw interpolant and residual for growing numbers of centres."""
    data = sites()
    x = data.points[:, 0]
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.subplots(2, len(COUNTS), sharex=True, sharey="row")
    for (top, bottom), count in zip(axes.T, COUNTS, strict=True):
        fit = adapted(count)
        errors, worst = residual(fit), int(np.argmax(residual(fit)))
        top.plot(x, 1e3 * data.values[:, 0], color="0.7", lw=4, label="known displacement")
        top.plot(x, 1e3 * fit.interpolant(data.points)[:, 0], color=BLUE, label="interpolant")
        top.plot(x[fit.chosen], 1e3 * data.values[fit.chosen, 0], "o", color=BLUE, ms=6, label="centres")
        top.set_title(f"{count} centres")
        bottom.plot(x, 1e3 * errors, color=RED)
        bottom.plot(x[worst], 1e3 * errors[worst], "v", color="black", ms=9, label="next centre")
        bottom.set_xlabel("x, m")
    axes[0, 0].set_ylabel("displacement, mm")
    axes[1, 0].set_ylabel("residual, mm")
    handles = [*axes[0, 0].get_lines(), axes[1, 0].get_lines()[1]]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize="small", frameon=False)
    return figure


if __name__ == "__main__":
    draw().savefig("greedy_centres.png", dpi=100)

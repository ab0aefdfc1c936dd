"""Two rules for the next centres: the worst sites, or bad sites that are no neighbours."""

import numpy as np
from matplotlib.figure import Figure
from point_cloud import HINGE, REGION, flap

from sdm_deflect.base.arrays import farthest
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join
from sdm_deflect.deform.rbf.greedy import Adaptation, adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Rule, Separated, Worst

RED = "#d1350f"
TOLERANCE = 1e-4
RULES: dict[str, tuple[Rule, int]] = {
    "Worst, 1 at a time": (Worst(), 1),
    "Worst, 10 at a time": (Worst(), 10),
    "Separated": (Separated(), 10),
}


def sites() -> DataSites:
    """Return the z displacement of the flap of `point_cloud.py`, and zero on the faces of its region."""
    surface = flap(0.005)
    moving = DataSites(surface, HINGE.displacement(surface, 20.0)[:, [2]], (2,))
    return join([moving, fixed_sites(REGION.face_sites(0.01), (2,))])


def adapted(name: str, iterations: int = 100_000) -> Adaptation:
    """Adapt with one of the rules."""
    data, (rule, n_add) = sites(), RULES[name]
    options = GreedyOptions(n_add=n_add, tol_add=TOLERANCE, tol_stop=TOLERANCE, max_iterations=iterations)
    return adapt(data, ThinPlateSpline(), farthest(data.points, 20), options, rule=rule)


def draw() -> Figure:
    """Draw the first block of each rule on the flap, and the course of all three."""
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    plans, course = figure.subplots(1, 3, width_ratios=(1, 1, 1.7))[:2], figure.axes[2]
    points, start = sites().points, adapted("Separated", 0).chosen
    for axes, name in zip(plans, ("Worst, 10 at a time", "Separated"), strict=True):
        added = np.setdiff1d(adapted(name, 1).chosen, start)
        for rows, style in ((np.arange(len(points)), {"color": "0.85", "ms": 1.5}), (added, {"color": RED, "ms": 6})):
            shown = 1e3 * points[rows[points[rows, 2] == 0.0]]
            axes.plot(shown[:, 0], shown[:, 1], "o", **style)
        axes.set(title=f"first block,\n{name}", xlabel="x, mm", aspect="equal")
    plans[0].set_ylabel("y, mm")
    for name, style in zip(RULES, ("-", "--", "o-"), strict=True):
        steps = adapted(name).history
        label = f"{name}: {steps[-1].iteration} iterations"
        course.plot([s.n_centers for s in steps], [1e3 * s.max_residual for s in steps], style, ms=4, label=label)
    course.axhline(1e3 * TOLERANCE, color="black", lw=0.8, ls=":")
    course.set(yscale="log", xlabel="centres", ylabel="largest residual, mm")
    course.legend(fontsize="small")
    return figure


if __name__ == "__main__":
    draw().savefig("greedy_rules.png", dpi=100)

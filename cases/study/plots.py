"""Plots of the studies: figure 2 of the paper and its kin."""

from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.study.measure import DEFAULT, GMRES, GROWN, Measured
from sdm_deflect.cases.study.study import Result
from sdm_deflect.cases.study.trends import title

COLOURS = {"x": "#0072b2", "y": "#d55e00", "z": "#009e73", "xyz": "0.6"}
LOOP_COLOURS = {"grown": "#0072b2", "lapack": "#e69f00", "gmres": "#d55e00", "default": "#009e73"}
PAPER = {"color": "black", "marker": "s", "ls": "--", "lw": 1.2, "ms": 4}

Draw = Callable[[Result, Figure], str]


def table1(result: Result, figure: Figure) -> str:
    """Figure 2: residual against centres, and against time with the uni-variate adaptations one after the other."""
    loop = GMRES if result.by(GMRES) else GROWN
    fewest = min(one.row.setting.initial for one in result.measured)
    chosen = {
        one.row.setting.columns: one
        for one in result.measured
        if one.loop == loop and one.row.setting.initial == fewest
    }
    left, right = figure.subplots(1, 2, sharey=True)
    start = 0.0
    for columns in ("xyz", "x", "y", "z"):
        curve(left, chosen[columns])
        seconds = [start + step.seconds for step in chosen[columns].history]
        curve(right, chosen[columns], seconds)
        start = 0.0 if columns == "xyz" else seconds[-1]
    finish(left, result, "centres")
    finish(right, result, f"time of {loop.name}, s (SQUV: x, y and z in turn)")
    left.set_ylabel("largest residual, m")
    left.legend(fontsize="small")
    return "Largest residual against centres and against time for MV and for SQUV in x, y and z."


def table2(result: Result, figure: Figure) -> str:
    """Time and final centres against M_add."""
    left, right = figure.subplots(1, 2)
    theirs = result.study.table.rows
    n_add = [row.setting.n_add for row in theirs]
    left.plot(n_add, [row.seconds for row in theirs], label="paper", **PAPER)
    right.plot(n_add, [row.centers for row in theirs], label="paper", **PAPER)
    for loop in result.loops:
        looks: dict[str, Any] = {"color": LOOP_COLOURS[loop.name], "label": f"here, {loop.name}", "marker": "o"}
        left.plot(n_add, [row.seconds for row in result.by(loop)], ms=4, **looks)
        if loop in (GROWN, DEFAULT):
            right.plot(n_add, [row.centers for row in result.by(loop)], ms=4, **looks)
    left.set(yscale="log", ylabel="time, s")
    right.set(ylabel="final centres", ylim=(0, None))
    for axes in (left, right):
        axes.set_xlabel("centres added in an iteration, $M_{add}$")
        axes.grid(alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), fontsize="small", ncols=5, loc="outside upper center")
    return "Time and final number of centres against M_add, the paper's and ours."


def table3(result: Result, figure: Figure) -> str:
    """Residual against centres for each angle."""
    angles = sorted(result.sites, key=abs)
    for angle, axes in zip(angles, figure.subplots(1, len(angles), sharey=True), strict=True):
        for one in result.measured:
            if one.loop == GROWN and one.row.setting.angle == angle:
                curve(axes, one)
        finish(axes, result, f"centres ({angle:+g} deg)")
        axes.legend(fontsize="small")
    figure.axes[0].set_ylabel("largest residual, m")
    return "Largest residual against centres for f_x, f_y and f_z at each angle."


def table4(result: Result, figure: Figure) -> str:
    """Residual against centres, and where the paper ended."""
    axes = figure.add_subplot()
    for one in result.measured:
        if one.loop == GROWN:
            curve(axes, one)
    for row in result.study.table.rows:
        label = f"paper, ${title(row.setting.columns)}$"
        axes.plot(row.centers, row.max_error, "s", color=COLOURS[row.setting.columns], mec="black", label=label)
    finish(axes, result, "centres")
    axes.set_ylabel("largest residual, m")
    axes.legend(fontsize="small", ncols=2)
    return "Largest residual against centres for f_x, f_y and f_z; squares mark where the paper's adaptations ended."


DRAW: dict[str, Draw] = {"table1": table1, "table2": table2, "table3": table3, "table4": table4}


def curve(axes: Axes, one: Measured, seconds: list[float] | None = None) -> None:
    """Draw one adaptation's residuals against centres or times; MV as a wide line, so that f_z shows on top of it."""
    columns = one.row.setting.columns
    wide = {"lw": 6, "alpha": 0.6} if columns == "xyz" else {"lw": 1.8}
    residuals = [step.max_residual for step in one.history]
    marker = "o" if len(residuals) == 1 else ""
    name = f"${title(columns)}$" if len(columns) == 1 else title(columns)
    abscissa = seconds or [step.n_centers for step in one.history]
    axes.semilogy(abscissa, residuals, color=COLOURS[columns], label=name, marker=marker, **wide)


def finish(axes: Axes, result: Result, label: str) -> None:
    """Mark the tolerance and label the abscissa."""
    tolerance = result.study.table.tolerance
    axes.axhline(tolerance, color="0.3", lw=1, ls=":")
    looks: dict[str, Any] = {"ha": "right", "va": "top", "color": "0.3", "fontsize": "small"}
    axes.annotate(f"tolerance {tolerance:g} m", (0.98, tolerance), xycoords=("axes fraction", "data"), **looks)
    axes.set_xlabel(label)
    axes.grid(alpha=0.3)

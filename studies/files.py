"""A study as CSV and as a plot (figure 2 of the paper and its kin), ours beside the paper's."""

import csv
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.report.colours import XYZ
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.cases.run.output import write_table
from studies.measure import DEFAULT, GMRES, GROWN, REPETITIONS, Measured, Result
from studies.paper import Row, Setting, Size, paper
from studies.trends import title

SETTING = ("columns", "angle_deg", "initial_surface", "initial_hexahedron", "n_add")
RESULTS = ("iterations", "centers", "seconds", "max_error")
FIELDS = ("source", *SETTING, "sites", *RESULTS, "converged", "repetitions")
CURVE = ("columns", "angle_deg", "iteration", "centers", "max_residual", "seconds")
COLOURS = dict(zip("xyz", XYZ, strict=True)) | {"xyz": "0.6"}
LOOP_COLOURS = dict(zip(("grown", "gmres", "default"), XYZ, strict=True))
PAPER = {"color": "black", "marker": "s", "ls": "--", "lw": 1.2, "ms": 4}


def write_study(result: Result, folder: Path) -> None:
    """Write <name>.csv and <name>.png into `folder`."""
    write_csv(result, folder / f"{result.name}.csv")
    write_curves(result, folder / f"{result.name}-curves.csv")
    write_plot(result, folder / f"{result.name}.png")


def write_plot(result: Result, path: Path) -> str:
    """Write the picture of a study; return its text alternative."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    alternative = DRAW[result.name](result, figure)
    write_png(figure, path)
    return alternative


def write_csv(result: Result, path: Path) -> None:
    """Write one line for every row of the paper and for every row measured here."""
    rows: list[list[object]] = [list(FIELDS)]
    for row in result.table.rows:
        rows.append(["paper", *_setting(row.setting), "", *_results(row), "", ""])
    for one in result.measured:
        results = (*_results(one.row), one.converged, REPETITIONS)
        rows.append([one.loop.name, *_setting(one.row.setting), one.row.sites, *results])
    write_table(path, rows)


def write_curves(result: Result, path: Path) -> None:
    """Write the largest residual of each iteration of the adaptations that are drawn; no file where none is."""
    rows: list[list[object]] = [list(CURVE)]
    for one in drawn(result):
        columns, angle, *_ = _setting(one.row.setting)
        for step in one.history:
            figures = (f"{step.max_residual:.9g}", f"{step.seconds:.6g}")
            rows.append([columns, angle, step.iteration, step.n_centers, *figures])
    if len(rows) > 1:
        write_table(path, rows)


def read_curves(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Return the centres and residuals of each adaptation of one angle, by its directions."""
    found: dict[str, list[tuple[int, float]]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found.setdefault(row["columns"], []).append((int(row["centers"]), float(row["max_residual"])))
    return found


def drawn(result: Result) -> list[Measured]:
    """Return the adaptations whose curves are drawn: in figure 2 those by GMRES from the fewest initial centres."""
    if result.name == "table2":
        return []
    fewest = min(one.row.setting.initial for one in result.measured)
    loop = GMRES if result.by(GMRES) else GROWN
    return [one for one in result.measured if one.loop == loop and one.row.setting.initial == fewest]


def read_rows(path: Path, source: str) -> list[Row]:
    """Return the rows of a loop, by its name, as `write_csv` wrote them."""
    with path.open(newline="", encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if row["source"] == source]
    settings = [
        Setting(
            one["columns"], float(one["angle_deg"]),
            (int(one["initial_surface"]), int(one["initial_hexahedron"])), int(one["n_add"]),
        ) for one in found
    ]  # fmt: skip
    ended = [
        (int(one["iterations"]), int(one["centers"]), float(one["seconds"]), int(one["sites"]), float(one["max_error"]))
        for one in found
    ]
    return [Row(setting, *own) for setting, own in zip(settings, ended, strict=True)]


def sizes(result: Result) -> str:
    """Say on what the study was carried out, ours and theirs, and how far the sites move."""
    ground, theirs = result.ground, paper().size(result.table.case)
    moved = "; ".join(
        f"{', '.join(f'{most:.3g}' for most in one.values())} mm at {angle:+g}°"
        for angle, one in ground.largest_mm.items()
    )
    return (
        f"Here (scale `{ground.scale}`): {_size(ground.size)}. The paper: {_size(theirs)}. "
        f"Margins of the hexahedron are {ground.margins:g} times the case's; zero sites stand "
        f"{1e3 * ground.spacing:.2f} mm apart, {ground.spacing / ground.edge:.2f} median edges of the surface. "
        f"Largest prescribed displacement in x, y, z: {moved}."
    )


def _size(size: Size) -> str:
    zero = size.zero_sites
    text = str(zero[0]) if len(set(zero)) == 1 else "{} / {} / {} (x / y / z)".format(*zero)
    return f"{size.points:,} points, {size.cells:,} tetrahedra, {size.surface} sites on the surface and {text} at zero"


def _setting(setting: Setting) -> list[object]:
    return [setting.columns, f"{setting.angle:g}", *setting.initial, setting.n_add]


def _results(row: Row) -> list[object]:
    return [row.iterations, row.centers, f"{row.seconds:.6g}", f"{row.max_error:.6g}"]


def table1(result: Result, figure: Figure) -> str:
    """Figure 2: residual against centres, and against time with the uni-variate adaptations one after the other."""
    chosen = {one.row.setting.columns: one for one in drawn(result)}
    left, right = figure.subplots(1, 2, sharey=True)
    start = 0.0
    for columns in ("xyz", "x", "y", "z"):
        curve(left, chosen[columns])
        seconds = [start + step.seconds for step in chosen[columns].history]
        curve(right, chosen[columns], seconds)
        start = 0.0 if columns == "xyz" else seconds[-1]
    finish(left, result, "centres")
    finish(right, result, f"time of {chosen['z'].loop.name}, s (SQUV: x, y and z in turn)")
    left.set_ylabel("largest residual, m")
    left.legend(fontsize="small")
    return "Largest residual against centres and against time for MV and for SQUV in x, y and z."


def table2(result: Result, figure: Figure) -> str:
    """Time and final centres against M_add."""
    left, right = figure.subplots(1, 2)
    theirs = result.table.rows
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
    angles = sorted(result.ground.largest_mm, key=abs)
    for angle, axes in zip(angles, figure.subplots(1, len(angles), sharey=True), strict=True):
        for one in drawn(result):
            if one.row.setting.angle == angle:
                curve(axes, one)
        finish(axes, result, f"centres ({angle:+g} deg)")
        axes.legend(fontsize="small")
    figure.axes[0].set_ylabel("largest residual, m")
    return "Largest residual against centres for f_x, f_y and f_z at each angle."


def table4(result: Result, figure: Figure) -> str:
    """Residual against centres, and where the paper ended."""
    axes = figure.add_subplot()
    for one in drawn(result):
        curve(axes, one)
    for row in result.table.rows:
        label = f"paper, ${title(row.setting.columns)}$"
        axes.plot(row.centers, row.max_error, "s", color=COLOURS[row.setting.columns], mec="black", label=label)
    finish(axes, result, "centres")
    axes.set_ylabel("largest residual, m")
    axes.legend(fontsize="small", ncols=2)
    return "Largest residual against centres for f_x, f_y and f_z; squares mark where the paper's adaptations ended."


DRAW = {"table1": table1, "table2": table2, "table3": table3, "table4": table4}


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
    tolerance = result.table.tolerance
    axes.axhline(tolerance, color="0.3", lw=1, ls=":")
    looks: dict[str, Any] = {"ha": "right", "va": "top", "color": "0.3", "fontsize": "small"}
    axes.annotate(f"tolerance {tolerance:g} m", (0.98, tolerance), xycoords=("axes fraction", "data"), **looks)
    axes.set_xlabel(label)
    axes.grid(alpha=0.3)

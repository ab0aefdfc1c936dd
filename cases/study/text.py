"""A study as CSV and as a table in Markdown, ours beside the paper's."""

import csv
from collections.abc import Iterator
from math import isnan
from pathlib import Path

from matplotlib.figure import Figure

from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.cases.study.measure import DEFAULT, GROWN, REPETITIONS
from sdm_deflect.cases.study.paper import Row, Setting, Size, paper
from sdm_deflect.cases.study.plots import DRAW
from sdm_deflect.cases.study.study import Result
from sdm_deflect.cases.study.trends import listed, title

SETTING = ("columns", "angle_deg", "initial_surface", "initial_hexahedron", "n_add")
RESULTS = ("iterations", "centers", "seconds", "max_error")
FIELDS = ("source", *SETTING, "sites", *RESULTS, "converged", "repetitions")


def write_study(result: Result, folder: Path) -> None:
    """Write <name>.csv, <name>.md and <name>.png into `folder`."""
    name = result.study.name
    write_csv(result, folder / f"{name}.csv")
    alternative = write_plot(result, folder / f"{name}.png")
    (folder / f"{name}.md").write_text(f"{markdown(result)}\n![{alternative}]({name}.png)\n", encoding="utf-8")


def write_plot(result: Result, path: Path) -> str:
    """Write the picture of a study; return its text alternative."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    alternative = DRAW[result.study.name](result, figure)
    write_png(figure, path)
    return alternative


def write_csv(result: Result, path: Path) -> None:
    """Write one line for every row of the paper and for every row measured here."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(FIELDS)
        for row in result.study.table.rows:
            out.writerow(["paper", *_setting(row.setting), "", *_results(row), "", ""])
        for one in result.measured:
            counted = (one.converged, one.repetitions)
            out.writerow([one.loop.name, *_setting(one.row.setting), one.sites, *_results(one.row), *counted])


def markdown(result: Result) -> str:
    """Return heading, sizes, table, loops and trends."""
    table = result.study.table
    loops = [f"- `{loop.name}`: {loop.meaning}." for loop in result.loops]
    parts = [
        f"## Table {result.study.name[-1]}: {table.title}",
        sizes(result),
        "\n".join(rows(result)),
        f"Seconds by loop (wall time, median of up to {REPETITIONS} runs):\n\n" + "\n".join(loops),
        convergence(result),
        "\n".join(verdicts(result)),
    ]
    return "\n\n".join(parts) + "\n"


def sizes(result: Result) -> str:
    """Say on what the study was carried out, ours and theirs, and how far the sites move."""
    theirs, sites = paper().size(result.study.table.case), next(iter(result.sites.values()))
    x, y, z = (sites.plan.sites.zero_sites(c) for c in range(3))
    ours = Size(theirs.case, result.points, result.cells, sites.surface, (x, y, z))
    moved = "; ".join(f"{listed(map(one.largest_mm, 'xyz'))} mm at {angle:+g}°" for angle, one in result.sites.items())
    return (
        f"Here (scale `{result.case.scale}`): {_size(ours)}. The paper: {_size(theirs)}. "
        f"Largest prescribed displacement in x, y, z: {moved}."
    )


def rows(result: Result) -> list[str]:
    """Return the lines of the Markdown table."""
    loops = [loop for loop in result.loops if loop != DEFAULT]
    heads = ["", "initial", "M_add", "t_end paper", "here", "N_c,end paper", "here", "max error, m", "s paper"]
    heads += [f"s `{loop.name}`" for loop in loops] + [f"`{DEFAULT.name}`: t_end, N_c,end, s"]
    lines = [_line(heads), _line(["---", "---", *["---:"] * (len(heads) - 2)])]
    ours = {(one.row.setting, one.loop): one.row for one in result.measured}
    for theirs in result.study.table.rows:
        setting = theirs.setting
        times = [_seconds(ours.get((setting, loop))) for loop in loops]
        row, own = ours[setting, loops[0]], ours[setting, DEFAULT]
        what = f"{title(setting.columns)} at {setting.angle:+g}°"
        counts = map(str, (setting.n_add, theirs.iterations, row.iterations, theirs.centers, row.centers))
        times += [f"{own.iterations}, {own.centers}, {_seconds(own)}"]
        initial = "{} + {}".format(*setting.initial)
        lines.append(_line([what, initial, *counts, _errors(theirs, row), _seconds(theirs), *times]))
    return lines


def convergence(result: Result) -> str:
    """Say how many adaptations reached the tolerance, how the centres compare, and which had nothing to do."""
    reached, table = sum(one.converged for one in result.measured), result.study.table
    ratios = [ours.centers / theirs.centers for ours, theirs in zip(result.by(GROWN), table.rows, strict=True)]
    sentences = [
        f"{reached} of {len(result.measured)} adaptations here reached the tolerance of {table.tolerance:g} m.",
        f"The paper's rule ends here with {min(ratios):.2f} to {max(ratios):.2f} times as many centres as there.",
    ]
    return " ".join([*sentences, *small_motions(result)])


def small_motions(result: Result) -> Iterator[str]:
    """Say which directions move by less than the tolerance, and what they then cost."""
    for angle, sites in result.sites.items():
        for d in "xyz":
            rows = [row for row in result.by(GROWN) if row.setting.columns == d and row.setting.angle == angle]
            if rows and sites.largest_mm(d) < 1e3 * result.study.table.tolerance:
                most = max(row.iterations for row in rows)
                yield (
                    f"At {angle:+g}° f_{d} is nowhere larger than {sites.largest_mm(d):.3g} mm, less than the "
                    f"tolerance; it takes {most} iterations."
                )


def verdicts(result: Result) -> list[str]:
    """Return one list item for each trend of the paper: whether it holds here, and the numbers."""
    lines = []
    for trend in result.study.trends:
        found = result.findings(trend)
        named = "`{}` " if trend.of_time else ""
        judged = [f"{named.format(loop.name)}**{one.verdict}** ({one.evidence})" for loop, one in found.items()]
        lines.append(f"- {trend.statement} Here: {'; '.join(judged) or 'these rows cannot tell'}.")
    return lines


def _size(size: Size) -> str:
    zero = size.zero_sites
    text = str(zero[0]) if len(set(zero)) == 1 else "{} / {} / {} (x / y / z)".format(*zero)
    return f"{size.points:,} points, {size.cells:,} tetrahedra, {size.surface} sites on the surface and {text} at zero"


def _setting(setting: Setting) -> list[object]:
    return [setting.columns, f"{setting.angle:g}", *setting.initial, setting.n_add]


def _results(row: Row) -> list[object]:
    return [row.iterations, row.centers, f"{row.seconds:.6g}", f"{row.max_error:.6g}"]


def _errors(theirs: Row, ours: Row) -> str:
    """Return the largest error, with the paper's before it where there is one."""
    text = f"{ours.max_error:.2e}"
    return text if isnan(theirs.max_error) else f"paper {theirs.max_error:.2e}, here {text}"


def _seconds(row: Row | None) -> str:
    return "" if row is None else f"{row.seconds:.3g}"


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"

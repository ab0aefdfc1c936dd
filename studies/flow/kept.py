"""Tables and sentences of docs/flow.md, from the results that are kept in `studies/flow/results`.

`python -m docs.fly.facts` writes them, `python -m studies.flow.kept docs/figures` draws the picture.
"""

import csv
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.cases.report.colours import CELLS, MOVES, STAYS, WORSE
from sdm_deflect.cases.report.pictures import write_png
from studies.flow.results import ALLOWED, CONFIDENCE
from studies.flow.trend import SMALL

RESULTS = Path(__file__).with_name("results")
# A row of a page's table, by the heads of its columns.
Row = dict[str, str]
# Coefficients that decide, in the order of the tables.
NAMES = ("CL", "Cm", "Cl", "Ch")
OVER_ANGLE = "aileron-angles"
# Normal deviate that 95 % of all lie within.
DEVIATE = 1.96
# Per cent that the picture reaches to; the largest difference is 20.
LARGEST = 24.0


def tables(name: str) -> list[list[Row]]:
    """Return the tables of a page of `python -m studies flow`, each as its rows."""
    text = (RESULTS / f"flow-{name}.md").read_text(encoding="utf-8")
    found = []
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        heads, _, *lines = ([cell.strip() for cell in line.strip()[1:-1].split("|")] for line in block.splitlines())
        found.append([dict(zip(heads, cells, strict=True)) for cells in lines])
    return found


def at(name: str, angle: str) -> list[Row]:
    """Return the rows of a page at one angle, such as "+12"."""
    return [row for row in tables(name)[0] if row["deg"] == angle]


def share(row: Row, kind: str) -> str:
    """Return the difference of a kind of mesh from new ones, by the increment of the new ones."""
    return f"{100.0 * (float(row[kind]) / float(row['new meshes']) - 1.0):+.1f} %"


def agreeing(rows: Sequence[Row]) -> str:
    """Return how many increments agree with those of new meshes."""
    return f"{sum(row['agrees'] == 'yes' for row in rows)} of {len(rows)}"


def differences() -> str:
    """Return the table of all differences, a row for each deflected mesh."""
    (first, means), (tail, far) = tables("aileron"), (at("tail", angle) for angle in ("+12", "+20"))
    hold = all(row["holds 0"] == "yes" for row in means)
    rows = [
        _differing("aileron at -12°", "deflected", 3, first, agreeing(first)),
        _differing("the same", "4 deflected ones, their mean", 3, means, "4 of 4" if hold else "not all"),
    ]
    for angle in ("-20", "-12", "-6", "+6", "+12", "+20"):
        own = at(OVER_ANGLE, angle)
        words, count = f"aileron at {angle}°, over the angle", 3 if angle == "-12" else 1
        rows.append(_differing(words, "deflected", count, own, agreeing(own)))
    for angle, count, own in (("+12", 3, tail), ("+20", 1, far)):
        plain = [{"difference": share(row, "deflected")} for row in own]
        rows.append(_differing(f"tail at {angle}°", "deflected", count, plain, ""))
        rows.append(_differing("the same", "repaired", count, own, agreeing(own)))
    rows.append(_differing("free aileron at -12°", "deflected", 1, tables("aileron-free")[0], ""))
    return _table(("", "mesh", "new meshes", *NAMES, "agree"), rows, words=2)


def _differing(words: str, mesh: str, count: int, rows: Sequence[Row], agree: str) -> tuple[str, ...]:
    # a number and its unit stay on one line
    return words, mesh, str(count), *(row["difference"].replace(" ", "\N{NO-BREAK SPACE}") for row in rows), agree


def disagreement() -> str:
    """Say how many increments over the angle disagree, and the largest differences."""
    rows = tables(OVER_ANGLE)[0]
    off = [row for row in rows if row["agrees"] == "no"]
    largest = sorted(off, key=lambda row: -abs(float(row["difference"].split()[0])))[:4]
    words = ", ".join(f"{row['']} {row['difference']} at {row['deg']}°" for row in largest)
    return f"**Over the angle {len(off)} of {len(rows)} increments of the aileron do not agree**, most of all {words}."


def slopes() -> str:
    """Return the table of control derivatives: on deflected meshes, on new ones, and of the vortex lattice."""
    with (RESULTS / "lattice.csv").open(newline="", encoding="utf-8") as file:
        lattice = {row["coefficient"]: float(row["per_degree"]) for row in csv.DictReader(file)}
    kinds = {"deflected mesh, -6 and +6 degrees": "deflected", "new meshes, -6 and +6 degrees": "new meshes"}
    rates = {words: [_slope(name, kind) for name in NAMES] for words, kind in kinds.items()}
    rows = [(words, *(f"{rate:+.5f}" for rate in own)) for words, own in rates.items()]
    rows.append(("vortex lattice, 63 panels along the chord", *(f"{lattice[name]:+.5f}" for name in NAMES)))
    deflected, new = rates.values()
    rows.append(("deflected by new", *(f"{a / b:.2f}" for a, b in zip(deflected, new, strict=True))))
    for words, own in rates.items():
        ratios = (f"{rate / lattice[name]:.2f}" for name, rate in zip(NAMES, own, strict=True))
        rows.append((f"{words.split(',')[0]} by lattice", *ratios))
    return _table(("per degree", *NAMES), rows, words=1)


def needed() -> str:
    """Say how many meshes of each kind would show a bias of 2 % of the hinge moment."""
    row = next(one for one in tables("aileron")[1] if one[""] == "Ch")
    mean, deviation = map(float, row["increment, new meshes"].split(","))
    spread = 100.0 * deviation / abs(mean)
    count = round(2.0 * (DEVIATE * spread / 2.0) ** 2)
    return (
        f"Hinge moments of new meshes at -12° have a standard deviation of {spread:.1f} %. A bias of 2 % shows, at a "
        f"confidence of {100 * CONFIDENCE:.0f} %, from some {count} meshes of each kind on, or from cells so small "
        "that their scatter is less."
    )


def _slope(name: str, kind: str) -> float:
    """Return the slope (per degree) through zero of the increments at small angles."""
    rows = [row for row in tables(OVER_ANGLE)[0] if row[""] == name and abs(float(row["deg"])) <= SMALL]
    angle, value = (np.array([float(row[key]) for row in rows]) for key in ("deg", kind))
    return float(angle @ value / (angle @ angle))


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> str:
    marks = ["---"] * words + ["---:"] * (len(heads) - words)
    return "\n".join(f"| {' | '.join(line)} |" for line in (heads, marks, *rows))


def differences_over_angle() -> Figure:
    """Draw the differences of the aileron's increments over the angle, on the bands within which they agree."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.subplots(1, len(NAMES), sharey=True)
    for panel, name in zip(axes, NAMES, strict=True):
        _draw(panel, name)
    axes[0].set_ylabel("deflection, deg")
    figure.supxlabel("increment on the deflected mesh less that on a new mesh, by the latter, %", fontsize="medium")
    return figure


def _draw(axes: Axes, name: str) -> None:
    rows = sorted((row for row in tables(OVER_ANGLE)[0] if row[""] == name), key=lambda row: float(row["deg"]))
    place = np.arange(len(rows))
    expected, scatter = (
        np.array([abs(float(row[key].strip("()"))) for row in rows]) for key in ("new meshes", "scatter")
    )
    band = 100.0 * np.maximum(scatter / expected, ALLOWED)
    apart = np.array([row["agrees"] == "no" for row in rows])
    share = np.array([float(row["difference"].split()[0]) for row in rows])
    axes.barh(place, 2.0 * band, left=-band, height=0.6, color=CELLS)
    axes.axvline(0.0, color=STAYS, lw=1.0)
    for own, colour in ((~apart, MOVES), (apart, WORSE)):
        axes.plot(share[own], place[own], "o", color=colour)
    axes.set(title=name, xlim=(-LARGEST, LARGEST), yticks=place, yticklabels=[row["deg"] for row in rows])


# Blocks of docs/flow.md, by name.
BLOCKS = {one.__name__: one for one in (differences, disagreement, slopes, needed)}


if __name__ == "__main__":
    write_png(differences_over_angle(), Path(sys.argv[1]) / "flow.png")

"""What the page says about a run and a frame, in sentences, numbers and a histogram."""

from collections.abc import Iterator
from math import floor, log10
from operator import add
from typing import Any

import numpy as np

from sdm_deflect.cases.report.data import METRES, round_length, shape_of
from sdm_deflect.cases.report.scene3d import CHANGE_RANGE, QUALITY_RANGE, change_rgb, moved_rgb, quality_rgb
from sdm_deflect.cases.view.pieces import ViewPieces, bounds
from sdm_deflect.cases.view.run import DeflectedMesh, InteractiveRun, Spans
from sdm_deflect.deform.base.arrays import FloatArray, IntArray

POSITIONS = 500
"""A section has about so many positions along the largest extent of the hexahedra."""
BINS = np.linspace(0.0, 1.0, 41)
WIDTH, HEIGHT, LEFT, BASE = 340.0, 126.0, 38.0, 96.0
"""Size of the drawing, and where its axes cross."""
TOP, RIGHT = 6.0, 12.0
COLOURS = {"quality": "quality", "change": "change of quality", "displacement": "displacement"}
"""What colours may stand for, with the words of the buttons."""
COUNTS = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


def verdict(frame: DeflectedMesh, run: InteractiveRun) -> tuple[str, str]:
    """Return whether the mesh at this angle is verified, as a kind of message and a sentence."""
    residual, tolerance, count = _small(frame.residual, run), _small(frame.tolerance, run, "g"), len(frame.inverted)
    if frame.further:
        cells = "1 inverted cell" if count == 1 else f"{count} inverted cells"
        cells += f" ({frame.further} of them not before)" if frame.further < count else ""
        remedy = "" if run.repairs else " Run it at this angle with repair, or turn it less."
        return "error", f"\N{MULTIPLICATION X} Not verified: {cells}, drawn red; residual {residual}.{remedy}"
    if frame.residual >= frame.tolerance:
        return (
            "warning",
            f"! Not verified: residual {residual}, above the run's tolerance of {tolerance}. Run it at this angle.",
        )
    known = f"{count} inverted cells as before" if count else "no inverted cell"
    return "success", f"\N{CHECK MARK} Verified: residual {residual}, below {tolerance}; {known}."


def mending(frame: DeflectedMesh, run: InteractiveRun, before: float) -> str:
    """Return what the repair has done to a frame, given the least quality of the interpolant's mesh."""
    if not run.repairs:
        return "Repair: off in this run; the mesh is the interpolant's."
    if frame.repaired is None:
        return "Repair: once the slider rests; the mesh is the interpolant's."
    if not frame.repaired:
        return "Repair: none was needed."
    nodes = "1 node" if frame.repaired == 1 else f"{frame.repaired:,} nodes"
    now = float(frame.quality.min())
    return f"Repaired: {nodes} moved, least quality {before:.3f} \N{RIGHTWARDS ARROW} {now:.3f}."


def facts(frame: DeflectedMesh, run: InteractiveRun, pieces: ViewPieces) -> list[dict[str, str]]:
    """Return the numbers of a frame as rows of a table; each has an id, a name and a value.

    One node of each surface tells how far it has moved.
    """
    rows = [
        ("shown", "shown at", f"{frame.angle:+g}{run.unit}"),
        ("residual", "residual at all data sites", _small(frame.residual, run, ".2f")),
        *_smallest(frame, run),
    ]
    if len(frame.quality):
        rows.append(("worst", "  in the cell at", _place(pieces.worst(frame), run)))
    rows.append(("inverted", "inverted cells", str(len(frame.inverted))))
    for one in run.surfaces:
        point, alone, name = frame.points[one.node], len(run.surfaces) == 1, one.name.replace("_", " ")
        moved = run.display.length.factor * float(np.linalg.norm(point - run.mesh.points[one.node]))
        if alone:
            rows.append((f"place-{one.name}", one.place, _place(point, run)))
        text = "  moved by" if alone else f"{name} moved by"
        rows.append((f"moved-{one.name}", text, f"{moved:.{_decimals(run) + 2}f}{_unit(run)}"))
    return [{"id": key, "name": name, "value": value} for key, name, value in rows]


def about(run: InteractiveRun) -> dict[str, Any]:
    """Return what the page says once about the run."""
    centres = sum(len(one.basis.chosen) for box in run.boxes for step in box.steps for one in step.all)
    steps, mesh = sum(len(box.steps) for box in run.boxes), run.mesh
    shapes = {shape_of(block) for block in mesh.cells}
    cells = "tetrahedra" if shapes == {"tetra"} else "cells"
    return {
        "run_title": run.display.title,
        "run_facts": f"{len(mesh.points):,} points, {sum(map(len, mesh.cells)):,} {cells}, of which "
        f"{run.touched.count:,} touch a box. {centres:,} centres of the run at {run.angle:+g}{run.unit}"
        + (f", {steps} steps" if steps > len(run.boxes) else "")
        + ". "
        + _several(run)
        + ("" if _unit(run) else f"Lengths are in {run.display.length.shown}."),
        "measure": run.measure,
        "unit": run.unit.strip(),
        "length_factor": run.display.length.factor,
        "length_unit": _unit(run),
        "decimals": _decimals(run),
    }


def _several(run: InteractiveRun) -> str:
    """Return the surfaces and by what factor of the angle each turns; nothing for a single one."""
    names = [mover.name.replace("_", " ") for mover in run.surfaces]
    factors = ["" if mover.factor == 1.0 else f" × {mover.factor:g}" for mover in run.surfaces]
    return f"Surfaces: {', '.join(map(add, names, factors))}." if len(names) > 1 else ""


def key(colour: str, run: InteractiveRun, farthest: float) -> dict[str, Any]:
    """Return the key to colours: what they stand for, the bar, and what is at its ends and in its middle."""
    shares = np.linspace(0.0, 1.0, 9)
    if colour == "displacement":
        rgb, ends = (
            moved_rgb(shares),
            [f"{run.display.length.factor * farthest * share:.3g}" for share in (0.0, 0.5, 1.0)],
        )
        title = f"displacement{',' if _unit(run) else ''}{_unit(run)}"
    elif colour == "change":
        values = np.asarray(CHANGE_RANGE.inverse(shares))
        rgb, ends = change_rgb(values), [f"{values[i]:+g}" if i != 4 else "0" for i in (0, 4, 8)]
        title = "change of quality of the cells cut"
    else:
        values = np.asarray(QUALITY_RANGE.inverse(shares))
        rgb, ends = quality_rgb(values), [f"{values[i]:g}" for i in (0, 4, 8)]
        ends[0] = f"≤ {ends[0]}"
        title = f"{run.measure} of the cells cut"
    bar = ",".join(f"rgb({r},{g},{b})" for r, g, b in rgb)
    return {"key_title": title, "key_bar": f"width:220px;height:12px;background:linear-gradient(90deg,{bar})",
            "key_ends": ends}  # fmt: skip


def parsed(text: str, spans: Spans, unit: str = "\N{DEGREE SIGN}") -> float:
    """Return the angle that a user typed.

    Raises ValueError: one sentence: what is wrong with it and what would be right.
    """
    span = spans.possible
    try:
        angle = float(text.strip().replace("\N{MINUS SIGN}", "-").removesuffix(unit).replace(",", "."))
    except ValueError:
        raise ValueError(f"{text.strip()!r} is not a number" + (" of degrees" if unit[0] != " " else "")) from None
    if angle not in span:
        reason = span.below if angle < span.low else span.above if angle > span.high else ""
        end = f": {reason}" if reason else ""
        raise ValueError(f"{angle:g}{unit} is outside {span.low:g}{unit} to {span.high:g}{unit}{end}")
    return angle


def grain(run: InteractiveRun) -> float:
    """Return the step between positions of the section: 1, 2 or 5 times a power of ten."""
    low, high = bounds(run)
    return round_length(float((high - low).max()) / POSITIONS)


def rounded(position: float, run: InteractiveRun) -> float:
    """Return a position of the section without digits that mean nothing."""
    step = grain(run) / 5.0
    return float(f"{round(position / step) * step:.12g}")


def _decimals(run: InteractiveRun) -> int:
    return max(0, -floor(log10(run.display.length.factor * grain(run))))


def _small(length: float, run: InteractiveRun, form: str = ".1f") -> str:
    """Return a length about as large as a residual."""
    if run.display.length is METRES:
        return f"{1e6 * length:{form}} µm"
    return f"{length:.2e}"


def _place(point: FloatArray, run: InteractiveRun) -> str:
    digits = _decimals(run) + 1
    return "(" + ", ".join(f"{run.display.length.factor * c:.{digits}f}" for c in point) + ")" + _unit(run)


def _unit(run: InteractiveRun) -> str:
    """Return what follows a length; mesh units are named once, at the top."""
    return f" {run.display.length.shown}" if run.display.length is METRES else ""


def _smallest(frame: DeflectedMesh, run: InteractiveRun) -> Iterator[tuple[str, str, str]]:
    """Yield the smallest quality of each type of cell."""
    shapes = [shape_of(block) for block in run.mesh.cells]
    label = np.repeat(np.arange(len(shapes)), [len(rows) for rows in run.touched.rows])
    for shape in dict.fromkeys(shapes):
        own = np.isin(label, [i for i, name in enumerate(shapes) if name == shape])
        if own.any():
            key = "smallest" if len(set(shapes)) == 1 else f"smallest-{shape}"
            name = "smallest mean ratio" if set(shapes) == {"tetra"} else f"smallest of {shape} cells"
            yield key, name, f"{frame.quality[own].min():.3f}"


def histogram(quality: FloatArray, before: FloatArray, measure: str) -> str:
    """Draw qualities (L,) as bars in the colours of the section, and those before as a line."""
    now, then = (np.histogram(np.clip(one, 0.0, 1.0), BINS)[0] for one in (quality, before))
    top = max(10.0, float(then.max()) * 1.6)
    parts = [*_axes(top, measure), *_bars(now, top), _line(then, top)]
    text = f"Histogram of the {measure} of {len(quality)} cells, smallest {quality.min(initial=1.0):.3f}"
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{text}" '
        'style="width:100%;font:10px sans-serif;fill:var(--ink)">' + "".join(parts) + "</svg>"
    )


def _x(value: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * value


def _y(count: float, top: float) -> float:
    """Return the height of a count: logarithmic above one."""
    share = np.log10(1.0 + count) / np.log10(1.0 + top)
    return float(BASE - (BASE - TOP) * min(share, 1.0))


def _axes(top: float, measure: str) -> Iterator[str]:
    for count in (0, *(c for c in COUNTS if c <= top)):
        y = _y(count, top)
        yield f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" style="stroke:var(--line)"/>'
        yield f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{count:,}</text>'
    for tick in np.linspace(0.0, 1.0, 6):
        yield f'<text x="{_x(tick):.1f}" y="{BASE + 13}" text-anchor="middle">{tick:.1f}</text>'
    label = "quality" if ";" in measure else f"{measure} (1: regular, 0: flat)"
    yield f'<text x="{_x(0.5):.1f}" y="{HEIGHT - 4}" text-anchor="middle">{label}</text>'


def _bars(counts: IntArray, top: float) -> Iterator[str]:
    width = _x(BINS[1]) - _x(0.0)
    colours = quality_rgb(0.5 * (BINS[1:] + BINS[:-1]))
    for low, count, (r, g, b) in zip(BINS, counts, colours, strict=False):
        y = _y(count, top)
        yield (
            f'<rect x="{_x(low):.1f}" y="{y:.1f}" width="{width:.2f}" height="{BASE - y:.1f}" '
            f'fill="rgb({r},{g},{b})" style="stroke:var(--rim)" stroke-width=".4"/>'
        )


def _line(counts: IntArray, top: float) -> str:
    corners = [f"{_x(BINS[0]):.1f},{BASE:.1f}"]
    for low, high, count in zip(BINS, BINS[1:], counts, strict=False):
        y = _y(count, top)
        corners += [f"{_x(low):.1f},{y:.1f}", f"{_x(high):.1f},{y:.1f}"]
    return f'<polyline points="{" ".join(corners)}" fill="none" style="stroke:var(--ink)" stroke-width="1.1"/>'

"""The method in one figure: `python -m docs.fly.figure FOLDER` writes method.svg and method_narrow.svg.

Four panels on the fighter's left tail at 20 degrees: what is known, a field without and with sites on the box, few and
all centres, and the deflected tail whose root slides on the fuselage.
"""

import argparse
import re
from base64 import b64decode, b64encode
from collections.abc import Iterable
from io import BytesIO
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Line
from PIL import Image

from docs.fly.tail import SECTION, SURFACE, Tail, cut, outline
from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.cases.report.colours import BOX, CELLS, DARKEST, INK, LOSS, LOST, MOVES, STAYS, WORSE
from sdm_deflect.deform.rbf.interpolant import Interpolant

# Distance of lattice lines, and margin of the view beyond the box, in metres.
STEP, BESIDE = 0.0085, 0.011
# Loss of quality at which a cell has the darkest colour, and number of shades up to it.
DARK, SHADES = 0.35, 6
# Sites and centres at most this far (m) from the section are drawn.
NEAR = 0.012
# Least error (m) that is drawn, and the shape of its spot: an octagon around 0.
LEAST = 5e-4
SPOT = np.array([(np.cos(k * np.pi / 4.0), np.sin(k * np.pi / 4.0)) for k in range(9)])
# Numbers of centres of the two steps before all.
FEW, MORE = 10, 50
# A point of the section: x and z in metres.
Place = tuple[float, float]
# Angles (degrees) from which the tail is seen: around z, and above the horizon.
AROUND, ABOVE = -58.0, 26.0
# The last panel shows faces behind this x (m), and with less than this y: the left half and the fin.
AFT, BESIDE_AXIS = 0.70, 0.04
# Colour of the panel that follows the tail: a light MOVES.
SLIDES = "#8bb8e6"
# Pixels an inch of the pictures in the SVG, and their colours.
INSIDE, COLOURS = 74, 48


def drawn(narrow: bool = False) -> Figure:
    """Draw the figure; `narrow` for a phone, with two panels in a row and the tail below."""
    tail = Tail.at()
    with rc_context({"font.family": "DejaVu Sans", "font.size": 9.0, "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.0, 11.6) if narrow else (12.6, 5.0))
        edges = {"left": 0.004, "right": 0.996, "bottom": 0.008, "wspace": 0.03}
        if narrow:
            grid = figure.add_gridspec(4, 2, top=0.98, hspace=0.1, height_ratios=[1, 1, 1, 2.2], **edges)
        else:
            grid = figure.add_gridspec(2, 4, top=0.95, hspace=0.12, width_ratios=[1, 1, 1, 1.3], **edges)
        places = [grid[k // (2 if narrow else 3), k % (2 if narrow else 3)] for k in range(6)]
        first, free, held, *centres = map(figure.add_subplot, places)
        draw_task(first, tail)
        draw_field(free, tail, tail.without_box(), held=False)
        draw_field(held, tail, tail.with_all(), held=True)
        for axes, count, name in zip(centres, (FEW, MORE, len(tail.sites.points)), ("3a", "3b", "3c"), strict=True):
            draw_centres(axes, tail, count, name)
        draw_tail(figure.add_subplot(grid[3, :] if narrow else grid[:, 3]), tail)
    return figure


def limits(tail: Tail) -> tuple[FloatArray, FloatArray]:
    """Return the low and the high corner (2,) of the box in the section."""
    corners = tail.plan.region.hexahedron.corners[:, [0, 2]]
    return corners.min(axis=0), corners.max(axis=0)


def frame(axes: Axes, tail: Tail, title: str, held: bool) -> None:
    """Draw the box, its sites if they hold, and the title."""
    low, high = limits(tail)
    axes.plot(*np.array([low, [high[0], low[1]], high, [low[0], high[1]], low]).T, color=BOX, lw=1.3, ls="--")
    if held:
        zero = tail.sites.points[tail.in_mesh :]
        near = zero[np.abs(zero[:, 1] - SECTION) < 0.75 * NEAR]
        axes.plot(near[:, 0], near[:, 2], "o", color=BOX, ms=3.2)
    low, high = low - BESIDE, high + BESIDE
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_title(title, loc="left", fontsize=9.5, color=INK)
    axes.axis("off")


def draw_lines(axes: Axes, segments: list[FloatArray], colour: str, width: float) -> None:
    """Draw polylines (K, 2) as one path."""
    path = Line.make_compound_path(*(Line(segment) for segment in segments))
    axes.add_patch(PathPatch(path, fill=False, edgecolor=colour, linewidth=width))


def draw_skin(axes: Axes, tail: Tail, points: FloatArray, colour: str) -> None:
    """Draw the tail's skin in the section."""
    draw_lines(axes, outline(tail, points), colour, 1.6)


def draw_mesh(axes: Axes, tail: Tail, points: FloatArray) -> None:
    """Draw the cells in the section: coloured only where they lost more than `LOST`, darkest where inside out."""
    low, high = limits(tail)
    centre = tail.mesh.points[tail.tets][:, :, [0, 2]]
    seen = ((centre > low - BESIDE) & (centre < high + BESIDE)).any(axis=1).all(axis=1)
    section = cut(tail, points, np.flatnonzero(seen))
    before, _ = tail.quality(tail.mesh.points, section.rows)
    now, inverted = tail.quality(points, section.rows)
    loss = np.where(inverted, 1.0, before - now)
    edges = {
        tuple(sorted((tuple(a.round(5)), tuple(b.round(5)))))
        for polygon in section.polygons
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    }
    shade = np.where(inverted, SHADES, np.floor((loss - LOST) / (DARK - LOST) * SHADES).clip(-1, SHADES - 1))
    for level in range(SHADES + 1):
        rows = np.flatnonzero((shade == level) & (loss > LOST))
        if len(rows):
            rings = (np.vstack([polygon, polygon[:1]]) for polygon in (section.polygons[row] for row in rows))
            path = Line.make_compound_path(*(Line(ring, closed=True) for ring in rings))
            colour = DARKEST if level == SHADES else LOSS((level + 0.5) / SHADES)
            axes.add_patch(PathPatch(path, facecolor=colour, edgecolor="none"))
    draw_lines(axes, chained(edges), CELLS, 0.35)


def chained(edges: Iterable[tuple[Place, Place]]) -> list[FloatArray]:
    """Join edges, each a pair of places, to few polylines (K, 2), so that the SVG is small."""
    beside: dict[Place, set[Place]] = {}
    for a, b in edges:
        if a != b:
            beside.setdefault(a, set()).add(b)
            beside.setdefault(b, set()).add(a)
    lines = []
    for start in sorted(beside):
        while beside[start]:
            line = [start]
            while beside[line[-1]]:
                following = min(beside[line[-1]])
                beside[line[-1]].remove(following)
                beside[following].remove(line[-1])
                line.append(following)
            lines.append(np.array(line))
    return lines


def draw_task(axes: Axes, tail: Tail) -> None:
    """Draw what is known: where the tail goes, and that only nodes in the box move."""
    points = tail.mesh.points
    draw_mesh(axes, tail, points)
    draw_skin(axes, tail, points, INK)
    draw_skin(axes, tail, points + tail.displacement, MOVES)
    frame(axes, tail, "1  Known: where the tail goes", held=False)
    low, high = limits(tail)
    axes.text(low[0] + 0.004, high[1] - 0.012, "box", color=BOX, weight="bold")
    for where, colour, text, beside in (
        (points, INK, "from here", (0.004, 0.026)), (points + tail.displacement, MOVES, "to here", (0.004, -0.028)),
    ):  # fmt: skip
        edge = max(np.concatenate(outline(tail, where)), key=lambda place: place[0])
        line = {"arrowstyle": "-", "color": colour}
        axes.annotate(text, edge, edge + beside, color=colour, fontsize=8.5, ha="center", arrowprops=line)


def draw_field(axes: Axes, tail: Tail, found: Interpolant, held: bool) -> None:
    """Draw how a field moves a lattice, and by how much it jumps at the box; lines are cut where it does."""
    low, high = limits(tail)
    x, z = (np.arange(low[k] - BESIDE, high[k] + BESIDE + 1e-9, STEP) for k in range(2))
    flat = np.stack(np.meshgrid(x, z), axis=-1)
    inside = ((flat > low) & (flat < high)).all(axis=-1)
    places = np.insert(flat.reshape(-1, 2), 1, SECTION, axis=1)
    moved = flat + np.where(inside[..., None], found(places)[:, [0, 2]].reshape(flat.shape), 0.0)
    segments = [part for lines, mask in ((moved, inside), (moved.transpose(1, 0, 2), inside.T))
                for line, own in zip(lines, mask, strict=True)
                for part in ([line] if held else apart(line, own))]  # fmt: skip
    draw_lines(axes, segments, CELLS, 0.7)
    draw_skin(axes, tail, tail.mesh.points + tail.displacement, MOVES)
    if held:
        frame(axes, tail, "2b  Sites on the box: no jump", held=True)
        return
    rim = around(low, high)
    off = found(np.insert(rim, 1, SECTION, axis=1))[:, [0, 2]]
    draw_lines(axes, [np.array([a, a + b]) for a, b in zip(rim, off, strict=True)], WORSE, 0.9)
    jump = np.linalg.norm(found(tail.sites.points[tail.in_mesh :]), axis=1).max()
    frame(axes, tail, f"2a  No sites on the box: a jump of {1e3 * jump:.0f} mm", held=False)


def apart(line: FloatArray, inside: BoolArray) -> list[FloatArray]:
    """Cut a lattice line (K, 2) where it crosses the box; single points are left out."""
    parts = np.split(line, np.flatnonzero(inside[1:] != inside[:-1]) + 1)
    return [part for part in parts if len(part) > 1]


def around(low: FloatArray, high: FloatArray, count: int = 36) -> FloatArray:
    """Return points (4 count, 2) on the edges of a rectangle."""
    share = np.arange(count)[:, None] / count
    ends = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    return np.concatenate([a + share * (b - a) for a, b in pairwise(ends)])


def draw_centres(axes: Axes, tail: Tail, count: int, name: str) -> None:
    """Draw the mesh that so many centres move, the centres and the errors at sites near the section."""
    every = count == len(tail.sites.points)
    adaptation = None if every else tail.greedy(count)
    found = adaptation.interpolant if adaptation else tail.with_all()
    points, error = tail.moved(found), tail.error(found)
    draw_mesh(axes, tail, points)
    draw_skin(axes, tail, points, MOVES)
    sites = tail.sites.points
    if adaptation:
        near = np.flatnonzero((np.abs(sites[:, 1] - SECTION) < NEAR) & (error > LEAST))
        spots = [Line(sites[row, [0, 2]] + 0.2 * error[row] * SPOT) for row in near]
        axes.add_patch(PathPatch(Line.make_compound_path(*spots), facecolor=WORSE, alpha=0.3, edgecolor="none"))
        centres = sites[adaptation.chosen]
        axes.plot(centres[:, 0], centres[:, 2], "o", color=INK, ms=3.4, alpha=0.85)
    inverted = tail.cells[tail.quality(points, tail.cells)[1]]
    beside = np.abs(tail.mesh.points[tail.tets[inverted], 1] - SECTION).min(axis=1) < 2.0 * NEAR
    if beside.any():
        draw_lines(axes, chained(edges_seen(points, tail.tets[inverted[beside]])), DARKEST, 0.5)
    cells = f"{len(inverted)} inside out" if len(inverted) else "none inside out"
    text = f"all {count:,} sites" if every else f"{count} centres: {1e3 * error.max():.1f} mm off"
    frame(axes, tail, f"{name}  {text}, {cells}", held=False)


def edges_seen(points: FloatArray, tets: IntArray) -> set[tuple[Place, Place]]:
    """Return the edges of tetrahedra as seen along y, with places rounded to 0.01 mm."""
    ends = points[tets[:, list(combinations(range(4), 2))]][..., [0, 2]].round(5).reshape(-1, 2, 2).tolist()
    return {tuple(sorted((tuple(a), tuple(b)))) for a, b in ends}


def skin(tail: Tail) -> tuple[IntArray, FloatArray]:
    """Return the triangles (F, 3) that the last panel shows, and their colours (F, 3): blue where nodes moved."""
    faces, colours = [], []
    for patch in tail.mesh.patches:
        nodes = np.concatenate([block.nodes for block in patch.faces])
        places = tail.mesh.points[nodes]
        seen = (places[:, :, 0].min(axis=1) > AFT) & (places[:, :, 1].max(axis=1) < BESIDE_AXIS)
        nodes = nodes[seen & (patch.name != "far_field")]
        slid = tail.displacement[nodes].any(axis=(1, 2))[:, None]
        colours.append(np.where(slid, _rgb(MOVES if patch.name == SURFACE else SLIDES), _rgb(STAYS)))
        faces.append(nodes)
    return np.concatenate(faces), np.concatenate(colours)


def draw_tail(axes: Axes, tail: Tail) -> None:
    """Draw the deflected tail, and the panel of the fuselage on which its root slides, as a picture."""
    around_z, above = np.radians(AROUND), np.radians(ABOVE)
    eye = np.array([np.cos(above) * np.cos(around_z), np.cos(above) * np.sin(around_z), np.sin(above)])
    right = np.array([-np.sin(around_z), np.cos(around_z), 0.0])
    screen = np.stack([right, np.cross(eye, right)], axis=1)
    nodes, colour = skin(tail)
    corners = (tail.mesh.points + tail.displacement)[nodes]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normal @ eye / np.linalg.norm(normal, axis=1)
    order = np.argsort(corners.mean(axis=1) @ eye)
    shaded = colour * (0.5 + 0.5 * np.abs(facing))[:, None]
    axes.add_collection(
        PolyCollection(
            (corners @ screen)[order], facecolors=shaded[order], edgecolors="#00000038", lw=0.25, rasterized=True
        )
    )
    box = tail.plan.region.hexahedron.corners @ screen
    for a, b in ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)):
        axes.plot(*box[[a, b]].T, color=BOX, lw=1.0, ls="--")
    axes.set_title(f"4  The tail at {tail.angle:g}°: its root slides on the skin", loc="left", fontsize=9.5, color=INK)
    axes.set_aspect("equal")
    axes.axis("off")


def _rgb(colour: str) -> FloatArray:
    """Return red, green and blue (3,) of a colour such as #1a73c9."""
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0


def write(folder: Path) -> None:
    """Write the figure as a small SVG, and another for a phone."""
    for name, narrow in (("method", False), ("method_narrow", True)):
        figure, path = drawn(narrow), folder / f"{name}.svg"
        with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
            figure.savefig(path, dpi=INSIDE, facecolor="white", metadata={"Date": None})
        path.write_text(compact(path.read_text(encoding="utf-8")), encoding="utf-8")


def compact(text: str) -> str:
    """Return an SVG with relative coordinates to a tenth of a point, short names, and few colours in its picture."""
    text = re.sub(r' d="([MLz \n\d.e-]+)"', lambda found: f' d="{_relative(found[1])}"', text)
    for number, name in enumerate(dict.fromkeys(re.findall(r'id="([pm][0-9a-f]{10})"', text))):
        text = text.replace(name, f"i{number}")
    text = re.sub(r"(?<=base64,)\s*([\w+/=\s]+)", lambda found: _few_colours(found[1]), text)
    return re.sub(r"\n\s*", "\n", re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL))


def _relative(path: str) -> str:
    """Return a path of straight lines with relative coordinates."""
    at, start, out = np.zeros(2), np.zeros(2), []
    for letter, *numbers in (command.split() for command in re.findall(r"[MLz][^MLz]*", path)):
        if letter == "z":
            out.append("z")
            at = start
            continue
        place = np.array(numbers, dtype=float)
        step = (place - at).round(1)
        at = at + step
        start = at if letter == "M" else start
        out.append(f"{letter.lower()}{step[0]:g} {step[1]:g}".replace(" -", "-"))
    return "".join(out)


def _few_colours(picture: str) -> str:
    """Return a picture in base64 as a PNG of few colours."""
    pixels = BytesIO()
    Image.open(BytesIO(b64decode(picture))).convert("RGBA").quantize(COLOURS).save(pixels, "PNG", optimize=True)
    return b64encode(pixels.getvalue()).decode()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path(__file__).parents[1] / "figures")
    write(parser.parse_args().folder)

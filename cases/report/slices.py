"""Sections through the cells around a surface: the mesh, what moves, and the cells that lost quality.

Also faces as arrays.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch as Swatch
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.box import hexahedron
from sdm_deflect.meshing.mesh.cells import PLANE, Cells, Faces, Volume
from sdm_deflect.meshing.mesh.edges import are_lines, edges_of, polygons_of
from sdm_deflect.meshing.mesh.faces import FACES
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.polyhedra import corner_edges
from sdm_deflect.meshing.mesh.quality import quality_of

from . import colours
from .data import Box, MovedSurface, ReportData, measure_in_words

BOX_EDGES = np.array(hexahedron.EDGES)
AXES = "xyz"
# Largest distance of a section's nodes from it, as a share of the span.
BESIDE = 0.03
# Half the width of a panel, in chords of what moves: the whole surface with as much again around it, and the worst
# cell, where single cells of a coarse mesh can be told apart.
WHOLE, CLOSE = 0.95, 0.35
# Width over height of a panel, and the inches of a panel's width, of the margins around it, and of the legend.
RATIO, WIDE, SIDE, HEAD, FOOT = 1.5, 4.7, 0.6, 0.56, 0.62
# Share of a panel's height from which on the number of its worst cell stands below the cell.
LOWER = 0.85
# Least distance of a section from the ends of a box, by its width.
INSIDE = 1e-3
# Quality below which a cell is outlined: three times what is poor in a check, so that cells on the way there show.
POOR = 0.3
# Number of surfaces from which on each has the section of the whole surface alone: pages stay small.
MANY = 3
# Edges of each shape.
EDGES = {
    shape: sorted({(min(ends), max(ends)) for face in faces for ends in zip(face, face[1:] + face[:1], strict=True)})
    for shape, faces in FACES.items()
}


def by_size(faces: Iterable[Faces]) -> list[IntArray]:
    """Return faces as arrays (F, k), one for each number k of corners."""
    blocks: dict[int, list[IntArray]] = {}
    for block in faces:
        if isinstance(block, Cells):
            blocks.setdefault(block.nodes.shape[1], []).append(block.nodes)
            continue
        sizes = np.diff(block.offsets)
        for k in np.unique(sizes):
            rows = block.offsets[:-1][sizes == k, None] + np.arange(k)
            blocks.setdefault(int(k), []).append(block.nodes[rows])
    return [np.concatenate(blocks[k]) for k in sorted(blocks)]


def triangles_of(faces: Iterable[Faces]) -> IntArray:
    """Return faces cut into triangles (T, 3) of the same normals, all from a face's first corner; flat for lines."""
    parts = [np.empty((0, 3), dtype=np.intp)]
    for cells in by_size(faces):
        if cells.shape[1] == 2:
            parts.append(cells[:, [0, 1, 1]])
        parts += [cells[:, [0, i, i + 1]] for i in range(1, cells.shape[1] - 1)]
    return np.concatenate(parts)


@dataclass(frozen=True, slots=True, eq=False)
class CutPlane:
    """A plane x, y or z = const: its place, its title, and the part (2, 3) that is drawn."""

    axis: int
    station: float
    what: str
    window: FloatArray

    @property
    def across(self) -> tuple[int, int]:
        """The axes to the right and upwards in a picture of the plane."""
        return ((1, 2), (0, 2), (0, 1))[self.axis]


def directions(points: FloatArray, surface: MovedSurface) -> tuple[int, int]:
    """Return the coordinate axes along a surface's span and chord, from its hinge and its nodes at points (N, 3)."""
    places = points[surface.nodes]
    extent = np.ptp(places, axis=0)
    if surface.axis is None:
        span = int(np.argmax(extent))
        return span, int(np.argmax(np.where(np.arange(3) == span, -1.0, extent)))
    span = int(np.argmax(np.abs(surface.axis.direction)))
    reach = np.abs(surface.axis.radial(places)).max(axis=0)
    reach[span] = -1.0
    return span, int(np.argmax(reach))


def planes(data: ReportData, box: Box, surface: MovedSurface) -> tuple[CutPlane, ...]:
    """Return the section at half span of the whole surface, and one through the worst cell near it.

    The section of a plane mesh is its plane. If layers changed, a further section is at their largest change. Where
    many surfaces moved, each has the first section alone.
    """
    points = data.mesh.points[surface.nodes]
    span, chordwise = (2, 0) if data.mesh.plane else directions(data.mesh.points, surface)
    half = float(points[:, span].min() + points[:, span].max()) / 2
    off = np.abs(points[:, span] - half)
    near = np.flatnonzero(off <= off.min() + BESIDE * np.ptp(points[:, span]))
    both = np.vstack([points[near], data.points[surface.nodes[near]]])
    chord = float(np.ptp(points[near, chordwise])) or float(np.ptp(points, axis=0).max())
    what = "the plane" if data.mesh.plane else "section at half span"
    cuts = [CutPlane(span, half, what, _window((both.min(axis=0), both.max(axis=0)), WHOLE * chord, span))]
    if len(data.surfaces) < MANY and box.affected.count:
        cell = data.points[box.affected.worst(data.points)].mean(axis=0)
        station = half if data.mesh.plane else _within(box, float(cell[span]), span)
        cuts.append(CutPlane(span, station, "at the worst cell", _window((cell, cell), CLOSE * chord, span)))
    for window in (np.array(check.window) for check in data.checks if check.window):
        if box.hexahedron.contains(window.mean(axis=0)[None]).all():
            station = half if data.mesh.plane else float(window[:, span].mean())
            cuts.append(CutPlane(span, station, "where layers changed most", window))
    return tuple(cuts)


def _within(box: Box, station: float, axis: int) -> float:
    """Return the station nearest to one at which a plane cuts a box: cells at it reach beyond."""
    low, high = (float(end(box.hexahedron.corners[:, axis])) for end in (np.min, np.max))
    return min(max(station, low + INSIDE * (high - low)), high - INSIDE * (high - low))


def _window(ends: tuple[FloatArray, FloatArray], least: float, span: int) -> FloatArray:
    """Return a window (2, 3) around two corners, `RATIO` wide, at least twice `least` and a fifth wider than they."""
    middle, size = 0.5 * (ends[0] + ends[1]), 0.6 * (ends[1] - ends[0])
    right, up = (i for i in range(3) if i != span)
    half = max(least, float(size[right]), RATIO * float(size[up]))
    reach = np.full(3, half)
    reach[up] = half / RATIO
    return np.array([middle - reach, middle + reach])


def slices(data: ReportData, box: Box, surface: MovedSurface) -> tuple[Figure, str]:
    """Draw the sections of a surface before and after the deflection; return a description."""
    cuts, texts = planes(data, box, surface), []
    wide, high = 2.0 * (WIDE + SIDE) + 0.15, len(cuts) * (WIDE / RATIO + HEAD) + FOOT
    figure = Figure(figsize=(wide, high))
    for row, plane in enumerate(cuts):
        bottom = high - (row + 1) * (WIDE / RATIO + HEAD) + 0.26
        place = f"{plane.what}, {AXES[plane.axis]} = {data.length.text(plane.station)}"
        least = []
        for column, (state, points) in enumerate((("before", data.mesh.points), ("after", data.points))):
            left = SIDE + column * (WIDE + SIDE)
            axes = figure.add_axes((left / wide, bottom / high, WIDE / wide, WIDE / RATIO / high))
            least.append(_draw(axes, data, points, surface, box, plane))
            name = f"{state}, {surface.amount_text}" if column else state
            axes.set_title(name, loc="left", fontsize=10, weight="bold")
            axes.set_title(place if column else "", loc="right", fontsize=8, color=colours.SOFT)
        texts.append(
            f"{place[0].upper()}{place[1:]}: smallest of its cells {least[0]:.3f} before, {least[1]:.3f} after."
        )
    _legend(figure, wide, high)
    return figure, (
        f"Sections through the cells around {surface.name}, before (left) and after (right). Cells that lost more than "
        f"{colours.LOST:g} of their {measure_in_words(data.boxes)} are coloured, those below {POOR:g} outlined. "
        + " ".join(texts)
    )


def _legend(figure: Figure, wide: float, high: float) -> None:
    """Explain colours and lines below the panels."""
    bar = figure.add_axes((SIDE / wide, 0.26 / high, 2.4 / wide, 0.11 / high))
    figure.colorbar(ScalarMappable(colours.LOSSES, colours.LOSS), cax=bar, orientation="horizontal", extend="max")
    bar.set_title("quality lost by a cell", fontsize=8, loc="left", pad=3)
    bar.tick_params(labelsize=8)
    handles: list[Any] = [
        Swatch(facecolor="none", edgecolor=colours.WORSE, label=f"below {POOR:g}"),
        Line2D([], [], color=colours.WORSE, marker="o", ls="", mfc="none", ms=10, label="worst here"),
        Line2D([], [], color=colours.MOVES, lw=2.4, label="moves"),
        Line2D([], [], color=colours.INK, lw=1.4, label="stays"),
        Line2D([], [], color=colours.INK, lw=1.0, ls="--", label="was"),
        Line2D([], [], color=colours.BOX, lw=1.0, ls=":", label="box"),
    ]
    place = (3.4 / wide, 0.3 / high)
    figure.legend(handles=handles, ncols=6, fontsize=9, frameon=False, loc="center left", bbox_to_anchor=place)


def _draw(axes: Axes, data: ReportData, points: FloatArray, surface: MovedSurface, box: Box, plane: CutPlane) -> float:
    """Draw one section of a mesh at points (N, 3); return the smallest quality of a cell in it."""
    factor, (right, up), mesh = data.length.factor, plane.across, data.mesh
    polygons, now, lost = list[FloatArray](), [np.empty(0)], [np.empty(0)]
    for block, sign in zip(mesh.cells, box.affected.orientation, strict=True):
        some, rows = cut_cells(points, block, plane)
        polygons += some
        now.append(quality_of(points, block, rows, sign))
        lost.append(quality_of(mesh.points, block, rows, sign) - now[-1])
    quality, loss = np.concatenate(now), np.concatenate(lost)
    _draw_cells(axes, factor, polygons, quality, loss)
    _draw_lines(axes, data, points, surface, box, plane)
    axes.set_facecolor(colours.STAYS)  # a body has no cells, and is seen as grey
    axes.set(xlim=factor * plane.window[:, right], ylim=factor * plane.window[:, up])
    axes.tick_params(labelsize=8, colors=colours.SOFT)
    axes.spines[:].set_color(colours.CELLS)
    note = f"{AXES[right]} to the right, {AXES[up]} up"
    axes.text(0.01, 0.02, note, transform=axes.transAxes, fontsize=7, color=colours.SOFT)
    places = np.array([polygon.mean(axis=0) for polygon in polygons]).reshape(-1, 2)
    low, top = plane.window[:, plane.across]
    seen = np.flatnonzero(((places > low) & (places < top)).all(axis=1))
    if len(seen):
        worst = seen[np.argmin(quality[seen])]
        _mark(axes, factor * places[worst], float(quality[worst]))
    return float(quality[seen].min(initial=1.0))


def _draw_cells(
    axes: Axes, factor: float, polygons: Sequence[FloatArray], quality: FloatArray, loss: FloatArray
) -> None:
    """Draw cells; colour those that lost much quality, and outline poor ones."""
    lost_much, poor = np.flatnonzero(loss > colours.LOST), np.flatnonzero(quality < POOR)
    _fill(axes, factor, polygons, np.arange(len(polygons)), facecolors="white", edgecolors=colours.CELLS, lw=0.3)
    shades: dict[str, Any] = {"cmap": colours.LOSS, "norm": colours.LOSSES, "edgecolors": colours.CELLS}
    _fill(axes, factor, polygons, lost_much, loss, lw=0.3, **shades)
    _fill(axes, factor, polygons, poor, facecolors="none", edgecolors=colours.WORSE, lw=0.8)


def _draw_lines(
    axes: Axes, data: ReportData, points: FloatArray, surface: MovedSurface, box: Box, plane: CutPlane
) -> None:
    """Draw the walls, where the surface was before it moved, and the box."""
    mesh, factor = data.mesh, data.length.factor
    if points is not mesh.points:
        was = factor * cut_walls(mesh, mesh.points, plane, surface.patches)
        axes.add_collection(LineCollection(list(was), colors=colours.INK, linewidths=0.9, linestyles="--"))
    stays = [name for name in mesh.names if name not in surface.patches]
    for names, colour, width in ((stays, colours.INK, 1.3), (surface.patches, colours.MOVES, 2.2)):
        walls = factor * cut_walls(mesh, points, plane, names)
        axes.add_collection(LineCollection(list(walls), colors=colour, linewidths=width))
    normal = np.eye(3)[plane.axis]
    section = factor * box.hexahedron.section(plane.station * normal, normal)[:, plane.across]
    axes.plot(*np.vstack([section, section[:1]]).T, color=colours.BOX, lw=1.0, ls=":")


def _mark(axes: Axes, place: FloatArray, quality: float) -> None:
    """Mark the worst cell, and write its quality beside it."""
    x, y = place
    axes.plot(x, y, "o", ms=17, mfc="none", mec=colours.WORSE, mew=1.6)
    looks = {"fontsize": 9, "weight": "bold", "color": colours.BAD, "textcoords": "offset points"}
    low, top = axes.get_ylim()
    below = y > low + LOWER * (top - low)  # above it the title begins
    note = axes.annotate(
        f"{quality:.3f}", (x, y), xytext=(11, -9 if below else 9), va="top" if below else "bottom",
        annotation_clip=True, **looks,
    )  # fmt: skip
    note.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0})


def _fill(
    axes: Axes, factor: float, polygons: Sequence[FloatArray], rows: IntArray, shades: FloatArray | None = None,
    **looks: Any,
) -> None:  # fmt: skip
    """Draw some polygons; an array of those of one size is drawn much faster than a list."""
    sizes = np.array([len(polygons[i]) for i in rows], dtype=np.intp)
    for size in np.unique(sizes):
        some = rows[sizes == size]
        corners: Any = factor * np.array([polygons[i] for i in some])
        axes.add_collection(PolyCollection(corners, array=None if shades is None else shades[some], **looks))


def cut_cells(points: FloatArray, block: Volume, plane: CutPlane) -> tuple[list[FloatArray], IntArray]:
    """Return polygons (k, 2) in which the plane cuts the cells of its window, and the rows (P,) of these cells.

    Cells of a plane mesh lie in it.
    """
    above = points[:, plane.axis] >= plane.station
    (right, up), window = plane.across, plane.window
    beyond = [] if isinstance(block, Cells) and block.shape in PLANE else [above, ~above]
    beyond += [points[:, c] > window[0, c] for c in (right, up)] + [points[:, c] < window[1, c] for c in (right, up)]
    rows = np.flatnonzero(np.all([with_node(block, mask) for mask in beyond], axis=0))
    if isinstance(block, Cells) and block.shape in PLANE:
        return list(points[block.nodes[rows]][:, :, plane.across]), rows
    cell, edges = cell_edges(block, rows)
    polygons = _cut(points, cell, edges, len(rows), plane)
    kept = [i for i, polygon in enumerate(polygons) if len(polygon) > 2]
    return [polygons[i] for i in kept], rows[kept]


def cut_walls(mesh: Mesh, points: FloatArray, plane: CutPlane, names: Sequence[str]) -> FloatArray:
    """Return segments (S, 2, 2) in which the plane cuts some patches."""
    faces = polygons_of(tuple(chain.from_iterable(mesh.patch(name).faces for name in names)))
    if not len(faces):
        return np.empty((0, 2, 2))
    if are_lines(faces):
        return np.asarray(points[faces.nodes.reshape(-1, 2)][:, :, plane.across])
    edges, face = edges_of(faces)
    above = points[:, plane.axis] >= plane.station
    crossing = above[edges[:, 0]] != above[edges[:, 1]]
    places, rows = section(points, face[crossing], edges[crossing], plane.axis, plane.station)
    straight = np.bincount(rows, minlength=len(faces))[rows] == 2
    walls = places[straight][:, plane.across].reshape(-1, 2, 2)
    low, high = plane.window[:, plane.across]
    return np.asarray(walls[((walls.min(axis=1) <= high) & (walls.max(axis=1) >= low)).all(axis=1)])


def with_node(block: Volume, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells (M,) have a node in the mask (N,)."""
    if isinstance(block, Cells):
        return np.asarray(np.logical_or.reduce([mask[column] for column in block.nodes.T]))
    face = np.logical_or.reduceat(mask[block.faces.nodes], block.faces.offsets[:-1])
    flags = np.zeros(len(block), dtype=bool)
    flags[block.owner[face]] = True
    flags[block.neighbour[face[: len(block.neighbour)]]] = True
    return flags


def cell_edges(block: Volume, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the edges (E, 2) of some cells, and the row (E,) to which each belongs."""
    if isinstance(block, Cells):
        ends = block.nodes[rows][:, EDGES[block.shape]]
        return np.repeat(np.arange(len(rows)), ends.shape[1]), ends.reshape(-1, 2)
    first, last, cell = corner_edges(block, rows)
    once = first < last
    return cell[once], np.column_stack([first[once], last[once]])


def _cut(points: FloatArray, cell: IntArray, edges: IntArray, count: int, plane: CutPlane) -> list[FloatArray]:
    """Return for each of `count` convex cells the corners (k, 2) of its section, one after another around it."""
    places, rows = section(points, cell, edges, plane.axis, plane.station)
    number = np.bincount(rows, minlength=count)
    return np.split(places[:, plane.across], np.cumsum(number)[:-1]) if count else []


def section(
    points: FloatArray, cell: IntArray, edges: IntArray, axis: int, station: float
) -> tuple[FloatArray, IntArray]:
    """Cut convex cells with edges (E, 2) by the plane in which a coordinate is `station`.

    A node in the plane counts as on its positive side.

    Parameters
    ----------
    points : (N, 3) node coordinates.
    cell : (E,) the cell of each edge.

    Returns
    -------
    The corners (P, 3) of the polygons, cell by cell and one after another around each, and their cells (P,).
    """
    height = points[:, axis] - station
    above = height >= 0.0
    crossing = above[edges[:, 0]] != above[edges[:, 1]]
    cell, edges = cell[crossing], edges[crossing]
    a, b, low, high = points[edges[:, 0]], points[edges[:, 1]], height[edges[:, 0]], height[edges[:, 1]]
    places = a + (low / (low - high))[:, None] * (b - a)
    places[:, axis] = station
    _, rows, number = np.unique(cell, return_inverse=True, return_counts=True)
    right, up = (i for i in range(3) if i != axis)
    off = [places[:, i] - (np.bincount(rows, places[:, i]) / number)[rows] for i in (right, up)]
    order = np.lexsort((np.arctan2(off[1], off[0]), rows))
    return places[order], cell[order]

"""Sections through the cells around a surface, coloured by quality.

Also colours of patches, qualities and displacements, and faces as arrays.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any
from zlib import crc32

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.box import hexahedron
from sdm_deflect.meshing.mesh.cells import PLANE, Cells, Faces, Volume
from sdm_deflect.meshing.mesh.edges import are_lines, edges_of, polygons_of
from sdm_deflect.meshing.mesh.faces import FACES
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.polyhedra import corner_edges
from sdm_deflect.meshing.mesh.quality import quality_of

from .data import Box, MovedSurface, ReportData, measure_in_words

Colour = tuple[int, int, int]
Direction = tuple[float, float, float]
QUALITY_MAP = "cividis"
# Cells of a quality below 0.4 get the darkest colour.
QUALITY_RANGE = Normalize(0.4, 1.0)

BOX_COLOUR = "#cc00cc"
# After Paul Tol's muted scheme.
COMPONENTS = {
    "fuselage": "#bbbbbb",
    "canopy": "#332288",
    "inlet": "#999933",
    "pedestal": "#dddddd",
    "strake": "#44aa99",
    "wing": "#88ccee",
    "aileron": "#cc6677",
    "tail": "#ddcc77",
    "ventral": "#117733",
    "fin": "#aa4499",
    "rudder": "#882255",
    "chimera": BOX_COLOUR,
}

# Colours of patches that are no component of our aircraft, chosen by the letters of the name.
OTHERS = ("#bbbbbb", "#88ccee", "#44aa99", "#dddddd", "#ddcc77", "#999933", "#6699cc", "#b8b8d8")
# Colour of such patches if they move.
MOVING = COMPONENTS["aileron"]

DARK: Colour = (90, 90, 90)
GREY: Colour = (190, 190, 190)
# Also the colour of boxes.
MAGENTA: Colour = (204, 0, 204)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)
CHANGE_MAP = "RdBu"
# Colours of the change of quality: red for a loss, blue for a gain.
CHANGE_RANGE = Normalize(-0.2, 0.2)
# Colours of the displacement: pale for none, dark for the largest.
MOVED_MAP = "YlOrRd"
BOX_EDGES = np.array(hexahedron.EDGES)
AXES = "xyz"
# Margin around the box, as a share of its size.
AROUND = 0.06
# Largest distance of a section's nodes from it, as a share of the span.
BESIDE = 0.03
# Half the width and height of the view of the hinge, as a share of the box's size.
CLOSE = 0.128
# Position of the colour bar in the figure: left, bottom, width, height.
BAR = (0.89, 0.2, 0.025, 0.6)
# Edges of each shape.
EDGES = {
    shape: sorted({(min(ends), max(ends)) for face in faces for ends in zip(face, face[1:] + face[:1], strict=True)})
    for shape, faces in FACES.items()
}


def component(patch: str) -> str:
    """Return the component that a patch belongs to; left and right are alike."""
    stem = patch.removesuffix("_left").removesuffix("_right")
    return "fuselage" if stem.startswith("fuselage") else stem


def patch_colour(patch: str, moving: bool = False) -> Colour:
    """Return the colour of a patch's component."""
    name = component(patch)
    colour = COMPONENTS.get(name) or (MOVING if moving else OTHERS[crc32(name.encode()) % len(OTHERS)])
    r, g, b = (round(255 * share) for share in to_rgb(colour))
    return r, g, b


def hexadecimal(colour: Colour) -> str:
    """Return a colour as text for a web page."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


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
    """Return sections at half span: of the whole box, around the hinge, and around the trailing edge.

    The section of a plane mesh is its plane. The trailing edge is at the node of the section that moves farthest. A
    motion without a hinge has no section around one. If layers changed, the last section is at their largest change.
    """
    points, corners = data.mesh.points[surface.nodes], box.hexahedron.corners
    size = float(np.ptp(corners, axis=0).max())
    span = 2 if data.mesh.plane else directions(data.mesh.points, surface)[0]
    half = float(points[:, span].min() + points[:, span].max()) / 2
    close = np.full(3, CLOSE * size)
    off = np.abs(points[:, span] - half)
    near = np.flatnonzero(off <= off.min() + BESIDE * np.ptp(points[:, span]))
    moves = np.linalg.norm(data.points[surface.nodes[near]] - points[near], axis=1)
    edge = surface.nodes[near[np.argmax(moves)]]
    ends = np.array([data.mesh.points[edge], data.points[edge]])
    what = "the plane" if data.mesh.plane else "section at half span"
    windows = [(what, corners.min(axis=0) - AROUND * size, corners.max(axis=0) + AROUND * size)]
    if surface.axis is not None:
        along = surface.axis.direction[span]
        hinge = surface.axis.point + (half - surface.axis.point[span]) / (along or np.inf) * surface.axis.direction
        windows.append(("at the hinge", hinge - close, hinge + close))
    windows.append(("at the trailing edge", ends.min(axis=0) - close, ends.max(axis=0) + close))
    cuts = [CutPlane(span, half, text, np.array([low, high])) for text, low, high in windows]
    for window in (np.array(check.window) for check in data.checks if check.window):
        if box.hexahedron.contains(window.mean(axis=0)[None]).all():
            station = half if data.mesh.plane else float(window[:, span].mean())
            cuts.append(CutPlane(span, station, "where layers changed most", window))
    return tuple(cuts)


def slices(data: ReportData, box: Box, surface: MovedSurface) -> tuple[Figure, str]:
    """Draw the sections of a surface before and after the deflection; return a description."""
    cuts, texts = planes(data, box, surface), []
    figure = Figure(figsize=(9.6, 4.0 * len(cuts)))
    figure.subplots_adjust(left=0.09, right=0.86, bottom=0.05, top=0.94, wspace=0.28, hspace=0.28)
    axes = figure.subplots(len(cuts), 2)
    states = (("undeflected", data.mesh.points), (surface.amount_text, data.points))
    for row, plane in zip(axes, cuts, strict=True):
        pairs = zip(row, states, strict=True)
        before, after = (draw_slice(mesh_state, data, points, box, plane, name) for mesh_state, (name, points) in pairs)
        place = f"{plane.what.capitalize()}, {AXES[plane.axis]} = {data.length.text(plane.station)}"
        texts.append(f"{place}: smallest of its cells {before:.3f} before, {after:.3f} after.")
    shades, measure = ScalarMappable(QUALITY_RANGE, QUALITY_MAP), measure_in_words(data.boxes)
    figure.colorbar(shades, cax=figure.add_axes(BAR), label=f"{measure} of a cell", extend="min")
    figure.suptitle(surface.name, fontsize="medium")
    return figure, (
        f"Sections through the cells around {surface.name}, coloured by {measure}, before (left) and after (right); "
        "walls are black, the box is dashed. " + " ".join(texts)
    )


def draw_slice(axes: Axes, data: ReportData, points: FloatArray, box: Box, plane: CutPlane, state: str) -> float:
    """Draw one slice; return the smallest quality of a cell in it."""
    factor, unit, (right, up) = data.length.factor, data.length.shown, plane.across
    signed = zip(data.mesh.cells, box.affected.orientation, strict=True)
    cuts = [cut_cells(points, block, plane, sign) for block, sign in signed]
    polygons = [polygon for some, _ in cuts for polygon in some]
    shades = np.concatenate([np.empty(0), *(rows for _, rows in cuts)])
    looks: dict[str, Any] = {"cmap": QUALITY_MAP, "norm": QUALITY_RANGE, "edgecolors": "0.15", "lw": 0.25}
    sizes = np.array([len(polygon) for polygon in polygons])
    for size in np.unique(sizes):  # an array of polygons is drawn much faster than a list
        rows = np.flatnonzero(sizes == size)
        corners: Any = factor * np.array([polygons[i] for i in rows])
        axes.add_collection(PolyCollection(corners, array=shades[rows], **looks))
    walls = factor * cut_walls(data.mesh, points, plane)
    axes.add_collection(LineCollection(list(walls), colors="black", linewidths=1.6))
    normal = np.eye(3)[plane.axis]
    section = factor * box.hexahedron.section(plane.station * normal, normal)[:, plane.across]
    axes.plot(*np.vstack([section, section[:1]]).T, color=BOX_COLOUR, lw=1.3, ls="--")
    axes.set(xlim=factor * plane.window[:, right], ylim=factor * plane.window[:, up], aspect="equal")
    axes.set(xlabel=f"{AXES[right]}, {unit}", ylabel=f"{AXES[up]}, {unit}")
    axes.set_title(f"{plane.what},\n{state}", fontsize="small")
    return float(shades.min(initial=1.0))


def cut_cells(
    points: FloatArray, block: Volume, plane: CutPlane, orientation: float = 1.0
) -> tuple[list[FloatArray], FloatArray]:
    """Return polygons (k, 2) in which the plane cuts the cells of its window, and these cells' drawn quality (P,).

    Cells of a plane mesh lie in it.
    """
    above = points[:, plane.axis] >= plane.station
    (right, up), window = plane.across, plane.window
    beyond = [] if isinstance(block, Cells) and block.shape in PLANE else [above, ~above]
    beyond += [points[:, c] > window[0, c] for c in (right, up)] + [points[:, c] < window[1, c] for c in (right, up)]
    rows = np.flatnonzero(np.all([with_node(block, mask) for mask in beyond], axis=0))
    if isinstance(block, Cells) and block.shape in PLANE:
        return list(points[block.nodes[rows]][:, :, plane.across]), quality_of(points, block, rows, orientation)
    cell, edges = cell_edges(block, rows)
    polygons = _cut(points, cell, edges, len(rows), plane)
    kept = [i for i, polygon in enumerate(polygons) if len(polygon) > 2]
    return [polygons[i] for i in kept], quality_of(points, block, rows[kept], orientation)


def cut_walls(mesh: Mesh, points: FloatArray, plane: CutPlane) -> FloatArray:
    """Return segments (S, 2, 2) in which the plane cuts the boundary."""
    faces = polygons_of(tuple(chain.from_iterable(patch.faces for patch in mesh.patches)))
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

"""Pictures in three dimensions, drawn by PyVista: what they show, as plain arrays with colours."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import floor, log10
from typing import Any, NamedTuple

import numpy as np
import pyvista as pv
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.cases.report import colours
from sdm_deflect.cases.report.data import METRES, Length
from sdm_deflect.cases.report.slices import BOX_EDGES, by_size
from sdm_deflect.meshing.mesh.mesh import Mesh

from .colours import BOX, COMPONENTS, Colour, Direction, component, patch_colour

Image = NDArray[np.uint8]
# Width of one image.
INCHES = 5.2
# Inches above it.
TITLE = 0.35


# Size of a picture over what it frames.
MARGIN = 1.08
# Edges of faces shorter than so many pixels are not drawn.
FINEST = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Faces, lines or dots.

    Attributes
    ----------
    points : (N, 3), in the mesh's unit of length.
    cells : (F, k) node indices: k = 1 for dots, 2 for lines, 3 or more for faces.
    rgb : (F, 3) colour of each cell, or (1, 3) for all, 0 to 255.
    opacity : 0 to 1.
    edge : colour of the faces' edges, or None for none.
    width : of lines and edges, or size of dots, in pixels.
    ambient : share of the light that falls from everywhere: 1 shows the colours as they are.
    """

    points: FloatArray
    cells: IntArray
    rgb: IntArray
    opacity: float = 1.0
    edge: Colour | None = None
    width: float = 1.0
    ambient: float = 0.35

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or not self.cells.shape[1]:
            raise ValueError(f"cells {self.cells.shape} must be (F, k): dots, lines or faces of k nodes")
        if self.rgb.shape not in ((len(self.cells), 3), (1, 3)):
            raise ValueError(f"rgb {self.rgb.shape} must be ({len(self.cells)}, 3) or (1, 3)")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Layers seen by parallel projection.

    Attributes
    ----------
    focus : (3,) point in the middle of the picture.
    towards : (3,) direction from there to the eye.
    height : of the picture, a length at the focus.
    pixels : width and height.
    up : (3,) direction that is up in the picture.
    """

    layers: tuple[Layer, ...]
    focus: FloatArray
    towards: Direction
    height: float
    pixels: tuple[int, int] = (800, 600)
    up: Direction = (0.0, 0.0, 1.0)


def framed(layers: tuple[Layer, ...], points: FloatArray, towards: Direction, pixels: tuple[int, int]) -> View:
    """Return the view from a direction, with z up, that just holds all of points (N, 3)."""
    eye = np.array(towards) / np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    frame = np.array([right, np.cross(eye, right), eye])
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height, _ = MARGIN * (high - low)
    return View(layers, 0.5 * (low + high) @ frame, towards, max(height, width * pixels[1] / pixels[0]), pixels)


def legible(view: View) -> View:
    """Return the view without the edges of faces so small in it that they would blacken it."""
    least = FINEST * view.height / view.pixels[1]
    layers = (replace(one, edge=None) if one.edge and median_edge(one) < least else one for one in view.layers)
    return replace(view, layers=tuple(layers))


def median_edge(layer: Layer) -> float:
    """Median length of the edges of faces; 0 without faces."""
    corners = layer.points[layer.cells]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.median(lengths)) if lengths.size else 0.0


def plain(points: FloatArray, cells: IntArray, colour: Colour, **looks: Any) -> Layer:
    """Return cells of one colour."""
    return Layer(points, cells, np.array([colour], dtype=np.intp), **looks)


def dots(points: FloatArray, colour: Colour, size: float) -> Layer:
    """Return points (N, 3) as dots."""
    return plain(points, np.arange(len(points))[:, None], colour, width=size)


def patches(
    mesh: Mesh, names: Iterable[str], colour: Colour | None = None, moving: Sequence[str] = (), **looks: Any
) -> tuple[Layer, ...]:
    """Return the faces of patches, or their nodes as dots, in one colour or in those of their components."""
    layers, points = [], mesh.points
    for name in names:
        patch, own = mesh.patch(name), colour or patch_colour(name, name in moving)
        layers += [plain(points, cells, own, **looks) for cells in by_size(patch.faces)]
        if not patch.faces:
            layers.append(dots(points[patch.nodes], own, 4.0))
    return tuple(layers)


def box(corners: FloatArray, width: float = 3.0) -> Layer:
    """Return the edges of a hexahedron (8, 3)."""
    return plain(corners, BOX_EDGES, BOX, width=width)


def rendered(views: Sequence[View]) -> list[Image]:
    """Return each view as an image (H, W, 3)."""
    return [_image(legible(view)) for view in views]


def _image(view: View) -> Image:
    plotter = pv.Plotter(off_screen=True, window_size=list(view.pixels), lighting="light kit")
    plotter.set_background("white")
    for layer in view.layers:
        cells = np.insert(layer.cells, 0, layer.cells.shape[1], axis=1).ravel()
        kind = {1: "verts", 2: "lines"}.get(layer.cells.shape[1], "faces")
        mesh = pv.PolyData(np.asarray(layer.points, dtype=np.float64), **{kind: cells})
        mesh.cell_data["rgb"] = np.broadcast_to(layer.rgb, (len(layer.cells), 3)).astype(np.uint8)
        edges = {"show_edges": True, "edge_color": layer.edge} if layer.edge and kind == "faces" else {}
        looks = {"ambient": layer.ambient, "diffuse": 1.0 - layer.ambient} if kind == "faces" else {"lighting": False}
        plotter.add_mesh(
            mesh, scalars="rgb", rgb=True, opacity=layer.opacity, line_width=layer.width, point_size=layer.width,
            **edges, **looks,
        )  # fmt: skip
    eye = np.array(view.towards) / np.linalg.norm(view.towards)
    plotter.camera_position = (view.focus + 10.0 * view.height * eye, view.focus, view.up)
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * view.height
    plotter.reset_camera_clipping_range()
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image


@dataclass(frozen=True, slots=True)
class Picture:
    """Views and what is written around them.

    Attributes
    ----------
    views, titles : row by row.
    columns : how many images stand side by side.
    legend : colours by name.
    scale : what colours of cells stand for, a name in `SCALES`; "" for no bar.
    alternative : what the picture shows, in words.
    length : the unit of length.
    """

    views: tuple[View, ...]
    titles: tuple[str, ...]
    alternative: str
    columns: int = 2
    legend: dict[str, str] = field(default_factory=dict)
    scale: str = ""
    length: Length = METRES


def figure_of(picture: Picture) -> Figure:
    """Render the views and put them together."""
    return assembled(picture, rendered(picture.views))


def assembled(picture: Picture, images: Sequence[Image]) -> Figure:
    """Put the images (H, W, 3) of a picture's views together."""
    rows = -(-len(images) // picture.columns)
    width, height = picture.views[0].pixels
    across, scaled = INCHES * picture.columns, bool(picture.scale)
    size = across + 1.0 * scaled, rows * (INCHES * height / width + TITLE)
    figure = Figure(figsize=size, layout="constrained" if scaled or picture.legend else None)
    if not figure.get_layout_engine():
        figure.subplots_adjust(
            0.004, 0.004, 0.996, 1.0 - TITLE / size[1], 0.02, TITLE * rows / (size[1] - TITLE * rows)
        )
    axes = figure.subplots(rows, picture.columns, squeeze=False).ravel()
    for one, shown, view, title in zip(axes, images, picture.views, picture.titles, strict=True):
        one.imshow(shown)
        one.set_title(title, fontsize="medium")
        one.set_axis_off()
        _scale(one, view, picture.length)
    if picture.scale:
        one = SCALES[picture.scale]
        figure.colorbar(ScalarMappable(one.range, one.colours), ax=axes.tolist(), label=one.label, shrink=0.85)
    if picture.legend:
        handles = [Patch(facecolor=colour, edgecolor="0.3", label=name) for name, colour in picture.legend.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize="small", frameon=False)
    return figure


def _scale(axes: Axes, view: View, unit: Length) -> None:
    """Draw a bar of a round length across the line of sight: parallel projection has one scale."""
    width, height = view.pixels
    pixel = view.height / height
    length = round_length(0.25 * width * pixel)
    right, low = 0.97 * width, 0.95 * height
    # on white: cells may lie below
    axes.axhspan(low - 0.07 * height, low + 0.02 * height, right / width - length / pixel / width, 1.0, color="white")
    axes.plot([right - length / pixel, right], [low, low], color="black", lw=2.5)
    axes.annotate(unit.text(length, "g"), (right, low - 0.015 * height), fontsize="small", va="bottom", ha="right")


def round_length(most: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above `most`."""
    power = 10.0 ** floor(log10(most))
    return max(first * power for first in (1.0, 2.0, 5.0) if first * power <= most * (1.0 + 1e-12))


def components_of(patches: Iterable[str]) -> list[str]:
    """Return the components among patches that have a colour, in the order of `COMPONENTS`."""
    present = {component(patch) for patch in patches}
    return [name for name in COMPONENTS if name in present]


class Scale(NamedTuple):
    """A range of values, its colours, and what it is of."""

    range: Normalize
    colours: Colormap
    label: str

    def rgb(self, values: FloatArray) -> IntArray:
        """Return the colours (F, 3) of values (F,); white below a range that begins above zero."""
        rgb = np.asarray(np.rint(255.0 * self.colours(self.range(values))[:, :3]), dtype=np.intp)
        rgb[values < (self.range.vmin or -np.inf)] = 255
        return rgb


# What colours of cells may stand for.
SCALES = {
    "quality": Scale(colours.QUALITIES, colours.QUALITY, "mean ratio of a cell"),
    "lost": Scale(colours.LOSSES, colours.LOSS, "mean ratio lost by a cell"),
}

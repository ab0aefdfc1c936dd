"""What a picture shows, as plain arrays with colours: no graphics library is needed to compose or to test one."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize, to_rgb

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.hexahedron import EDGES
from sdm_deflect.deform.mesh.mesh import Cells, Faces, Mesh

Colour = tuple[int, int, int]
Direction = tuple[float, float, float]
MARGIN = 1.08
"""Size of a picture over what it frames."""
FINEST = 4.0
"""Edges of faces shorter than so many pixels are not drawn."""


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


QUALITY_MAP = "cividis"
QUALITY_RANGE = Normalize(0.4, 1.0)
"""Cells of a quality below 0.4 get the darkest colour."""

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
    "chimera": "#cc00cc",
}
"""After Paul Tol's muted scheme."""

OTHERS = ("#bbbbbb", "#88ccee", "#44aa99", "#dddddd", "#ddcc77", "#999933", "#6699cc", "#b8b8d8")
"""For patches that are no component of our aircraft: taken in turn by the letters of the name."""
MOVING = COMPONENTS["aileron"]
"""For such patches that move."""

DARK: Colour = (90, 90, 90)
GREY: Colour = (190, 190, 190)
MAGENTA: Colour = (204, 0, 204)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)


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
    """Return a colour as a web page wants it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def components_of(patches: Iterable[str]) -> list[str]:
    """Return the components among patches that have a colour, in the order of `COMPONENTS`."""
    present = {component(patch) for patch in patches}
    return [name for name in COMPONENTS if name in present]


def quality_rgb(quality: FloatArray) -> IntArray:
    """Return the colours (F, 3) of qualities (F,)."""
    return _rgb(QUALITY_MAP, QUALITY_RANGE(quality))


CHANGE_MAP = "RdBu"
CHANGE_RANGE = Normalize(-0.2, 0.2)
"""From cells that lose quality, red, to those that gain it."""


def change_rgb(change: FloatArray) -> IntArray:
    """Return the colours (F, 3) of changes of quality (F,)."""
    return _rgb(CHANGE_MAP, np.clip(CHANGE_RANGE(change), 0.0, 1.0))


def moved_rgb(shares: FloatArray) -> IntArray:
    """Return the colours (F, 3) of displacements (F,), as shares of the largest."""
    return _rgb(MOVED_MAP, shares)


def _rgb(scale: str, shares: Any) -> IntArray:
    return np.asarray(np.rint(255.0 * mpl.colormaps[scale](shares)[:, :3]), dtype=np.intp)


MOVED_MAP = "YlOrRd"
"""From nodes that stay to those that move farthest."""


def moved_faces(mesh: Mesh, names: Iterable[str], lengths: FloatArray, **looks: Any) -> tuple[Layer, ...]:
    """Return the faces of patches, coloured by how far their nodes moved: `lengths` (N,), of all nodes."""
    most = float(lengths.max(initial=0.0)) or 1.0
    faces = by_size(faces for name in names for faces in mesh.patch(name).faces)
    return tuple(Layer(mesh.points, c, _rgb(MOVED_MAP, lengths[c].mean(axis=1) / most), **looks) for c in faces)


BOX_EDGES = np.array(EDGES)


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


def by_size(faces: Iterable[Faces]) -> list[IntArray]:
    """Return faces as arrays (F, k), one for each number k of corners."""
    found: dict[int, list[IntArray]] = {}
    for block in faces:
        if isinstance(block, Cells):
            found.setdefault(block.nodes.shape[1], []).append(block.nodes)
            continue
        sizes = np.diff(block.offsets)
        for k in np.unique(sizes):
            rows = block.offsets[:-1][sizes == k, None] + np.arange(k)
            found.setdefault(int(k), []).append(block.nodes[rows])
    return [np.concatenate(found[k]) for k in sorted(found)]


def triangles_of(faces: Iterable[Faces]) -> IntArray:
    """Return faces cut into triangles (T, 3) of the same normals, all from a face's first corner; flat for lines."""
    parts = [np.empty((0, 3), dtype=np.intp)]
    for cells in by_size(faces):
        if cells.shape[1] == 2:
            parts.append(cells[:, [0, 1, 1]])
        parts += [cells[:, [0, i, i + 1]] for i in range(1, cells.shape[1] - 1)]
    return np.concatenate(parts)


def box(corners: FloatArray, width: float = 3.0) -> Layer:
    """Return the edges of a hexahedron (8, 3)."""
    return plain(corners, BOX_EDGES, MAGENTA, width=width)

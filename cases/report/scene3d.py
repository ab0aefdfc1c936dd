"""What a picture shows, as plain arrays with colours: no graphics library is needed to compose or to test one."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import NDArray

from sdm_deflect.cases.sdm.job import BLOCK
from sdm_deflect.deform.edges import median_edge
from sdm_deflect.deform.mesh import Cells
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.meshing.mesh import BoolArray, FloatArray, IntArray, TetMesh

Array = NDArray[np.generic]
Colour = tuple[int, int, int]
ARRAYS = ("points", "cells", "rgb")
LOOKS = ("opacity", "edge", "width", "ambient")
MARGIN = 1.08
"""Size of a picture over what it frames."""
FINEST = 4.0
"""Edges of triangles shorter than so many pixels are not drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Triangles, lines or dots.

    Attributes
    ----------
    points : (N, 3), metres.
    cells : (F, k) node indices: k = 3 for triangles, 2 for lines, 1 for dots.
    rgb : (F, 3) colour of each cell, or (1, 3) for all, 0 to 255.
    opacity : 0 to 1.
    edge : colour of the triangles' edges, or None for none.
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
        if self.cells.ndim != 2 or self.cells.shape[1] not in (1, 2, 3):
            raise ValueError(f"cells {self.cells.shape} must be (F, 1), (F, 2) or (F, 3)")
        if self.rgb.shape not in ((len(self.cells), 3), (1, 3)):
            raise ValueError(f"rgb {self.rgb.shape} must be ({len(self.cells)}, 3) or (1, 3)")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Layers seen by parallel projection.

    Attributes
    ----------
    focus : (3,) point in the middle of the picture, metres.
    towards : (3,) direction from there to the eye.
    height : of the picture, in metres at the focus.
    pixels : width and height.
    up : (3,) direction that is up in the picture.
    """

    layers: tuple[Layer, ...]
    focus: FloatArray
    towards: tuple[float, float, float]
    height: float
    pixels: tuple[int, int] = (800, 600)
    up: tuple[float, float, float] = field(default=(0.0, 0.0, 1.0))


def framed(
    layers: tuple[Layer, ...], points: FloatArray, towards: tuple[float, float, float], pixels: tuple[int, int]
) -> View:
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
    """Return the view without the edges of triangles so small in it that they would blacken it."""
    pixel = view.height / view.pixels[1]
    layers = (replace(one, edge=None) if one.edge and _edge(one) < FINEST * pixel else one for one in view.layers)
    return replace(view, layers=tuple(layers))


def _edge(layer: Layer) -> float:
    """Return the median length (m) of the triangles' edges."""
    return median_edge(layer.points, [Cells("triangle", layer.cells)])


def plain(points: FloatArray, cells: IntArray, colour: Colour, **looks: Any) -> Layer:
    """Return cells of one colour."""
    return Layer(points, cells, np.array([colour], dtype=np.intp), **looks)


def dots(points: FloatArray, colour: Colour, size: float) -> Layer:
    """Return points (N, 3) as dots."""
    return plain(points, np.arange(len(points))[:, None], colour, width=size)


def encoded(views: tuple[View, ...]) -> dict[str, Array]:
    """Return views as named arrays, for another process."""
    arrays: dict[str, Array] = {}
    description = []
    for i, view in enumerate(views):
        for j, layer in enumerate(view.layers):
            arrays |= {f"{i}.{j}.{name}": getattr(layer, name) for name in ARRAYS}
        description.append({
            "layers": [{name: getattr(one, name) for name in LOOKS} for one in view.layers],
            "focus": view.focus.tolist(), "towards": view.towards, "height": view.height, "pixels": view.pixels,
            "up": view.up,
        })  # fmt: skip
    return arrays | {"views": np.array(json.dumps(description))}


def decoded(arrays: Mapping[str, Array]) -> tuple[View, ...]:
    """Return the views that `encoded` wrote."""
    views = []
    for i, view in enumerate(json.loads(str(arrays["views"]))):
        layers = tuple(
            Layer(*(np.asarray(arrays[f"{i}.{j}.{name}"]) for name in ARRAYS), **_tuples(looks))  # type: ignore[arg-type]
            for j, looks in enumerate(view.pop("layers"))
        )
        views.append(View(layers, np.array(view.pop("focus")), **_tuples(view)))
    return tuple(views)


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


QUALITY_MAP = "cividis"
QUALITY_RANGE = Normalize(0.4, 1.0)
"""Mean ratios below 0.4 get the darkest colour."""

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

OTHERS = ("#4477aa", "#ee8866", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbcc33", "#99ddff")
"""For patches that are no component of our aircraft: taken in turn by the letters of the name."""

DARK: Colour = (90, 90, 90)
GREY: Colour = (190, 190, 190)
MAGENTA: Colour = (204, 0, 204)
ORANGE: Colour = (213, 94, 0)
BLUE: Colour = (0, 114, 178)


def component(patch: str) -> str:
    """Return the component that a patch belongs to; left and right are alike."""
    stem = patch.removesuffix("_left").removesuffix("_right")
    return "fuselage" if stem.startswith("fuselage") else stem


def patch_colour(patch: str) -> Colour:
    """Return the colour of a patch's component."""
    name = component(patch)
    colour = COMPONENTS.get(name) or OTHERS[crc32(name.encode()) % len(OTHERS)]
    r, g, b = (round(255 * share) for share in to_rgb(colour))
    return r, g, b


def hexadecimal(colour: Colour) -> str:
    """Return a colour as a web page wants it."""
    r, g, b = colour
    return f"#{r:02x}{g:02x}{b:02x}"


def components_of(patches: Iterable[str]) -> list[str]:
    """Return the components among patches that have a colour, in the order of `COMPONENTS`."""
    present = {component(patch) for patch in patches}
    return [name for name in COMPONENTS if name in present]


def quality_rgb(quality: FloatArray) -> IntArray:
    """Return the colours (F, 3) of mean ratios (F,)."""
    shades = mpl.colormaps[QUALITY_MAP](QUALITY_RANGE(quality))[:, :3]
    return np.asarray(np.rint(255.0 * shades), dtype=np.intp)


TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
BOX_EDGES = np.array([[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit])
"""Edges of a hexahedron whose corner i has the binary code zyx."""
EDGE: Colour = (40, 40, 40)
FAR_FIELD = "far_field"


def patches(mesh: TetMesh, names: Iterable[str], colour: Colour | None = None, **looks: object) -> tuple[Layer, ...]:
    """Return the surface meshes of patches, in one colour or in those of their components."""
    return tuple(plain(mesh.points, mesh.triangles_of(name), colour or patch_colour(name), **looks) for name in names)


def walls(mesh: TetMesh) -> list[str]:
    """Return the patches of the aircraft itself."""
    return [name for name in mesh.names[1:] if name not in (FAR_FIELD, BLOCK)]


def shell(tets: IntArray) -> tuple[IntArray, IntArray]:
    """Return the triangles (F, 3) that bound a set of tetrahedra (M, 4), and the row (F,) of each one's cell."""
    faces = tets[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    return faces[outer], outer // 4


def cells_by_quality(mesh: TetMesh, chosen: BoolArray, **looks: object) -> Layer:
    """Return the outside of the chosen (M,) cells, coloured by their mean ratio."""
    tets = mesh.tets[chosen]
    triangles, cell = shell(tets)
    rgb = quality_rgb(mean_ratio(mesh.points, tets)[cell])
    return Layer(mesh.points, triangles, rgb, **{"edge": EDGE, "ambient": 0.85, **looks})  # type: ignore[arg-type]


def centroids(mesh: TetMesh) -> FloatArray:
    """Return the centroids (M, 3) of the cells."""
    return np.asarray(mesh.points[mesh.tets].mean(axis=1))


def box(corners: FloatArray, width: float = 3.0) -> Layer:
    """Return the edges of a hexahedron (8, 3)."""
    return plain(corners, BOX_EDGES, MAGENTA, width=width)

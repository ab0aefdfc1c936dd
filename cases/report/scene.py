"""What a picture shows, as plain arrays: no graphics library is needed to compose or to test one."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.meshing.mesh import FloatArray, IntArray

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
    layers = (
        replace(one, edge=None) if one.edge and median_edge(one) < FINEST * pixel else one for one in view.layers
    )
    return replace(view, layers=tuple(layers))


def median_edge(layer: Layer) -> float:
    """Median length (m) of the triangles' edges; 0 without triangles."""
    corners = layer.points[layer.cells]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.median(lengths)) if lengths.size else 0.0


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

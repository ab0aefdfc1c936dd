"""Views drawn sample by sample, without a graphics library: of what lies behind a sample the nearest is seen."""

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.scene3d import Layer, View, legible
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.compiled import compiled_exactly
from sdm_deflect.deform.base.sets import distinct

Image = NDArray[np.uint8]
Canvas = NDArray[np.float32]

FINER = 2
"""Samples along each side of a pixel; a pixel has the mean of their colours."""
LIGHT = np.array([0.1, 0.45, 0.89])
"""Where the light comes from: shares to the right, upwards and towards the eye."""
LIFT = 1.5
"""Lines on faces are drawn so much nearer, in widths of the line: else the faces they bound hide half of them."""


def rendered(views: tuple[View, ...]) -> tuple[Image, ...]:
    """Return the images (H, W, 3) of views."""
    return tuple(image(view) for view in views)


def image(view: View) -> Image:
    """Draw one view: faces first, then lines and dots, then what is transparent."""
    view = legible(view)
    width, height = FINER * view.pixels[0], FINER * view.pixels[1]
    canvas = np.full((height, width, 3), 255.0, dtype=np.float32)
    nearest = np.full((height, width), -np.inf)
    placed = [(layer, *_placed(view, layer)) for layer in view.layers]
    faces = [parts for parts in placed if parts[0].cells.shape[1] > 2]
    for parts in faces:
        if parts[0].opacity == 1.0:
            _draw_faces(*parts, canvas, nearest)
    for parts in placed:
        _draw_lines(*parts, canvas, nearest)
    for parts in faces:
        if parts[0].opacity < 1.0:
            _draw_faces(*parts, canvas, nearest)
    samples = [canvas[i::FINER, j::FINER] for i in range(FINER) for j in range(FINER)]
    return np.asarray(np.rint(sum(samples) / FINER**2), dtype=np.uint8)


def _placed(view: View, layer: Layer) -> tuple[FloatArray, IntArray]:
    """Return column, row and nearness (K, 3), in samples, of the nodes of a layer, and its cells in their numbers."""
    eye = np.array(view.towards) / np.linalg.norm(view.towards)
    right = np.cross(view.up, eye)
    right /= np.linalg.norm(right)
    scale = FINER * view.pixels[1] / view.height
    middle = 0.5 * FINER * np.array([*view.pixels, 0.0])
    nodes = distinct(layer.cells.ravel())
    seen = middle + scale * (layer.points[nodes] - view.focus) @ np.array([right, -np.cross(eye, right), eye]).T
    return seen, np.searchsorted(nodes, layer.cells)


def _draw_faces(layer: Layer, seen: FloatArray, cells: IntArray, canvas: Canvas, nearest: FloatArray) -> None:
    fill(seen, cells, layer.rgb.astype(np.float64), (layer.ambient, layer.opacity), LIGHT, canvas, nearest)


def _draw_lines(layer: Layer, seen: FloatArray, cells: IntArray, canvas: Canvas, nearest: FloatArray) -> None:
    """Draw a layer of lines or dots, or the edges of its faces."""
    rgb = layer.rgb if cells.shape[1] < 3 else np.array([layer.edge] if layer.edge else [])
    if len(rgb):
        stroke(seen, cells, rgb.astype(np.float64), FINER * max(1.0, layer.width), LIFT, canvas, nearest)


@compiled_exactly
def fill(
    seen: FloatArray, cells: IntArray, rgb: FloatArray, looks: tuple[float, float], light: FloatArray,
    canvas: Canvas, nearest: FloatArray,
) -> None:  # fmt: skip
    """Draw faces (F, k), cut into triangles from their first corner, where nothing nearer is drawn.

    Parameters
    ----------
    seen : (N, 3) column, row and nearness of nodes, in samples.
    rgb : (F, 3) colour of each face, or (1, 3) of all.
    looks : Share of the light that falls from everywhere; opacity. Faces that are transparent hide nothing.
    light : (3,) direction to the other light.
    canvas : (H, W, 3) colours, overwritten.
    nearest : (H, W) nearness of what is drawn, overwritten.
    """
    for face in range(len(cells)):
        for i in range(1, cells.shape[1] - 1):
            corners = cells[face, 0], cells[face, i], cells[face, i + 1]
            _triangle(seen, corners, rgb[min(face, len(rgb) - 1)], looks, light, canvas, nearest)


@compiled_exactly
def _triangle(
    seen: FloatArray, corners: tuple[int, int, int], colour: FloatArray, looks: tuple[float, float], light: FloatArray,
    canvas: Canvas, nearest: FloatArray,
) -> None:  # fmt: skip
    x, y, z = seen[corners[0], 0], seen[corners[0], 1], seen[corners[0], 2]
    bx, by, bz = seen[corners[1], 0] - x, seen[corners[1], 1] - y, seen[corners[1], 2] - z
    cx, cy, cz = seen[corners[2], 0] - x, seen[corners[2], 1] - y, seen[corners[2], 2] - z
    left, right = _span(x + min(0.0, bx, cx), x + max(0.0, bx, cx), canvas.shape[1])
    top, bottom = _span(y + min(0.0, by, cy), y + max(0.0, by, cy), canvas.shape[0])
    area = bx * cy - by * cx
    if area == 0.0 or left >= right or top >= bottom:
        return
    share = _lit(by * cz - bz * cy, bz * cx - bx * cz, area, looks[0], light)
    for row in range(top, bottom):
        for column in range(left, right):
            across, down = column + 0.5 - x, row + 0.5 - y
            v, w = (across * cy - down * cx) / area, (down * bx - across * by) / area
            near = z + v * bz + w * cz
            if v >= 0.0 and w >= 0.0 and v + w <= 1.0 and near > nearest[row, column]:
                for i in range(3):
                    canvas[row, column, i] += looks[1] * (share * colour[i] - canvas[row, column, i])
                if looks[1] == 1.0:
                    nearest[row, column] = near


@compiled_exactly
def _lit(x: float, y: float, z: float, ambient: float, light: FloatArray) -> float:
    """Return the share of its colour in which a face of some normal appears: the side that is seen is lit."""
    towards = (x * light[0] - y * light[1] + z * light[2]) / np.sqrt(x * x + y * y + z * z)
    share: float = ambient + (1.0 - ambient) * max(0.0, towards if z > 0.0 else -towards)
    return share


@compiled_exactly
def stroke(
    seen: FloatArray, cells: IntArray, rgb: FloatArray, width: float, lift: float, canvas: Canvas, nearest: FloatArray
) -> None:
    """Draw the edges of faces (F, k), lines (F, 2) or dots (F, 1), in samples `width` wide, as `fill` does faces."""
    count = cells.shape[1]
    for face in range(len(cells)):
        for i in range(count if count != 2 else 1):
            ends = cells[face, i], cells[face, (i + 1) % count]
            _line(seen, ends, rgb[min(face, len(rgb) - 1)], width, lift, canvas, nearest)


@compiled_exactly
def _line(
    seen: FloatArray, ends: tuple[int, int], colour: FloatArray, width: float, lift: float,
    canvas: Canvas, nearest: FloatArray,
) -> None:  # fmt: skip
    x, y, z = seen[ends[0], 0], seen[ends[0], 1], seen[ends[0], 2]
    bx, by, bz = seen[ends[1], 0] - x, seen[ends[1], 1] - y, seen[ends[1], 2] - z
    half, square = 0.5 * width, max(1e-9, bx * bx + by * by)
    left, right = _span(x + min(0.0, bx) - half, x + max(0.0, bx) + half, canvas.shape[1])
    top, bottom = _span(y + min(0.0, by) - half, y + max(0.0, by) + half, canvas.shape[0])
    for row in range(top, bottom):
        for column in range(left, right):
            across, down = column + 0.5 - x, row + 0.5 - y
            share = min(1.0, max(0.0, (across * bx + down * by) / square))
            away = (across - share * bx) ** 2 + (down - share * by) ** 2
            near = z + share * bz + lift * width
            if away <= half * half and near > nearest[row, column]:
                for i in range(3):
                    canvas[row, column, i] = colour[i]
                nearest[row, column] = near


@compiled_exactly
def _span(low: float, high: float, most: int) -> tuple[int, int]:
    """Return the first sample of a range of places, and the one after its last, within a picture."""
    return int(max(0.0, np.floor(low))), int(min(float(most), np.ceil(high) + 1.0))

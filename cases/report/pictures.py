"""Every picture of a run: rendered views put together, saved, with what each shows in words."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image as ImageFile

from sdm_deflect.cases.report import figures, scene3d, slices
from sdm_deflect.cases.report.data import METRES, Box, Length, MovedSurface, ReportData, round_length
from sdm_deflect.cases.report.raster import Image, rendered
from sdm_deflect.deform.base.arrays import FloatArray

INCHES = 5.2
"""Width of one image."""
TITLE = 0.35
"""Inches above it."""


class Drawing(Figure):
    """A figure that notebooks show as it is; they show matplotlib's own only if its backend is loaded."""

    def _repr_png_(self) -> bytes:
        drawn = BytesIO()
        self.savefig(drawn, format="png")
        return drawn.getvalue()


@dataclass(frozen=True, slots=True)
class Picture:
    """Views and what is written around them.

    Attributes
    ----------
    views, titles : row by row.
    columns : how many images stand side by side.
    legend : colours by name.
    quality : True for a colour bar of the mean ratio.
    farthest : for a colour bar of displacements, the largest one; else 0.
    alternative : what the picture shows, in words.
    length : the unit of length.
    """

    views: tuple[scene3d.View, ...]
    titles: tuple[str, ...]
    alternative: str
    columns: int = 2
    legend: dict[str, str] = field(default_factory=dict)
    quality: bool = False
    farthest: float = 0.0
    length: Length = METRES


def figure_of(picture: Picture) -> Drawing:
    """Render the views and put them together."""
    return assembled(picture, rendered(picture.views))


def assembled(picture: Picture, images: Sequence[Image]) -> Drawing:
    """Put the images (H, W, 3) of a picture's views together."""
    rows = -(-len(images) // picture.columns)
    width, height = picture.views[0].pixels
    across, scaled = INCHES * picture.columns, picture.quality or picture.farthest > 0.0
    size = across + 1.0 * scaled, rows * (INCHES * height / width + TITLE)
    figure = Drawing(figsize=size, layout="constrained" if scaled or picture.legend else None)
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
    if picture.quality:
        shades = ScalarMappable(scene3d.QUALITY_RANGE, scene3d.QUALITY_MAP)
        figure.colorbar(shades, ax=axes.tolist(), label="mean ratio of a cell", extend="min", shrink=0.85)
    if picture.farthest:
        shades = ScalarMappable(Normalize(0.0, picture.length.factor * picture.farthest), scene3d.MOVED_MAP)
        figure.colorbar(shades, ax=axes.tolist(), label=f"displacement, {picture.length.shown}", shrink=0.85)
    if picture.legend:
        handles = [Patch(facecolor=colour, edgecolor="0.3", label=name) for name, colour in picture.legend.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize="small", frameon=False)
    return figure


def _scale(axes: Axes, view: scene3d.View, unit: Length) -> None:
    """Draw a bar of a round length across the line of sight: parallel projection has one scale."""
    width, height = view.pixels
    pixel = view.height / height
    length = round_length(0.25 * width * pixel)
    right, low = 0.97 * width, 0.95 * height
    axes.plot([right - length / pixel, right], [low, low], color="black", lw=2.5)
    axes.annotate(unit.text(length, "g"), (right, low - 0.015 * height), fontsize="small", va="bottom", ha="right")


PIXELS = (900, 640)
LINES: dict[str, Any] = {"edge": (70, 70, 70), "width": 0.7}
STILL: scene3d.Colour = (216, 219, 223)
"""Of walls that do not move: those that do stand out from it."""
BEHIND, BESIDE, ABOVE = 1.0, 0.6, 0.45
"""Direction from a surface to the eye: along its chord, along its span away from the middle, upwards."""


def moved(data: ReportData, own: Box) -> Picture:
    """Draw each surface in a box before, and after, coloured by how far the nodes moved."""
    lengths = np.linalg.norm(data.points - data.mesh.points, axis=1)
    layers = scene3d.moved_faces(data.mesh.with_points(data.points), data.drawn, lengths, **LINES)
    rows = [(surface, close(data, data.mesh.points, own, surface)) for surface in own.surfaces]
    titles = [(f"{surface.name}, undeflected", f"{surface.name}, {surface.turned}") for surface, _ in rows]
    return Picture(
        tuple(view for _, before in rows for view in (before, replace(before, layers=(*layers, before.layers[-1])))),
        tuple(title for pair in titles for title in pair),
        "Surfaces before, and after, coloured by how far their nodes moved.",
        farthest=float(lengths.max()),
        length=data.length,
    )


def close(data: ReportData, points: FloatArray, own: Box, surface: MovedSurface) -> scene3d.View:
    """Look at a moving surface; the picture holds it before and after."""
    held = np.vstack([data.mesh.points[surface.nodes], data.points[surface.nodes]])
    moving = [name for one in data.surfaces for name in one.patches]
    mesh, still = data.mesh.with_points(points), [name for name in data.drawn if name not in moving]
    layers = scene3d.patches(mesh, still, STILL, ambient=0.5, **LINES)
    layers += scene3d.patches(
        mesh, [name for name in data.drawn if name in moving], moving=moving, ambient=0.5, **LINES
    )
    box = scene3d.box(own.hexahedron.corners, 2.5)
    return scene3d.framed((*layers, box), held, towards(data, own, surface), PIXELS)


def towards(data: ReportData, own: Box, surface: MovedSurface) -> tuple[float, float, float]:
    """Return the direction to the eye: from behind the surface, from above (z), from its outer end."""
    chord = slices.directions(data.mesh.points, surface)[1] % 2 if surface.axis is not None else 0
    eye = np.array([0.0, 0.0, ABOVE])
    outwards = (own.hexahedron.corners.mean(axis=0) - data.middle)[1 - chord]
    size = float(np.ptp(own.hexahedron.corners, axis=0).max())
    reach = surface.axis.radial(data.mesh.points[surface.nodes])[:, chord] if surface.axis else np.ones(1)
    eye[chord] = -BEHIND if -reach.min() > 1.5 * reach.max() else BEHIND
    eye[1 - chord] = BESIDE if outwards > 1e-6 * size else -BESIDE
    return float(eye[0]), float(eye[1]), float(eye[2])


LARGEST = 300_000
"""Bytes that a picture should not exceed."""
LADDER = ((110, 1), (110, 4), (95, 4), (80, 4), (65, 4))
"""Dots per inch, and colours (0 to 255) rounded to multiples: the first that makes the file small enough counts."""
SHARP = 92
"""Dots per inch of a picture for a page that may be printed."""
WHITE = 252
"""Colours (0 to 255) from which on white was meant."""


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure, no coarser than its size demands; white stays white."""
    for dpi, step in LADDER:
        pixels = np.asarray(pixels_of(figure, dpi), dtype=np.intp)
        rounded = np.minimum(255, (pixels + step // 2) // step * step).astype(np.uint8)
        data = BytesIO()
        ImageFile.fromarray(rounded).save(data, "png", optimize=True)
        if data.tell() <= LARGEST:
            break
    path.write_bytes(data.getvalue())


def write_sharp_png(figure: Figure, path: Path) -> None:
    """Write a figure with fine lines in the colours that represent it best; white stays white."""
    pixels = pixels_of(figure, SHARP).quantize(96, method=ImageFile.Quantize.FASTOCTREE, dither=ImageFile.Dither.NONE)
    pixels.putpalette([shade if shade < WHITE else 255 for shade in pixels.getpalette() or ()])
    pixels.save(path, "png")


def pixels_of(figure: Figure, dpi: int) -> ImageFile.Image:
    """Return a figure as coloured pixels."""
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return ImageFile.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


Drawn = tuple[str, str, Figure, str]
"""Part of the page, name of a surface, figure, and what it shows in words."""


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A picture in a file: the part of the page it belongs to, and what it shows in words."""

    part: str
    path: Path
    alternative: str


@dataclass(frozen=True, slots=True)
class Gallery:
    """All pictures."""

    exhibits: tuple[Exhibit, ...]

    def of(self, part: str) -> list[Exhibit]:
        """Return the pictures of one part of the page."""
        return [one for one in self.exhibits if one.part == part]

    def with_more(self, exhibits: Sequence[Exhibit]) -> "Gallery":
        """Return the gallery with further pictures."""
        return replace(self, exhibits=(*self.exhibits, *exhibits))


def drawn(data: ReportData, folder: Path) -> Gallery:
    """Draw every picture that needs no verdict into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    return Gallery(tuple(saved(folder, *drawing) for drawing in plots(data.near)))


def plots(data: ReportData) -> Iterator[Drawn]:
    """Yield each picture that needs no verdict."""
    yield "convergence", "", *figures.convergence(data)
    if data.mesh.cells:
        yield "quality", "", *figures.quality(data)
        for own in data.boxes:
            for surface in own.surfaces:
                yield "slices", surface.name, *slices.slices(data, own, surface)


def saved(folder: Path, part: str, name: str, figure: Figure, alternative: str) -> Exhibit:
    """Write a figure of one part of the page, such as of one surface, into a folder."""
    harmless = re.sub(r"[^\w.+-]", "_", f"{part}_{name}" if name else part)
    path = folder / f"{harmless}.png"
    write_sharp_png(figure, path)
    return Exhibit(part, path, alternative)

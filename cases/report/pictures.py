"""Every picture of a run: rendered views put together, saved, with what each shows in words."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image as ImageFile

from sdm_deflect.cases.report import cad_map, figures, slices
from sdm_deflect.cases.report.data import ReportData
from sdm_deflect.cases.report.offscreen import Image, RenderError, rendered, rendering
from sdm_deflect.cases.report.scene3d import QUALITY_MAP, QUALITY_RANGE, View, box, framed, patches, walls
from sdm_deflect.cases.sdm.job import BLOCK
from sdm_deflect.deform.volume.deflection import Plan
from sdm_deflect.meshing.mesh import TetMesh

INCHES = 5.2
"""Width of one image."""
ROUND_LENGTHS = tuple(first * 10.0**power for power in range(-6, 3) for first in (1, 2, 5))


@dataclass(frozen=True, slots=True)
class Picture:
    """Views and what is written around them.

    Attributes
    ----------
    views, titles : row by row.
    columns : how many images stand side by side.
    legend : colours by name.
    quality : True for a colour bar of the mean ratio.
    alternative : what the picture shows, in words.
    """

    views: tuple[View, ...]
    titles: tuple[str, ...]
    alternative: str
    columns: int = 2
    legend: dict[str, str] = field(default_factory=dict)
    quality: bool = False


def figure_of(picture: Picture) -> Figure:
    """Render the views and put them together.

    Raises
    ------
    RenderError
        If the views cannot be rendered.
    """
    return assembled(picture, rendered(picture.views))


def assembled(picture: Picture, images: Sequence[Image]) -> Figure:
    """Put the images (H, W, 3) of a picture's views together."""
    rows = -(-len(images) // picture.columns)
    width, height = picture.views[0].pixels
    size = (INCHES * picture.columns + 1.0 * picture.quality, rows * (INCHES * height / width + 0.35))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, picture.columns, squeeze=False).ravel()
    for one, shown, view, title in zip(axes, images, picture.views, picture.titles, strict=True):
        one.imshow(shown)
        one.set_title(title, fontsize="medium")
        one.set_axis_off()
        _scale(one, view)
    if picture.quality:
        shades = ScalarMappable(QUALITY_RANGE, QUALITY_MAP)
        figure.colorbar(shades, ax=axes.tolist(), label="mean ratio of a cell", extend="min", shrink=0.85)
    if picture.legend:
        handles = [Patch(facecolor=colour, edgecolor="0.3", label=name) for name, colour in picture.legend.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize="small", frameon=False)
    return figure


def _scale(axes: Axes, view: View) -> None:
    """Draw a bar of a round length across the line of sight: parallel projection has one scale."""
    width, height = view.pixels
    metres = view.height / height
    longest = 0.25 * width * metres
    length = max(round_length for round_length in ROUND_LENGTHS if round_length <= longest)
    right, low = 0.97 * width, 0.95 * height
    axes.plot([right - length / metres, right], [low, low], color="black", lw=2.5)
    axes.annotate(f"{1e3 * length:g} mm", (right, low - 0.015 * height), fontsize="small", va="bottom", ha="right")


PIXELS = (900, 640)
TOWARDS = (1.0, -0.6, 0.45)
"""From behind, port and above; mirrored for surfaces to starboard."""


def before_after(data: ReportData, plan: Plan) -> Picture:
    """Draw a control surface with its hexahedron, before and after side by side."""
    moved = np.linalg.norm(data.deflected.points - data.mesh.points, axis=1)[plan.sites.moving]
    count = len(data.mesh.triangles_of(plan.surface))
    return Picture(
        tuple(close(data, mesh, plan) for mesh in (data.mesh, data.deflected)),
        (f"{plan.surface}, undeflected", f"{plan.surface}, {plan.angle:+g} deg"),
        f"Surface mesh of {plan.surface} ({count} triangles) and its surroundings before (left) and after (right) it "
        f"turns by {plan.angle:+g} deg; nodes move by up to {1e3 * moved.max():.1f} mm. The edges of the hexahedron, "
        "outside of which nothing moves, are magenta.",
    )


def close(data: ReportData, mesh: TetMesh, plan: Plan) -> View:
    """Look at a control surface; the picture holds it before and after."""
    nodes = mesh.on(plan.surface)
    held = np.vstack([data.mesh.points[nodes], data.deflected.points[nodes]])
    corners = plan.region.hexahedron.corners
    names = [name for name in walls(mesh) if name != BLOCK]
    side = 1.0 if corners[:, 1].mean() <= 1e-9 else -1.0
    layers = (*patches(mesh, names, edge=(70, 70, 70), width=0.7), box(corners, 2.5))
    return framed(layers, held, (TOWARDS[0], side * TOWARDS[1], TOWARDS[2]), PIXELS)


LARGEST = 300_000
"""Bytes that a picture should not exceed."""
LADDER = ((110, 1), (110, 4), (95, 4), (80, 4), (65, 4))
"""Dots per inch, and colours (0 to 255) rounded to multiples: the first that makes the file small enough counts."""
SHARP, SHADES = 140, 256
"""Dots per inch and colours of a picture for a page that may be printed."""


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure, no coarser than its size demands."""
    for dpi, step in LADDER:
        data = compressed(figure, dpi, step)
        if len(data) <= LARGEST:
            break
    path.write_bytes(data)


def write_sharp_png(figure: Figure, path: Path) -> None:
    """Write a figure with fine lines in the colours that represent it best."""
    figure.set_dpi(SHARP)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    few = ImageFile.fromarray(pixels).quantize(SHADES, ImageFile.Quantize.MAXCOVERAGE, dither=ImageFile.Dither.NONE)
    few.save(path, "png")


def compressed(figure: Figure, dpi: int, step: int) -> bytes:
    """Return the PNG of a figure, its colours rounded to multiples of `step`; white stays white."""
    drawn = BytesIO()
    figure.savefig(drawn, dpi=dpi, format="png")
    with ImageFile.open(drawn) as full:
        pixels = np.asarray(full.convert("RGB"), dtype=np.intp)
    rounded = np.minimum(255, (pixels + step // 2) // step * step).astype(np.uint8)
    buffer = BytesIO()
    ImageFile.fromarray(rounded).save(buffer, "png", optimize=True)
    return buffer.getvalue()


Drawn = tuple[str, str, Figure, str]
"""Part of the page, name, figure, and what it shows in words."""


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A picture in a file: the part of the page it belongs to, and what it shows in words."""

    part: str
    path: Path
    alternative: str


@dataclass(frozen=True, slots=True)
class Gallery:
    """All pictures, and why some could not be drawn (empty if all were)."""

    exhibits: tuple[Exhibit, ...]
    missing: str

    def of(self, part: str) -> list[Exhibit]:
        """Return the pictures of one part of the page."""
        return [one for one in self.exhibits if one.part == part]


def drawn(data: ReportData, folder: Path) -> Gallery:
    """Draw every picture that needs no validation into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [before_after(data, plan) for plan in data.plans]
    missing = ""
    with rendering(tuple(view for picture in pictures for view in picture.views)) as images:
        exhibits = [_saved(folder, *plot) for plot in plots(data)]
        try:
            exhibits += [_saved(folder, *one) for one in renderings(data, pictures, images())]
        except RenderError as error:
            missing = str(error)
    return Gallery(tuple(exhibits), missing)


def compared(data: ReportData, folder: Path) -> list[Exhibit]:
    """Draw the distances from the CAD that the validation found into `folder`."""
    maps = ((f"cad_map_{plan.surface}", *cad_map.cad_map(data, plan)) for plan in data.plans)
    return [_saved(folder, "cad_map", *one) for one in maps]


def plots(data: ReportData) -> Iterator[Drawn]:
    """Yield each plot that needs no graphics library."""
    yield "convergence", "convergence", *figures.convergence(data)
    yield "quality", "quality", *figures.quality(data)
    for plan in data.plans:
        yield "slices", f"slices_{plan.surface}", *slices.slices(data, plan)


def renderings(data: ReportData, pictures: Sequence[Picture], images: Sequence[Image]) -> Iterator[Drawn]:
    """Yield the pictures of each control surface, put together from the images of their views."""
    rest = iter(images)
    for plan, picture in zip(data.plans, pictures, strict=True):
        figure = assembled(picture, [next(rest) for _ in picture.views])
        yield "before_after", f"before_after_{plan.surface}", figure, picture.alternative


def _saved(folder: Path, part: str, name: str, figure: Figure, alternative: str) -> Exhibit:
    path = folder / f"{file_name(name)}.png"
    write_sharp_png(figure, path)
    return Exhibit(part, path, alternative)


def file_name(name: str) -> str:
    """Return a name without characters that mean something in a path."""
    return re.sub(r"[^\w.+-]", "_", name)

"""All pictures of a run, with descriptions: rendered views are combined and saved."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image as ImageFile

from . import figures, slices
from .data import ReportData

# Bytes that a picture should not exceed.
LARGEST = 300_000
# Dots per inch, and colours (0 to 255) rounded to multiples: the first that makes the file small enough counts.
LADDER = ((110, 1), (110, 4), (95, 4), (80, 4), (65, 4))
# Dots per inch of a picture for a paper.
SHOWN = 300
# Dots per inch of plots and of sections, which have fine lines, as a page shows them; pixels for one of the
# page: screens and paper have more.
PLAIN, FINE, SHARPER = 92, 110, 1.55
# Colours of a picture: with fewer, scales show steps.
COLOURS = 64
# Colours (0 to 255) from which on white was meant.
WHITE = 252
# Part of the page, name of a surface, figure, and what it shows in words.
Drawn = tuple[str, str, Figure, str]


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; resolution and colours are reduced only if the file is too large, white stays white."""
    for dpi, step in LADDER:
        pixels = np.asarray(pixels_of(figure, dpi), dtype=np.intp)
        rounded = np.minimum(255, (pixels + step // 2) // step * step).astype(np.uint8)
        data = BytesIO()
        ImageFile.fromarray(rounded).save(data, "png", optimize=True)
        if data.tell() <= LARGEST:
            break
    path.write_bytes(data.getvalue())


def pixels_of(figure: Figure, dpi: int) -> ImageFile.Image:
    """Return a figure as a colour image."""
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return ImageFile.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A picture in a file: its part of the page, its description and its figure."""

    part: str
    path: Path
    alternative: str
    figure: Figure | None = None

    def write(self, form: str) -> None:
        """Write the figure beside its file as pdf, svg or png, for a paper; equal figures give equal bytes."""
        if self.figure:
            dated = {"pdf": "CreationDate", "svg": "Date"}.get(form, "Software")
            with rc_context({"svg.hashsalt": self.part}):
                self.figure.savefig(self.path.with_suffix(f".{form}"), metadata={dated: None}, dpi=SHOWN)


@dataclass(frozen=True, slots=True)
class Gallery:
    """All pictures."""

    exhibits: tuple[Exhibit, ...]

    def of(self, part: str) -> list[Exhibit]:
        """Return the pictures of one part of the page."""
        return [exhibit for exhibit in self.exhibits if exhibit.part == part]

    def with_more(self, exhibits: Sequence[Exhibit]) -> "Gallery":
        """Return the gallery with further pictures."""
        return replace(self, exhibits=(*self.exhibits, *exhibits))


def draw_pictures(data: ReportData, folder: Path) -> Gallery:
    """Draw every picture that needs no verdict into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    return Gallery(tuple(save_figure(folder, *drawing) for drawing in plots(data.near)))


def plots(data: ReportData) -> Iterator[Drawn]:
    """Yield each picture that needs no verdict."""
    yield "convergence", "", *figures.convergence(data)
    if data.mesh.cells:
        yield "quality", "", *figures.quality(data)
        for box in data.boxes:
            for surface in box.surfaces:
                yield "slices", surface.name, *slices.slices(data, box, surface)


def save_figure(folder: Path, part: str, name: str, figure: Figure, alternative: str) -> Exhibit:
    """Write a figure of one part of the page, such as of one surface, into a folder."""
    harmless = re.sub(r"[^\w.+-]", "_", f"{part}_{name}" if name else part)
    path = folder / f"{harmless}.png"
    pixels = pixels_of(figure, round(SHARPER * (FINE if part == "slices" else PLAIN))).quantize(
        COLOURS, method=ImageFile.Quantize.FASTOCTREE, dither=ImageFile.Dither.NONE
    )
    pixels.putpalette([shade if shade < WHITE else 255 for shade in pixels.getpalette() or ()])
    pixels.save(path, "png", optimize=True)
    return Exhibit(part, path, alternative, figure)

"""PNG files of modest size."""

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

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
    few = Image.fromarray(pixels).quantize(SHADES, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(path, "png")


def compressed(figure: Figure, dpi: int, step: int) -> bytes:
    """Return the PNG of a figure, its colours rounded to multiples of `step`; white stays white."""
    drawn = BytesIO()
    figure.savefig(drawn, dpi=dpi, format="png")
    with Image.open(drawn) as full:
        pixels = np.asarray(full.convert("RGB"), dtype=np.intp)
    rounded = np.minimum(255, (pixels + step // 2) // step * step).astype(np.uint8)
    buffer = BytesIO()
    Image.fromarray(rounded).save(buffer, "png", optimize=True)
    return buffer.getvalue()

"""PNG files of modest size."""

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

DPI = 110
LARGEST = 300_000
"""Bytes that a picture should not exceed."""
STEPS = (1, 4, 8, 16)
"""Colours (0 to 255) are rounded to multiples of the first of these that makes the file small enough."""


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure, its shades rounded no more than its size demands."""
    buffer = BytesIO()
    figure.savefig(buffer, dpi=DPI, format="png")
    with Image.open(buffer) as full:
        pixels = np.asarray(full.convert("RGB"), dtype=np.intp)
    for step in STEPS:
        data = compressed(pixels, step)
        if len(data) <= LARGEST:
            break
    path.write_bytes(data)


def compressed(pixels: np.ndarray, step: int) -> bytes:
    """Return the PNG of pixels (H, W, 3) rounded to multiples of `step`; white stays white."""
    rounded = np.minimum(255, (pixels + step // 2) // step * step).astype(np.uint8)
    buffer = BytesIO()
    Image.fromarray(rounded).save(buffer, "png", optimize=True)
    return buffer.getvalue()

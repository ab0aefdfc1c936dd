"""PNG files of modest size."""

from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

DPI = 110


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure with a palette of 256 colours: a third of the bytes of full colour."""
    buffer = BytesIO()
    figure.savefig(buffer, dpi=DPI, format="png", metadata={"Software": None})
    with Image.open(buffer) as full:
        full.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)

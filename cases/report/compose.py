"""Rendered images side by side in one figure, with titles, a colour bar and a legend drawn by matplotlib."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sdm_deflect.cases.report.colours import QUALITY_MAP, QUALITY_RANGE
from sdm_deflect.cases.report.offscreen import Image, rendered
from sdm_deflect.cases.report.scene import View

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

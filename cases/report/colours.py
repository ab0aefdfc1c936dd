"""Colours of pages and pictures: what moves is blue, what stays is grey, what is worse is vermilion.

They are those of the style sheet's light scheme (`palette.css`), so that pages and figures agree.
"""

import re
from importlib.resources import files

from matplotlib.colors import LinearSegmentedColormap, Normalize, to_hex

PALETTE = dict(
    re.findall(
        r"--([\w-]+): (#\w+)", files(__package__).joinpath("palette.css").read_text(encoding="utf-8").partition("}")[0]
    )
)
MOVES, STAYS, EDGE, CELLS, BOX, WORSE = (PALETTE[name] for name in ("moves", "stays", "edge", "cells", "box", "worse"))
INK, SOFT, BAD = PALETTE["ink"], PALETTE["soft"], PALETTE["bad"]
# Of the directions x, y and z.
XYZ = MOVES, WORSE, INK
# Darkest ends of scales: of what is worse, of what moves, and of what is better.
DARKEST, NAVY, BETTER = "#6b1503", "#0b2c52", "#0a6b4f"


def _scale(name: str, *colours: str) -> LinearSegmentedColormap:
    return LinearSegmentedColormap.from_list(name, colours)


# Quality of poor cells from bad to good, loss of quality, its change, and displacement.
QUALITY = _scale("quality", DARKEST, WORSE, "#f7b79f", "#f1f3f5")
LOSS = _scale("loss", "#fdeae3", "#f2a184", WORSE, DARKEST)
CHANGE = _scale("change", WORSE, "#f7b79f", "#e6e9ec", "#8fc7b3", BETTER)
DISPLACEMENT = _scale("displacement", "#e6e9ec", "#8bb8e6", MOVES, NAVY)
# Least loss of quality that has a colour.
LOST = 0.05
# Ranges of quality, of its loss, and of its change; beyond them colours stay.
QUALITIES, LOSSES, CHANGES = Normalize(0.0, 1.0), Normalize(LOST, 0.4), Normalize(-0.2, 0.2)
# Number of colours by which a scale is sent to a page.
SHADES = 9


def shades(scale: LinearSegmentedColormap) -> list[list[object]]:
    """Return a scale as shares of its range and their colours."""
    return [[i / (SHADES - 1), to_hex(scale(i / (SHADES - 1)))] for i in range(SHADES)]

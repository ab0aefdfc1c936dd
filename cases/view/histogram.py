"""The histogram of the mean ratio as a drawing (SVG) that the page shows and changes."""

from collections.abc import Iterator

import numpy as np

from sdm_deflect.cases.report.scene3d import quality_rgb
from sdm_deflect.deform.mesh import FloatArray, IntArray

BINS = np.linspace(0.0, 1.0, 41)
WIDTH, HEIGHT, LEFT, BASE = 340.0, 126.0, 38.0, 96.0
"""Size of the drawing, and where its axes cross."""
TOP, RIGHT = 6.0, 12.0
COUNTS = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


def histogram(quality: FloatArray, before: FloatArray) -> str:
    """Draw the mean ratios (L,) as bars in the colours of the section, and those before as a line."""
    now, then = (np.histogram(one, BINS)[0] for one in (quality, before))
    top = max(10.0, float(then.max()) * 1.6)
    parts = [*_axes(top), *_bars(now, top), _line(then, top)]
    text = f"Histogram of the mean ratio of {len(quality)} cells, smallest {quality.min():.3f}"
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{text}" '
        'style="width:100%;font:10px sans-serif;fill:#333">' + "".join(parts) + "</svg>"
    )


def _x(value: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * value


def _y(count: float, top: float) -> float:
    """Return the height of a count: logarithmic above one."""
    share = np.log10(1.0 + count) / np.log10(1.0 + top)
    return float(BASE - (BASE - TOP) * min(share, 1.0))


def _axes(top: float) -> Iterator[str]:
    for count in (0, *(c for c in COUNTS if c <= top)):
        y = _y(count, top)
        yield f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>'
        yield f'<text x="{LEFT - 4}" y="{y + 3:.1f}" text-anchor="end">{count:,}</text>'
    for tick in np.linspace(0.0, 1.0, 6):
        yield f'<text x="{_x(tick):.1f}" y="{BASE + 13}" text-anchor="middle">{tick:.1f}</text>'
    yield f'<text x="{_x(0.5):.1f}" y="{HEIGHT - 4}" text-anchor="middle">mean ratio (1: regular, 0: flat)</text>'


def _bars(counts: IntArray, top: float) -> Iterator[str]:
    width = _x(BINS[1]) - _x(0.0)
    colours = quality_rgb(0.5 * (BINS[1:] + BINS[:-1]))
    for low, count, (r, g, b) in zip(BINS, counts, colours, strict=False):
        y = _y(count, top)
        yield (
            f'<rect x="{_x(low):.1f}" y="{y:.1f}" width="{width:.2f}" height="{BASE - y:.1f}" '
            f'fill="rgb({r},{g},{b})" stroke="#fff" stroke-width=".4"/>'
        )


def _line(counts: IntArray, top: float) -> str:
    corners = [f"{_x(BINS[0]):.1f},{BASE:.1f}"]
    for low, high, count in zip(BINS, BINS[1:], counts, strict=False):
        y = _y(count, top)
        corners += [f"{_x(low):.1f},{y:.1f}", f"{_x(high):.1f},{y:.1f}"]
    return f'<polyline points="{" ".join(corners)}" fill="none" stroke="#111" stroke-width="1.1"/>'

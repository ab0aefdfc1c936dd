"""Shape quality of tetrahedra: the mean ratio of the paper's section 5.1."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sdm_deflect.meshing.mesh import FloatArray, IntArray

# Rows handled at a time: temporaries stay in the processor's cache, and millions of cells in little memory.
BLOCK = 1 << 14


def signed_volumes(points: FloatArray, tets: IntArray) -> FloatArray:
    """Volume (M,) in cubic metres of each tetrahedron (M, 4), negative where it is inverted."""
    volumes = np.empty(len(tets))
    for rows in _blocks(len(tets)):
        _, volumes[rows] = _edges_and_volume(points, tets[rows])
    return volumes


def mean_ratio(points: FloatArray, tets: IntArray) -> FloatArray:
    """Mean ratio (M,) of each tetrahedron: 1 for the regular one, 0 for flat and inverted ones.

    Q = 12 (9 V^2)^(1/3) / (sum of the squared lengths of the six edges), the paper's footnote x.
    """
    quality = np.empty(len(tets))
    for rows in _blocks(len(tets)):
        squares, volume = _edges_and_volume(points, tets[rows])
        quality[rows] = 12.0 * np.cbrt(9.0 * np.maximum(volume, 0.0) ** 2) / squares
    return quality


@dataclass(frozen=True, slots=True)
class QualitySummary:
    """What a histogram of the mean ratio is judged by; the shares are fractions of all cells."""

    min: float
    p01: float
    mean: float
    below_0_2: float
    below_0_4: float
    inverted: int


def summarise(quality: FloatArray) -> QualitySummary:
    """Condense mean ratios (M,); a cell of quality 0 counts as inverted.

    Raises
    ------
    ValueError
        If there are no cells.
    """
    if not len(quality):
        raise ValueError("no cells to judge")
    return QualitySummary(
        min=float(quality.min()),
        p01=float(np.percentile(quality, 1.0)),
        mean=float(quality.mean()),
        below_0_2=float(np.mean(quality < 0.2)),
        below_0_4=float(np.mean(quality < 0.4)),
        inverted=int(np.count_nonzero(quality <= 0.0)),
    )


def _blocks(rows: int) -> Iterator[slice]:
    return (slice(start, start + BLOCK) for start in range(0, rows, BLOCK))


def _edges_and_volume(points: FloatArray, tets: IntArray) -> tuple[FloatArray, FloatArray]:
    """Sum of squared edge lengths (m^2) and signed volume (m^3) of each tetrahedron."""
    origin = points[tets[:, 0]]
    a, b, c = (points[tets[:, i]] - origin for i in (1, 2, 3))
    squares = sum(np.einsum("ij,ij->i", edge, edge) for edge in (a, b, c, b - a, c - a, c - b))
    volume = np.einsum("ij,ij->i", np.cross(a, b), c) / 6.0
    return np.asarray(squares), volume

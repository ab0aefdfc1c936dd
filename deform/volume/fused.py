"""Confined volume deformation (paper section 3)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.deform.rbf.greedy import Adaptation
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray, first_coincident
from sdm_deflect.deform.volume.hexahedron import Hexahedron


def fused(fits: Sequence[Adaptation]) -> Interpolant:
    """Return one interpolant with columns x, y, z on the union of all centres; zero for a direction without fit.

    The costly part of a pair, the logarithm, is then taken once for all directions that share a centre.
    """
    if not fits:
        raise ValueError("no adaptation to evaluate")
    kernel = fits[0].interpolant.kernel
    if any(f.interpolant.kernel != kernel for f in fits):
        raise ValueError("the adaptations have different kernels")
    components = [c for f in fits for c in f.components]
    if len(set(components)) != len(components):
        raise ValueError(f"two adaptations hold one direction: {components}")
    centers = np.vstack([f.interpolant.centers for f in fits])
    first = first_coincident(centers)
    keep = np.flatnonzero(first == np.arange(len(first)))
    place = np.searchsorted(keep, first)
    alpha, beta = np.zeros((4, 3)), np.zeros((len(keep), 3))
    start = 0
    for f in fits:
        rows = place[start : start + len(f.interpolant.centers)]
        columns = list(f.components)
        beta[rows[:, None], columns] = f.interpolant.beta
        alpha[:, columns] = f.interpolant.alpha
        start += len(rows)
    return Interpolant(kernel, centers[keep], beta, alpha)


def displacement(
    points: FloatArray, inside: IndexArray, interpolant: Interpolant, progress: Progress = silent
) -> FloatArray:
    """Return the displacement (N, 3) of points (N, 3): interpolated in rows `inside`, exactly zero elsewhere."""
    out = np.zeros_like(points)
    out[inside] = interpolant(points[inside], progress=progress)
    return out


def inside(points: FloatArray, region: Hexahedron, tol: float = 0.0) -> IndexArray:
    """Return the rows of points (N, 3) in the region: find them once, use them for every interpolant."""
    return np.flatnonzero(region.contains(points, tol))


class Prescribed(NamedTuple):
    """A displacement that takes known values exactly."""

    displacement: FloatArray  # (N, 3)
    correction: float  # m, the largest change that this took


def prescribe(displacement: FloatArray, nodes: IndexArray, values: FloatArray) -> Prescribed:
    """Replace rows `nodes` of a displacement (N, 3) by their known values (M, 3).

    The interpolant is off by up to tol_stop at data sites that are no centres; nodes of a moved or fixed
    surface take their places exactly.

    Raises
    ------
    ValueError
        If a node is named twice with different values.
    """
    values = np.broadcast_to(np.asarray(values, dtype=np.float64), (len(nodes), 3))
    out = np.array(displacement)
    out[nodes] = values
    if not np.array_equal(out[nodes], values):
        raise ValueError("a node is prescribed twice, with different displacements")
    correction = float(np.abs(out[nodes] - displacement[nodes]).max(initial=0.0))
    return Prescribed(out, correction)

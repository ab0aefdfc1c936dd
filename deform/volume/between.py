"""How far the interpolant is from the moving surface between its sites: at midpoints of edges and centres of faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.mesh.cells import Polygons
from sdm_deflect.deform.mesh.edges import are_lines, edges_of, polygons_of
from sdm_deflect.deform.volume.boundary import PrescribedNodes
from sdm_deflect.deform.volume.step import Step

MOST = 20_000
"""Points that are measured; of more, every n-th."""


@dataclass(frozen=True, slots=True)
class ErrorBetween:
    """Error of the interpolants between the data sites, a length: largest in any direction, as at the sites.

    Attributes
    ----------
    max, p99 : the largest, and what 99 % of the points do not exceed.
    points : number of points.
    """

    max: float
    p99: float
    points: int

    @classmethod
    def of(cls, boundary: PrescribedNodes, steps: Sequence[Step], displacement: FloatArray) -> "ErrorBetween | None":
        """Measure the steps of a deflection whose moving nodes (K, 3) go so far; None for surfaces without faces.

        A point of an edge or a face goes as far as the mean of its corners does. That is where a rotation brings it,
        exactly, and what becomes of the mesh's own, flat face for any motion; of one that bends within a face, the
        error holds how much.
        """
        faces = [block for surface in boundary.surfaces for block in boundary.mesh.faces_of(surface.patches)]
        corners = _corners(polygons_of(faces))
        if not len(corners):
            return None
        start = _means(boundary.mesh.points, corners)
        places = start.copy()
        for step in steps:
            places += step.fits.interpolant(places)
        moved = np.zeros_like(boundary.mesh.points)
        moved[boundary.nodes] = displacement
        off = np.abs(places - start - _means(moved, corners)).max(axis=1)
        return cls(float(off.max()), float(np.quantile(off, 0.99)), len(off))


def _corners(faces: Polygons) -> Polygons:
    """Return the corners of edges, then of faces, each edge once; of more than `MOST` of both, every n-th."""
    edges = np.empty((0, 2), dtype=np.intp) if are_lines(faces) else np.sort(edges_of(faces)[0], axis=1)
    edges = np.unique(edges, axis=0)
    sizes = np.concatenate([np.full(len(edges), 2), np.diff(faces.offsets)])
    nodes = np.concatenate([edges.ravel(), faces.nodes])
    chosen = np.arange(0, len(sizes), max(1, -(-len(sizes) // MOST)))
    starts = (np.cumsum(sizes) - sizes)[chosen]
    offsets = np.concatenate([[0], np.cumsum(sizes[chosen])])
    rows = np.arange(offsets[-1]) + np.repeat(starts - offsets[:-1], sizes[chosen])
    return Polygons(nodes[rows], offsets.astype(np.intp))


def _means(values: FloatArray, corners: Polygons) -> FloatArray:
    """Return the mean (P, 3) of the values (N, 3) at the corners of each."""
    sums = np.add.reduceat(values[corners.nodes], corners.offsets[:-1], axis=0)
    return np.asarray(sums / np.diff(corners.offsets)[:, None])

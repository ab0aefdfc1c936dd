"""Does the deflected mesh have the shape it should have? Checks that can fail."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sdm_deflect.cases.motion import FloatArray, IndexArray

Judgement = Literal["at most", "at least"]


@dataclass(frozen=True, slots=True)
class Check:
    """One validation: a measured value beside what was asked.

    Attributes
    ----------
    name : fixed name (see the contract), with the surface appended when a case deflects several.
    value, limit : in `unit`; the check passes if value <= limit ("at most") or value >= limit ("at least").
    where : what was measured, over how many nodes, and where the worst one lies.
    nodes, distances : (K,) the nodes and what was measured at each, where a map of it is worth drawing.
    """

    name: str
    value: float
    limit: float
    unit: str
    where: str
    judgement: Judgement = "at most"
    nodes: IndexArray | None = field(default=None, compare=False, repr=False)
    distances: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def passed(self) -> bool:
        """True if the value keeps its limit; nan never does."""
        return self.value <= self.limit if self.judgement == "at most" else self.value >= self.limit


def worst(distances: FloatArray, points: FloatArray) -> str:
    """Describe the largest of distances (N,) at points (N, 3): rms, count and place."""
    if not distances.any():
        return f"{len(distances)} nodes"
    x, y, z = points[int(np.argmax(distances))]
    rms = float(np.sqrt(np.mean(distances**2)))
    return f"{len(distances)} nodes, rms {rms:.1e}, worst at ({x:.4f}, {y:.4f}, {z:.4f})"


def plane_deviation(points: FloatArray) -> FloatArray:
    """Distance (N,) of points (N, 3) from their least-squares plane."""
    return np.asarray(np.abs((points - points.mean(axis=0)) @ plane_normal(points)), dtype=np.float64)


def plane_normal(points: FloatArray) -> FloatArray:
    """Unit normal (3,) of the least-squares plane of points (N, 3); its sign is arbitrary."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2], dtype=np.float64)

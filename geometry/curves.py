"""Nearest points on the curves of CAD edges, clamped to the edge: exact where the edge is straight."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from cadquery import Edge
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.Geom import Geom_Curve
from OCP.GeomAbs import GeomAbs_Line
from OCP.GeomAPI import GeomAPI_ProjectPointOnCurve
from OCP.gp import gp_Pnt

from sdm_deflect.geometry.surfaces import FloatArray


class Curve(Protocol):
    """A bounded curve."""

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (N, 3) and their parameters (N,), for `points` (N, 3)."""
        ...

    def at(self, shares: FloatArray) -> FloatArray:
        """Points (N, 3) at shares (N,) of the parameter range, 0 at the first end and 1 at the last."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """The straight segment from `start` (3,) to `end` (3,); its parameter is the distance from `start`."""

    start: FloatArray
    end: FloatArray

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Orthogonal projections (N, 3), clamped, and distances (N,) along the segment."""
        span = self.end - self.start
        length = float(np.linalg.norm(span))
        along = np.clip((points - self.start) @ span / length**2, 0.0, 1.0)
        return self.start + along[:, None] * span, length * along

    def at(self, shares: FloatArray) -> FloatArray:
        """Points (N, 3) at shares (N,) of the length."""
        return np.asarray(self.start + shares[:, None] * (self.end - self.start), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FreeCurve:
    """Any other curve between two of its parameters, point by point through the CAD kernel."""

    geometry: Geom_Curve
    first: float
    last: float

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (N, 3) and the kernel's curve parameters (N,)."""
        parameters = np.array([self._parameter(gp_Pnt(*row)) for row in points.tolist()])
        return self._values(parameters), parameters

    def at(self, shares: FloatArray) -> FloatArray:
        """Points (N, 3) at shares (N,) of the parameter range."""
        return self._values(self.first + shares * (self.last - self.first))

    def _values(self, parameters: FloatArray) -> FloatArray:
        values = [self.geometry.Value(t) for t in parameters.tolist()]
        return np.array([[v.X(), v.Y(), v.Z()] for v in values]).reshape(-1, 3)

    def _parameter(self, point: gp_Pnt) -> float:
        # The kernel finds interior extrema only; the ends compete with them.
        projection = GeomAPI_ProjectPointOnCurve(point, self.geometry, self.first, self.last)
        candidates = [self.first, self.last]
        candidates += [projection.Parameter(i + 1) for i in range(projection.NbPoints())]
        return min(candidates, key=lambda t: float(self.geometry.Value(t).SquareDistance(point)))


def curve_of(edge: Edge) -> Curve:
    """The bounded curve under an edge, in the direction of the kernel's parameter."""
    adaptor = BRepAdaptor_Curve(edge.wrapped)
    first, last = adaptor.FirstParameter(), adaptor.LastParameter()
    if adaptor.GetType() == GeomAbs_Line:
        ends = [adaptor.Value(t) for t in (first, last)]
        start, end = (np.array([p.X(), p.Y(), p.Z()]) for p in ends)
        return Segment(start, end)
    return FreeCurve(BRep_Tool.Curve_s(edge.wrapped, 0.0, 0.0), first, last)

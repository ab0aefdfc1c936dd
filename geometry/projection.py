"""Nearest points on the surfaces of CAD faces and the curves of CAD edges: exact on planes, cylinders and lines."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from cadquery import Edge, Face
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.Geom import Geom_Curve, Geom_Surface
from OCP.GeomAbs import GeomAbs_Cylinder, GeomAbs_Line, GeomAbs_Plane
from OCP.GeomAPI import GeomAPI_ProjectPointOnCurve
from OCP.GeomLProp import GeomLProp_SLProps
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt, gp_Pnt2d
from OCP.ShapeAnalysis import ShapeAnalysis_Surface
from OCP.TopAbs import TopAbs_Orientation

from sdm_deflect.base.arrays import component

from .parameters import FloatArray

# Far below any dimension of an aircraft, far above rounding.
RESOLUTION = 1e-12

# The kernel's projection converges to rounding with this and stops early with a smaller one.
SEARCH_PRECISION = 1e-7


def coordinates(places: Iterable[gp_Pnt | gp_Dir]) -> FloatArray:
    """Return the kernel's points or directions as rows (N, 3)."""
    return np.array([[place.X(), place.Y(), place.Z()] for place in places], dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSurface:
    """The plane through `origin` (3,) with outward unit `normal` (3,)."""

    origin: FloatArray
    normal: FloatArray

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return orthogonal projections (N, 3)."""
        height = component(points - self.origin, self.normal)
        return np.asarray(points - height[:, None] * self.normal, dtype=np.float64)

    def normals(self, points: FloatArray) -> FloatArray:
        """Return the same normal for every point (N, 3)."""
        return np.tile(self.normal, (len(points), 1))


@dataclass(frozen=True, slots=True, eq=False)
class CylinderSurface:
    """The circular cylinder about unit `axis` through `origin` (3,); `side` is -1 if outside is towards the axis."""

    origin: FloatArray
    axis: FloatArray
    radius: float
    side: float

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return radial projections (N, 3); points on the axis have none and raise ValueError."""
        radial = self._radial(points)
        length = np.linalg.norm(radial, axis=1, keepdims=True)
        if np.any(length < RESOLUTION):
            raise ValueError("points on the axis of a cylinder have no nearest point on it")
        return np.asarray(points + radial * (self.radius / length - 1.0), dtype=np.float64)

    def normals(self, points: FloatArray) -> FloatArray:
        """Return radial unit vectors (N, 3)."""
        radial = self._radial(points)
        return np.asarray(self.side * radial / np.linalg.norm(radial, axis=1, keepdims=True), dtype=np.float64)

    def _radial(self, points: FloatArray) -> FloatArray:
        offset = points - self.origin
        return np.asarray(offset - np.outer(component(offset, self.axis), self.axis), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FreeFormSurface:
    """Any other surface, evaluated point by point by the CAD kernel; `side` is -1 if outside is against its normal."""

    geometry: Geom_Surface
    side: float

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return nearest points (N, 3), as exact as the kernel's projection of points."""
        return coordinates(self.geometry.Value(uv.X(), uv.Y()) for uv in self._parameters(points))

    def normals(self, points: FloatArray) -> FloatArray:
        """Return unit normals (N, 3); at a pole, that of a neighbouring point."""
        return self.side * coordinates(self._normal(uv) for uv in self._parameters(points))

    def _parameters(self, points: FloatArray) -> list[gp_Pnt2d]:
        analysis = ShapeAnalysis_Surface(self.geometry)
        return [analysis.ValueOfUV(gp_Pnt(*row), SEARCH_PRECISION) for row in points.tolist()]

    def _normal(self, uv: gp_Pnt2d) -> gp_Dir:
        u0, u1, v0, v1 = self.geometry.Bounds()
        properties = GeomLProp_SLProps(self.geometry, uv.X(), uv.Y(), 1, RESOLUTION)
        if not properties.IsNormalDefined():
            towards = 1e-6 * np.array([0.5 * (u0 + u1) - uv.X(), 0.5 * (v0 + v1) - uv.Y()])
            properties.SetParameters(uv.X() + towards[0], uv.Y() + towards[1])
        return properties.Normal()


Surface = PlaneSurface | CylinderSurface | FreeFormSurface


def surface_of(face: Face) -> Surface:
    """Return the unbounded surface under a face; the face's orientation gives its outside."""
    side = -1.0 if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
    adaptor = BRepAdaptor_Surface(face.wrapped)
    if adaptor.GetType() == GeomAbs_Plane:
        origin, frame = _frame(adaptor.Plane().Position())
        return PlaneSurface(origin, side * np.cross(frame[0], frame[1]))
    if adaptor.GetType() == GeomAbs_Cylinder:
        position = adaptor.Cylinder().Position()
        origin, frame = _frame(position)
        handed = 1.0 if position.Direct() else -1.0
        return CylinderSurface(origin, frame[2], adaptor.Cylinder().Radius(), side * handed)
    return FreeFormSurface(BRep_Tool.Surface_s(face.wrapped), side)


def _frame(position: gp_Ax3) -> tuple[FloatArray, FloatArray]:
    """Origin (3,) of a placement and its x, y and z directions as rows (3, 3)."""
    rows = coordinates([position.XDirection(), position.YDirection(), position.Direction()])
    return coordinates([position.Location()])[0], rows


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """The straight segment from `start` (3,) to `end` (3,); its parameter is the distance from `start`."""

    start: FloatArray
    end: FloatArray

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return orthogonal projections (N, 3), clamped to the segment, and distances (N,) along it."""
        span = self.end - self.start
        square = component(span, span)
        along = np.clip(component(points - self.start, span) / square, 0.0, 1.0)
        return self.start + along[:, None] * span, np.sqrt(square) * along

    def at(self, shares: FloatArray) -> FloatArray:
        """Return points (N, 3) at shares (N,) of the length."""
        return np.asarray(self.start + shares[:, None] * (self.end - self.start), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FreeCurve:
    """Any other curve between two parameters, evaluated point by point by the CAD kernel."""

    geometry: Geom_Curve
    first: float
    last: float

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return nearest points (N, 3) and the kernel's curve parameters (N,)."""
        parameters = np.array([self._parameter(gp_Pnt(*row)) for row in points.tolist()])
        return self._values(parameters), parameters

    def at(self, shares: FloatArray) -> FloatArray:
        """Return points (N, 3) at shares (N,) of the parameter range."""
        return self._values(self.first + shares * (self.last - self.first))

    def _values(self, parameters: FloatArray) -> FloatArray:
        return coordinates(map(self.geometry.Value, parameters.tolist()))

    def _parameter(self, point: gp_Pnt) -> float:
        # The kernel finds interior extrema only; the ends compete with them.
        projection = GeomAPI_ProjectPointOnCurve(point, self.geometry, self.first, self.last)
        candidates = [self.first, self.last]
        candidates += [projection.Parameter(i + 1) for i in range(projection.NbPoints())]
        return min(candidates, key=lambda t: float(self.geometry.Value(t).SquareDistance(point)))


Curve = Segment | FreeCurve


def curve_of(edge: Edge) -> Curve:
    """Return the bounded curve under an edge, in the direction of the kernel's parameter."""
    adaptor = BRepAdaptor_Curve(edge.wrapped)
    first, last = adaptor.FirstParameter(), adaptor.LastParameter()
    if adaptor.GetType() == GeomAbs_Line:
        return Segment(*coordinates(map(adaptor.Value, (first, last))))
    return FreeCurve(BRep_Tool.Curve_s(edge.wrapped, 0.0, 0.0), first, last)

"""Nearest points and normals on the surfaces of CAD faces: exact on planes and cylinders."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from cadquery import Face
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.Geom import Geom_Surface
from OCP.GeomAbs import GeomAbs_Cylinder, GeomAbs_Plane
from OCP.GeomLProp import GeomLProp_SLProps
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt, gp_Pnt2d
from OCP.ShapeAnalysis import ShapeAnalysis_Surface
from OCP.TopAbs import TopAbs_Orientation

FloatArray = NDArray[np.float64]

# Far below any dimension of an aircraft, far above rounding.
RESOLUTION = 1e-12

# The kernel's projection converges to rounding with this and stops early with a smaller one.
SEARCH_PRECISION = 1e-7


class Surface(Protocol):
    """An unbounded surface with a side that counts as outside."""

    def nearest(self, points: FloatArray) -> FloatArray:
        """Nearest points (N, 3) on the surface."""
        ...

    def normals(self, points: FloatArray) -> FloatArray:
        """Outward unit normals (N, 3) at the points nearest to `points` (N, 3)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSurface:
    """The plane through `origin` (3,) with outward unit `normal` (3,)."""

    origin: FloatArray
    normal: FloatArray

    def nearest(self, points: FloatArray) -> FloatArray:
        """Orthogonal projections (N, 3)."""
        height = (points - self.origin) @ self.normal
        return np.asarray(points - height[:, None] * self.normal, dtype=np.float64)

    def normals(self, points: FloatArray) -> FloatArray:
        """The same normal for every point (N, 3)."""
        return np.tile(self.normal, (len(points), 1))


@dataclass(frozen=True, slots=True, eq=False)
class CylinderSurface:
    """The circular cylinder about unit `axis` through `origin` (3,); `side` is -1 where out is inwards."""

    origin: FloatArray
    axis: FloatArray
    radius: float
    side: float

    def nearest(self, points: FloatArray) -> FloatArray:
        """Radial projections (N, 3); points on the axis have none and raise ValueError."""
        radial = self._radial(points)
        length = np.linalg.norm(radial, axis=1, keepdims=True)
        if np.any(length < RESOLUTION):
            raise ValueError("points on the axis of a cylinder have no nearest point on it")
        return np.asarray(points + radial * (self.radius / length - 1.0), dtype=np.float64)

    def normals(self, points: FloatArray) -> FloatArray:
        """Radial unit vectors (N, 3)."""
        radial = self._radial(points)
        return np.asarray(self.side * radial / np.linalg.norm(radial, axis=1, keepdims=True), dtype=np.float64)

    def _radial(self, points: FloatArray) -> FloatArray:
        offset = points - self.origin
        return np.asarray(offset - np.outer(offset @ self.axis, self.axis), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FreeFormSurface:
    """Any other surface, point by point by the CAD kernel; `side` is -1 where out is against its normal."""

    geometry: Geom_Surface
    side: float

    def nearest(self, points: FloatArray) -> FloatArray:
        """Nearest points (N, 3), as close as the kernel's own point projection."""
        out = np.empty((len(points), 3))
        for i, uv in enumerate(self._parameters(points)):
            value = self.geometry.Value(uv.X(), uv.Y())
            out[i] = value.X(), value.Y(), value.Z()
        return out

    def normals(self, points: FloatArray) -> FloatArray:
        """Unit normals (N, 3); at a pole, that of a neighbouring point."""
        out = np.empty((len(points), 3))
        for i, uv in enumerate(self._parameters(points)):
            direction = self._normal(uv)
            out[i] = direction.X(), direction.Y(), direction.Z()
        return self.side * out

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


def surface_of(face: Face) -> Surface:
    """The unbounded surface under a face, its outside on the side to which the face is oriented."""
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
    origin = position.Location()
    rows = [position.XDirection(), position.YDirection(), position.Direction()]
    frame = np.array([[d.X(), d.Y(), d.Z()] for d in rows])
    return np.array([origin.X(), origin.Y(), origin.Z()]), frame

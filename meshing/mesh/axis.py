"""Rigid rotation about an axis, and projection onto a cylinder."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.base.arrays import FloatArray


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) of the cross product of a vector (3,) with another one."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """A directed line; rotations about it are right-handed.

    Parameters
    ----------
    point : (3,) any point of the line, in metres.
    direction : (3,) of any length but zero; stored as a unit vector.
    length : Distance between the two points of `through`; None for a line from a point and a direction.
    """

    point: FloatArray
    direction: FloatArray
    length: float | None = None

    def __post_init__(self) -> None:
        direction = np.asarray(self.direction, dtype=np.float64)
        length = float(np.linalg.norm(direction))
        if direction.shape != (3,) or not 0.0 < length < np.inf:
            raise ValueError(f"the direction {self.direction} of an axis must be 3 numbers, not all zero")
        object.__setattr__(self, "direction", direction / length)
        object.__setattr__(self, "point", np.asarray(self.point, dtype=np.float64))

    @classmethod
    def through(cls, a: FloatArray, b: FloatArray) -> "Axis":
        """Return the line from point a (3,) to point b (3,)."""
        direction = np.asarray(b) - np.asarray(a)
        return cls(np.asarray(a), direction, float(np.linalg.norm(direction)))

    def matrix(self, degrees: float) -> FloatArray:
        """Return the rotation matrix (3, 3)."""
        return np.asarray(np.eye(3) + self.turn(degrees))

    def displacement(self, points: FloatArray, degrees: float) -> FloatArray:
        """Return the displacement (N, 3) of points (N, 3) in a rotation by `degrees`."""
        x, y, z = np.moveaxis(points - self.point, 1, 0)[..., None]
        turn = self.turn(degrees).T
        return np.asarray(x * turn[0] + y * turn[1] + z * turn[2])

    def rotated(self, points: FloatArray, degrees: float) -> FloatArray:
        """Return points (N, 3) rotated by `degrees`."""
        return np.asarray(points + self.displacement(points, degrees))

    def radial(self, points: FloatArray) -> FloatArray:
        """Return the vectors (N, 3) from the axis to points (N, 3), perpendicular to it."""
        arm = points - self.point
        along = np.sum(arm * self.direction, axis=1, keepdims=True)
        return np.asarray(arm - along * self.direction)

    def turn(self, degrees: float) -> FloatArray:
        """Return the rotation matrix less the identity by Rodrigues' formula; small angles keep their digits."""
        cross = cross_matrix(self.direction)
        angle = np.radians(degrees)
        versine = 2.0 * np.sin(0.5 * angle) ** 2  # 1 - cos without cancellation
        return np.asarray(np.sin(angle) * cross + versine * (cross @ cross))


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A circular cylinder of infinite length.

    Parameters
    ----------
    axis : Its line.
    radius : In metres.
    """

    axis: Axis
    radius: float

    def __post_init__(self) -> None:
        if not 0.0 < self.radius < np.inf:
            raise ValueError(f"radius = {self.radius} m must be a positive length")

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (N,) of points (N, 3) from the surface, positive outside."""
        return np.asarray(np.linalg.norm(self.axis.radial(points), axis=1) - self.radius)

    def projected(self, points: FloatArray) -> FloatArray:
        """Return points (N, 3) moved radially onto the surface; ValueError for points on the axis."""
        radial = self.axis.radial(points)
        r = np.linalg.norm(radial, axis=1, keepdims=True)
        if not r.all():
            raise ValueError(f"{int(np.count_nonzero(r == 0.0))} points lie on the axis of the cylinder")
        return np.asarray(points + (self.radius - r) / r * radial)

    def projected_along(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return points (N, 3) moved along straight lines onto the surface.

        Each goes to the nearer of the two intersections.

        Parameters
        ----------
        points : (N, 3).
        directions : (N, 3) or (3,), of any length but zero.

        Raises ValueError if a line misses the cylinder or runs parallel to its axis.
        """
        d = np.broadcast_to(np.asarray(directions, dtype=np.float64), points.shape)
        p, across = self.axis.radial(points), d - np.outer(d @ self.axis.direction, self.axis.direction)
        a, b = np.sum(across**2, axis=1), np.sum(p * across, axis=1)
        c = np.sum(p * p, axis=1) - self.radius**2
        missed = ~((a > 0.0) & (b * b >= a * c))
        if missed.any():
            raise ValueError(f"{int(missed.sum())} of {len(missed)} lines miss the cylinder")
        # The root of smaller magnitude, in the form without cancellation.
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        t = np.divide(c, q, out=np.zeros_like(c), where=q != 0.0)
        return np.asarray(points + t[:, None] * d)

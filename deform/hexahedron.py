"""The confinement hexahedron (paper section 3), and near-equidistant points on its faces."""

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, first_coincident
from sdm_deflect.deform.base.compiled import compiled
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import in_chunks
from sdm_deflect.deform.mesh.cells import bounded
from sdm_deflect.deform.rbf.kernels import check_points

CLEARANCE = 0.5  # of the spacing: inner points nearer than this to an edge are left out


def polygon_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) on a convex planar polygon, its border included, about `spacing` apart.

    Edges are divided evenly; the inside is filled with rows parallel to the longest edge, evenly spaced across
    the polygon and evenly divided between its borders.

    Parameters
    ----------
    polygon : (n, 3) corners in order, n >= 3.
    spacing : Wanted distance of neighbours in metres.
    """
    return np.vstack([border_sites(polygon, spacing), inner_sites(polygon, spacing)])


def border_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) that divide each edge evenly, corners included."""
    _check(polygon, spacing)
    return np.vstack([divided(a, b, spacing) for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)])


def inner_sites(polygon: FloatArray, spacing: float) -> FloatArray:
    """Return points (P, 3) that fill the inside in rows."""
    _check(polygon, spacing)
    origin, axes = plane_axes(polygon)
    u, v = _inner_rows((polygon - origin) @ axes.T, spacing).T[:, :, None]
    return np.asarray(origin + u * axes[0] + v * axes[1])


def divided(a: FloatArray, b: FloatArray, spacing: float) -> FloatArray:
    """Return points (n, 3) that divide the edge evenly, a included and b not."""
    n = max(1, round(float(np.linalg.norm(b - a)) / spacing))
    return np.asarray(a + np.arange(n)[:, None] / n * (b - a))


def plane_axes(polygon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the first corner of the longest edge and orthonormal axes (2, 3), the first along that edge."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    longest = int(np.argmax(np.linalg.norm(edges, axis=1)))
    u = edges[longest] / np.linalg.norm(edges[longest])
    normal = np.sum(np.cross(polygon, np.roll(polygon, -1, axis=0)), axis=0)
    v = np.cross(normal / np.linalg.norm(normal), u)
    return polygon[longest], np.vstack([u, v])


def _inner_rows(flat: FloatArray, spacing: float) -> FloatArray:
    """Fill a convex polygon (n, 2), counter-clockwise, whose longest edge is its base."""
    height = float(flat[:, 1].max())
    count = max(1, round(height / spacing))
    rows = [_row(flat, height * i / count, spacing) for i in range(1, count)]
    points = np.vstack([np.empty((0, 2)), *rows])
    clear = np.full(len(points), np.inf)
    for corner, end in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        u, v = (end - corner) / np.linalg.norm(end - corner)
        np.minimum(clear, u * (points[:, 1] - corner[1]) - v * (points[:, 0] - corner[0]), out=clear)
    return np.asarray(points[clear >= CLEARANCE * spacing])


def _row(flat: FloatArray, level: float, spacing: float) -> FloatArray:
    """Divide the chord of the polygon at this level evenly, without its ends."""
    a, b = flat, np.roll(flat, -1, axis=0)
    crossing = (a[:, 1] <= level) != (b[:, 1] <= level)
    a, b = a[crossing], b[crossing]
    x = a[:, 0] + (level - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    n = max(1, round(float(x.max() - x.min()) / spacing))
    inner = x.min() + np.arange(1, n) / n * (x.max() - x.min())
    return np.column_stack([inner, np.full(len(inner), level)])


def _check(polygon: FloatArray, spacing: float) -> None:
    if not 0.0 < spacing < np.inf:
        raise ValueError(f"spacing = {spacing} m must be a positive length")
    if polygon.ndim != 2 or polygon.shape[1] != 3 or len(polygon) < 3:
        raise ValueError(f"polygon {polygon.shape} must be (n, 3) with at least 3 corners")


FACES = {
    "x-": (0, 4, 6, 2),
    "x+": (1, 3, 7, 5),
    "y-": (0, 1, 5, 4),
    "y+": (2, 6, 7, 3),
    "z-": (0, 2, 3, 1),
    "z+": (4, 5, 7, 6),
}
"""Corners of each face, ordered so that its triangles have outward normals."""

EDGES = tuple((i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit)

PLANAR = 1e-6  # largest distance of a corner from its face's plane, as a share of the hexahedron's size
COINCIDENT = 1e-9  # closest corners, likewise
SAME_SITE = 1e-6  # of the spacing: sites of two faces on their common edge


@dataclass(frozen=True, slots=True, eq=False)
class Hexahedron:
    """A convex hexahedron with planar faces.

    Parameters
    ----------
    corners : (8, 3) in the mesh's unit of length. Corner i has the binary code zyx: bit 1 is set on face "x+", bit 2 on
        "y+", bit 4 on "z+".

    Raises InputError if corners coincide, a face is not planar, or the hexahedron is not convex or inside out.
    """

    corners: FloatArray
    planes: FloatArray = field(init=False, repr=False)  # (12, 4) outward normals and offsets of the triangles

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", bounded(self.corners, "corners"))
        if self.corners.shape != (8, 3):
            raise InputError(f"corners {self.corners.shape} must be 8 points of 3 coordinates")
        size = float(np.ptp(self.corners, axis=0).max())
        for i in range(8):
            for j in range(i):
                if np.linalg.norm(self.corners[i] - self.corners[j]) <= COINCIDENT * size:
                    raise InputError(f"corners {j} and {i} of the hexahedron coincide at {self.corners[i]}")
        object.__setattr__(self, "planes", _triangle_planes(self.corners))
        _check_faces(self.corners, self.planes)

    def contains(self, points: FloatArray, tol: float = 0.0) -> NDArray[np.bool_]:
        """Return which of points (M, 3) lie behind all twelve face triangles, or at most `tol` metres out."""
        check_points(points=points)
        x = np.ascontiguousarray(points, dtype=np.float64)
        inside = np.empty(len(x), dtype=np.bool_)
        low, high = self.corners.min(axis=0) - abs(tol), self.corners.max(axis=0) + abs(tol)

        def chunk(start: int, stop: int) -> None:
            _behind(x[start:stop], low, high, self.planes, tol, inside[start:stop])

        in_chunks(chunk, len(x), len(self.planes))
        return inside

    def face(self, name: str) -> FloatArray:
        """Return the corners (4, 3) of a face, counter-clockwise from outside."""
        if name not in FACES:
            raise ValueError(f"no face {name!r}: the faces are {', '.join(FACES)}")
        return self.corners[list(FACES[name])]

    def sites_on(self, name: str, spacing: float) -> FloatArray:
        """Return near-equidistant points (P, 3) on one face, its edges included."""
        return polygon_sites(self.face(name), spacing)

    def face_sites(self, spacing: float, skip: AbstractSet[str] = frozenset()) -> FloatArray:
        """Return near-equidistant points (P, 3) on all faces not in `skip`, each once.

        An edge keeps its points as long as one of its two faces is not skipped.
        """
        for name in skip:
            self.face(name)
        faces = [self.face(name) for name in FACES if name not in skip]
        nothing = np.empty((0, 3))
        borders = np.vstack([nothing, *(border_sites(face, spacing) for face in faces)])
        inner = np.vstack([nothing, *(inner_sites(face, spacing) for face in faces)])
        distinct = first_coincident(borders, SAME_SITE * spacing) == np.arange(len(borders))
        return np.vstack([borders[distinct], inner])

    def section(self, point: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the polygon (k, 3) in which a plane cuts the hexahedron.

        Raises ValueError if the plane misses it, or touches it in a corner or an edge only.
        """
        n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
        height = (self.corners - point) @ n
        size = float(np.ptp(self.corners, axis=0).max())
        height[np.abs(height) <= COINCIDENT * size] = 0.0
        cuts = [self.corners[i] for i in range(8) if height[i] == 0.0]
        for i, j in EDGES:
            if height[i] * height[j] < 0.0:
                share = height[i] / (height[i] - height[j])
                cuts.append(self.corners[i] + share * (self.corners[j] - self.corners[i]))
        if len(cuts) < 3:
            raise ValueError(f"the plane through {point} with normal {n} does not cut the hexahedron")
        return _around(np.array(cuts), n)


def box(low: FloatArray, high: FloatArray) -> Hexahedron:
    """Return the axis-aligned hexahedron between two corners (3,)."""
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
    return Hexahedron(np.asarray(low + bits * (np.asarray(high) - low)))


def _triangle_planes(corners: FloatArray) -> FloatArray:
    """Return (n, d) with n . x <= d inside, (12, 4), for the two triangles of each face."""
    planes = []
    for a, b, c, d in FACES.values():
        for i, j, k in ((a, b, c), (a, c, d)):
            n = np.cross(corners[j] - corners[i], corners[k] - corners[i])
            size = float(np.linalg.norm(n))
            n = n / size if size > 0.0 else n
            planes.append([*n, n @ corners[i]])
    return np.array(planes)


def _check_faces(corners: FloatArray, planes: FloatArray) -> None:
    """Raise for faces that are not planar or that have a corner of the hexahedron in front of them."""
    size = float(np.ptp(corners, axis=0).max())
    two_each = [item for item in FACES.items() for _ in range(2)]
    for (name, face), plane in zip(two_each, planes, strict=True):
        if not plane[:3].any():
            raise InputError(f"three corners of face {name} (corners {face}) lie on one line")
        height = corners @ plane[:3] - plane[3]
        off = float(np.abs(height[list(face)]).max())
        if off > PLANAR * size:
            raise InputError(f"face {name} (corners {face}) is not planar: a corner is {off:.3g} m off")
        front = int(np.argmax(height))
        if height[front] > PLANAR * size:
            raise InputError(
                f"the hexahedron is not convex, or its corners are not in the order of their codes zyx: "
                f"corner {front} is {height[front]:.3g} m in front of face {name} (corners {face})"
            )


def _around(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Sort coplanar points (k, 3) of a convex polygon around their centre."""
    arm = points - points.mean(axis=0)
    u = arm[0] / np.linalg.norm(arm[0])
    return points[np.argsort(np.arctan2(arm @ np.cross(normal, u), arm @ u))]


@compiled
def _behind(
    x: FloatArray, low: FloatArray, high: FloatArray, planes: FloatArray, tol: float, inside: NDArray[np.bool_]
) -> None:  # pragma: no cover - machine code
    """Test points x (M, 3) against the bounding box first: most are outside of it."""
    for i in range(len(x)):
        a, b, c = x[i, 0], x[i, 1], x[i, 2]
        within = a >= low[0] and a <= high[0] and b >= low[1] and b <= high[1] and c >= low[2] and c <= high[2]
        if within:
            for k in range(len(planes)):
                if planes[k, 0] * a + planes[k, 1] * b + planes[k, 2] * c - planes[k, 3] > tol:
                    within = False
                    break
        inside[i] = within

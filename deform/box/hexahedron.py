"""The confining hexahedron (paper section 3)."""

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, first_coincident
from sdm_deflect.base.compiled import compiled
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import in_chunks
from sdm_deflect.base.ties import EQUAL
from sdm_deflect.deform.rbf.kernels import check_points
from sdm_deflect.meshing.mesh.cells import bounded

from .face_sites import border_sites, inner_sites, polygon_sites

# Corners of each face, in the order that gives outward normals.
FACES = {
    "x-": (0, 4, 6, 2),
    "x+": (1, 3, 7, 5),
    "y-": (0, 1, 5, 4),
    "y+": (2, 6, 7, 3),
    "z-": (0, 2, 3, 1),
    "z+": (4, 5, 7, 6),
}

EDGES = tuple((i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit)

# Largest distance of a corner from its face's plane, as a share of the hexahedron's size: files of six digits.
PLANAR = 1e-6
# Least distance of two corners, as a share of the hexahedron's size.
COINCIDENT = 1e-9
# Approximate largest number of sites on all faces; a spacing that gives more is widened.
MOST_SITES = 12_000
# Largest number of sites on one edge, for a box like a needle.
MOST_ON_EDGE = 3_000
# Least spacing that a user may give, as a share of the spacing that both limits allow.
FINEST = 0.1
# Sites of two faces on their common edge coincide within this share of the spacing.
SAME_SITE = 1e-6


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

    def contains(self, points: FloatArray, tol: float | None = None) -> NDArray[np.bool_]:
        """Return which of points (M, 3) lie inside, or at most `tol` outside of the plane of any face.

        The default is a share `EQUAL` of the size: a point on a face is inside, wherever rounding puts it.
        """
        check_points(points=points)
        tol = EQUAL * float(np.ptp(self.corners, axis=0).max()) if tol is None else tol
        x = np.ascontiguousarray(points, dtype=np.float64)
        inside = np.empty(len(x), dtype=np.bool_)
        low, high = self.corners.min(axis=0) - abs(tol), self.corners.max(axis=0) + abs(tol)

        def chunk(start: int, stop: int) -> None:
            _behind(x[start:stop], low, high, self.planes, tol, inside[start:stop])

        in_chunks(chunk, len(x), len(self.planes))
        return inside

    def face(self, name: str) -> FloatArray:
        """Return the corners (4, 3) of a face, counter-clockwise as seen from outside."""
        if name not in FACES:
            raise ValueError(f"no face {name!r}: the faces are {', '.join(FACES)}")
        return self.corners[list(FACES[name])]

    def sites_on(self, name: str, spacing: float) -> FloatArray:
        """Return nearly equidistant points (P, 3) on one face and its edges."""
        return polygon_sites(self.face(name), spacing)

    def face_sites(self, spacing: float, skip: AbstractSet[str] = frozenset()) -> FloatArray:
        """Return nearly equidistant points (P, 3) on all faces not in `skip`, each once.

        An edge keeps its points unless both of its faces are skipped.
        """
        for name in skip:
            self.face(name)
        faces = [self.face(name) for name in FACES if name not in skip]
        nothing = np.empty((0, 3))
        borders = np.vstack([nothing, *(border_sites(face, spacing) for face in faces)])
        inner = np.vstack([nothing, *(inner_sites(face, spacing) for face in faces)])
        distinct = first_coincident(borders, SAME_SITE * spacing) == np.arange(len(borders))
        return np.vstack([borders[distinct], inner])

    def spacing(self, given: float, wanted: float) -> float:
        """Return the spacing of sites on the faces: the given one, else the wanted one or a larger one for fewer sites.

        Raises InputError if the given spacing needs far too many sites.
        """
        faces = [self.face(name) for name in FACES]
        area = sum(float(np.linalg.norm(np.cross(f[2] - f[0], f[3] - f[1]))) / 2.0 for f in faces)
        longest = max(float(np.linalg.norm(f - np.roll(f, 1, axis=0), axis=1).max()) for f in faces)
        usual = max(float(np.sqrt(area / MOST_SITES)), longest / MOST_ON_EDGE)
        if 0.0 < given < (least := FINEST * usual):
            raise InputError(f"spacing = {given:g} puts too many sites on the box: at least {least:.2g} is possible")
        return given or max(wanted, usual)

    def section(self, point: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the polygon (k, 3) in which a plane cuts the hexahedron.

        Raises ValueError if the plane misses the hexahedron, or touches only a corner or an edge.
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
    low, high = bounded(low, "corners"), bounded(high, "corners")
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
    return Hexahedron(np.asarray(low + bits * (high - low)))


def _triangle_planes(corners: FloatArray) -> FloatArray:
    """Return (n, d) (12, 4) of the two triangles of each face; n . x <= d inside."""
    planes = []
    for a, b, c, d in FACES.values():
        for i, j, k in ((a, b, c), (a, c, d)):
            n = np.cross(corners[j] - corners[i], corners[k] - corners[i])
            size = float(np.linalg.norm(n))
            n = n / size if size > 0.0 else n
            planes.append([*n, n @ corners[i]])
    return np.array(planes)


def _check_faces(corners: FloatArray, planes: FloatArray) -> None:
    """Raise for a face that is not plane, or that has a corner of the hexahedron in front of it."""
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
    """Sort the points (k, 3) of a convex plane polygon around their centre; the first one stays the first."""
    arm = points - points.mean(axis=0)
    u = arm[0] / np.linalg.norm(arm[0])
    angle = np.arctan2(arm @ np.cross(normal, u), arm @ u)
    return points[np.argsort((angle + EQUAL) % (2.0 * np.pi))]


@compiled
def _behind(
    x: FloatArray, low: FloatArray, high: FloatArray, planes: FloatArray, tol: float, inside: NDArray[np.bool_]
) -> None:  # pragma: no cover - machine code
    """Find the points x (M, 3) behind all planes; most fail the bounding box, which is tested first."""
    for i in range(len(x)):
        a, b, c = x[i, 0], x[i, 1], x[i, 2]
        within = a >= low[0] and a <= high[0] and b >= low[1] and b <= high[1] and c >= low[2] and c <= high[2]
        if within:
            for k in range(len(planes)):
                if planes[k, 0] * a + planes[k, 1] * b + planes[k, 2] * c - planes[k, 3] > tol:
                    within = False
                    break
        inside[i] = within

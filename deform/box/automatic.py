"""The confining hexahedron (section 3): chosen along the hinge, or given."""

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.ties import EQUAL, first_largest
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import LARGEST, bounded

from .hexahedron import FACES, Hexahedron, box

# Least margin of the box, in largest displacements: cells in between are compressed by a third on average.
GROWTH = 3.0
# Margin of a face that gives way to a patch, as a share of the distance to the patch, which stays outside.
GAP = 0.9
# Least margin of a face that gives way, as a share of the wanted margin; beyond that the patch is in the box.
LEAST = 0.05
BITS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)


class BoxScene(NamedTuple):
    """What a box must contain and should avoid."""

    moving: FloatArray  # (K, 3) nodes of the moving surfaces
    track: FloatArray  # (T, 3) positions that they reach
    largest: float  # largest displacement
    hinge: Axis | None
    obstacles: FloatArray  # (O, 3) nodes of patches without a role
    far_hinge: bool = False  # whether the hinge may be far away: the reach is then the surface's own size


class Chosen(NamedTuple):
    """A hexahedron, and why it was chosen."""

    hexahedron: Hexahedron
    why: str
    open_faces: frozenset[str] = frozenset()  # faces without zero sites


class BoxRule(Protocol):
    """A rule that chooses the hexahedron."""

    @property
    def settings(self) -> str:
        """Setting that makes the box larger or smaller, for messages."""
        ...

    def choose(self, scene: BoxScene) -> Chosen:
        """Return the hexahedron for a scene."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """A hexahedron given by its corners.

    Attributes
    ----------
    hexahedron : the box.
    open_faces : names of faces without zero sites, such as one inside a body.
    settings : setting that makes the box larger or smaller, for messages.
    """

    hexahedron: Hexahedron = field(repr=False)
    open_faces: frozenset[str] = frozenset()
    settings: str = "box"

    def __post_init__(self) -> None:
        unknown = sorted(self.open_faces - FACES.keys())
        if unknown:
            raise InputError(f"open_faces: {unknown[0]!r} is no face of the box; the faces are {', '.join(FACES)}")

    @classmethod
    def at(cls, corners: FloatArray) -> "Given":
        """Take corners (8, 3) in the order of `Hexahedron`, or two opposite corners (2, 3) of a box along the axes."""
        try:
            places = np.asarray(corners, dtype=np.float64)
            return cls(box(*np.sort(places, axis=0)) if places.shape == (2, 3) else Hexahedron(places))
        except (TypeError, ValueError) as error:
            raise InputError(f"the box: {error}") from None

    def choose(self, scene: BoxScene) -> Chosen:
        """Return the given hexahedron."""
        del scene
        return Chosen(self.hexahedron, "corners as given", self.open_faces)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The box of a plane mesh: a convex quadrilateral in its plane.

    Attributes
    ----------
    corners : (4, 2), one after another around it.
    settings : setting that makes the box larger or smaller, for messages.
    """

    corners: FloatArray = field(repr=False)
    settings: str = "box"

    @classmethod
    def at(cls, corners: FloatArray) -> "Outline":
        """Take four corners (4, 2) in order, or two opposite corners (2, 2) of a rectangle along the axes."""
        places = bounded(corners, "the box: corners")
        if places.shape == (2, 2):
            (left, low), (right, high) = np.sort(places, axis=0)
            places = np.array([[left, low], [right, low], [right, high], [left, high]])
        if places.shape != (4, 2):
            raise InputError(
                f"the box: corners {places.shape} must be four points of two numbers, or two opposite ones"
            )
        found = cls(places)
        found.prism(0.0)
        return found

    def prism(self, z: float) -> Hexahedron:
        """Return the hexahedron over the outline, centred on the plane of z and as high as the outline is large."""
        places = self.corners
        if np.cross(np.append(places[2] - places[0], 0.0), np.append(places[3] - places[1], 0.0))[2] < 0.0:
            places = places[[0, 3, 2, 1]]
        half = 0.5 * float(np.ptp(places, axis=0).max())
        rows = places[[0, 1, 3, 2]]
        try:
            return Hexahedron(np.vstack([np.column_stack([rows, np.full(4, z + sign * half)]) for sign in (-1.0, 1.0)]))
        except ValueError as error:
            raise InputError(f"the box: {error}") from None

    def choose(self, scene: BoxScene) -> Chosen:
        """Return the prism around the mesh's plane.

        Raises InputError if the mesh is not plane.
        """
        z = scene.moving[:, 2]
        if z.min() < z.max():
            raise InputError("the box: corners of two numbers are for a plane mesh; give three")
        return Chosen(self.prism(float(z[0])), "corners as given")


@dataclass(frozen=True, slots=True)
class Automatic:
    """An oriented box along the hinge.

    Its axes are the hinge, the direction from the hinge to the surface, and their normal. Every face keeps a margin
    from all positions of the surface. A face gives way where it would enclose nodes of other patches.

    Attributes
    ----------
    margin : margin in the mesh's unit; 0 for the surface's reach from the hinge, and at least `GROWTH` times the
        largest displacement.
    largest : largest displacement that the box must hold, whatever the positions in the scene; 0 to take those.
    """

    margin: float = 0.0
    largest: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.margin < LARGEST:
            raise InputError(f"margin = {self.margin} must be a length below {LARGEST:g}, or 0 to have it chosen")

    @property
    def settings(self) -> str:
        """Setting that makes the box larger or smaller, for messages."""
        return "margin"

    def choose(self, scene: BoxScene) -> Chosen:
        """Return the box for a scene."""
        origin, axes = frame(scene)
        if self.largest and scene.largest > self.largest:
            raise InputError(
                f"largest = {self.largest:g}: the surface moves by up to {scene.largest:.4g}; give at least that"
            )
        places = (scene.moving if self.largest else np.vstack([scene.moving, scene.track])) - origin
        places = places @ axes.T
        low, high = places.min(axis=0) - self.largest, places.max(axis=0) + self.largest
        wanted = self.margin or max(_reach(places, scene), GROWTH * (self.largest or scene.largest))
        margins = _clear(low, high, wanted, (scene.obstacles - origin) @ axes.T)
        low, high = low - margins[0], high + margins[1]
        corners = origin + (low + BITS * (high - low)) @ axes
        return Chosen(Hexahedron(np.asarray(corners)), _why(margins, wanted, self.margin))


def frame(scene: BoxScene) -> tuple[FloatArray, FloatArray]:
    """Return an origin (3,) and right-handed unit axes (3, 3): hinge, direction to the surface, normal."""
    center = scene.moving.mean(axis=0)
    if scene.hinge is None:
        spread = np.linalg.svd(scene.moving - center, full_matrices=False)[2]
        spread = np.array([axis * np.copysign(1.0, axis[first_largest(np.abs(axis))]) for axis in spread])
        return center, np.vstack([spread[:2], np.cross(spread[0], spread[1])])
    along = scene.hinge.direction
    arms = scene.hinge.radial(scene.moving)
    away = np.linalg.svd(arms, full_matrices=False)[2][0]
    away = away - (away @ along) * along
    away /= np.linalg.norm(away)
    ahead = float(arms.mean(axis=0) @ away)
    if abs(ahead) < EQUAL * float(np.linalg.norm(arms, axis=1).max()):  # alike on both sides of the hinge
        ahead = away[first_largest(np.abs(away))]
    away *= np.copysign(1.0, ahead)
    return scene.hinge.point, np.vstack([along, away, np.cross(along, away)])


def _reach(places: FloatArray, scene: BoxScene) -> float:
    """Return the largest distance from the hinge, or the extent across a far one; half of an extent without a hinge."""
    if scene.hinge is None:
        return 0.5 * float(np.sort(np.ptp(places, axis=0))[1])
    if scene.far_hinge:
        return float(np.linalg.norm(np.ptp(places[:, 1:], axis=0)))
    return float(np.linalg.norm(places[:, 1:], axis=1).max())


def _clear(low: FloatArray, high: FloatArray, wanted: float, obstacles: FloatArray) -> FloatArray:
    """Return the margins (2, 3) of the lower and upper faces, reduced where obstacles (O, 3) are near.

    Obstacles are avoided in order of difficulty, each by the face that loses the smallest share of its margin.
    """
    margins = np.full((2, 3), wanted)
    while True:
        inside = ((obstacles > low - margins[0]) & (obstacles < high + margins[1])).all(axis=1)
        beyond = np.stack([low - obstacles[inside], obstacles[inside] - high], axis=1)  # (I, 2, 3)
        share = (beyond / margins).reshape(len(beyond), 6)
        best = share.max(axis=1, initial=-np.inf)
        free = np.flatnonzero(best > LEAST / GAP)
        if not len(free):
            return margins
        worst = free[first_largest(1.0 / best[free])]  # the first of the least
        face = first_largest(share[worst])
        margins[face // 3, face % 3] = GAP * beyond[worst].ravel()[face]


def _why(margins: FloatArray, wanted: float, given: float) -> str:
    reason = "as given" if given else f"the reach from the hinge, or {GROWTH:g} times the largest displacement"
    names = [f"{axis}{sign}" for sign in "-+" for axis in "xyz"]
    assert set(names) == set(FACES)
    gave = [f"{name} at {m:.4g}" for name, m in zip(names, margins.ravel(), strict=True) if m < wanted]
    clear = f"; faces that give way to other patches: {', '.join(gave)}" if gave else ""
    return f"along the hinge (x), away from it (y), normal (z); margin {wanted:.4g}: {reason}{clear}"

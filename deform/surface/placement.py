"""Where a hinge stands beside its surface, and what the surface reaches of its angle."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.axis import Axis

from .blended import BlendedLaw
from .motions import MotionLaw
from .surface import Surface
from .tail_root import RootLaw

UNITS = (1000.0, 0.001, 25.4, 1.0 / 25.4, 0.3048, 1.0 / 0.3048, 39.37, 1.0 / 39.37)
"""Factors between metres, millimetres, inches and feet."""
HALF, QUARTER = 0.5, 0.25
"""Share of a surface along its hinge that the hinge's two points span at least; share of its width that is far."""
HALF_TURN = 1.1 * np.pi
"""Largest angle without nodes around a hinge between an upper and a lower skin, with some allowance."""
MEANT = "correct it, or say --force (force = true) if it is meant"


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A hinge beside the surface that turns about it; lengths in the mesh's unit.

    Attributes
    ----------
    surface : its patches, for messages.
    axis : the hinge.
    width : extent of the surface across the hinge.
    distance : of the hinge's line from the nearest node; 0 inside the surface, whose nodes are all around it.
    covered : share of the surface's extent along the hinge that lies between the two points of the hinge; 1 where these
        are not known.
    ahead : how far the surface reaches to the other side of the hinge than its farthest node.
    chord : second largest extent of the surface, whichever way it lies.
    ends : (E, 3) the two points of the hinge, as far as they are known, with their `apart` (E,) from the nearest node.
    """

    surface: str
    axis: Axis
    width: float
    distance: float
    covered: float
    ahead: float
    chord: float
    ends: FloatArray = field(repr=False)
    apart: FloatArray = field(repr=False)

    @classmethod
    def of(cls, surface: Surface, axis: Axis) -> "Placement":
        """Measure where the hinge lies."""
        points = surface.points
        radial = axis.radial(points)
        along = (points - axis.point) @ axis.direction
        low, high, covered = float(along.min()), float(along.max()), 1.0
        if axis.length is not None and high > low:
            covered = max(min(high, axis.length) - max(low, 0.0), 0.0) / (high - low)
        width = float(np.linalg.norm(np.ptp(radial, axis=0)))
        centred = points - points.mean(axis=0)
        chord = float(np.sort(np.ptp(centred @ np.linalg.eigh(centred.T @ centred)[1], axis=0))[1])
        known = [] if axis.length is None or high <= low else [0.0, axis.length]
        ends = np.array([axis.point + far * axis.direction for far in known]).reshape(-1, 3)
        apart = cKDTree(points).query(ends)[0] if len(ends) else np.empty(0)
        reach = np.linalg.norm(radial, axis=1)
        distance = 0.0 if _surrounds(radial, axis) else float(reach.min())
        ahead = -float((radial @ radial[np.argmax(reach)]).min()) / max(float(reach.max()), np.finfo(np.float64).tiny)
        return cls(surface.label, axis, width, distance, covered, ahead, chord, ends, apart)

    @property
    def near(self) -> bool:
        """Whether the hinge passes the surface no farther away than it is wide."""
        return self.distance <= self.width

    def check(self, surface: Surface, force: bool) -> None:
        """Raise InputError if the hinge is far away, unless by `force`, or fits in another unit of length."""
        if self.near or force:
            return
        fits = [(there.distance, factor) for factor, there in self._elsewhere(surface)]
        help = f"times {min(fits)[1]:.4g} it would fit: give it in the mesh's unit of length" if fits else MEANT
        raise InputError(f"hinge: {self.passes}; {help}")

    @property
    def passes(self) -> str:
        """How far away the hinge is, in words."""
        return f"its line passes {self.distance:.4g} from {self.surface}, which is {self.width:.4g} wide across it"

    def _elsewhere(self, surface: Surface) -> Iterator[tuple[float, "Placement"]]:
        """Yield units of the hinge, by their factor, in which it fits to the surface."""
        for factor in UNITS:
            length = None if self.axis.length is None else factor * self.axis.length
            there = Placement.of(surface, replace(self.axis, point=factor * self.axis.point, length=length))
            if there.near and there.covered >= HALF:
                yield factor, there

    def warnings(self, blended: bool) -> Iterator[str]:
        """Yield what makes it likely that the hinge is wrong, as sentences."""
        if self.distance > QUARTER * self.width:
            yield f"hinge: {self.passes}: is it the right one?"
        if self.covered < HALF:
            yield f"hinge: its two points cover {self.covered:.0%} of the span of {self.surface}: is it the right one?"
        if blended and self.ahead > QUARTER * self.width:
            yield f"hinge: {self.surface}, {self.width:.4g} wide, reaches {self.ahead:.4g} ahead of it: is it right?"
        for name, end, apart in zip(("first", "second"), self.ends, self.apart, strict=False):
            if self.near and apart > self.chord:
                place = ", ".join(f"{x:.6g}" for x in end)
                yield (
                    f"hinge: its {name} point, ({place}), is {apart:.4g} from {self.surface}, whose chord is "
                    f"{self.chord:.4g}: is it right?"
                )


def _surrounds(radial: FloatArray, axis: Axis) -> bool:
    """Return whether vectors (N, 3) away from an axis leave no more than half of the circle around it free."""
    first = radial[0]
    angles = np.sort(np.arctan2(radial @ np.cross(axis.direction, first), radial @ first))
    return bool(np.diff(angles, append=angles[0] + 2.0 * np.pi).max() < HALF_TURN)


FULL = 0.99
"""Share of the angle from which on it counts as the full angle."""
OUTER = 0.9
"""Of the distance of the trailing edge from the hinge: held nodes beyond are its ends."""
FAR_FROM_ITS_WAY = 0.5
"""Of the largest distance from the hinge: what counts as trailing edge where no nodes follow a motion."""
NO_DISTANCE = 1e-9
"""Chords from a rigid turn that are rounding."""
STATIONS = 2001
"""Places along the span at which the angle is averaged, and the resolution of nodes' places is finer by 1000."""


@dataclass(frozen=True, slots=True)
class Reached:
    """How much of its angle a surface reaches.

    Attributes
    ----------
    full : share of the span over which the trailing edge reaches the full angle.
    mean : mean of the trailing edge's angle over the span, as a share of the angle.
    off : largest distance of a node from where the rigid turn would bring it, over the chord there, from the hinge to
        the trailing edge; without the strips beside closed ribs, and without a tail's root.
    place : coordinates of that node before, in the mesh's unit of length.
    """

    full: float
    mean: float
    off: float
    place: tuple[float, float, float]

    @classmethod
    def of(cls, points: FloatArray, moved: FloatArray, axis: Axis, amount: float, law: MotionLaw) -> "Reached":
        """Compare the nodes (K, 3) of a surface, which moved by (K, 3), with a turn about the hinge by an amount.

        A node's share of the angle is its displacement along that of the turn, over the length of the latter.
        """
        turn, station = axis.displacement(points, amount), points @ axis.direction
        reach, square = np.linalg.norm(axis.radial(points), axis=1), np.sum(turn**2, axis=1)
        share = np.sum(moved * turn, axis=1) / np.where(square > 0.0, square, 1.0)
        edge = _edge(law, station, reach)
        low, span = float(station[edge].min()), float(np.ptp(station[edge])) or 1.0
        finest = 1000.0 * STATIONS
        at, rows, count = np.unique(
            np.round((station[edge] - low) / span * finest), return_inverse=True, return_counts=True
        )
        shares, chords = (np.bincount(rows, values[edge]) / count for values in (share, reach))
        angle = np.interp(np.linspace(0.0, at[-1], STATIONS), at, shares)
        chord = np.interp((station - low) / span * finest, at, chords)
        off = np.where(_turning(law), np.linalg.norm(moved - turn, axis=1) / chord, 0.0)
        worst = int(np.argmax(off))
        x, y, z = points[worst].tolist()
        return cls(float((angle >= FULL).mean()), float(angle.mean()), float(off[worst]), (x, y, z))

    @property
    def text(self) -> str:
        """The figures as a sentence."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        share = f"{self.full:.0%} of the span turns by the full angle; the mean over the span is {self.mean:.0%} of it"
        if self.full in (0.0, 1.0):  # as in a plane mesh, which has no span
            share = "turns by the full angle" if self.full else f"turns by {self.mean:.0%} of the angle on average"
        off = f"; nodes are up to {self.off:.2g} chords from a rigid turn, at ({place})"
        return share + (off if self.off >= NO_DISTANCE else "")


def _turning(law: MotionLaw) -> BoolArray:
    """Return which nodes (K,) a rigid turn would bring where they go: not in strips, panels and extended roots."""
    return law.beyond_root if isinstance(law, RootLaw) else law.exact


def _edge(law: MotionLaw, station: FloatArray, reach: FloatArray) -> BoolArray:
    """Return which nodes (K,) are on the trailing edge: those that follow a blended motion, and its ends that stay.

    Of other motions they are those far from the hinge, of a tail those beyond its root.
    """
    if not isinstance(law, BlendedLaw):
        turning = _turning(law)
        return np.asarray(turning & (reach >= FAR_FROM_ITS_WAY * reach[turning].max()))
    rows = np.flatnonzero(law.driven)
    rows = rows[np.argsort(station[rows], kind="stable")]
    return np.asarray(law.driven | (law.held & (reach >= OUTER * np.interp(station, station[rows], reach[rows]))))

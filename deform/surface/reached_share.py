"""The share of its angle by which a surface turns: less than 1 in the strips of a blended motion."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray
from sdm_deflect.base.numbers import percent
from sdm_deflect.meshing.mesh.axis import Axis

from .blended import BlendedLaw
from .motions import MotionLaw
from .tail_root import RootLaw, SkinLaw

# Share of the angle that counts as the full angle.
FULL = 0.99
# Share of the trailing edge's distance from the hinge, beyond which held nodes are its ends.
OUTER = 0.9
# Share of the largest distance from the hinge, beyond which nodes are on the trailing edge of an unblended surface.
FAR_FROM_ITS_WAY = 0.5
# Distance from a rigid turn, in chords, that is rounding.
NO_DISTANCE = 1e-9
# Number of stations along the span at which the angle is averaged; nodes are placed 1000 times as finely.
STATIONS = 2001


@dataclass(frozen=True, slots=True)
class ReachedShare:
    """Share of its angle that a surface reaches.

    Attributes
    ----------
    full : share of the span over which the trailing edge reaches the full angle.
    mean : mean of the trailing edge's angle over the span, as a share of the angle.
    off : largest distance of a node from its place after a rigid turn, over the local chord from hinge to trailing
        edge; without strips beside closed ribs and without a tail's root.
    place : undeflected coordinates of that node, in the mesh's unit.
    near : the same distance of the nodes that are left out, in strips and at the root; 0 without any.
    but : what is left out, in words.
    """

    full: float
    mean: float
    off: float
    place: tuple[float, float, float]
    near: float = 0.0
    but: str = ""

    @classmethod
    def of(cls, points: FloatArray, moved: FloatArray, axis: Axis, amount: float, law: MotionLaw) -> "ReachedShare":
        """Compare the displacement `moved` (K, 3) of a surface's nodes with a turn about the hinge by `amount`.

        A node's share is the component of its displacement along the rigid turn's, over the length of the latter.
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
        every, turning = np.linalg.norm(moved - turn, axis=1) / chord, _turning(law)
        off, near = np.where(turning, every, 0.0), float(every[~turning].max(initial=0.0))
        worst, but = int(np.argmax(off)), "in the strips" if isinstance(law, BlendedLaw) else "at the root"
        x, y, z = points[worst].tolist()
        return cls(float((angle >= FULL).mean()), float(angle.mean()), float(off[worst]), (x, y, z), near, but)

    @property
    def text(self) -> str:
        """The figures as a sentence."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        off = f"distance from a rigid turn: up to {self.off:.2g} chords, at ({place})"
        if self.near > self.off:
            off += f", and {self.near:.2g} {self.but}"
        return self.turn + (f"; {off}" if max(self.off, self.near) >= NO_DISTANCE else "")

    @property
    def turn(self) -> str:
        """By how much of its angle the surface turns, in words."""
        mean = percent(self.mean)
        if self.full in (0.0, 1.0):  # a plane mesh has no span
            return "turns by the full angle" if self.full else f"turns by {mean} of the angle on average"
        return f"full angle over {percent(self.full)} of the span, {mean} on average"


def _turning(law: MotionLaw) -> BoolArray:
    """Return which nodes (K,) a rigid turn should move: those beyond strips, panels and extended roots, or all."""
    turning = law.beyond_root if isinstance(law, RootLaw | SkinLaw) else law.exact
    return turning if turning.any() else law.exact


def _edge(law: MotionLaw, station: FloatArray, reach: FloatArray) -> BoolArray:
    """Return the nodes (K,) of the trailing edge: the driven nodes of a blended motion, and its ends.

    Of other motions these are the nodes far from the hinge; of a tail those outboard of its root.
    """
    if not isinstance(law, BlendedLaw):
        turning = _turning(law)
        return np.asarray(turning & (reach >= FAR_FROM_ITS_WAY * reach[turning].max()))
    rows = np.flatnonzero(law.driven)
    rows = rows[np.argsort(station[rows], kind="stable")]
    return np.asarray(law.driven | (law.held & (reach >= OUTER * np.interp(station, station[rows], reach[rows]))))

"""What a surface that should turn really does: over which share of its span, by how much, and how far from rigidly."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.surface.blended import BlendedLaw
from sdm_deflect.deform.surface.motions import MotionLaw

FULL = 0.99
"""Share of the angle from which on it counts as the full angle."""
OUTER = 0.9
"""Of the distance of the trailing edge from the hinge: held nodes beyond are its ends."""
FAR = 0.5
"""Of the largest distance from the hinge: what counts as trailing edge where no nodes follow a motion."""
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
        the trailing edge; of the nodes beyond the strips beside closed ribs.
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
        off = np.where(law.exact, np.linalg.norm(moved - turn, axis=1) / chord, 0.0)
        worst = int(np.argmax(off))
        x, y, z = points[worst].tolist()
        return cls(float((angle >= FULL).mean()), float(angle.mean()), float(off[worst]), (x, y, z))

    @property
    def text(self) -> str:
        """The figures as a sentence."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        return (
            f"{self.full:.0%} of the span turns by the full angle; the mean over the span is {self.mean:.0%} of it; "
            f"nodes are up to {self.off:.2g} chords from a rigid turn" + (f", at ({place})" if self.off else "")
        )


def _edge(law: MotionLaw, station: FloatArray, reach: FloatArray) -> BoolArray:
    """Return which nodes (K,) are on the trailing edge: those that follow a blended motion, and its ends that stay."""
    if not isinstance(law, BlendedLaw):
        return np.asarray(reach >= FAR * reach.max())
    rows = np.flatnonzero(law.driven)
    rows = rows[np.argsort(station[rows], kind="stable")]
    return np.asarray(law.driven | (law.held & (reach >= OUTER * np.interp(station, station[rows], reach[rows]))))

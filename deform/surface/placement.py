"""Where a hinge lies beside the surface that turns about it: slips of units and of digits show there."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.surface.surface import Surface

UNITS = (1000.0, 0.001, 25.4, 1.0 / 25.4, 0.3048, 1.0 / 0.3048, 39.37, 1.0 / 39.37)
"""Factors between metres, millimetres, inches and feet."""
HALF = 0.5
"""Share of a surface along its hinge that the hinge's two points span at least in another unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A hinge beside the surface that turns about it; lengths in the mesh's unit.

    Attributes
    ----------
    surface : its patches, for messages.
    axis : the hinge.
    width : extent of the surface across the hinge.
    distance : of the hinge's line from the nearest node.
    covered : share of the surface's extent along the hinge that lies between the two points of the hinge; 1 where these
        are not known.
    chord : second largest extent of the surface, whichever way it lies.
    ends : (E, 3) the two points of the hinge, as far as they are known, with their `apart` (E,) from the nearest node.
    """

    surface: str
    axis: Axis
    width: float
    distance: float
    covered: float
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
        reach = [] if axis.length is None else [0.0, axis.length]
        ends = np.array([axis.point + far * axis.direction for far in reach]).reshape(-1, 3)
        apart = cKDTree(points).query(ends)[0] if len(ends) else np.empty(0)
        distance = float(np.linalg.norm(radial, axis=1).min())
        return cls(surface.named, axis, width, distance, covered, chord, ends, apart)

    @property
    def near(self) -> bool:
        """Whether the hinge passes the surface no farther away than it is wide."""
        return self.distance <= self.width

    def check(self, surface: Surface) -> None:
        """Raise InputError if the hinge is far away, and fits to the surface in another unit of length."""
        if self.near:
            return
        fits = [(there.distance, factor) for factor, there in self._elsewhere(surface)]
        if fits:
            raise InputError(
                f"hinge: its line passes {self.distance:.4g} from {self.surface}, which is {self.width:.4g} wide "
                f"across it; times {min(fits)[1]:.4g} it would fit: give it in the mesh's unit of length"
            )

    def _elsewhere(self, surface: Surface) -> Iterator[tuple[float, "Placement"]]:
        """Yield units of the hinge, by their factor, in which it fits to the surface."""
        for factor in UNITS:
            length = None if self.axis.length is None else factor * self.axis.length
            there = Placement.of(surface, replace(self.axis, point=factor * self.axis.point, length=length))
            if there.near and there.covered >= HALF:
                yield factor, there

    def notes(self) -> Iterator[str]:
        """Yield what is unusual, as sentences."""
        if not self.near:
            yield (
                f"the hinge passes {self.distance:.4g} from {self.surface}, which is {self.width:.4g} wide across it: "
                "is it the right one?"
            )
        for name, end, apart in zip(("first", "second"), self.ends, self.apart, strict=False):
            if self.near and apart > self.chord:
                place = ", ".join(f"{x:.6g}" for x in end)
                yield (
                    f"the {name} point of the hinge, ({place}), is {apart:.4g} from {self.surface}, whose chord is "
                    f"{self.chord:.4g}: is it right?"
                )

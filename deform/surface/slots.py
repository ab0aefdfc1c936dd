"""Slots of high-lift elements in a plane mesh: gap and overlap, measured and prescribed.

The gap is the least distance between the trailing edge of the element ahead and the skin of the element behind. The
overlap is how far the foremost point of the skin lies ahead of that edge, along x. A blunt trailing edge has two
corners; the one nearer to the skin counts.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray, distinct
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.ties import first_largest
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.edges import polygons_of, sharp_edges
from sdm_deflect.meshing.mesh.mesh import Mesh

from .motions import TRACK_UNIT, Hinged
from .surface import Surface
from .tracks import Track, TrackLaw

# Degrees by which lines turn at a corner of a trailing edge.
CORNER = 30.0
# Share of an element's extent along x, from its rearmost point, in which the corners of its trailing edge lie.
REAR = 0.02
# Newton steps before a setting is given up; error of a setting that is solved, over the size of the skin.
MOST_ROUNDS, SOLVED = 50, 1e-14
# Largest Newton step, as a share of the skin's extent along x.
LONGEST_STEP = 0.25


class GapOverlap(NamedTuple):
    """Gap and overlap of a slot as lengths, and the unit vector (2,) across the gap, from the skin to the edge."""

    gap: float
    overlap: float
    normal: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Slot:
    """The trailing edge (2,) of the element ahead, and the lines (S, 2, 2) of the skin of the element behind."""

    edge: FloatArray
    skin: FloatArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, one: str, other: str) -> "Slot":
        """Take two patches of a plane mesh; the one whose nodes have the smaller mean x is ahead.

        Raises InputError if the mesh is not plane, or a patch is unknown or has no lines.
        """
        if not mesh.plane or mesh.across != 2:
            raise InputError(f"{mesh.name}: gap and overlap are measured in a plane mesh of x and y")
        names = [mesh.expand([name], "slot") for name in (one, other)]
        ahead, behind = sorted(names, key=lambda some: float(mesh.points[mesh.on(*some), 0].mean()))
        lines = polygons_of(mesh.faces_of(behind))
        skin = mesh.points[lines.nodes.reshape(-1, 2), :2]
        return cls(_trailing_edge(mesh, ahead, skin), skin)

    @property
    def setting(self) -> GapOverlap:
        """Gap and overlap of the slot."""
        start, along = self.skin[:, 0], self.skin[:, 1] - self.skin[:, 0]
        share = np.clip(np.sum((self.edge - start) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        arm = self.edge - start - share[:, None] * along
        far = np.linalg.norm(arm, axis=1)
        row = int(np.argmin(far))
        return GapOverlap(float(far[row]), float(self.edge[0] - self.skin[..., 0].min()), arm[row] / far[row])

    def turned(self, hinge: Axis, degrees: float, is_ahead: bool) -> "Slot":
        """Return the slot with one element turned about a hinge: the one ahead, or the one behind."""
        points = self.edge if is_ahead else self.skin
        flat = np.pad(points.reshape(-1, 2), ((0, 0), (0, 1)))
        there = hinge.rotated(flat, degrees)[:, :2].reshape(points.shape)
        return replace(self, edge=there) if is_ahead else replace(self, skin=there)

    def shift(self, gap: float, overlap: float) -> FloatArray:
        """Return the shift (2,) of the skin that gives a gap and an overlap, by Newton's method.

        Raises InputError if it finds none.
        """
        shift, size = np.zeros(2), float(np.ptp(self.skin[..., 0]))
        for _ in range(MOST_ROUNDS):
            now = replace(self, skin=self.skin + shift).setting
            wrong = np.array([gap - now.gap, overlap - now.overlap])
            if np.abs(wrong).max() <= SOLVED * max(size, float(np.abs(self.skin).max())):
                return shift
            step = np.linalg.lstsq(np.array([-now.normal, [-1.0, 0.0]]), wrong, rcond=1e-3)[0]
            shift = shift + step * min(1.0, LONGEST_STEP * size / max(float(np.linalg.norm(step)), 1e-300))
        raise InputError(f"gap = {gap:g}, overlap = {overlap:g}: no place of the element has them at this angle")


@dataclass(frozen=True, slots=True, eq=False)
class SlotSetting(Hinged):
    """The motion to a setting of a slot: an angle about the hinge, and a shift that gives gap and overlap.

    Attributes
    ----------
    hinge : the hinge of the undeflected mesh.
    beside : patch of the other element.
    angle : degrees.
    gap, overlap : lengths; None for those of the mesh.
    """

    hinge: Axis
    beside: str
    angle: float = 0.0
    gap: float | None = None
    overlap: float | None = None
    unit: ClassVar[str] = TRACK_UNIT

    def __post_init__(self) -> None:
        if self.gap is not None and not 0.0 < self.gap < np.inf:
            raise InputError(f"gap = {self.gap:g} must be a positive length")
        if self.overlap is not None and not abs(self.overlap) < np.inf:
            raise InputError(f"overlap = {self.overlap:g} must be a length")

    def slot(self, surface: Surface) -> Slot:
        """Return the slot of the undeflected mesh."""
        return min(
            (Slot.of(surface.mesh, name, self.beside) for name in surface.patches), key=lambda slot: slot.setting.gap
        )

    def law(self, surface: Surface) -> TrackLaw:
        """Return the straight track to the setting; InputError if no position of the element gives it."""
        if {*surface.mesh.expand([self.beside], "slot")} & {*surface.patches}:
            raise InputError(f"slot = {self.beside}: this is the surface itself; name the element beyond the slot")
        slot = self.slot(surface)
        is_ahead = bool((np.abs(surface.points[:, :2] - slot.edge).max(axis=1) == 0.0).any())
        now = slot.setting
        gap, overlap = (old if new is None else new for old, new in zip(now[:2], (self.gap, self.overlap), strict=True))
        shift = slot.turned(self.hinge, self.angle, is_ahead).shift(gap, overlap) * (-1.0 if is_ahead else 1.0)
        whole = np.append(shift, 0.0)
        return Track.straight(self.hinge, self.angle, whole, whole).law(surface)


def _trailing_edge(mesh: Mesh, patches: tuple[str, ...], skin: FloatArray) -> FloatArray:
    """Return the corner (2,) of an element's trailing edge that is nearest to a skin (S, 2, 2)."""
    faces = polygons_of(mesh.faces_of(patches))
    x = mesh.points[mesh.on(*patches), 0]
    corners = distinct(sharp_edges(mesh.points, faces, CORNER))
    rear = corners[mesh.points[corners, 0] >= x.max() - REAR * np.ptp(x)]
    nodes = rear if len(rear) else mesh.on(*patches)[[first_largest(x - x.min())]]
    places = mesh.points[nodes, :2]
    return np.asarray(min(places, key=lambda place: Slot(place, skin).setting.gap))

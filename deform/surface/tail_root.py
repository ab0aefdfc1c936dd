"""An all-moving tail whose root stays on a cylindrical body; a panel of the body follows (appendix A)."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.box.hexahedron import Hexahedron, box
from sdm_deflect.deform.mesh.axis import Axis, Cylinder
from sdm_deflect.deform.rbf.kernels import Multiquadric

from .appendix_a import elongate, slide_panel
from .motions import Functions, Powers
from .surface import Surface

POWERS = 6  # powers of the angle for displacements up to 15 degrees; they miss by 0.014 of the usual tolerance
SCALE = 15.0  # degrees at which these powers are 1


@dataclass(frozen=True, slots=True, eq=False)
class RootOnCylinder:
    """Rotation of a tail whose root line slides on a cylinder, with the panel around the root.

    All planes of the tail meet in the apex of its trapezoid. A node that slides along its ray to the rotated apex stays
    in its planes. So the root line slides along rays until it meets the cylinder, and a multiquadric of the sliding
    distance extends the root region. (The paper interpolates the displacement vector, which leaves the planes
    slightly.) The panel follows by thin plate splines between root line and border, projected radially onto the
    cylinder.

    Attributes
    ----------
    hinge : the axis of rotation.
    cylinder : the body.
    apex : (3,) point where the tail's planes meet.
    panel : patches of the body that follow; the other patches of the surface rotate.
    within : hexahedron outside which panel nodes stay; so do nodes that would leave it.
    depth : length of the extended root region, outboard of the root line.
    epsilon : shape parameter of the multiquadric, 1/length.
    """

    hinge: Axis
    cylinder: Cylinder
    apex: FloatArray
    panel: tuple[str, ...]
    within: Hexahedron = field(repr=False)
    depth: float
    epsilon: float = 1e4

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        return "deg"

    @property
    def axis(self) -> Axis:
        """The hinge."""
        return self.hinge

    def law(self, surface: Surface) -> "RootLaw":
        """Find the nodes of tail, root line, panel and the panel's border."""
        mesh = surface.mesh
        tail = surface.on([name for name in surface.patches if name not in self.panel])
        panel = surface.on(self.panel)
        border = surface.on([name for name in mesh.names if name not in self.panel])
        stays = panel & ~tail & (border | ~self.within.contains(surface.points))
        if not (tail & panel).any():
            raise InputError(f"{surface.label}: the surface and its panel share no node")
        return RootLaw(self, surface.points, tail, panel, stays)


@dataclass(frozen=True, slots=True, eq=False)
class RootLaw:
    """The motion of points (K, 3): masks (K,) of the tail, its panel, and the panel's nodes that stay.

    The root region and the nodes that stay are chosen for each amount, unless `chosen_at` fixes them.
    """

    motion: RootOnCylinder
    points: FloatArray = field(repr=False)
    tail: BoolArray = field(repr=False)
    panel: BoolArray = field(repr=False)
    stays: BoolArray = field(repr=False)
    chosen_at: float | None = None

    @property
    def exact(self) -> BoolArray:
        """Nodes (K,) of the tail."""
        return self.tail

    @property
    def beyond_root(self) -> BoolArray:
        """Nodes (K,) of the tail outboard of the extended region."""
        beyond = self.tail.copy()
        beyond[self.tail] = ~self._region(0.0).inside
        return beyond

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3).

        Raises InputError if the tail turns so far that a ray of its root misses the cylinder.
        """
        chosen_at = amount if self.chosen_at is None else self.chosen_at
        region = self._region(chosen_at)
        return self._moved(amount, region, self._staying(chosen_at, region))

    @property
    def functions(self) -> Functions:
        """Powers of the angle: the root slides, so sine and cosine are not enough."""
        return Powers(POWERS, SCALE)

    def frozen_at(self, amount: float) -> "RootLaw":
        """Return the law with the root region and the staying nodes of an amount."""
        return replace(self, chosen_at=amount)

    def _region(self, amount: float) -> "RootRegion":
        rotated = self.motion.hinge.rotated(self.points[self.tail], amount)
        return RootRegion.of(rotated, rotated[self.panel[self.tail]], self.motion.depth)

    def _staying(self, amount: float, region: "RootRegion") -> BoolArray:
        """Return the panel's nodes (K,) that stay, including those that would leave the hexahedron."""
        stays, within = self.stays, self.motion.within
        while True:
            follow = self.panel & ~self.tail & ~stays
            places = self.points[follow] + self._moved(amount, region, stays)[follow]
            leaving = ~within.contains(places)
            if not leaving.any():
                return stays
            stays = stays.copy()
            stays[np.flatnonzero(follow)[leaving]] = True

    def _moved(self, amount: float, region: "RootRegion", stays: BoolArray) -> FloatArray:
        motion, out = self.motion, np.zeros_like(self.points)
        rotated = motion.hinge.rotated(self.points[self.tail], amount)
        apex = motion.hinge.rotated(motion.apex[None], amount)[0]
        root = self.panel[self.tail]
        out[self.tail] = rotated + _extension(motion, rotated, root, apex, region) - self.points[self.tail]
        both = self.tail & self.panel
        follow = self.panel & ~both & ~stays
        values = slide_panel(self.points[self.panel], motion.cylinder, self.points[both], out[both], self.points[stays])
        out[follow] = values[follow[self.panel]]
        return out


class RootRegion(NamedTuple):
    """Tail nodes (T,) that are extended, and points (F, 3) outboard that stay."""

    inside: BoolArray
    still: FloatArray

    @classmethod
    def of(cls, rotated: FloatArray, root: FloatArray, depth: float) -> "RootRegion":
        """Take the nodes (T, 3) of a rotated tail within `depth` of its root nodes (R, 3)."""
        low, high = _ends(root, depth)
        region, tip = box(low, high), "y-" if root[:, 1].mean() < 0.0 else "y+"
        return cls(region.contains(rotated), (region.sites_on(tip, 0.25 * depth) - low) / (high - low))


def root_on(cylinder: Cylinder, root: FloatArray, rays: FloatArray) -> FloatArray:
    """Return where the rays (R, 3) of the root nodes (R, 3) meet the cylinder; InputError if one misses it."""
    try:
        return cylinder.projected_along(root, rays)
    except ValueError as error:
        raise InputError(f"the tail turns so far that its root leaves the fuselage: {error}; turn it less") from None


def _ends(root: FloatArray, depth: float) -> tuple[FloatArray, FloatArray]:
    return root.min(axis=0) - depth, root.max(axis=0) + depth


def _extension(
    motion: RootOnCylinder, rotated: FloatArray, root: BoolArray, apex: FloatArray, region: RootRegion
) -> FloatArray:
    """Return the displacement (T, 3) that extends the rotated tail (T, 3) onto the cylinder along rays to its apex.

    The root nodes slide until they meet the cylinder. Nodes within `depth` outboard slide by a multiquadric of that
    distance, which is zero at the region's end towards the tip.
    """
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    onto = root_on(motion.cylinder, rotated[root], rays[root]) - rotated[root]
    distances = np.einsum("ij,ij->i", onto, rays[root])[:, None]
    low, high = _ends(rotated[root], motion.depth)
    still, kernel = low + region.still * (high - low), Multiquadric(motion.epsilon)
    extension = elongate(rotated, region.inside, rotated[root], distances, still, kernel) * rays
    extension[root] = onto
    return np.asarray(extension)

"""An all-moving surface on a cylindrical body: its root stays on the body, whose panel follows (appendix A)."""

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

POWERS = 6  # of the angle, for its displacement within 15 degrees: they miss it by .014 of the usual tolerance
SCALE = 15.0  # deg, at which these powers are 1


@dataclass(frozen=True, slots=True, eq=False)
class RootOnCylinder:
    """Rotation of a tail whose root line slides on a cylinder, with the panel around it.

    Every plane of the tail contains the apex of its trapezoid, so a node that slides along its ray to the (rotated)
    apex stays on its planes: the root line slides until it meets the cylinder, and a multiquadric of that sliding
    distance extends the root region (the paper interpolates the displacement vector, which leaves the planes by what
    the blending is not affine). The panel follows by thin plate splines between root line and border, then radially
    back onto the cylinder.

    Attributes
    ----------
    hinge : the axis of rotation.
    cylinder : the body.
    apex : (3,) where the tail's planes meet.
    panel : patches of the body that follow; all other patches of the surface rotate.
    within : panel nodes outside stay, and those that would leave it.
    depth : length of the root region that is extended, outboard of the root line.
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
        """Sort the surface's nodes into tail, root line, panel and the panel's border."""
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
    """The motion of points (K, 3): masks (K,) of the tail, of its panel, and of the panel's nodes that stay.

    Which nodes belong to the root region, and which further ones stay, is decided anew at each amount, unless it is
    held at `chosen_at`.
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
        """Nodes (K,) of the tail outboard of the region that is extended."""
        beyond = self.tail.copy()
        beyond[self.tail] = ~self._region(0.0).inside
        return beyond

    def displacement(self, amount: float) -> FloatArray:
        """Return how far each node (K, 3) moves.

        Raises InputError if the tail turns so far that its root misses the cylinder.
        """
        chosen_at = amount if self.chosen_at is None else self.chosen_at
        region = self._region(chosen_at)
        return self._moved(amount, region, self._staying(chosen_at, region))

    @property
    def functions(self) -> Functions:
        """Powers of the angle: no sum of sine and cosine, for the root slides."""
        return Powers(POWERS, SCALE)

    def frozen_at(self, amount: float) -> "RootLaw":
        """Return the law with the same nodes in the root region and at rest as at an amount."""
        return replace(self, chosen_at=amount)

    def _region(self, amount: float) -> "RootRegion":
        rotated = self.motion.hinge.rotated(self.points[self.tail], amount)
        return RootRegion.of(rotated, rotated[self.panel[self.tail]], self.motion.depth)

    def _staying(self, amount: float, region: "RootRegion") -> BoolArray:
        """Return the panel's nodes (K,) that stay, those that would leave the hexahedron among them."""
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
    """Which of the tail's nodes (T,) are extended, and still points (F, 3) outboard, as shares of the root's box."""

    inside: BoolArray
    still: FloatArray

    @classmethod
    def of(cls, rotated: FloatArray, root: FloatArray, depth: float) -> "RootRegion":
        """Take the nodes (T, 3) of a rotated tail within `depth` of its root nodes (R, 3)."""
        low, high = _ends(root, depth)
        region, tip = box(low, high), "y-" if root[:, 1].mean() < 0.0 else "y+"
        return cls(region.contains(rotated), (region.sites_on(tip, 0.25 * depth) - low) / (high - low))


def root_on(cylinder: Cylinder, root: FloatArray, rays: FloatArray) -> FloatArray:
    """Return where the rays (R, 3) of a tail's root nodes (R, 3) meet the body; InputError if one misses it."""
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

    The root nodes slide until they meet the cylinder. Nodes within `depth` outboard of them slide by a multiquadric of
    that distance, which is zero at the tip-facing end of the root region.
    """
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    onto = root_on(motion.cylinder, rotated[root], rays[root]) - rotated[root]
    distances = np.einsum("ij,ij->i", onto, rays[root])[:, None]
    low, high = _ends(rotated[root], motion.depth)
    still, kernel = low + region.still * (high - low), Multiquadric(motion.epsilon)
    extension = elongate(rotated, region.inside, rotated[root], distances, still, kernel) * rays
    extension[root] = onto
    return np.asarray(extension)

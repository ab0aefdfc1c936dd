"""A surface blended between nodes that stay and nodes that follow a motion (paper appendix A)."""

from dataclasses import dataclass, field, replace
from numbers import Real

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, farthest
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.deform.rbf.kernels import Multiquadric
from sdm_deflect.meshing.mesh.axis import Axis

from .appendix_a import blend, blend_strip
from .motions import Functions, Motion, MotionLaw, SoughtHinge
from .surface import NodeSet, OnPatches, Surface, TrailingEdge

# Largest number of held, and of moving, nodes in a direct solve.
MOST = 800
# Held nodes farther from the hinge than this share of the largest distance are on a rib.
NEAR = 0.35
# Shape parameter times the surface's size: the multiquadric is then linear in r.
LINEAR = 1e5
# Degrees by which a chosen strip shears cells at the trailing edge, at the largest angle.
SHEAR = 35.0
# Nodes nearer to a rib than this share of the surface's length are on it; a chosen strip holds the next row.
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Rib:
    """Ribs where a surface ends at a parent without a gap, and the strip that is blended there.

    Attributes
    ----------
    nodes : held nodes on ribs; None for those far from the hinge.
    share : width of the strip, as a share of the surface's length along `direction`.
    width : width of the strip as a length; 0 to use `share`.
    direction : (3,) direction across the strip; None for the hinge's.
    turn : largest angle in degrees, for which the width is chosen (`width_for`); 0 to use `width` or `share`.
    """

    nodes: NodeSet | None = None
    share: float = 0.2
    width: float = 0.0
    direction: FloatArray | None = None
    turn: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.share <= 1.0 and 0.0 <= self.width < np.inf):
            raise InputError(f"strip = {self.width or self.share} must be a positive width, as a share at most 1")

    def width_for(self, points: FloatArray, hinge: Axis) -> float:
        """Return the width of the strip of a surface with nodes (K, 3), a length.

        A chosen width shears cells at the trailing edge by `SHEAR` degrees at the largest angle.
        """
        if self.turn:
            reach = float(np.linalg.norm(hinge.radial(points), axis=1).max())
            return 2.0 * reach * float(np.sin(np.radians(abs(self.turn)) / 2.0) / np.tan(np.radians(SHEAR)))
        across = hinge.direction if self.direction is None else self.direction
        return self.width or self.share * float(np.ptp(points @ across))


@dataclass(frozen=True, slots=True, eq=False)
class Blended:
    """A motion blended between held and driven nodes, by a multiquadric that is linear in the distance.

    Held nodes far from the hinge are on a rib without a gap; a strip beside it is blended spanwise. Outside the strip
    plane faces stay plane (appendix A), if the hinge nodes are only those of the hinge edges.

    Attributes
    ----------
    base : motion of the driven nodes.
    held : nodes that stay; by default those shared with other patches.
    driven : nodes that follow `base`; by default the sharp edges far from the hinge.
    rib : how strips beside closed ribs are blended.
    hinge_nodes : held nodes of the chordwise blending; None for those near the hinge.
    epsilon : shape parameter of the multiquadric, 1/length; 0 for `LINEAR` over the surface's size.

    Raises InputError if `base` is not a motion, or `held` or `driven` not a set of nodes.
    """

    base: Motion
    held: NodeSet = field(default_factory=OnPatches)
    driven: NodeSet = field(default_factory=TrailingEdge)
    rib: Rib = field(default_factory=Rib)
    hinge_nodes: NodeSet | None = None
    epsilon: float = 0.0

    def __post_init__(self) -> None:
        if not hasattr(self.base, "law"):
            given = shortened(self.base)
            raise InputError(f"base = {given} is no motion: give one such as Rotation.about(first, second)")
        for name in ("held", "driven", "hinge_nodes"):
            given = getattr(self, name)
            if not hasattr(given, "of") and (name != "hinge_nodes" or given is not None):
                kinds = "OnPatches, TrailingEdge or Listed"
                raise InputError(f"{name} = {shortened(given)} is no set of nodes: give {kinds}")
        if not isinstance(self.rib, Rib):
            raise InputError(f"rib = {shortened(self.rib)} is no Rib")
        if not isinstance(self.epsilon, Real) or not 0.0 <= self.epsilon < np.inf:
            raise InputError(f"epsilon = {shortened(self.epsilon)} must be a positive number, or 0 to have it chosen")

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        return self.base.unit

    @property
    def axis(self) -> Axis | None:
        """The hinge."""
        return self.base.axis

    def law(self, surface: Surface) -> "BlendedLaw":
        """Find the held, driven and strip nodes of a surface.

        Raises InputError if no node is held or none driven, or if the strips cover the whole surface.
        """
        hinge, points = self.base.axis, surface.points
        if isinstance(self.base, SoughtHinge):
            self.base.law(surface)
        if hinge is None:
            raise InputError(f"{surface.label}: a blended motion needs a hinge")
        held = self.held.of(surface, hinge)
        follow = self.driven.of(surface, hinge)
        driven = follow & ~held
        if follow.any() and not driven.any():
            raise InputError(
                f"{surface.label}: all {int(follow.sum())} nodes that follow the motion are held as well; name fewer "
                "patches or nodes in held, or in fixed, which is held by default, or cut out both skins"
            )
        stay, go = "nodes that stay, such as its hinge edge", "nodes that follow the motion, such as its trailing edge"
        for mask, what, option in ((held, stay, "held"), (driven, go, "driven")):
            if not mask.any():
                raise InputError(f"{surface.label}: found no {what}; mend the hinge, or name them by --{option}")
        reach = np.linalg.norm(hinge.radial(points), axis=1)
        given = self.hinge_nodes.of(surface, hinge) if self.hinge_nodes else held & (reach <= NEAR * reach.max())
        front = given & held if (given & held).any() else held
        ribs = self.rib.nodes.of(surface, hinge) if self.rib.nodes else held & ~front
        strip = _strip(self.rib, points, ribs, hinge)
        if strip.all():
            raise InputError(
                f"{surface.label}: all of it lies beside a rib that stays: lower the strip's width, or move the "
                "hinge to the surface's front edge; a surface that is cut out must end along the hinge"
            )
        kernel = Multiquadric(self.epsilon or LINEAR / float(np.ptp(points, axis=0).max()))
        return BlendedLaw(self.base.law(surface), points, held, driven, front, strip, kernel)


@dataclass(frozen=True, slots=True, eq=False)
class BlendedLaw:
    """A blended motion of points (K, 3).

    Attributes
    ----------
    base : motion of the driven nodes.
    held, driven, front : (K,) nodes that stay, that follow, and the held ones of the chordwise blending.
    strip : (K,) nodes beside closed ribs, which are blended spanwise.
    kernel : the multiquadric.
    """

    base: MotionLaw
    points: FloatArray = field(repr=False)
    held: BoolArray = field(repr=False)
    driven: BoolArray = field(repr=False)
    front: BoolArray = field(repr=False)
    strip: BoolArray = field(repr=False)
    kernel: Multiquadric

    @property
    def exact(self) -> BoolArray:
        """Nodes (K,) outside the strips beside closed ribs."""
        return ~self.strip

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3)."""
        return self._spread(self.base.displacement(amount))

    @property
    def functions(self) -> Functions:
        """Functions of the base motion, because blending is linear."""
        return self.base.functions

    def frozen_at(self, amount: float) -> "BlendedLaw":
        """Return the law with its base frozen."""
        return replace(self, base=self.base.frozen_at(amount))

    def _spread(self, full: FloatArray) -> FloatArray:
        """Blend between 0 at the held nodes and `full` (K, 3) at the driven nodes."""
        points, rows = self.points, _thin(self.points, self.driven)
        out = blend(points, points[_thin(points, self.front)], points[rows], full[rows], self.kernel)
        out[self.driven] = full[self.driven]
        if self.strip.any():
            out = blend_strip(points, self.strip, out, points[_thin(points, self.held)], self.kernel)
        out[self.held] = 0.0
        return out


def _strip(rib: Rib, points: FloatArray, ribs: BoolArray, hinge: Axis) -> BoolArray:
    if not ribs.any():
        return np.zeros(len(points), dtype=bool)
    station = points @ (hinge.direction if rib.direction is None else rib.direction)
    ends = np.concatenate([[-np.inf], np.unique(station[ribs]), [np.inf]])
    after = np.searchsorted(ends, station)
    gap = np.minimum(station - ends[after - 1], ends[after] - station)
    width = rib.width_for(points, hinge)
    if rib.turn:
        width = max(width, (1.0 + ROUNDING) * float(gap[gap > ROUNDING * np.ptp(station)].min(initial=np.inf)))
    return np.asarray(gap < width)


def _thin(points: FloatArray, mask: BoolArray) -> IntArray:
    """Return the rows of a mask; more than `MOST` are thinned evenly."""
    rows = np.flatnonzero(mask)
    return rows[farthest(points[rows], MOST)] if len(rows) > MOST else rows

"""A surface blended between nodes that stay and nodes that follow a motion (appendix A)."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.motion import Motion
from sdm_deflect.cases.own.surface import BoolArray, NodeSet, OnPatches, Surface, TrailingEdge
from sdm_deflect.deform.rbf.kernels import FloatArray, Multiquadric
from sdm_deflect.deform.rbf.points import IndexArray, farthest
from sdm_deflect.deform.surface.appendix import blend, blend_strip
from sdm_deflect.deform.surface.axis import Axis

MOST = 800  # nodes of either kind that a direct solve takes in a moment
NEAR = 0.35  # of the largest distance from the hinge: held nodes beyond are on a rib
LINEAR = 1e5  # shape parameter times the surface's size: the multiquadric is then linear in r


@dataclass(frozen=True, slots=True, eq=False)
class Blended:
    """Between held nodes and driven ones, by a multiquadric that is linear in the distance.

    Held nodes far from the hinge are on a rib without a gap: there a strip of the surface is blended spanwise, and
    beyond it planar faces stay planar (appendix A).

    Attributes
    ----------
    base : the motion of the driven nodes.
    held : nodes that stay; by default those shared with other patches.
    driven : nodes that follow; by default the sharp edges far from the hinge.
    strip : width of the strip beside a rib, as a share of the surface's length along the hinge.
    """

    base: Motion
    held: NodeSet = field(default_factory=OnPatches)
    driven: NodeSet = field(default_factory=TrailingEdge)
    strip: float = 0.2

    @property
    def unit(self) -> str:
        """Unit of the amount."""
        return self.base.unit

    @property
    def axis(self) -> Axis | None:
        """The hinge."""
        return self.base.axis

    def displacement(self, surface: Surface, amount: float) -> FloatArray:
        """Return how far each node (K, 3) moves."""
        return self._spread(surface, self.base.displacement(surface, amount))

    def rate(self, surface: Surface, amount: float) -> FloatArray:
        """Return the derivative (K, 3); blending is linear, so it is the blended derivative."""
        return self._spread(surface, self.base.rate(surface, amount))

    def _spread(self, surface: Surface, full: FloatArray) -> FloatArray:
        """Blend between zero at the held nodes and `full` (K, 3) at the driven ones."""
        hinge = _hinge(self.base, surface)
        held, driven = self._nodes(surface, hinge)
        points = surface.points
        kernel = Multiquadric(LINEAR / float(np.ptp(points, axis=0).max()))
        reach = np.linalg.norm(hinge.radial(points), axis=1)
        front = held & (reach <= NEAR * reach.max())
        rib = held & ~front
        rows = _thinned(points, driven)
        fixed = points[_thinned(points, front if front.any() else held)]
        out = blend(points, fixed, points[rows], full[rows], kernel)
        out[driven] = full[driven]
        if rib.any() and front.any():
            out = self._beside_ribs(points, hinge, out, held, rib)
        out[held] = 0.0
        return out

    def _beside_ribs(
        self, points: FloatArray, hinge: Axis, out: FloatArray, held: BoolArray, rib: BoolArray
    ) -> FloatArray:
        """Blend spanwise between ribs that stay and what lies beyond the strip."""
        station = points @ hinge.direction
        ends = np.unique(station[rib])
        place = np.clip(np.searchsorted(ends, station), 1, max(1, len(ends) - 1))
        gap = np.minimum(np.abs(station - ends[place - 1]), np.abs(station - ends[min(1, len(ends) - 1) * place]))
        strip = gap < self.strip * float(np.ptp(station))
        if strip.all():
            raise InputError("the whole surface lies beside a rib that stays: lower the strip's width")
        kernel = Multiquadric(LINEAR / float(np.ptp(points, axis=0).max()))
        return blend_strip(points, strip, out, points[_thinned(points, held)], kernel)

    def _nodes(self, surface: Surface, hinge: Axis) -> tuple[BoolArray, BoolArray]:
        held = self.held.of(surface, hinge)
        driven = self.driven.of(surface, hinge) & ~held
        for mask, what in ((held, "nodes that stay, such as its hinge edge"), (driven, "nodes that follow the motion")):
            if not mask.any():
                raise InputError(f"{', '.join(surface.patches)}: found no {what}; name a patch or give a list of nodes")
        return held, driven


def _hinge(motion: Motion, surface: Surface) -> Axis:
    if motion.axis is None:
        raise InputError(f"{', '.join(surface.patches)}: a blended motion needs a hinge")
    return motion.axis


def _thinned(points: FloatArray, mask: BoolArray) -> IndexArray:
    """Return rows of a mask, at most MOST of them, evenly spread."""
    rows = np.flatnonzero(mask)
    return rows[farthest(points[rows], MOST)] if len(rows) > MOST else rows

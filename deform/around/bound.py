"""Bound nodes, which slide on shapes or move as images of one another, and images among the free nodes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.rbf.problem import DataSites

from .addition import Acting, Addition

ROUNDS = 8
"""Number of times that nodes are put on several shapes, one after another."""


@dataclass(frozen=True, slots=True, eq=False)
class Bind(Addition):
    """What binds nodes.

    Attributes
    ----------
    nodes : (L,) the bound nodes.
    sampled : rows of these that are data sites once they are known.
    shapes : shapes on which bound nodes slide, with the rows of these.
    images : nodes that move as images of one another.
    components : directions in which nodes move.
    """

    nodes: IntArray = field(repr=False)
    sampled: IntArray = field(repr=False)
    shapes: tuple[tuple[SlidingSurface, IntArray], ...] = field(repr=False)
    images: Images = field(repr=False)
    components: tuple[int, ...]

    def at(self, points: FloatArray, free: IntArray) -> "Binding":
        """See `Addition`."""
        return Binding(self, points[self.nodes], self.images.among(self.nodes), self.images.among(free))


@dataclass(frozen=True, slots=True, eq=False)
class Binding(Acting):
    """What binds nodes in one step, with the bound ones at `points` (L, 3); images among these and the free nodes."""

    of: Bind = field(repr=False)
    points: FloatArray = field(repr=False)
    bound: Images = field(repr=False)
    free: Images = field(repr=False)

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return the bound nodes, once they are known."""
        rows, columns = self.of.sampled, self.of.components
        if not last or not len(rows):
            return ()
        values = known[len(known) - len(self.points) :]
        return (DataSites(self.points[rows], values[rows][:, columns], columns),)

    def corrected(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Put nodes on their shapes, as images of one another; those on several, on one after another."""
        del known
        if last:
            return self.free.projected(u)
        several = len(self.of.shapes) + bool(len(self.bound.nodes)) > 1
        for shape, rows in self.of.shapes * (ROUNDS if several else 1):
            u[rows] = shape.projected(self.points[rows], u[rows])
            u = self.bound.projected(u)
        return self.bound.projected(u)

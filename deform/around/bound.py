"""Bound nodes, which slide on shapes or move as images of one another, and images among the free nodes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.box.face_sites import border_sites
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.confined import zero_sites
from sdm_deflect.deform.mesh.images import Images
from sdm_deflect.deform.mesh.sliding import Plane, SlidingSurface
from sdm_deflect.deform.rbf.problem import DataSites

from .addition import Acting, Addition, Kept

ROUNDS = 8
"""Number of times that nodes are put on several shapes, one after another."""


@dataclass(frozen=True, slots=True, eq=False)
class Bind(Addition):
    """What binds nodes.

    Attributes
    ----------
    nodes : (L,) the bound nodes.
    sampled : rows of these that are data sites once they are known.
    slides : patches on whose shapes bound nodes slide, with these.
    faces : planes of faces of blocks, and the bound nodes on these, which stay in them as well.
    images : nodes that move as images of one another.
    components : directions in which nodes move.
    sides : planes that bound the mesh, with the length within which a point is on one, and its sign on the mesh's side.
    walls : planes of pairs, where the box may cut them.
    """

    nodes: IntArray = field(repr=False)
    sampled: IntArray = field(repr=False)
    slides: tuple[Kept, ...] = field(repr=False)
    faces: tuple[tuple[Plane, IntArray], ...] = field(repr=False)
    images: Images = field(repr=False)
    components: tuple[int, ...]
    sides: tuple[tuple[Plane, float, float], ...] = field(repr=False)
    walls: tuple[Plane, ...] = field(repr=False)

    def on_box(self, hexahedron: Hexahedron, sites: FloatArray, spacing: float) -> FloatArray:
        """Add sites where the box cuts planes of pairs, and drop those behind planes: nothing is there to be held.

        Between two planes of pairs there may be less than a spacing.
        """
        around = [np.empty((0, 3))]
        for plane in self.walls:
            heights = plane.distance(hexahedron.corners)
            if heights.min() < 0.0 < heights.max():
                around.append(border_sites(hexahedron.section(plane.point, plane.normal), spacing))
        cut = np.vstack(around)
        sites = np.vstack([zero_sites(sites, cut, spacing), cut]) if len(cut) else sites
        for plane, near, sign in self.sides:
            sites = sites[plane.distance(sites) * sign >= -near]
        return np.ascontiguousarray(sites)

    def shapes(self) -> Sequence[Kept]:
        """Return the patches on whose shapes nodes slide."""
        return self.slides

    def at(self, points: FloatArray, free: IntArray) -> "Binding":
        """See `Addition`."""
        slides = [(one.shape, one.nodes) for one in self.slides if not isinstance(one.shape, str)]
        shapes = tuple((shape, np.searchsorted(self.nodes, nodes)) for shape, nodes in (*slides, *self.faces))
        return Binding(self, points[self.nodes], shapes, self.images.among(self.nodes), self.images.among(free))


@dataclass(frozen=True, slots=True, eq=False)
class Binding(Acting):
    """What binds nodes in one step.

    Attributes
    ----------
    of : what does in all steps.
    points : (L, 3) the bound nodes.
    shapes : shapes, and the rows of the bound nodes on each.
    bound, free : images among the bound nodes, and among the free ones.
    """

    of: Bind = field(repr=False)
    points: FloatArray = field(repr=False)
    shapes: tuple[tuple[SlidingSurface, IntArray], ...] = field(repr=False)
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
        several = len(self.shapes) + bool(len(self.bound.nodes)) > 1
        for shape, rows in self.shapes * (ROUNDS if several else 1):
            u[rows] = shape.projected(self.points[rows], u[rows])
            u = self.bound.projected(u)
        return self.bound.projected(u)

"""Nodes that slide on shapes or move like their periodic images.

In the first pass nodes of planes hold the displacement along the normal, and no other component of it. Without that the
mesh runs past the corner of two planes. The pass takes displacements along the normals, not along x, y and z, if planes
stand at an angle: so each direction is still interpolated on its own. Sites that hold a normal component alone would
couple the directions in one system of three times the size. Normals of a cylinder turn from node to node, so
cylinders and surfaces hold nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct, union
from sdm_deflect.base.ties import EQUAL, first_largest
from sdm_deflect.deform.box.face_sites import border_sites
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.confined import zero_sites
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites
from sdm_deflect.meshing.mesh.edges import unit
from sdm_deflect.meshing.mesh.images import Images
from sdm_deflect.meshing.mesh.sliding import Plane, SlidingSurface

from .modifier import Linearized, Modifier, ModifierAtStep, NodesOnShape

# Largest share of a normal across a direction for the two to count as alike: fitted normals are as exact as that.
ALONG = 1e-6
# How often nodes on several shapes are projected onto each in turn.
ROUNDS = 8


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedNodes(Modifier):
    """Bound nodes: those that slide, and those that move like their images.

    Attributes
    ----------
    nodes : (L,) the bound nodes.
    sampled : rows of `nodes` that become data sites after the first pass.
    slides : sliding patches, their shapes and their bound nodes.
    faces : planes of block faces with the bound nodes on them, which stay in these planes too.
    images : nodes that move as images of one another.
    components : directions in which nodes move.
    sides : planes that bound the mesh; for each the distance below which a point is on it, and the sign of the mesh's
        side.
    walls : planes of periodic pairs that the box may cut.
    """

    nodes: IntArray = field(repr=False)
    sampled: IntArray = field(repr=False)
    slides: tuple[NodesOnShape, ...] = field(repr=False)
    faces: tuple[tuple[Plane, IntArray], ...] = field(repr=False)
    images: Images = field(repr=False)
    components: tuple[int, ...]
    sides: tuple[tuple[Plane, float, float], ...] = field(repr=False)
    walls: tuple[Plane, ...] = field(repr=False)

    @property
    def directions(self) -> FloatArray | None:
        """Directions (3, 3) of the first pass, `held_directions` of the planes; None for x, y and z."""
        own = [c for c in range(3) if c not in self.components]
        own += [int(np.abs(plane.normal).argmax()) for plane, _ in self.faces]
        normals = [slide.shape.normal for slide in self.slides if isinstance(slide.shape, Plane)]
        return held_directions(distinct(np.array(own, dtype=np.intp)), normals)

    @property
    def held(self) -> set[int]:
        """Which directions of the first pass some plane holds."""
        directions = self.directions
        planes = (slide.shape for slide in self.slides if isinstance(slide.shape, Plane) and len(slide.nodes))
        return {row for plane in planes if (row := along(directions, plane.normal)) is not None}

    def on_box(self, hexahedron: Hexahedron, sites: FloatArray, spacing: float) -> FloatArray:
        """Add sites where the box cuts periodic planes, and drop sites behind planes that bound the mesh.

        Two periodic planes may be less than one spacing apart.
        """
        around = [np.empty((0, 3))]
        for plane in self.walls:
            heights = plane.distance(hexahedron.corners)
            touching = EQUAL * float(np.ptp(hexahedron.corners, axis=0).max())
            if heights.min() < -touching and heights.max() > touching:
                around.append(border_sites(hexahedron.section(plane.point, plane.normal), spacing))
        cut = np.vstack(around)
        sites = np.vstack([zero_sites(sites, cut, spacing), cut]) if len(cut) else sites
        for plane, near, sign in self.sides:
            sites = sites[plane.distance(sites) * sign >= -near]
        return np.ascontiguousarray(sites)

    def shapes(self) -> Sequence[NodesOnShape]:
        """Return the sliding patches with their shapes."""
        return self.slides

    def at(self, points: FloatArray, free: IntArray) -> "ConstraintAtStep":
        slides = [(slide.shape, slide.nodes) for slide in self.slides if not isinstance(slide.shape, str)]
        shapes = tuple((shape, np.searchsorted(self.nodes, nodes)) for shape, nodes in (*slides, *self.faces))
        return ConstraintAtStep(
            self, points[self.nodes], shapes, self.images.among(self.nodes), self.images.among(free)
        )


def held_directions(own: IntArray, normals: Sequence[FloatArray]) -> FloatArray | None:
    """Return three directions (3, 3) at right angles, normals of planes among them; None if they are x, y and z.

    Normals are taken in their order. One that is neither along nor across those before is left out.

    Parameters
    ----------
    own : Numbers of the coordinate axes that stay directions.
    normals : Unit vectors.
    """
    taken = [np.eye(3)[c] for c in own]
    for normal in normals:
        if all(abs(normal @ other) <= ALONG for other in taken):
            taken.append(normal)
    if all(np.count_nonzero(normal) == 1 for normal in taken):
        return None
    while len(taken) < 3:
        left = np.eye(3) - sum(np.outer(other, other) for other in taken)
        taken.append(unit(left[[first_largest(np.linalg.norm(left, axis=1))]])[0])
    out = np.empty((3, 3))
    out[[*own, *(c for c in range(3) if c not in own)]] = taken
    return out


def along(directions: FloatArray | None, normal: FloatArray) -> int | None:
    """Return which of three directions a unit normal (3,) is along; None if it is along none of them."""
    shares = np.abs(normal if directions is None else directions @ normal)
    return int(shares.argmax()) if np.count_nonzero(shares > ALONG) == 1 else None


@dataclass(frozen=True, eq=False)
class ConstraintAtStep(ModifierAtStep):
    """Bound nodes in one step.

    Attributes
    ----------
    of : the bound nodes, whatever the step.
    points : (L, 3) the bound nodes.
    shapes : shapes, each with the rows of the bound nodes on it.
    bound, free : images among the bound nodes, and among the free ones.
    """

    of: ConstrainedNodes = field(repr=False)
    points: FloatArray = field(repr=False)
    shapes: tuple[tuple[SlidingSurface, IntArray], ...] = field(repr=False)
    bound: Images = field(repr=False)
    free: Images = field(repr=False)

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return the data sites: in the first pass nodes of planes, along the normal alone; in the last all of them."""
        rows, columns = self.of.sampled, self.of.components
        if not last:
            return self._on_planes
        if not len(rows):
            return ()
        values = known[len(known) - len(self.points) :]
        return (DataSites(self.points[rows], values[rows][:, columns], columns),)

    @cached_property
    def _on_planes(self) -> Sequence[DataSites]:
        """Zero sites at nodes of planes: one set for each direction that a plane holds."""
        directions, held = self.of.directions, [list[IntArray]() for _ in range(3)]
        for shape, nodes in self.shapes:
            row = along(directions, shape.normal) if isinstance(shape, Plane) else None
            if row is not None:
                held[row].append(np.intersect1d(nodes, self.of.sampled, assume_unique=True))
        rows = [(c, union(*parts)) for c, parts in enumerate(held) if parts]
        return tuple(fixed_sites(self.points[nodes], (c,)) for c, nodes in rows if len(nodes))

    def correct(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Project nodes onto their shapes, and make images move alike."""
        del known
        if last:
            return self.free.projected(u)
        several = len(self.shapes) + bool(len(self.bound.nodes)) > 1
        for shape, rows in self.shapes * (ROUNDS if several else 1):
            u[rows] = shape.projected(self.points[rows], u[rows])
            u = self.bound.projected(u)
        return self.bound.projected(u)

    def linearized(self, u: FloatArray, known: FloatArray, last: bool) -> "ConstraintRates":
        """Return the derivative; of bound nodes along the projections of `u`."""
        trail, u = [], np.array(u)
        several = len(self.shapes) + bool(len(self.bound.nodes)) > 1
        for shape, rows in () if last else self.shapes * (ROUNDS if several else 1):
            trail.append((shape, rows, u[rows]))
            u[rows] = shape.projected(self.points[rows], u[rows])
            u = self.bound.projected(u)
        return ConstraintRates(self, last, tuple(trail), len(known))


@dataclass(frozen=True, slots=True, eq=False)
class ConstraintRates(Linearized):
    """The derivative of bound nodes' projections. Each is orthogonal at its place, so it is its own transpose.

    Attributes
    ----------
    of : the bound nodes.
    last : whether the pass is for the free nodes.
    trail : shapes in turn, with their rows and the displacements (R, 3) before each projection.
    known : number of known nodes.
    """

    of: ConstraintAtStep = field(repr=False)
    last: bool
    trail: tuple[tuple[SlidingSurface, IntArray, FloatArray], ...] = field(repr=False)
    known: int

    @property
    def images(self) -> Images:
        """Images among the nodes of the pass."""
        return self.of.free if self.last else self.of.bound

    def sites(self, known: FloatArray) -> Sequence[DataSites]:
        """Return the bound nodes with their rates in the last pass."""
        return self.of.sites(known, self.last)

    def sites_reverse(self, gradient: FloatArray) -> FloatArray:
        """Put the gradient at the bound nodes."""
        out = np.zeros((self.known, 3))
        out[self.known - len(self.of.points) + self.of.of.sampled] = gradient
        return out

    def forward(self, rate: FloatArray, known: FloatArray) -> FloatArray:
        """Project the rates in the order of the projections."""
        del known
        out = np.array(rate)
        for shape, rows, u in self.trail:
            out[rows] = shape.rate(self.of.points[rows], u, out[rows])
            out = np.array(self.images.projected(out))
        return self.images.projected(out)

    def reverse(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray | float]:
        """Project the gradient in the opposite order."""
        out = np.array(self.images.projected(gradient))
        for shape, rows, u in reversed(self.trail):
            out = np.array(self.images.projected(out))
            out[rows] = shape.rate(self.of.points[rows], u, out[rows])
        return out, 0.0

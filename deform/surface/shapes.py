"""Shapes of a surface: new places of its nodes, given when a job is made, or later."""

from dataclasses import dataclass, field
from math import ceil
from typing import ClassVar

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.cells import bounded
from sdm_deflect.meshing.mesh.edges import edges_of, polygons_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .motions import Functions, MotionLaw, Smooth
from .placement import UNITS
from .surface import Surface
from .tables import TableLaw

# Median ratio of the edges' lengths, after to before, of shapes: exchanged rows make edges as long as the surface, and
# displacements in place of places shrink them to nothing.
SHORT, LONG = 0.1, 3.0
# Share of the surface's size by which nodes move at most in the right unit of length: half a chord is what a flap moves
# that turns by 30 degrees.
NEAR = 0.5
# Distance that is zero, as a share of the surface's size: files hold six digits or more.
STAYS = 1e-6


@dataclass(frozen=True, slots=True)
class AnyShape:
    """A motion that is given later, as places of the surface's nodes. Until then nothing moves."""

    axis: ClassVar[None] = None

    @property
    def unit(self) -> str:
        """The unit of the amount: a share of the shape."""
        return "of the shape"

    def law(self, surface: Surface) -> MotionLaw:
        """Return the law of a surface that stays."""
        return TableLaw(np.zeros_like(surface.points))


@dataclass(frozen=True, slots=True, eq=False)
class NodePlaces:
    """New places of a surface's nodes.

    Attributes
    ----------
    places : (R, 3) in the mesh's unit of length, or (R, 2) of a plane mesh.
    numbers : (R,) numbers of the nodes in the mesh's file, from 0; None if the rows are the surface's nodes in order.
    title : name of the file, for messages.

    Raises InputError for other shapes, numbers that are not finite, or a node that is given twice.
    """

    places: FloatArray = field(repr=False)
    numbers: IntArray | None = field(default=None, repr=False)
    title: str = "to"

    def __post_init__(self) -> None:
        places = bounded(self.places, "places")
        object.__setattr__(self, "places", places)
        if places.ndim != 2 or places.shape[1] not in (2, 3):
            raise InputError(f"places {places.shape} must be (K, 3), or (K, 2) of a plane mesh")
        if self.numbers is not None and len(np.unique(self.numbers)) < len(places):
            raise InputError("a node is given twice")

    def displacement(self, surface: Surface) -> FloatArray:
        """Return the displacement (K, 3) of a surface's nodes.

        Raises InputError if a node of the surface is missing, if another one would move, or for two columns of places
        in a mesh in space.
        """
        if self.places.shape[1] == 2 and not surface.mesh.plane:
            raise InputError(f"{self.title}: it lacks z, and {surface.mesh.name} is a mesh in space")
        rows = self._rows(surface)
        out = np.zeros_like(surface.points)
        columns = self._columns(surface.mesh)
        out[:, columns] = self.places[rows] - surface.points[:, columns]
        return out

    def check(self, surface: Surface, force: bool) -> None:
        """Raise InputError for places in another unit of length, or in another order of nodes (unless `force`)."""
        if force:
            return
        move, size = self.displacement(surface), float(np.ptp(surface.points, axis=0).max())
        far = float(np.linalg.norm(move, axis=1).max())
        for factor in UNITS if far > size else ():
            off = np.linalg.norm(factor * (surface.points + move) - surface.points, axis=1)
            if off.max() < NEAR * size:
                raise InputError(
                    f"{self.title}: times {factor:.4g} its places would be near {surface.label}: give them in the "
                    "mesh's unit of length, or say --force (force = true) if it is meant"
                )
        faces = surface.mesh.faces_of(surface.patches)
        first, second = np.searchsorted(surface.nodes, edges_of(polygons_of(faces))[0].T) if faces else ([], [])
        before, after = (
            np.linalg.norm(places[first] - places[second], axis=1) for places in (surface.points, surface.points + move)
        )
        ratio = float(np.median(after[before > 0.0] / before[before > 0.0])) if before.any() else 1.0
        if not SHORT < ratio < LONG:
            order = "Are its rows in the order of the mesh's nodes, and numbers counted from 0?"
            hint = "Are these displacements? Give places." if ratio <= SHORT else order
            raise InputError(
                f"{self.title}: half of the edges of {surface.label} would be {ratio:.2g} times as long. {hint} If it "
                "is meant, say --force (force = true)"
            )

    def _columns(self, mesh: Mesh) -> list[int]:
        """Return the coordinate axes of the columns of places."""
        return [axis for axis in range(3) if self.places.shape[1] == 3 or axis != mesh.across]

    def _rows(self, surface: Surface) -> IntArray:
        """Return the row (K,) of each node of a surface."""
        mesh, label = surface.mesh, surface.label
        if self.numbers is None:
            if len(self.places) != len(surface.nodes):
                raise InputError(
                    f"{self.title}: {len(self.places)} places, and {label} has {len(surface.nodes)} nodes: give one "
                    "place for each, in the order of the mesh's file, or number the nodes"
                )
            return np.arange(len(surface.nodes))
        order = np.argsort(self.numbers)
        wanted = mesh.numbers(surface.nodes)
        at = np.searchsorted(self.numbers, wanted, sorter=order).clip(max=len(order) - 1)
        rows = order[at]
        missing = np.flatnonzero(self.numbers[rows] != wanted)
        if len(missing):
            raise InputError(
                f"{self.title}: {len(missing)} of {len(wanted)} nodes of {label} are not listed, such as node "
                f"{wanted[missing[0]]} at {surface.points[missing[0]].tolist()}"
            )
        self._check_others(surface, np.setdiff1d(np.arange(len(self.numbers)), rows, assume_unique=True))
        return np.asarray(rows)

    def _check_others(self, surface: Surface, rows: IntArray) -> None:
        """Raise InputError if a listed node that is not on the surface is unknown, or would move."""
        mesh, numbers = surface.mesh, self.numbers[rows] if self.numbers is not None else rows
        nodes = np.searchsorted(mesh.whole.nodes, numbers) if mesh.whole else numbers
        known = (numbers >= 0) & (nodes < len(mesh.points))
        known[known] &= mesh.numbers(nodes[known]) == numbers[known]
        if not known.all():
            where = "in the part of it that is read" if mesh.whole else f"in {mesh.name}"
            raise InputError(
                f"{self.title}: {int((~known).sum())} listed nodes, such as {numbers[~known][0]}, are on no moving "
                f"surface and not {where}: leave them out"
            )
        off = np.abs(self.places[rows] - mesh.points[nodes][:, self._columns(mesh)]).max(axis=1, initial=0.0)
        moves = np.flatnonzero(off > STAYS * float(np.ptp(surface.points, axis=0).max()))
        if len(moves):
            raise InputError(
                f"{self.title}: {len(moves)} listed nodes that are not on {surface.label} would move by up to "
                f"{off.max():.4g}, such as node {numbers[moves[0]]}: name their patches, too, or leave them in place"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Shapes(AnyShape):
    """Shapes that a surface takes one after another; the amount 1 is the first, 2 the second, and so on.

    Attributes
    ----------
    shapes : the places of each.
    largest : largest displacement that the box must hold, a length; 0 for that of the shapes.
    """

    shapes: tuple[NodePlaces, ...] = field(default=(), repr=False)
    largest: float = 0.0

    @property
    def unit(self) -> str:
        """The unit of the amount: a share of the only shape, or the number of one among several."""
        return "of the shape" if len(self.shapes) == 1 else "of the series"

    def law(self, surface: Surface) -> MotionLaw:
        """Return the law of a surface's nodes; InputError as `NodePlaces.displacement`."""
        vectors = np.stack([shape.displacement(surface) for shape in self.shapes])
        return TableLaw(vectors[0]) if len(vectors) == 1 else ShapesLaw(vectors)


@dataclass(frozen=True, slots=True)
class Stops(Functions):
    """The functions of several shapes: the box must contain each. They have no plan."""

    count: int

    @property
    def stops(self) -> tuple[float, ...]:
        """The amounts of the shapes."""
        return tuple(map(float, range(1, self.count + 1)))


@dataclass(frozen=True, slots=True, eq=False)
class ShapesLaw(Smooth):
    """The displacements (n, K, 3) of several shapes; straight from each to the next one."""

    vectors: FloatArray = field(repr=False)

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,)."""
        return np.ones(self.vectors.shape[1], dtype=bool)

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3) at an amount, between those of its two neighbours."""
        after = min(max(1, ceil(amount)), len(self.vectors))
        share = amount - (after - 1)
        before = self.vectors[after - 2] if after > 1 else 0.0
        return np.asarray((1.0 - share) * before + share * self.vectors[after - 1])

    @property
    def functions(self) -> Functions:
        """One for each shape."""
        return Stops(len(self.vectors))

    def straight_to(self, amount: float) -> TableLaw:
        """Return the law of one shape alone, which the surface reaches on a straight way."""
        return TableLaw(self.displacement(amount), amount or 1.0)

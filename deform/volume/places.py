"""Nodes known by their undeflected coordinates: what a plan keeps of its mesh, and how other meshes are recognised.

A part of a mesh, in any order, has its nodes found again by the bits of their coordinates. Other meshes are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.surface.placement import UNITS
from sdm_deflect.meshing.mesh.thin import MidPlane

from .plan import Plan

# Shifts and factors of SplitMix64 (Steele, Lea and Flood 2014), which mix all bits of a number with all others.
MIXING = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
# Share of the distance between places, below which a point is a rounded copy of a place.
# Of a million nodes of an overlapping zone about 4e-6 are so near to a place by chance.
NEAR = 1e-4
ANOTHER = "measured on another mesh"


@dataclass(frozen=True, slots=True, eq=False)
class PlanBox:
    """Where the nodes of one box of a plan lie.

    Attributes
    ----------
    hexahedron : the box.
    zones : names of the zones that deform.
    halfway : in a mesh one cell thick, the plane of the box; None in others.
    """

    hexahedron: Hexahedron
    zones: tuple[str, ...]
    halfway: MidPlane | None = None

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 3) lie inside."""
        return self.hexahedron.contains(self.halfway.places(points) if self.halfway else points)


@dataclass(frozen=True, eq=False)
class PlaceTable:
    """Places of all nodes in the boxes of a plan, each once.

    Attributes
    ----------
    places : (P, 3) undeflected coordinates.
    box : (P,) index of the box of each place.
    boxes : the boxes.
    mesh_points, zones : numbers of nodes and of zones of the mesh.
    """

    places: FloatArray = field(repr=False)
    box: IntArray = field(repr=False)
    boxes: tuple[PlanBox, ...]
    mesh_points: int
    zones: int

    @classmethod
    def of(cls, plan: Plan) -> "tuple[PlaceTable, IntArray, IntArray]":
        """Return the table of a plan, its sorted nodes (M,), and the index (M,) of the place of each."""
        mesh, boxes, nodes = plan.mesh, [], []
        for part in plan.boxes:
            region, thin = part.region, part.boundary.thin
            box = PlanBox(region.hexahedron, region.zones, thin.halfway if thin else None)
            within = [
                zone.start + np.flatnonzero(box.contains(mesh.points[zone.start : zone.stop]))
                for zone in mesh.zones
                if zone.name in region.zones
            ]
            boxes.append(box)
            nodes.append(union(*within, part.movable))
        rows, first = np.unique(np.concatenate(nodes), return_index=True)
        box_of = np.repeat(np.arange(len(boxes)), list(map(len, nodes)))[first]
        points = mesh.points[rows]
        keys = hashes(points)
        order = np.argsort(keys, kind="stable")
        again = _repeats(points[order])
        if (np.diff(keys[order]) == 0).sum() > again.sum():  # two places have one hash
            order = np.lexsort((*points.T, keys))
            again = _repeats(points[order])
        place = np.empty(len(rows), dtype=np.intp)
        place[order] = np.cumsum(np.append(True, ~again)) - 1
        first = order[np.append(True, ~again)]
        rank = np.argsort(np.argsort(first))  # places in the order of nodes
        kept = np.sort(first)
        table = cls(points[kept], box_of[kept], tuple(boxes), mesh.point_count, len(mesh.zones))
        return table, rows, rank[place]

    def find(self, points: FloatArray) -> IntArray:
        """Return the index (N,) of the place of each point (N, 3), and -1 where there is none."""
        out = np.full(len(points), -1, dtype=np.intp)
        keys, order = self._sorted
        rows = np.flatnonzero(self._among(points))
        wanted = hashes(points[rows])
        at = np.searchsorted(keys, wanted)
        while len(rows):  # two places may have one hash
            alike = at < len(keys)
            alike[alike] = keys[at[alike]] == wanted[alike]
            rows, wanted, at = rows[alike], wanted[alike], at[alike]
            equal = (self.places[order[at]] == points[rows]).all(axis=1)
            out[rows[equal]] = order[at[equal]]
            rows, wanted, at = rows[~equal], wanted[~equal], at[~equal] + 1
        return out

    def nearly(self, points: FloatArray) -> int:
        """Count the points (N, 3), none of them a place, that are rounded copies of a place."""
        some = points[self._among(points)]
        if not len(some) or len(self.places) < 2:
            return 0
        tree = cKDTree(self.places)
        distance, row = tree.query(some, workers=-1)
        spacing = tree.query(self.places[row], k=2, workers=-1)[0][:, 1]
        return int(np.count_nonzero(distance <= NEAR * spacing))

    def contains(self, points: FloatArray, boxes: Sequence[int]) -> BoolArray:
        """Return which points (N, 3) lie in any of some boxes."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for i in boxes:
            inside |= self.boxes[i].contains(points)
        return inside

    def check(self, points: FloatArray, place: IntArray) -> None:
        """Raise InputError unless points (N, 3) are nodes of the plan's mesh; `place` (N,) is the result of `find`.

        Of a part of a mesh with several zones some faults cannot be seen.
        """
        others = points[place < 0]
        if rounded := self.nearly(others):
            raise InputError(f"points: {rounded} are near a place of the plan, but not on it: give all digits")
        if (place < 0).all() and (hint := self.unit_hint(points)):
            raise InputError(f"points: {hint}")
        strangers = int(self.contains(others, range(len(self.boxes))).sum()) if self.zones == 1 else 0
        if strangers:
            raise InputError(f"points: {ANOTHER}: {strangers} in its box are no nodes of it")
        missing = len(self.places) - len(np.unique(place[place >= 0]))
        if missing and len(points) >= self.mesh_points:
            raise InputError(f"points: {ANOTHER}: {missing} of its {len(self.places)} nodes are not among them")

    def unit_hint(self, points: FloatArray) -> str:
        """Name the unit of length in which points (N, 3) would be places, as a sentence; empty if none fits."""
        for factor in UNITS:
            if (self.find(points * factor) >= 0).any():
                return f"times {factor:.4g} they would be those of the plan: give them in its unit of length"
        return ""

    def _among(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 3) are between the least and the largest coordinates of the places."""
        low, high = self.places.min(axis=0, initial=np.inf), self.places.max(axis=0, initial=-np.inf)
        room = NEAR * np.linalg.norm(high - low) if len(self.places) else 0.0
        return np.asarray(((points >= low - room) & (points <= high + room)).all(axis=1))

    @cached_property
    def _sorted(self) -> tuple[NDArray[np.uint64], IntArray]:
        """Sorted hashes of the places, and the place of each."""
        keys = hashes(self.places)
        order = np.argsort(keys)
        return keys[order], order


def hashes(places: FloatArray) -> NDArray[np.uint64]:
    """Return hashes (N,) of places (N, 3), which depend on every bit but the sign of zero."""
    out = np.zeros(len(places), dtype=np.uint64)
    for column in np.asarray(places).T:
        out += (column + 0.0).view(np.uint64)  # wraps around
        for shift, factor in MIXING:
            out ^= out >> np.uint64(shift)
            out *= np.uint64(factor)
    return out


def _repeats(points: FloatArray) -> BoolArray:
    """Return a mask (N - 1,): whether each point from the second on repeats the one before."""
    return np.asarray((np.diff(points, axis=0) == 0.0).all(axis=1))

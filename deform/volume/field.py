"""A deflection as a function of coordinates alone: small enough to send to where a large mesh is.

A node's displacement follows from its undeflected place: by the box, the interpolants, boundary nodes nearby, and a
table of nodes with prescribed final places. So any part of a mesh can be moved anywhere and in any order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.deform.around.near_wall import FollowingWalls, Nearby, NearWall
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import arrays_of, stored_kernel
from sdm_deflect.meshing.mesh.cells import bounded

from .deflection import BoxDeflection
from .plan import BoxPlan
from .region import ON_FACE
from .step import Step

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.thin import Halfway

POINTS_AT_A_TIME = 1 << 18
"""Nodes moved at a time."""
NEAR = 1e-6
"""Share of the distance between places, below which a point is a rounded copy of a place."""
ARRAYS = ("boundary", "values", "turns", "part")
"""Arrays of a step by their names in a file."""


@dataclass(frozen=True, slots=True, eq=False)
class FieldStep:
    """The displacement of nodes inside the flow in one step.

    Attributes
    ----------
    interpolant : the fitted one.
    boundary, values, turns : (B, 3), (B, 3), (B, 3, 3) boundary nodes at the start of the step, their displacements and
        their rotations R - 1.
    part : (B,) part of each: nodes of different parts may move differently.
    reach : distance up to which nodes follow the boundary; 0 for nowhere.
    """

    interpolant: Interpolant
    boundary: FloatArray = field(repr=False)
    values: FloatArray = field(repr=False)
    turns: FloatArray = field(repr=False)
    part: IntArray = field(repr=False)
    reach: float

    @classmethod
    def of(cls, plan: BoxPlan, step: Step) -> "FieldStep":
        """Take the result of a step of a plan."""
        boundary = step.start.points[step.start.known]
        part = np.zeros(len(boundary), dtype=np.intp)
        for i, rows in enumerate(plan.parts):
            part[rows] = i
        near = next((one for one in step.start.acting if isinstance(one, FollowingWalls)), None)
        turns = near.turning.rotations(step.known) if near else np.zeros((len(boundary), 3, 3))
        return cls(step.fits.interpolant, boundary, step.known, turns, part, near.reach if near else 0.0)

    def displacement(self, points: FloatArray) -> FloatArray:
        """Return the displacement of nodes at points (M, 3)."""
        out = self.interpolant(points)
        if not self.reach:
            return out
        parts = [np.flatnonzero(self.part == i) for i in range(int(self.part.max(initial=-1)) + 1)]
        nearby = Nearby.of(points, self.boundary, parts)
        near_wall = NearWall.of(points, self.boundary, nearby, parts, self.reach)
        return near_wall.following(out, self.values, self.turns)


@dataclass(frozen=True, eq=False)
class FieldBox:
    """The displacement in one box.

    Attributes
    ----------
    box : points outside stay, except those at `places`.
    zones : names of the zones that deform.
    steps : the steps, in order.
    places, ends : (K, 3) undeflected and final places of nodes with a prescribed end: nodes of moving, fixed and
        sliding patches in the box, images of others, and nodes moved by a repair. Each place occurs once.
    planes : (S, 3) component, station and tolerance of block faces, whose nodes stay in the plane.
    halfway : in a mesh one cell thick, the plane of box and steps.
    """

    box: Hexahedron = field(repr=False)
    zones: tuple[str, ...]
    steps: tuple[FieldStep, ...] = field(repr=False)
    places: FloatArray = field(repr=False)
    ends: FloatArray = field(repr=False)
    planes: FloatArray = field(repr=False)
    halfway: "Halfway | None" = None

    @classmethod
    def of(cls, one: BoxDeflection) -> "FieldBox":
        """Take the result of a deflection in one box; InputError as for `Field.of`."""
        plan, sites, thin = one.plan, one.plan.sites, one.plan.boundary.thin
        prescribed = np.zeros(len(plan.mesh.points), dtype=np.bool_)
        images = (thin or plan.boundary).images
        prescribed[np.intersect1d(images.nodes, plan.movable, assume_unique=True)] = True
        prescribed[sites.known] = True
        if one.repaired is not None:
            prescribed[one.repaired.moved] = True
        rows = np.flatnonzero(prescribed)
        rows = rows[np.lexsort(plan.mesh.points[rows].T)]
        again = (np.diff(plan.mesh.points[rows], axis=0) == 0.0).all(axis=1)
        if (one.exact[rows[1:][again]] != one.exact[rows[:-1][again]]).any():
            raise InputError(f"{plan.mesh.name}: nodes at one place move apart: the motion is no function")
        rows = np.sort(rows[np.append(True, ~again)]) if len(rows) else rows
        near = ON_FACE * plan.boundary.size
        planes = [(s.component, s.point[s.component], near) for s, _ in plan.region.sections]
        return cls(
            plan.region.hexahedron,
            plan.region.zones,
            tuple(FieldStep.of(plan, step) for step in one.steps),
            plan.mesh.points[rows],
            one.exact[rows],
            np.array(planes, dtype=np.float64).reshape(-1, 3),
            thin.halfway if thin else None,
        )

    def move(self, given: FloatArray, out: FloatArray) -> None:
        """Write the final places of the points `given` (M, 3) inside the box into `out` (M, 3)."""
        start = self.halfway.places(given) if self.halfway else given
        inside = self.inside(given)
        inner = np.flatnonzero(inside | self._among(given))
        distance, row = self._tree.query(given[inner]) if len(self.places) else (np.ones(len(inner)), inner)
        exact = distance == 0.0
        inside[inner[exact]] = False
        rows = np.flatnonzero(inside)
        moved = start[rows]
        for step in self.steps:
            if len(moved):
                displacement = step.displacement(moved)
                for component, station, near in self.planes:
                    stays = np.abs(given[rows, int(component)] - station) <= near
                    displacement[stays, int(component)] = 0.0
                moved += displacement
        away = moved - start[rows]
        out[rows] = given[rows] + self.halfway.displacement(given[rows], away) if self.halfway else moved
        out[inner[exact]] = self.ends[row[exact]]

    def inside(self, points: FloatArray) -> BoolArray:
        """Return which points (M, 3) lie inside the box."""
        return self.box.contains(self.halfway.places(points) if self.halfway else points)

    def matches(self, points: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return which places (K,) coincide with a point (M, 3), and which do so but for `NEAR` of the spacing."""
        found, near = np.zeros((2, len(self.places)), dtype=np.bool_)
        some = points[self._among(points)]
        if len(some):
            distance, row = self._tree.query(some)
            found[row[distance == 0.0]] = True
            spacing = self._tree.query(self.places, k=2)[0][:, 1]
            near[row[(distance > 0.0) & (distance <= NEAR * spacing[row])]] = True
        return found, near

    def _among(self, points: FloatArray) -> BoolArray:
        low, high = self.places.min(axis=0, initial=np.inf), self.places.max(axis=0, initial=-np.inf)
        room = NEAR * np.linalg.norm(high - low) if len(self.places) else 0.0
        return np.asarray(((points >= low - room) & (points <= high + room)).all(axis=1))

    @cached_property
    def _tree(self) -> Any:
        return cKDTree(self.places)


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """Final places of all points of a mesh.

    Attributes
    ----------
    boxes : one field for each box; boxes do not overlap.
    """

    boxes: tuple[FieldBox, ...]

    @classmethod
    def of(cls, deflected: Sequence[BoxDeflection]) -> "Field":
        """Take the unrounded results of deflections; InputError if nodes at one place move differently."""
        return cls(tuple(FieldBox.of(one) for one in deflected))

    def apply(self, points: FloatArray, progress: Progress = silent) -> FloatArray:
        """Return the deflected coordinates (N, 3) of undeflected points (N, 3); points that stay keep their bits.

        The points belong to zones that deform. Each row depends on itself alone, so any part of a mesh has the bits of
        the whole.

        Raises InputError if the points are not finite numbers (N, 3).
        """
        given = bounded(points, "points")
        if given.ndim != 2 or given.shape[1] != 3:
            raise InputError(f"points {given.shape} must be (N, 3)")
        out = given.copy()
        for start in range(0, len(out), POINTS_AT_A_TIME):
            rows = slice(start, start + POINTS_AT_A_TIME)
            for box in self.boxes:
                box.move(given[rows], out[rows])
            progress("moving", min(1.0, (start + POINTS_AT_A_TIME) / len(out)))
        return out

    def arrays(self, tag: str = "") -> dict[str, Any]:
        """Return the field as arrays whose names end with a tag, for `stored`."""
        arrays: dict[str, Any] = {f"boxes{tag}": np.array(len(self.boxes))}
        for b, box in enumerate(self.boxes):
            own = f"_{b}{tag}"
            arrays |= {
                f"corners{own}": box.box.corners, f"zones{own}": np.array(box.zones, dtype=np.str_),
                f"places{own}": box.places, f"ends{own}": box.ends, f"planes{own}": box.planes,
                f"steps{own}": np.array(len(box.steps)),
            }  # fmt: skip
            if box.halfway:
                arrays[f"halfway{own}"] = box.halfway.numbers
            for i, step in enumerate(box.steps):
                numbers = {name: getattr(step, name) for name in ARRAYS} | {"reach": np.array(step.reach)}
                numbers |= {name: getattr(step.interpolant, name) for name in ("centers", "beta", "alpha")}
                arrays |= {f"{name}_{i}{own}": values for name, values in numbers.items()}
                arrays |= arrays_of(step.interpolant.kernel, f"_{i}{own}")
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any], tag: str = "") -> "Field":
        """Make a field of the arrays of `arrays`; ValueError or KeyError if they do not fit together."""
        return cls(tuple(_box(arrays, f"_{b}{tag}") for b in _range(arrays, f"boxes{tag}")))


def _box(stored: Mapping[str, Any], tag: str) -> FieldBox:
    """Return one box of a file; ValueError if its arrays do not fit together."""
    places, ends, planes = (bounded(stored[f"{name}{tag}"], name) for name in ("places", "ends", "planes"))
    if places.shape != ends.shape or places.ndim != 2 or places.shape[1] != 3:
        raise ValueError(f"places {places.shape} and ends {ends.shape} must be (K, 3) both")
    steps = tuple(_step(stored, f"_{i}{tag}") for i in _range(stored, f"steps{tag}"))
    names = stored[f"zones{tag}"]
    if names.dtype.kind != "U" or names.ndim != 1 or not len(names):
        raise ValueError("zones must be names")
    zones = tuple(names.tolist())
    halfway = None
    if f"halfway{tag}" in stored:
        from sdm_deflect.meshing.mesh.thin import Halfway

        halfway = Halfway.from_numbers(bounded(stored[f"halfway{tag}"], "halfway"))
    return FieldBox(Hexahedron(stored[f"corners{tag}"]), zones, steps, places, ends, planes.reshape(-1, 3), halfway)


def _range(stored: Mapping[str, Any], name: str) -> range:
    """Return the indices of the boxes or steps of a file; ValueError if there are none."""
    count = stored[name]
    if count.shape or count.dtype.kind != "i" or count < 1:
        raise ValueError(f"{name} = {count} must be a whole number of at least 1")
    return range(int(count))


def _step(stored: Mapping[str, Any], tag: str) -> FieldStep:
    """Return one step of a file; ValueError if its arrays do not fit together."""
    one = {name: bounded(stored[f"{name}{tag}"], name) for name in (*ARRAYS, "centers", "beta", "alpha", "reach")}
    count = len(one["boundary"])
    for name, shape in (("values", (count, 3)), ("turns", (count, 3, 3)), ("part", (count,)), ("boundary", (count, 3))):
        if one[name].shape != shape:
            raise ValueError(f"{name} {one[name].shape} of step {tag} must be {shape}")
    if one["part"].min(initial=0.0) < 0.0 or one["part"].max(initial=-1.0) >= count:
        raise ValueError(f"parts of step {tag} must be numbers from 0 to below {count}")
    interpolant = Interpolant(stored_kernel(stored, tag), one["centers"], one["beta"], one["alpha"])
    arrays = one["boundary"], one["values"], one["turns"], one["part"].astype(np.intp)
    return FieldStep(interpolant, *arrays, float(one["reach"]))

"""A deflection as a function of coordinates alone: small enough to be sent to where the nodes of a large mesh lie.

What moves a node is where it was before: the box, the interpolants, the boundary nodes near by, and the nodes whose
ends are told outright, by their places. So any part of a mesh can be moved anywhere, in any order, and twice.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.reading import damaged, read_arrays
from sdm_deflect.deform.hexahedron import Hexahedron
from sdm_deflect.deform.mesh.mesh import bounded
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.rbf.kernels import KERNEL, ThinPlateSpline, arrays_of, stored_kernel
from sdm_deflect.deform.volume.deflection import Deflected
from sdm_deflect.deform.volume.near_wall import Nearby, NearWall
from sdm_deflect.deform.volume.region import ON_FACE
from sdm_deflect.deform.volume.step import Step

ROWS = 1 << 18
"""Nodes moved at a time."""
FILE = "displacement field of sdm-deflect"


@dataclass(frozen=True, slots=True, eq=False)
class FieldStep:
    """How nodes within the flow move in one step.

    Attributes
    ----------
    interpolant : the fitted one.
    boundary, values, turns : (B, 3), (B, 3), (B, 3, 3) boundary nodes at the start of the step, their displacements,
        and their rotations less the identity.
    part : (B,) which of them may move differently: each moving surface, and the rest.
    reach : how far from them nodes follow; 0: none does.
    """

    interpolant: Interpolant
    boundary: FloatArray = field(repr=False)
    values: FloatArray = field(repr=False)
    turns: FloatArray = field(repr=False)
    part: IntArray = field(repr=False)
    reach: float

    @classmethod
    def of(cls, step: Step) -> "FieldStep":
        """Take what a step has found."""
        state, sites = step.state, step.state.sites
        boundary = state.points[sites.known]
        values = state.boundary_values(step.move, step.slid)
        part = np.zeros(len(boundary), dtype=np.intp)
        for i, rows in enumerate(sites.parts(state.boundary)):
            part[rows] = i
        return cls(step.fits.interpolant, boundary, values, state.turning.rotations(values), part, state.reach)

    def displacement(self, points: FloatArray) -> FloatArray:
        """Return how far nodes at points (M, 3) move."""
        out = self.interpolant(points)
        if not self.reach:
            return out
        parts = [np.flatnonzero(self.part == i) for i in range(int(self.part.max(initial=-1)) + 1)]
        nearby = Nearby.of(points, self.boundary, parts)
        near_wall = NearWall.of(points, self.boundary, nearby, parts, self.reach)
        return near_wall.following(out, self.values, self.turns)


@dataclass(frozen=True, eq=False)
class Field:
    """Where each point of a mesh comes to be.

    Attributes
    ----------
    box : nodes outside stay, but for those of `places`.
    steps : one after another.
    places, ends : (K, 3) undeflected coordinates of the nodes whose ends are told outright, and these: those of moving,
        fixed and sliding patches in the box, those that move as images of others, and those that a repair has moved.
    planes : (S, 3) component, station and tolerance of faces of overlapping blocks, in whose planes nodes stay.
    """

    box: Hexahedron = field(repr=False)
    steps: tuple[FieldStep, ...] = field(repr=False)
    places: FloatArray = field(repr=False)
    ends: FloatArray = field(repr=False)
    planes: FloatArray = field(repr=False)

    @classmethod
    def of(cls, deflected: Deflected) -> "Field":
        """Take what a deflection has found; of a mesh with several zones it is that of the zones that deform.

        Raises InputError if it is of several boxes, or its points are rounded.
        """
        one = deflected.boxes[0]
        plan, sites = one.plan, one.plan.sites
        if len(deflected.boxes) > 1:
            raise InputError(f"{plan.mesh.name}: a field is of one box, and there are {len(deflected.boxes)}")
        if not plan.precision.is_double:
            raise InputError(f"{plan.mesh.name}: a field is of double precision; take that of the result itself")
        told = np.zeros(len(plan.mesh.points), dtype=np.bool_)
        told[np.intersect1d(plan.boundary.images.nodes, plan.region.inside, assume_unique=True)] = True
        told[sites.known] = True
        if one.repaired is not None:
            told[one.repaired.moved] = True
        rows = np.flatnonzero(told)
        near = ON_FACE * plan.boundary.size
        planes = [(s.component, s.point[s.component], near) for s, _ in plan.region.sections]
        return cls(
            plan.region.hexahedron,
            tuple(FieldStep.of(step) for step in one.steps),
            plan.mesh.points[rows],
            one.points[rows],
            np.array(planes, dtype=np.float64).reshape(-1, 3),
        )

    def apply(self, points: FloatArray, progress: Progress = silent) -> FloatArray:
        """Return where nodes at undeflected points (N, 3) come to be, (N, 3); those that stay keep their bits.

        Each row depends on nothing but itself: any part of a mesh gives the same bits as the whole.

        Raises InputError if the points are no finite numbers (N, 3).
        """
        given = bounded(points, "points")
        if given.ndim != 2 or given.shape[1] != 3:
            raise InputError(f"points {given.shape} must be (N, 3)")
        out = given.copy()
        for start in range(0, len(out), ROWS):
            rows = slice(start, start + ROWS)
            self._move(out[rows])
            progress("moving", min(1.0, (start + ROWS) / len(out)))
        return out

    def _move(self, points: FloatArray) -> None:
        """Move points (M, 3) in place."""
        inside = self.box.contains(points)
        told = np.flatnonzero(inside | ((points >= self._low) & (points <= self._high)).all(axis=1))
        distance, row = self._tree.query(points[told]) if len(self.places) else (np.ones(len(told)), told)
        exact = distance == 0.0
        inside[told[exact]] = False
        rows = np.flatnonzero(inside)
        moved = points[rows]
        for step in self.steps:
            if len(moved):
                displacement = step.displacement(moved)
                for component, station, near in self.planes:
                    stays = np.abs(points[rows, int(component)] - station) <= near
                    displacement[stays, int(component)] = 0.0
                moved += displacement
        points[rows] = moved
        points[told[exact]] = self.ends[row[exact]]

    @cached_property
    def _tree(self) -> Any:
        return cKDTree(self.places)

    @cached_property
    def _low(self) -> FloatArray:
        return np.asarray(self.places.min(axis=0, initial=np.inf))

    @cached_property
    def _high(self) -> FloatArray:
        return np.asarray(self.places.max(axis=0, initial=-np.inf))

    def save(self, path: str | PathLike[str]) -> None:
        """Write it to a file, whole or not at all; Field.load reads it."""
        arrays: dict[str, Any] = {
            "kind": np.array(FILE), "corners": self.box.corners, "places": self.places, "ends": self.ends,
            "planes": self.planes, "steps": np.array(len(self.steps)),
        }  # fmt: skip
        if self.steps and self.steps[0].interpolant.kernel != ThinPlateSpline():
            arrays |= arrays_of(self.steps[0].interpolant.kernel)
        for i, step in enumerate(self.steps):
            own = {
                "centers": step.interpolant.centers, "beta": step.interpolant.beta, "alpha": step.interpolant.alpha,
                "boundary": step.boundary, "values": step.values, "turns": step.turns, "part": step.part,
                "reach": np.array(step.reach),
            }  # fmt: skip
            arrays |= {f"{name}_{i}": values for name, values in own.items()}
        with TemporaryDirectory(prefix=".sdm-", dir=Path(path).parent) as folder:
            beside = Path(folder, "field.npz")
            np.savez_compressed(beside, **arrays)
            with suppress(FileNotFoundError):
                copymode(path, beside)
            beside.replace(path)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Field":
        """Read what `save` has written; InputError if the file is missing, damaged or another one."""
        stored = read_arrays(Path(path))
        with damaged(Path(path), FILE):
            if str(stored["kind"]) != FILE:
                raise ValueError("it holds something else")
            steps = tuple(_step(stored, i) for i in range(int(stored["steps"])))
            told = stored["places"], stored["ends"]
            if told[0].shape != told[1].shape or told[0].ndim != 2 or told[0].shape[1] != 3:
                raise ValueError(f"places {told[0].shape} and ends {told[1].shape} must be (K, 3) both")
            return cls(Hexahedron(stored["corners"]), steps, *told, stored["planes"].reshape(-1, 3))


def _step(stored: Mapping[str, Any], i: int) -> FieldStep:
    """Return one step of a file; ValueError if its arrays do not fit together."""
    one = {
        name: stored[f"{name}_{i}"]
        for name in ("centers", "beta", "alpha", "boundary", "values", "turns", "part", "reach")
    }
    count = len(one["boundary"])
    for name, shape in (("values", (count, 3)), ("turns", (count, 3, 3)), ("part", (count,)), ("boundary", (count, 3))):
        if one[name].shape != shape:
            raise ValueError(f"{name} {one[name].shape} of step {i} must be {shape}")
    kernel = stored_kernel(stored) if KERNEL in stored else ThinPlateSpline()
    interpolant = Interpolant(kernel, one["centers"], one["beta"], one["alpha"])
    arrays = one["boundary"], one["values"], one["turns"], one["part"].astype(np.intp)
    return FieldStep(interpolant, *arrays, float(one["reach"]))

"""Tables: displacements at points of another mesh, and rotations of a beam's points, at the nodes of a surface."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, component, farthest, first_coincident
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.ties import first_largest
from sdm_deflect.base.unpacking import PLACES, columns_of, damaged, read_arrays, read_rows
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import bounded

from .motions import Functions, Powers, Smooth
from .surface import Surface

TABLE = "table of points and displacements"
TITLES = "x,y,z,dx,dy,dz"
# Titles of displacements and rotations: ours, those of ParaView, and those of Nastran, T1 to R3.
VECTORS, ROTATIONS = (
    {
        f"{short}{name}": (f"{short}{name}", f"{long}:{i}", f"{long}{name}", f"{letter}{i + 1}")
        for i, name in enumerate("xyz")
    }
    for short, long, letter in (("d", "displacement", "T"), ("r", "rotation", "R"))
)
# Sets of columns: in space and in a plane, without and with rotations.
SPACE, PLANE = {*"xyz", *VECTORS}, {*"xy", "dx", "dy"}
COLUMNS = (SPACE, PLANE, {*SPACE, *ROTATIONS}, {*PLANE, "rz"})
# Largest number of points of a table in one direct solve: it takes .6 s.
MOST = 3000
# Number of points that interpolate the rest beside a node; 50 take twice as long, and are 3 to 10 % more accurate.
NEIGHBOURS = 20
# A node this near to a point of a table moves with it; a share of the surface's size, as files of six digits round.
OWN = 1e-6
# Points that lie in a plane or on a line to this share of their extent say nothing of a slope across it: files of four
# digits round so far. A beam on a sloping line, written with six, moved nodes beside it thousands of times too far.
THIN = 1e-3
# Largest rotation in radians: a whole turn, which degrees soon exceed.
WHOLE_TURN = 2.0 * np.pi
# Least cosine between a beam's steps and the normal of its sections: 76 degrees. A choice: wings are swept by less.
STEEP = 0.25
# Least step of a beam as a share of the mean one. A choice: a cubic spline through near points that differ overshoots.
CLOSE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Displacements at points of another mesh, such as bending and torsion of a structure under load.

    They are interpolated at the surface's nodes, by a thin plate spline where the table has up to 3,000 points. With
    rotations, the points are those of one beam (`Beam`), and turn the sections of the surface.

    Attributes
    ----------
    points, vectors : (P, 3) each, in the mesh's unit of length.
    hinge : an axis along the surface that the box follows, and across which sections lie; None for none.
    plane : whether it lacks z, so that it suits plane meshes alone.
    rotations : (P, 3) rotation vectors of a beam's points in radians; None for displacements alone.

    Raises InputError if shapes differ, if there are fewer than 4 points (2 with rotations), if a number is not finite,
    or for a rotation by more than a whole turn.
    """

    points: FloatArray = field(repr=False)
    vectors: FloatArray = field(repr=False)
    hinge: Axis | None = None
    plane: bool = False
    rotations: FloatArray | None = field(default=None, repr=False)
    unit: ClassVar[str] = "of the table"

    def __post_init__(self) -> None:
        names = ("points", "vectors", *(() if self.rotations is None else ("rotations",)))
        for name in names:
            object.__setattr__(self, name, bounded(getattr(self, name), f"table: {name}"))
        shapes = [getattr(self, name).shape for name in names]
        if len(shapes[0]) != 2 or shapes[0][1:] != (3,) or len({*shapes}) > 1:
            given = " and ".join(f"{name} {shape}" for name, shape in zip(names, shapes, strict=True))
            raise InputError(f"table: {given} must be (P, 3) {'both' if len(names) == 2 else 'all'}")
        least = 4 if self.rotations is None else 2
        if len(self.points) < least:
            raise InputError(f"table: {len(self.points)} points; it needs at least {least}")
        if self.largest_rotation > WHOLE_TURN:
            raise InputError(
                f"table: a rotation of {self.largest_rotation:.4g} is more than a whole turn: give radians; a mode may "
                "be divided, and its amount multiplied"
            )

    @classmethod
    def read(cls, path: str | PathLike[str], hinge: Axis | None = None) -> "Table":
        """Read a .csv with the titles x, y, z, dx, dy, dz in any order, or an .npz with `points` and `vectors`.

        A .csv for a plane mesh may have x, y, dx, dy only. Rotations are rx, ry, rz, in a plane rz alone, or an array
        `rotations`. Other columns are not read.

        Raises InputError for any other content.
        """
        if not isinstance(path, str | PathLike):
            raise InputError(f"table = {shortened(path)} is no path of a file")
        path = Path(path)
        if path.suffix == ".npz":
            stored = read_arrays(path)
            with damaged(path, TABLE):
                return cls(stored["points"], stored["vectors"], hinge, rotations=stored.get("rotations"))
        titles, rows = read_rows(path, TABLE, TITLES)
        with damaged(path, TABLE):
            columns = columns_of(titles, {**PLACES, **VECTORS, **ROTATIONS})
            if {*columns} not in COLUMNS:
                raise InputError(
                    f"titles must be {TITLES}, in a plane mesh x,y,dx,dy; rotations of a beam add rx,ry,rz, in a plane "
                    f"mesh rz; they are {','.join(titles)}"
                )
            points, vectors, rotations = (_rows(rows, columns, before) for before in ("", "d", "r"))
            return cls(points, vectors, hinge, "z" not in columns, rotations if "rz" in columns else None)

    @property
    def axis(self) -> Axis | None:
        """The axis along the surface, if given."""
        return self.hinge

    @property
    def largest_rotation(self) -> float:
        """Largest rotation in radians; 0 without rotations."""
        return 0.0 if self.rotations is None else float(np.linalg.norm(self.rotations, axis=1).max())

    @property
    def across(self) -> FloatArray:
        """Unit normal (3,) of a beam's sections: along the hinge, else y or z, whichever the beam is longer along.

        For a beam along x it is x. So the section at a plane of symmetry is that plane, also if the beam is swept.
        """
        if self.hinge:
            return self.hinge.direction
        along = np.abs(np.diff(self.points[farthest(self.points, 2)], axis=0)).sum(axis=0)
        span = 1 + first_largest(along[1:])
        return np.asarray(np.eye(3)[span if along[span] > STEEP * np.linalg.norm(along) else 0])

    def law(self, surface: Surface) -> "TableLaw | BeamLaw":
        """Interpolate the table at the nodes of a surface; nodes at its points take their displacements exactly.

        Raises InputError for a point with two displacements, rotations of points that are no beam, or a table without z
        for a mesh in space.
        """
        if self.plane and not surface.mesh.plane:
            raise InputError(f"table: it lacks z and dz, and {surface.mesh.name} is a mesh in space: {TITLES}")
        rows = self.distinct()
        points, vectors = self.points[rows], self.vectors[rows]
        if self.rotations is not None:
            return Beam.of(points, vectors, self.rotations[rows], self.across).law(surface.points)
        near = OWN * float(np.ptp(surface.points, axis=0).max())
        distance, at = cKDTree(points).query(surface.points, distance_upper_bound=near)
        known = np.isfinite(distance)
        out = np.empty_like(surface.points)
        out[known], out[~known] = vectors[at[known]], _interpolated(points, vectors, surface.points[~known])
        return TableLaw(out)

    def distinct(self) -> IntArray:
        """Return rows of the points without repeated ones; InputError for one with two displacements or rotations."""
        first = first_coincident(self.points)
        for values, what in ((self.vectors, "displacements"), (self.rotations, "rotations")):
            if values is None:
                continue
            torn = np.flatnonzero((values != values[first]).any(axis=1))
            if len(torn):
                row = torn[0]
                at, value, other = (x.tolist() for x in (self.points[row], values[first[row]], values[row]))
                raise InputError(f"table: the point {at} is given twice, with the {what} {value} and {other}")
        return np.flatnonzero(first == np.arange(len(first)))


def _rows(rows: FloatArray, columns: Mapping[str, int], before: str) -> FloatArray:
    """Return the columns x, y, z (P, 3) with a letter before; zeros for those that are missing."""
    out = np.zeros((len(rows), 3))
    for i, name in enumerate("xyz"):
        if before + name in columns:
            out[:, i] = rows[:, columns[before + name]]
    return out


def _interpolated(points: FloatArray, vectors: FloatArray, places: FloatArray) -> FloatArray:
    """Interpolate the vectors (P, 3) of distinct points (P, 3) at places (K, 3).

    A thin plate spline interpolates at most `MOST` of the points. What it misses at the others is interpolated locally.
    """
    if not len(places):
        return np.empty_like(places)
    rows = farthest(points, MOST) if len(points) > MOST else np.arange(len(points))
    spline = fit(ThinPlateSpline(), points[rows], vectors[rows], thin=THIN)
    out = spline(places)
    if len(rows) < len(points):
        from scipy.interpolate import RBFInterpolator  # loading takes 0.1 s

        missed = vectors - spline(points)
        out += RBFInterpolator(points, missed, neighbors=NEIGHBOURS, kernel="linear")(places)
    return np.asarray(out)


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """The points of a beam in order, and its sections.

    A section is a plane. It moves with the beam's point in it, and turns about this point. Sections beyond the ends
    move with the end.

    Attributes
    ----------
    across : (3,) normal of the sections, a unit vector.
    stations : (P,) coordinates of the points along it, rising.
    values : (P, 9) points, displacements and rotation vectors; a cubic spline joins them, as functions of the station.
    """

    across: FloatArray
    stations: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, points: FloatArray, vectors: FloatArray, rotations: FloatArray, across: FloatArray) -> "Beam":
        """Order distinct points (P, 3), with their displacements and rotation vectors.

        Raises InputError for a single point, for a step along a section, or if two points are close together.
        """
        if len(points) < 2:
            raise InputError("table: all its points are at one place; a beam needs two")
        station = component(points, across)
        order = np.argsort(station, kind="stable")
        points, along = points[order], np.diff(station[order])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        for wrong, what in (
            (steps < CLOSE * steps.mean(), "are close together: leave one of them out"),
            (along < STEEP * steps, "are in one section: give each beam a table of its own, and points beside a beam, "
             "or of a shell, one without rotations"),
        ):  # fmt: skip
            if wrong.any():
                row = int(np.argmax(wrong))
                raise InputError(f"table: its points {points[row].tolist()} and {points[row + 1].tolist()} {what}")
        values = np.hstack([points, vectors[order], rotations[order]])
        return cls(across, station[order], values)

    def law(self, places: FloatArray) -> "BeamLaw":
        """Return the motion of places (K, 3) with their sections."""
        from scipy.interpolate import CubicSpline  # loading takes 0.1 s

        station = np.clip(component(places, self.across), self.stations[0], self.stations[-1])
        points, vectors, rotations = np.split(CubicSpline(self.stations, self.values)(station), 3, axis=1)
        return BeamLaw(vectors, rotations, places - points)


@dataclass(frozen=True, slots=True, eq=False)
class TableLaw(Smooth):
    """A share of fixed vectors (K, 3), which the surface reaches at the amount `at`."""

    vectors: FloatArray = field(repr=False)
    at: float = 1.0

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,)."""
        return np.ones(len(self.vectors), dtype=bool)

    @property
    def slope(self) -> FloatArray:
        """Displacement (K, 3) per unit of the amount."""
        return self.vectors / self.at

    def displacement(self, amount: float) -> FloatArray:
        """Return the share of the vectors at an amount."""
        return np.asarray(amount / self.at * self.vectors)

    @property
    def functions(self) -> Functions:
        """The share itself."""
        return Powers(1, self.at)


@dataclass(frozen=True, slots=True, eq=False)
class BeamLaw(Smooth):
    """A share of displacements (K, 3) and of rotation vectors (K, 3) of the sections in which nodes lie.

    `arms` (K, 3) go from the beam's point of a section to the node.
    """

    vectors: FloatArray = field(repr=False)
    rotations: FloatArray = field(repr=False)
    arms: FloatArray = field(repr=False)

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,)."""
        return np.ones(len(self.vectors), dtype=bool)

    @property
    def slope(self) -> FloatArray:
        """Displacement (K, 3) per unit of the amount, for small amounts."""
        return self.vectors + np.cross(self.rotations, self.arms)

    def displacement(self, amount: float) -> FloatArray:
        """Return u + (R - 1) arm, where R turns by the rotation vector (Rodrigues' formula); both times the amount."""
        turn = amount * self.rotations
        half = np.linalg.norm(turn, axis=1, keepdims=True) / (2.0 * np.pi)  # half the angle over pi, for np.sinc
        swing = np.cross(turn, self.arms)
        return np.asarray(
            amount * self.vectors + np.sinc(2.0 * half) * swing + 0.5 * np.sinc(half) ** 2 * np.cross(turn, swing)
        )

    @property
    def functions(self) -> Functions:
        """The amount and its square, and higher powers where a plan needs them."""
        return Powers(2)

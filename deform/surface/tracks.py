"""Tracks: rigid motions through places, each an angle about the hinge and a shift of the hinge's two points.

The surface turns about its hinge and goes with it. These two are every rigid motion: a drop hinge, the steps of a CPACS
control surface, a tab on a carrier that turns. The amount is the track's parameter, 0 where the mesh stands.
"""

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import BoolArray, FloatArray
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.ties import first_largest
from sdm_deflect.base.unpacking import columns_of, damaged, read_rows
from sdm_deflect.deform.options import LARGEST_ANGLE
from sdm_deflect.meshing.mesh.axis import Axis, cross_matrix
from sdm_deflect.meshing.mesh.cells import bounded

from .motions import TRACK_UNIT, Functions, Hinged, Smooth
from .surface import Surface

# First title of a file with the steps of a CPACS control surface, between which CPACS interpolates linearly.
CPACS = "controlParameter"
# Titles of a file: dx2 to dz2 shift the second hinge point; files for plane meshes have no dz.
TITLES = ("parameter", "angle", "dx", "dy", "dz", "dx2", "dy2", "dz2")
# Amounts at which the entries of a motion are compared with one another.
SAMPLES = 201
# Least singular value of independent entries, as a share of the largest one.
INDEPENDENT = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class Track(Hinged):
    """A rigid motion through rows of places.

    Attributes
    ----------
    hinge : the hinge of the undeflected mesh.
    rows : (T, 8) parameter, angle in degrees, shift of the first hinge point (3,) and of the second (3,); sorted, with
        a row of zeros at parameter 0.
    smooth : whether rows are joined by monotone cubics (PCHIP); else linearly, like the steps of CPACS.
    plane : whether it lacks dz, so that it suits plane meshes alone.

    Raises InputError if the rows are of another form.
    """

    hinge: Axis
    rows: FloatArray = field(repr=False)
    smooth: bool = True
    plane: bool = False
    unit: ClassVar[str] = TRACK_UNIT

    def __post_init__(self) -> None:
        rows = bounded(self.rows, "track")
        if rows.ndim != 2 or rows.shape[1] != 8 or len(rows) < 2:
            raise InputError(f"track {rows.shape}: must be (T, 8) with two rows or more")
        rows = rows[np.argsort(rows[:, 0])]
        if (np.diff(rows[:, 0]) <= 0.0).any():
            raise InputError("track: a parameter occurs twice")
        if not (rows[:, 0] == 0.0).any() or rows[rows[:, 0] == 0.0, 1:].any():
            raise InputError("track: the mesh stands at parameter 0; give that a row with angle 0 and no shift")
        if (worst := float(np.abs(rows[:, 1]).max())) > LARGEST_ANGLE:
            raise InputError(f"track: {worst:g} deg is out of range: at most {LARGEST_ANGLE:g} deg either way")
        object.__setattr__(self, "rows", rows)

    @classmethod
    def straight(cls, hinge: Axis, angle: float, first: FloatArray, second: FloatArray) -> "Track":
        """Return the straight track that ends, at 1, with an angle and a shift (3,) of each hinge point."""
        return cls(hinge, np.array([np.zeros(8), [1.0, angle, *first, *second]]), smooth=False)

    @classmethod
    def read(cls, path: str | PathLike[str], hinge: Axis) -> "Track":
        """Read a .csv with the titles parameter, angle, dx, dy[, dz], and dx2, dy2[, dz2] of the second hinge point.

        Without the latter both points have the same shift. Titles stand in any order; other columns are not read. If
        `controlParameter` stands for `parameter`, rows are steps of CPACS. Raises InputError for any other content.
        """
        example = ",".join(TITLES[:5])
        titles, given = read_rows(Path(path), "track", example)
        with damaged(Path(path), "track"):
            columns = columns_of(titles, {name: (name, *([CPACS] if name == TITLES[0] else [])) for name in TITLES})
            plane, second = "dz" not in columns, "dx2" in columns
            shifts = ["dx", "dy", *([] if plane else ["dz"])]
            wanted = {*TITLES[:2], *shifts, *(f"{name}2" for name in shifts if second)}
            if {*columns} != wanted:
                raise InputError(f"titles must be {example}, in a plane mesh without dz; they are {','.join(titles)}")
            rows = np.zeros((len(given), 8))
            for name, column in columns.items():
                rows[:, TITLES.index(name)] = given[:, column]
            if not second:
                rows[:, 5:] = rows[:, 2:5]
            return cls(hinge, rows, not columns_of(titles, {CPACS: (CPACS,)}), plane)

    def law(self, surface: Surface) -> "TrackLaw":
        """Return the motion of the nodes of a surface; InputError for a track without dz and a mesh in space."""
        if self.plane and not surface.mesh.plane:
            raise InputError(f"track: it lacks dz, and {surface.mesh.name} is a mesh in space: {','.join(TITLES[:5])}")
        return TrackLaw(self, surface.points)

    def place(self, amount: float, rate: bool = False) -> FloatArray:
        """Return angle in degrees and shifts of both hinge points (7,) at an amount, or their derivatives.

        Raises InputError for an amount beyond the track.
        """
        low, high = self.rows[[0, -1], 0]
        if not low <= amount <= high:
            raise InputError(f"{amount:g} is beyond the track, which goes from {low:g} to {high:g}")
        from scipy.interpolate import PchipInterpolator, make_interp_spline  # loading takes 0.1 s

        at, values = self.rows[:, 0], self.rows[:, 1:]
        join = PchipInterpolator(at, values) if self.smooth else make_interp_spline(at, values, 1)
        return np.asarray(join(amount, int(rate)))

    def entries(self, amount: float, rate: bool = False) -> FloatArray:
        """Return the rotation less the identity, row by row, and the shift (12,) at an amount; or their derivatives.

        Raises InputError for an amount beyond the track, or a hinge whose points are shifted past each other.
        """
        place, speed = self.place(amount), self.place(amount, rate=True)
        turn, swing = self.hinge.turn(place[0]), _Swing.of(self.hinge, place[4:] - place[1:4], speed[4:] - speed[1:4])
        if not rate:
            return np.concatenate([(turn + swing.turn + swing.turn @ turn).ravel(), place[1:4]])
        turning = np.radians(speed[0]) * cross_matrix(self.hinge.direction) @ (np.eye(3) + turn)
        whole = turning + swing.turn @ turning + swing.rate @ (np.eye(3) + turn)
        return np.concatenate([whole.ravel(), speed[1:4]])


@dataclass(frozen=True, slots=True, eq=False)
class _Swing:
    """The smallest rotation, less the identity, from the hinge's direction to the shifted one, and its rate."""

    turn: FloatArray
    rate: FloatArray

    @classmethod
    def of(cls, hinge: Axis, apart: FloatArray, speed: FloatArray) -> "_Swing":
        """Take the difference of the two points' shifts (3,), and its rate (3,)."""
        old = hinge.direction
        new = (hinge.length or 1.0) * old + apart
        length = float(np.linalg.norm(new))
        if new @ old <= 0.0:
            raise InputError("track: the second hinge point is shifted past the first")
        new, speed = new / length, speed / length
        speed = speed - (speed @ new) * new
        v, w, c = cross_matrix(np.cross(old, new)), cross_matrix(np.cross(old, speed)), 1.0 + old @ new
        return cls(v + v @ v / c, w + (w @ v + v @ w) / c - v @ v * (old @ speed) / c**2)


@dataclass(frozen=True, slots=True, eq=False)
class TrackLaw(Smooth):
    """A track of points (K, 3)."""

    track: Track
    points: FloatArray = field(repr=False)

    @property
    def exact(self) -> BoolArray:
        """All nodes (K,)."""
        return np.ones(len(self.points), dtype=bool)

    def displacement(self, amount: float) -> FloatArray:
        """Return the displacement (K, 3)."""
        entries = self.track.entries(amount)
        return np.asarray((self.points - self.track.hinge.point) @ entries[:9].reshape(3, 3).T + entries[9:])

    @property
    def functions(self) -> "Places":
        """Independent entries of the motion."""
        size = float(np.linalg.norm(self.points - self.track.hinge.point, axis=1).max())
        hinge = self.track.hinge
        axis = (*hinge.point.tolist(), *hinge.direction.tolist(), hinge.length or 1.0)
        rows = tuple(map(tuple, self.track.rows.tolist()))
        low, high = self.track.rows[[0, -1], 0]
        return Places(rows, axis, self.track.smooth, size).within(float(low), float(high))


@dataclass(frozen=True, slots=True)
class Places(Functions):
    """Independent combinations of the entries of a track.

    Attributes
    ----------
    rows, axis, smooth : the track: its rows, and point, direction and length of its hinge.
    size : largest distance of a node from the hinge's first point, by which rotations are compared with shifts.
    basis : (12, k) coefficients of the combinations.
    """

    rows: tuple[tuple[float, ...], ...]
    axis: tuple[float, ...]
    smooth: bool
    size: float
    basis: tuple[tuple[float, ...], ...] = ()
    separate: ClassVar[bool] = True

    @property
    def track(self) -> Track:
        """The track."""
        *numbers, length = self.axis
        return Track(Axis(np.array(numbers[:3]), np.array(numbers[3:]), length), np.array(self.rows), self.smooth)

    def check(self) -> None:
        low, high = self.track.rows[[0, -1], 0]
        if len(self.axis) != 7 or not self.size > 0.0 or len(self.basis) != 12 or not 1 <= self.count <= 12:
            raise ValueError(f"a track from {low:g} to {high:g} whose functions are incomplete")
        if {*map(len, self.basis)} != {self.count}:
            raise ValueError("rows of the functions of a track are of different lengths")

    @property
    def count(self) -> int:
        return len(self.basis[0])

    @property
    def stops(self) -> tuple[float, ...]:
        """The parameters of the track's rows."""
        return tuple(row[0] for row in self.rows)

    def positions(self, points: FloatArray, amount: float) -> FloatArray:
        """Return points (N, 3) after the rigid motion."""
        return points + TrackLaw(self.track, points).displacement(amount)

    def values(self, amount: float) -> FloatArray:
        return np.asarray(self.track.entries(amount) @ np.array(self.basis))

    def rates(self, amount: float) -> FloatArray:
        return np.asarray(self.track.entries(amount, rate=True) @ np.array(self.basis))

    def within(self, low: float, high: float) -> "Places":
        """Return the combinations that are independent between two amounts."""
        track, weights = self.track, np.repeat([self.size, 1.0], [9, 3])
        entries = np.array([track.entries(amount) for amount in self._samples(low, high)]) * weights
        _, strength, directions = np.linalg.svd(entries, full_matrices=False)
        count = max(1, int(np.count_nonzero(strength > INDEPENDENT * strength[0])))
        scale = np.where(strength[:count] > 0.0, strength[:count], 1.0) / np.sqrt(len(entries))
        basis = weights[:, None] * directions[:count].T / scale
        return Places(self.rows, self.axis, self.smooth, self.size, tuple(map(tuple, basis.tolist())))

    def reads(self, low: float, high: float) -> tuple[float, ...]:
        """Return the amounts to read, sorted: the ends of the range, and those with the most independent values."""
        amounts = self._samples(low, high)
        left, taken = np.array([self.values(amount) for amount in amounts]), list[int]()
        ends = [int(np.searchsorted(amounts, end)) for end in (low, high) if end]
        while len(taken) < self.count:
            row = ends.pop() if ends else first_largest(np.linalg.norm(left, axis=1))
            direction = left[row] / np.linalg.norm(left[row])
            left = left - np.outer(left @ direction, direction)
            taken.append(row)
        return tuple(sorted(float(amount) for amount in amounts[taken]))

    def _samples(self, low: float, high: float) -> FloatArray:
        rows = np.array([row[0] for row in self.rows if low < row[0] < high])
        amounts = np.unique(np.concatenate([np.linspace(low, high, SAMPLES), rows]))
        return np.asarray(amounts[amounts != 0.0])


def shifts_of(shift: ArrayLike) -> FloatArray:
    """Return the shifts (2, 3) of both hinge points, given one or two of two or three numbers; else InputError."""
    rows = np.atleast_2d(bounded(shift, "shift"))
    if rows.shape not in ((1, 2), (1, 3), (2, 2), (2, 3)):
        raise InputError(f"shift = {shortened(shift)}: must be one shift x,y[,z], or one of each hinge point")
    out = np.zeros((2, 3))
    out[:, : rows.shape[1]] = rows
    return out

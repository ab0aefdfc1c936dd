"""Where a hinge or a table stands beside its surface: warnings of a wrong one."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, farthest
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.numbers import percent
from sdm_deflect.base.ties import first_largest
from sdm_deflect.meshing.mesh.axis import Axis

from .surface import Surface
from .tables import THIN, Table

# Ratios of metres, millimetres, inches and feet.
UNITS = (1000.0, 0.001, 25.4, 1.0 / 25.4, 0.3048, 1.0 / 0.3048, 39.37, 1.0 / 39.37)
# Least share of the surface's span between the hinge points; share of its width from which a hinge is far.
HALF, QUARTER = 0.5, 0.25
# Largest angle without nodes as seen from a hinge between two skins: half a turn with some allowance.
HALF_TURN = 1.1 * np.pi
# Largest width of a line of points as a share of its length. A choice: it leaves room for a cranked or bowed axis.
SLENDER = 0.1
# Share of a surface's extent along the flow that must lie aft of its hinge, for it to have a trailing edge there.
AFT = 0.1
# Pairs: by which ratio another unit must make table and surface coincide better, and how well they must then.
# Feet are off by 3.3 only, so that a ratio of 3 must do where the fit is nearly perfect. A table of a part of the
# surface fits less well; inches and millimetres make it better by 20 and more.
BETTER = ((20.0, 0.3), (3.0, 0.9))
# Largest rotation in radians that is no cause to ask whether degrees were meant.
RADIAN = 1.0
# Share of the largest displacement above which nodes on a plane in which they slide have moved, and from which the
# whole surface goes with them.
STILL, GOES = 0.01, 0.5
MEANT = "correct it, or say --force (force = true) if it is meant"


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A hinge beside its surface; lengths in the mesh's unit.

    Attributes
    ----------
    surface : its patches, for messages.
    axis : the hinge.
    width : extent of the surface across the hinge.
    distance : distance of the hinge's line from the nearest node; 0 if nodes surround the line.
    covered : share of the surface's extent along the hinge that lies between the hinge points; 1 if these are unknown.
    ahead : how far the surface reaches beyond the hinge, on the side opposite to its farthest node.
    chord : second largest extent of the surface in its principal directions.
    ends, apart : (E, 3) the hinge points, if known, and (E,) their distances from the nearest nodes.
    """

    surface: str
    axis: Axis
    width: float
    distance: float
    covered: float
    ahead: float
    chord: float
    ends: FloatArray = field(repr=False)
    apart: FloatArray = field(repr=False)

    @classmethod
    def of(cls, surface: Surface, axis: Axis) -> "Placement":
        """Measure the position of a hinge."""
        points = surface.points
        radial = axis.radial(points)
        along = (points - axis.point) @ axis.direction
        low, high, covered = float(along.min()), float(along.max()), 1.0
        if axis.length is not None and high > low:
            covered = max(min(high, axis.length) - max(low, 0.0), 0.0) / (high - low)
        width = float(np.linalg.norm(np.ptp(radial, axis=0)))
        chord = _extents(points)[1]
        known = [] if axis.length is None or high <= low else [0.0, axis.length]
        ends = np.array([axis.point + far * axis.direction for far in known]).reshape(-1, 3)
        apart = cKDTree(points).query(ends)[0] if len(ends) else np.empty(0)
        reach = np.linalg.norm(radial, axis=1)
        distance = 0.0 if _surrounds(radial, axis) else float(reach.min())
        ahead = -float((radial @ radial[np.argmax(reach)]).min()) / max(float(reach.max()), np.finfo(np.float64).tiny)
        return cls(surface.label, axis, width, distance, covered, ahead, chord, ends, apart)

    @property
    def near(self) -> bool:
        """True if the hinge is at most as far from the surface as the surface is wide."""
        return self.distance <= self.width

    def check(self, surface: Surface, force: bool) -> None:
        """Raise InputError if the hinge is far away (unless `force`); say if another unit of length would fit."""
        if self.near or force:
            return
        fits = [(there.distance, factor) for factor, there in self._elsewhere(surface)]
        help = f"times {min(fits)[1]:.4g} it would fit: give it in the mesh's unit of length" if fits else MEANT
        raise InputError(f"hinge: {self.passes}; {help}")

    @property
    def passes(self) -> str:
        """Distance of the hinge, in words."""
        return f"its line passes {self.distance:.4g} from {self.surface}, which is {self.width:.4g} wide across it"

    def _elsewhere(self, surface: Surface) -> Iterator[tuple[float, "Placement"]]:
        """Yield the factor of each unit of length in which the hinge would fit, and the placement there."""
        for factor in UNITS:
            length = None if self.axis.length is None else factor * self.axis.length
            there = Placement.of(surface, replace(self.axis, point=factor * self.axis.point, length=length))
            if there.near and there.covered >= HALF:
                yield factor, there

    def warnings(self, blended: bool) -> Iterator[str]:
        """Yield signs of a wrong hinge, as sentences."""
        if self.distance > QUARTER * self.width:
            yield f"hinge: {self.passes}: is it the right one?"
        if blended and self.covered < HALF:
            share = percent(self.covered)
            yield f"hinge: its two points cover {share} of the span of {self.surface}: is it the right one?"
        if blended and self.ahead > QUARTER * self.width:
            yield f"hinge: {self.surface}, {self.width:.4g} wide, reaches {self.ahead:.4g} ahead of it: is it right?"
        for name, end, apart in zip(("first", "second"), self.ends, self.apart, strict=False):
            if self.near and apart > self.chord:
                place = ", ".join(f"{x:.6g}" for x in end)
                yield (
                    f"hinge: its {name} point, ({place}), is {apart:.4g} from {self.surface}, whose chord is "
                    f"{self.chord:.4g}: is it right?"
                )


def check_aft(surface: Surface, axis: Axis) -> None:
    """Raise InputError if a surface lies ahead of its hinge along x: "down" and "up" are said of trailing edges."""
    station = axis.radial(surface.points)[:, 0]
    if station.max() < AFT * np.ptp(station):
        raise InputError(
            f"down and up are of trailing edges, and {surface.label} lies ahead of its hinge along x: give --angle"
        )


@dataclass(frozen=True, slots=True, eq=False)
class TablePlacement:
    """The points of a table beside its surface; lengths in the mesh's unit.

    Attributes
    ----------
    surface : its patches, for messages.
    nodes, points : (K, 3) nodes of the surface and (P, 3) distinct points of the table.
    plane : whether the mesh is plane.
    table : the table.
    moved : (K, 3) displacements of the nodes at the amount 1, once these are known.
    """

    surface: str
    nodes: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    plane: bool
    table: Table
    moved: FloatArray | None = field(default=None, repr=False)

    @classmethod
    def of(cls, surface: Surface, table: Table) -> "TablePlacement":
        """Take the nodes of a surface and the points of a table; InputError as for `Table.distinct`."""
        return cls(surface.label, surface.points, table.points[table.distinct()], surface.mesh.plane, table)

    @property
    def size(self) -> float:
        """Largest extent of the surface."""
        return float(np.ptp(self.nodes, axis=0).max())

    def overlap(self, factor: float = 1.0) -> float:
        """Return how well the boxes of surface and table coincide, in another unit: 0 for apart, 1 for equal.

        It is the product of intersection over union along the axes; a slender table or one in a plane counts as equal
        across it, if the surface is there.
        """
        low, high = _extent(self.nodes)
        first, last = _extent(factor * self.points)
        inner, outer = np.minimum(high, last) - np.maximum(low, first), np.maximum(high, last) - np.minimum(low, first)
        size = last - first
        flat = (size <= THIN * float(size.max())) | (self.slender & (np.arange(3) != first_largest(size)))
        shares = np.where(flat, inner >= -THIN * self.size, np.maximum(inner, 0.0) / np.where(outer > 0.0, outer, 1.0))
        return float(np.prod(shares))

    def check(self, surface: Surface, force: bool) -> None:
        """Raise InputError if table and surface are apart, or would coincide in another unit (unless `force`)."""
        del surface
        here, (there, factor) = self.overlap(), max((self.overlap(factor), factor) for factor in UNITS)
        fits = any(there >= good and there > much * here for much, good in BETTER)
        if force or (here and not fits):
            return
        if fits:
            raise InputError(
                f"table: times {factor:.4g} its points would lie where {self.surface} does: give points and "
                "displacements in the mesh's unit of length, or say --force (force = true) if it is meant"
            )
        apart = float(cKDTree(self.points).query(self.nodes)[0].min())
        raise InputError(f"table: its points are {apart:.4g} from {self.surface}, {self.size:.4g} long; {MEANT}")

    def warnings(self, blended: bool) -> Iterator[str]:
        """Yield signs of a table that does not cover its surface, as sentences."""
        if self.table.largest_rotation > RADIAN:
            turn = self.table.largest_rotation
            yield f"table: it turns by up to {turn:.4g} radians, {np.degrees(turn):.4g} degrees: is it in radians?"
        if len(self.points) == 1:
            at = self.points[0].tolist()
            yield f"table: all its points are at one place, {at}, and move {self.surface} as one piece"
            return
        nodes, points = self._along()
        (first, last), distance = _extent(points), cKDTree(points).query(nodes)[0]
        spacing = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
        off = np.maximum(first - nodes, nodes - last).max(axis=1)
        if self.table.rotations is None and self.on_line:
            yield (
                f"table: its points lie on a line and have no rotations, so that sections of {self.surface} move "
                "without turning: add rx, ry, rz in radians, or points beside the line"
            )
        if beyond := np.count_nonzero(off > spacing):
            yield (
                f"table: {percent(beyond / len(nodes))} of the nodes of {self.surface} lie beyond its points, by up to "
                f"{off.max():.4g}: {self._extrapolated('what follows it there' if blended else 'their displacement')}"
            )
        near = QUARTER * _extents(self.nodes)[2 if self.plane else 1]
        if coarse := np.count_nonzero((distance > near) & (off <= spacing)):
            yield (
                f"table: {percent(coarse / len(nodes))} of the nodes of {self.surface} are farther than {near:.4g} "
                "from its points: is it too coarse?"
            )

    @property
    def on_line(self) -> bool:
        """Whether the points are a line: slender, and much narrower than the surface."""
        return self.slender and _extents(self.points)[1] < QUARTER * _extents(self.nodes)[1]

    @property
    def slender(self) -> bool:
        """Whether the points are much narrower than they are long."""
        _, width, length = _extents(self.points)
        return width <= SLENDER * length

    def _along(self) -> tuple[FloatArray, FloatArray]:
        """Return nodes (K, d) and points (P, d) in the directions in which the points extend: a line has one."""
        first, last = _extent(self.points)
        axes = np.eye(3)[:, last - first > THIN * float((last - first).max())]
        if self.table.rotations is not None:
            axes = self.table.across[:, None]
        elif self.on_line:
            one, other = self.points[farthest(self.points, 2)]
            axes = (other - one)[:, None] / np.linalg.norm(other - one)
        return self.nodes @ axes, self.points @ axes

    def _extrapolated(self, what: str) -> str:
        """Say what becomes of nodes beyond the points, and how far they move if that is farther than any point."""
        if self.table.rotations is not None:
            return "they move with the beam's end"
        known = float(np.linalg.norm(self.table.vectors, axis=1).max())
        moved = 0.0 if self.moved is None else float(np.linalg.norm(self.moved, axis=1).max())
        text = f"{what} is extrapolated"
        return text + (f", to {moved:.4g} where the table's largest is {known:.4g}" if moved > known else "")

    def moved_on(self, patch: str, rows: BoolArray) -> Iterator[str]:
        """Yield a sentence if nodes on another patch (a mask (K,)) move, but far less than the surface: a root."""
        if self.moved is None or not rows.any():
            return
        moved = np.linalg.norm(self.moved, axis=1)
        root, largest = float(moved[rows].max()), float(moved.max())
        if STILL * largest < root < GOES * largest:
            row = np.flatnonzero(rows)[first_largest(moved[rows])]
            yield (
                f"table: it moves {self.surface} on {patch} by up to {root:.4g} of {largest:.4g}, at "
                f"({', '.join(f'{x:.6g}' for x in self.nodes[row])}): should that stay, give it points there that do"
            )


def _extent(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return points.min(axis=0), points.max(axis=0)


def _extents(points: FloatArray) -> list[float]:
    """Return the extents in the principal directions, rising."""
    centred = points - points.mean(axis=0)
    return sorted(np.ptp(centred @ np.linalg.eigh(centred.T @ centred)[1], axis=0).tolist())


def _surrounds(radial: FloatArray, axis: Axis) -> bool:
    """Return whether vectors (N, 3) from an axis leave no gap larger than `HALF_TURN` around it."""
    first = radial[0]
    angles = np.sort(np.arctan2(radial @ np.cross(axis.direction, first), radial @ first))
    return bool(np.diff(angles, append=angles[0] + 2.0 * np.pi).max() < HALF_TURN)

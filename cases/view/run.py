"""A finished run that turns to any angle: the same centres, a factor used again, no adaptation."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.report.finished import Display, FinishedRun
from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError, read_arrays
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.touched import TouchedCells
from sdm_deflect.deform.rbf.fitting import LARGEST_ANGLE
from sdm_deflect.deform.surface.surface import TrailingEdge, name_of
from sdm_deflect.deform.volume.deflection import BoxDeflection, with_repair
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.deform.volume.prepared import Centers, PreparedDeflection
from sdm_deflect.deform.volume.step import DIRECTIONS

SAME_MESH = 0.01
"""Of the tolerance: the mesh at the run's angle is no farther from that of the run."""
BEYOND = 3.0
"""A table of displacements is shown up to so many times the run's share of it."""
FOREIGN = "does not belong to the mesh and the settings of the run; run it again"
STEP = 0.5
"""The ends of what is possible are found to this many degrees; for a table, to as large a part of its range."""


@dataclass(frozen=True, slots=True, eq=False)
class DeflectedMesh:
    """The mesh at one angle.

    Attributes
    ----------
    angle : of the run, degrees or the share of a table.
    points : (N, 3) coordinates of all nodes; those outside the boxes have the bits of the run's mesh.
    quality : (L,) quality of the cells that touch a box, block by block, each by the measure of its type.
    inverted : rows of `quality` of the inverted cells.
    residual : largest error of the interpolants at any data site, in any direction, a length.
    tolerance : what the run allowed for it.
    before : rows of `quality` of the cells that are inverted in the undeflected mesh.
    repaired : number of nodes that the repair moved; None for the interpolant's mesh.
    """

    angle: float
    points: FloatArray = field(repr=False)
    quality: FloatArray = field(repr=False)
    inverted: IntArray = field(repr=False)
    residual: float
    tolerance: float
    before: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    repaired: int | None = None

    @property
    def further(self) -> int:
        """Number of cells that are inverted and were not before."""
        return len(np.setdiff1d(self.inverted, self.before, assume_unique=True))

    @property
    def fits(self) -> bool:
        """True if the residual is below the tolerance and no further cell is inverted."""
        return self.residual < self.tolerance and not self.further


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A moving surface.

    Attributes
    ----------
    name, patches : its name and its patches.
    following : patches that follow it.
    factor : its amount over the run's angle.
    node : the node that moves farthest.
    place : what that node is.
    """

    name: str
    patches: tuple[str, ...]
    following: tuple[str, ...]
    factor: float
    node: int
    place: str

    @classmethod
    def of(cls, plan: BoxPlan, row: int, angle: float, leading: int | None) -> "Mover":
        """Return a surface of a plan."""
        surface, moving = plan.boundary.surfaces[row], plan.job.surfaces[row]
        patches, following = surface.patches[:leading], surface.patches[leading or len(surface.patches) :]
        moves = plan.boundary.displacement(plan.job.amounts)[np.searchsorted(plan.boundary.nodes, surface.nodes)]
        farthest = int(np.argmax(np.where(surface.on(patches), np.linalg.norm(moves, axis=1), -1.0)))
        axis, node = moving.motion.axis, int(surface.nodes[farthest])
        place = "trailing edge" if axis and TrailingEdge().of(surface, axis)[farthest] else "farthest node"
        return cls(name_of(patches), patches, following, moving.amount / angle if angle else 1.0, node, place)


@dataclass(frozen=True, slots=True, eq=False)
class InteractiveRun:
    """A run, its surfaces ready to turn together.

    Attributes
    ----------
    display : how it is shown.
    angle : of the run; each surface turns by its factor times that.
    boxes : the deflection of each confining hexahedron.
    factors : the angle of each box over that of the run.
    changed : nodes of each box that may move.
    surfaces : the moving surfaces of all boxes.
    touched : the cells that touch a box.
    points, moved : (N, 3) the mesh of the run, and how far its repair has moved each node.
    """

    display: Display
    angle: float
    boxes: tuple[PreparedDeflection, ...] = field(repr=False)
    factors: tuple[float, ...]
    changed: tuple[IntArray, ...] = field(repr=False)
    surfaces: tuple[Mover, ...] = field(repr=False)
    touched: TouchedCells = field(repr=False)
    points: FloatArray = field(repr=False)
    moved: FloatArray = field(repr=False)

    @classmethod
    def of(cls, finished: FinishedRun) -> "InteractiveRun":
        """Prepare a finished run for other angles, with the centres of its folder, and factorise.

        Raises InputError if the centres or the points do not belong to its plan.
        """
        plan, angle, moved = finished.plan, finished.angle, finished.repair
        run = cls(
            display=finished.display,
            angle=angle,
            boxes=_prepared_boxes(finished.folder, plan),
            factors=tuple(box.job.angle / angle if angle else 1.0 for box in plan.boxes),
            changed=tuple(box.changed for box in plan.boxes),
            surfaces=tuple(
                Mover.of(box, row, angle, finished.display.leading)
                for box in plan.boxes
                for row in range(len(box.job.surfaces))
            ),
            touched=plan.touched,
            points=finished.points,
            moved=np.zeros_like(finished.points) if moved is None else moved,
        )
        frame = run.at(angle)
        if np.abs(frame.points + run.moved - run.points).max() > SAME_MESH * frame.tolerance:
            raise InputError(f"{finished.folder}: deflected.vtu {FOREIGN}")
        return run

    @property
    def mesh(self) -> Mesh:
        """The undeflected mesh."""
        return self.boxes[0].plan.mesh

    @property
    def repairs(self) -> bool:
        """True if spoiled cells are to be repaired."""
        return bool(self.moved.any()) or any(box.plan.job.repair.mode != "off" for box in self.boxes)

    @property
    def unit(self) -> str:
        """What follows an angle."""
        unit = self.boxes[0].plan.job.surfaces[0].motion.unit
        return "\N{DEGREE SIGN}" if unit == "deg" else f" {unit}"

    @property
    def largest(self) -> float:
        """Angle that no surface can exceed."""
        if self.boxes[0].plan.job.surfaces[0].motion.unit != "deg":
            return BEYOND * (abs(self.angle) or 1.0)
        return self.display.largest / max(abs(one.factor) for one in self.surfaces)

    @property
    def step(self) -> float:
        """Change of the angle that counts: `STEP` degrees, or as large a part of a table's range."""
        return STEP * (1.0 if self.unit == "\N{DEGREE SIGN}" else self.largest / LARGEST_ANGLE)

    def at(self, angle: float) -> DeflectedMesh:
        """Turn every surface to its share of the angle.

        Raises InputError if the angle is not a number or beyond what any surface can turn, or a surface cannot move so
        far within its box.
        """
        if not abs(angle) <= self.largest:
            raise InputError(f"{angle:g} is outside {-self.largest:g} ... {self.largest:g}{self.unit}")
        points, residual = self.mesh.points.copy(), 0.0
        for box, factor, changed in zip(self.boxes, self.factors, self.changed, strict=True):
            moved = box.at(factor * angle)
            points[changed] = moved.points[changed]
            residual = max(residual, moved.error)
        tolerance = min(box.plan.sites.tolerance for box in self.boxes)
        before = self.touched.before.inverted if any(self.touched.inverted) else ()
        return DeflectedMesh(angle, points, *self._judged(points), residual, tolerance, np.flatnonzero(before))

    def repaired(self, frame: DeflectedMesh) -> DeflectedMesh:
        """Return a frame of the interpolant repaired where that is needed; at the run's angle it is the run's mesh."""
        if not self.repairs:
            return frame
        points = frame.points.copy()
        if frame.angle == self.angle:
            points = self.points
        else:
            for box, factor, changed in zip(self.boxes, self.factors, self.changed, strict=True):
                amounts = box.plan.job.amounts_at(factor * frame.angle)
                found = with_repair(BoxDeflection.at(box.plan, amounts, frame.points))
                points[changed] = found.points[changed]
        moved = self.moved if points is self.points else points - frame.points
        quality, bad = self._judged(points)
        count = int(moved.any(axis=1).sum())
        return replace(frame, points=points, quality=quality, inverted=bad, repaired=count)

    def check(self, angle: float) -> None:
        """Raise InputError if a surface cannot move to its share of the angle within its box."""
        for box, factor in zip(self.boxes, self.factors, strict=True):
            box.check(factor * angle)

    def _judged(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the quality (L,) of the cells touched, and the rows of the inverted ones."""
        quality, inverted = self.touched.scores(points)
        return quality, np.flatnonzero(inverted)


def _prepared_boxes(folder: Path, plan: Plan) -> tuple[PreparedDeflection, ...]:
    """Return each box of a plan with the centres that a run has left for it; InputError if they do not belong to it."""
    stored = read_arrays(folder / "interpolant.npz")
    tags = [f"_{box.surface}" if i else "" for i, box in enumerate(plan.boxes)]
    try:
        pairs = zip(plan.boxes, tags, strict=True)
        return tuple(PreparedDeflection.of(box, box.job.angle, centers_of(stored, tag)) for box, tag in pairs)
    except InputError:
        raise InputError(f"{folder}: interpolant.npz {FOREIGN}") from None


def centers_of(stored: dict[str, Any], tag: str) -> list[Centers]:
    """Return the centres of each step of the box whose arrays bear a tag (see `write_interpolants`)."""

    def by_direction(prefix: str, step: str) -> dict[int, FloatArray]:
        names = {c: f"{prefix}centers_{letter}{tag}{step}" for c, letter in enumerate(DIRECTIONS)}
        return {c: stored[name] for c, name in names.items() if name in stored}

    count = 1 + sum(name.startswith(f"centers_x{tag}_step") for name in stored)
    return [
        Centers(*(by_direction(prefix, f"_step{k}" if k > 1 else "") for prefix in ("sliding_", "")))
        for k in range(1, count + 1)
    ]


@dataclass(frozen=True, slots=True)
class Span:
    """The ends of a range of angles that holds zero, and what prevents a step beyond each."""

    low: float
    high: float
    below: str = ""
    above: str = ""

    def __contains__(self, angle: float) -> bool:
        return self.low <= angle <= self.high


@dataclass(frozen=True, slots=True)
class Spans:
    """Where the surfaces can move, and where the interpolant's mesh fits (`DeflectedMesh.fits`) without a repair."""

    possible: Span
    fits: Span

    @classmethod
    def of(cls, run: InteractiveRun) -> "Spans":
        """Find where the surfaces can move by bisection, and where the mesh fits by steps from zero."""
        step = run.step
        low, high = (sign * step * _last(run, sign * step) for sign in (-1.0, 1.0))
        possible = Span(low, high, _obstacle(run, low - step), _obstacle(run, high + step))
        return cls(possible, Span(-step * _fitting(run, -step, low), step * _fitting(run, step, high)))


def _fitting(run: InteractiveRun, step: float, end: float) -> int:
    """Return how many steps from zero towards `end` fit before the first that does not."""
    k = 0
    while abs(step * (k + 1)) <= abs(end) and run.at(step * (k + 1)).fits:
        k += 1
    return k


def _obstacle(run: InteractiveRun, angle: float) -> str:
    """Say why no surface motion exists at an angle; empty if one does."""
    if abs(angle) > run.largest:
        return f"no surface turns by more than {run.largest:g} deg" if run.unit[0] != " " else "the table ends there"
    try:
        run.check(angle)
    except InputError as error:
        return str(error)
    return ""


def _last(run: InteractiveRun, step: float) -> int:
    """Return the last multiple of a step at which the surfaces can move, where they can at all below it."""
    low, bad = 0, int(run.largest / abs(step)) + 1
    while bad - low > 1:
        middle = (low + bad) // 2
        low, bad = (low, middle) if _obstacle(run, step * middle) else (middle, bad)
    return low

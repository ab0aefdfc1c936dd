"""What a report tells of: any deflected mesh, with its boxes, adaptations and checks."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import groupby, takewhile
from math import floor, log10
from pathlib import Path

import numpy as np

from sdm_deflect.cases.metrics import Json
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.hexahedron import Hexahedron
from sdm_deflect.deform.mesh import FloatArray, IntArray, Mesh, Polyhedra, Volume
from sdm_deflect.deform.quality import MEASURES, POLYHEDRON, Quality, quality_of
from sdm_deflect.deform.surface.axis import Axis
from sdm_deflect.deform.touched import TouchedCells
from sdm_deflect.deform.volume.deflection import Deflection, Plan
from sdm_deflect.deform.volume.step import DIRECTIONS

Rows = list[tuple[str, str, str, str]]
"""Name, value, unit and meaning of settings."""
FLAT = 6.0
"""Quality of polyhedra is coloured times this: that of a cube is then 1."""
LARGER = 3.0
"""Patches larger than this multiple of the moving and fixed ones together are hidden at first."""


@dataclass(frozen=True, slots=True)
class Length:
    """The unit of length of a mesh, and how lengths in it are shown.

    Attributes
    ----------
    name : the mesh's unit.
    shown : unit in figures.
    factor : by which coordinates are multiplied in figures.
    """

    name: str
    shown: str
    factor: float

    def text(self, length: float, figures: str = ".4g") -> str:
        """Return a length of the mesh's unit in the unit of the figures."""
        return f"{self.factor * length:{figures}} {self.shown}"


METRES = Length("m", "mm", 1e3)
MESH_UNITS = Length("mesh units", "mesh units", 1.0)


@dataclass(frozen=True, slots=True)
class Convergence:
    """The adaptation of one group of directions in one step.

    Attributes
    ----------
    box : name of the first patch that moves in the box.
    step : 1 for the first.
    directions : such as ``"x"`` or ``"xyz"``.
    centres, errors : number of centres and the largest residual with them, a length, by iteration.
    """

    box: str
    step: int
    directions: str
    centres: tuple[int, ...]
    errors: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """A moving surface.

    Attributes
    ----------
    name : of the surface; its patches if it has none.
    amount, unit : how far it goes, in degrees or as a share of a table.
    patches : names of its patches.
    nodes : (K,) its nodes.
    axis : its hinge, None without one.
    """

    name: str
    amount: float
    unit: str
    patches: tuple[str, ...]
    nodes: IntArray = field(repr=False)
    axis: Axis | None = None

    @property
    def turned(self) -> str:
        """Amount and unit."""
        return f"{self.amount:+g} {self.unit}"


@dataclass(frozen=True, eq=False)
class Box:
    """A confining hexahedron with the surfaces that move in it.

    Attributes
    ----------
    name : of the surfaces in it together.
    surfaces : at least one.
    nodes : (M,) nodes that may move.
    sites : (K,) nodes of the surfaces that are data sites.
    touched : cells with such a node.
    zero : (Z, 3) data sites of zero displacement.
    tolerance : of the residual at the data sites, a length.
    centres : (C, 3) of the first step by direction.
    """

    name: str
    surfaces: tuple[Moved, ...]
    hexahedron: Hexahedron
    nodes: IntArray = field(repr=False)
    sites: IntArray = field(repr=False)
    touched: TouchedCells = field(repr=False)
    zero: FloatArray = field(repr=False)
    tolerance: float
    convergence: tuple[Convergence, ...] = field(repr=False)
    centres: dict[str, FloatArray] = field(repr=False)

    @cached_property
    def before(self) -> tuple[Quality, ...]:
        """Quality of the touched cells before, by type."""
        return self.touched.quality(self.touched.mesh.points)


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that the page of a deflected mesh shows.

    Attributes
    ----------
    title : what was deflected.
    facts : name and value of what stands at the top of the page.
    mesh : before.
    points : (N, 3) after.
    boxes : disjoint.
    length : the mesh's unit.
    settings : content of the file `settings_file`, with which `repeat` repeats the run.
    tables : the settings in words, by table.
    middle : (3,) point from which ends of surfaces are inner or outer ones.
    drawn, hidden : names of the patches in pictures, and of those that only the turnable picture offers.
    quality_limit : smallest mean ratio that is accepted, None without a limit.
    checks : the verdict; empty until the mesh is judged.
    figures : the content of metrics.json; empty until then.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    mesh: Mesh
    points: FloatArray = field(repr=False)
    boxes: tuple[Box, ...]
    length: Length
    settings: str = field(repr=False)
    settings_file: str
    repeat: str
    tables: dict[str, Rows] = field(repr=False)
    middle: FloatArray = field(repr=False)
    drawn: tuple[str, ...]
    hidden: tuple[str, ...] = ()
    quality_limit: float | None = None
    checks: tuple[Check, ...] = ()
    figures: Json = field(default_factory=dict, repr=False)

    @property
    def surfaces(self) -> tuple[Moved, ...]:
        """The moving surfaces of all boxes."""
        return tuple(surface for box in self.boxes for surface in box.surfaces)

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return all(check.passed for check in self.checks)

    @cached_property
    def after(self) -> tuple[tuple[Quality, ...], ...]:
        """Quality of the touched cells of each box after, by type."""
        return tuple(box.touched.quality(self.points) for box in self.boxes)

    def worst(self) -> tuple[float, float] | None:
        """Return the smallest quality of the touched cells before and after, None without cells."""
        before = [one.min for box in self.boxes for one in box.before]
        after = [one.min for some in self.after for one in some]
        return (min(before), min(after)) if before and after else None

    def judged(self, checks: tuple[Check, ...], figures: Json) -> "ReportData":
        """Return the data with the verdict and the content of metrics.json."""
        return replace(self, checks=checks, figures=figures)


def in_view(mesh: Mesh, parts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the patches that pictures show: `parts`, and those not much larger, so no far field that hides them."""
    reach = LARGER * _diagonal(mesh.points[mesh.on(*parts)])
    return tuple(p.name for p in mesh.patches if p.name in parts or _diagonal(mesh.points[p.nodes]) <= reach)


def middle_of(mesh: Mesh, names: tuple[str, ...]) -> FloatArray:
    """Return the middle (3,) of the extent of some patches."""
    places = mesh.points[mesh.on(*names)]
    return np.asarray(0.5 * (places.min(axis=0) + places.max(axis=0)))


def _diagonal(points: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def measure_of(shapes: set[str]) -> str:
    """Return what the quality of cells of these shapes is, in words."""
    measures = {MEASURES[shape] for shape in shapes}
    if len(measures) == 1:
        return measures.pop()
    owners = {measure: sorted(shape for shape in shapes if MEASURES[shape] == measure) for measure in sorted(measures)}
    return "; ".join(f"{measure} ({', '.join(own)})" for measure, own in owners.items())


def shape_of(block: Volume) -> str:
    """Return the type of the cells of a block."""
    return POLYHEDRON if isinstance(block, Polyhedra) else block.shape


def drawn_quality(points: FloatArray, block: Volume, rows: IntArray, orientation: float) -> FloatArray:
    """Return the quality (R,) of cells as it is coloured: that of polyhedra is drawn times `FLAT`."""
    if not len(rows):
        return np.empty(0)
    return (FLAT if isinstance(block, Polyhedra) else 1.0) * quality_of(points, block, rows, orientation)


def drawn_measure(mesh: Mesh) -> str:
    """Return what the colours of cells mean."""
    shapes = {shape_of(block) for block in mesh.cells}
    text = measure_of(shapes) if shapes else "quality"
    return text.replace(MEASURES[POLYHEDRON], f"{FLAT:g} x {MEASURES[POLYHEDRON]}")


def round_length(most: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above `most`."""
    power = 10.0 ** floor(log10(most))
    return max(first * power for first in (1.0, 2.0, 5.0) if first * power <= most * (1.0 + 1e-12))


def name_of(patches: Sequence[str]) -> str:
    """Return a name for patches together: their own, or what their names begin with."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*patches, strict=False))
    start = "".join(letters[0] for letters in alike).rstrip("_-. /")
    return patches[0] if len(patches) == 1 else start if len(start) > 2 else f"{patches[0]} and {len(patches) - 1} more"


def box_of(
    plan: Plan, angle: float, name: str, convergence: tuple[Convergence, ...], centres: dict[str, FloatArray]
) -> Box:
    """Return the box of a plan with its surfaces, the first of them at `angle`."""
    surfaces = tuple(
        Moved(name_of(own.patches), one.amount, one.motion.unit, own.patches, own.nodes, one.motion.axis)
        for one, own in zip(plan.job.at(angle).surfaces, plan.boundary.surfaces, strict=True)
    )
    zero = np.vstack([np.empty((0, 3)), *(part.points for part in plan.sites.zero)])
    return Box(
        name=name,
        surfaces=surfaces,
        hexahedron=plan.region.hexahedron,
        nodes=plan.changed,
        sites=plan.sites.moving,
        touched=plan.touched,
        zero=zero,
        tolerance=plan.sites.tolerance,
        convergence=convergence,
        centres=centres,
    )


def convergence_of(one: Deflection) -> tuple[Convergence, ...]:
    """Return the adaptations of a deflection."""
    return tuple(
        Convergence(
            one.plan.surface,
            k,
            "".join(DIRECTIONS[c] for c in fit.components),
            tuple(row.n_centers for row in fit.history),
            tuple(row.max_residual for row in fit.history),
        )
        for k, step in enumerate(one.steps, 1)
        for fit in step.fits.adaptations
    )


def centres_of(one: Deflection) -> dict[str, FloatArray]:
    """Return the centres (C, 3) of a deflection's first step by direction."""
    return {DIRECTIONS[c]: fit.interpolant.centers for fit in one.steps[0].fits.adaptations for c in fit.components}


def check_of(row: Json) -> Check:
    """Return a check as metrics.json has it."""
    own = {item.name: row[item.name] for item in fields(Check) if item.name in row}
    return Check(**{**own, "value": float("nan") if row["value"] is None else row["value"]})


def read_convergence(path: Path) -> tuple[Convergence, ...]:
    """Read convergence.csv."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for key, group in groupby(rows, key=lambda row: (row["surface"], int(row["step"]), row["direction"])):
        pairs = [(int(row["centres"]), float(row["max_error"])) for row in group]
        found.append(Convergence(*key, tuple(count for count, _ in pairs), tuple(error for _, error in pairs)))
    return tuple(found)


def read_centres(path: Path, boxes: list[str]) -> dict[str, dict[str, FloatArray]]:
    """Read the centres of the first step from interpolant.npz, by box and direction."""
    with np.load(path, allow_pickle=False) as stored:
        return {
            name: {d: stored[f"centers_{d}_{name}" if i else f"centers_{d}"] for d in "xyz"}
            for i, name in enumerate(boxes)
        }

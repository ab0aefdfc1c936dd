"""Content of a report on any deflected mesh: boxes, adaptations, checks."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from itertools import groupby
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.unpacking import damaged, read_arrays
from sdm_deflect.cases.run.advice import narrower_setting, wider_setting
from sdm_deflect.cases.run.metrics import Json, signed
from sdm_deflect.cases.run.output import text_of
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.checks import Check, Grade, grade
from sdm_deflect.deform.mesh_motion import MeshMotion, control_name, panels_of
from sdm_deflect.deform.rbf.data_sites import DIRECTIONS
from sdm_deflect.deform.surface.surface import name_of
from sdm_deflect.deform.surface.tracks import TrackLaw
from sdm_deflect.deform.volume.deflection import BoxDeflection
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.plan import BoxPlan
from sdm_deflect.meshing.mesh.affected import AffectedCells
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import MEASURES, Quality, quality_of
from sdm_deflect.meshing.mesh.standard import parts_of

from .near import with_near_cells

# What a folder is not whose files are damaged.
RUN = "whole folder of a run"
# Margin around a box of what slices show, by its size.
AROUND = 0.13
# Share of the mesh's extent along an axis, from which on a patch is as wide as the mesh: far fields are rounded.
WIDE = 0.9
# Patches larger than this multiple of the moving and fixed ones together are hidden at first.
LARGER = 3.0


class SettingRow(NamedTuple):
    """A setting: its name, value, unit and meaning, and whether it differs from the usual one."""

    name: str
    value: str
    unit: str
    meaning: str
    differs: bool


Rows = list[SettingRow]


@dataclass(frozen=True, slots=True)
class Length:
    """The unit of length of a mesh, and the unit in figures.

    Attributes
    ----------
    name : the mesh's unit.
    shown : unit in figures.
    factor : factor of coordinates in figures.
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
    step : number of the step, from 1.
    directions : such as ``"x"`` or ``"xyz"``.
    centres, errors : number of centres and the largest residual with them, a length, by iteration.
    """

    box: str
    step: int
    directions: str
    centres: tuple[int, ...]
    errors: tuple[float, ...]


class FitRows(NamedTuple):
    """The adaptations of a deflection, and the centres (C, 3) of its first step by direction."""

    convergence: tuple[Convergence, ...]
    centres: dict[str, FloatArray]

    @classmethod
    def of(cls, deflection: BoxDeflection) -> "FitRows":
        """Return the adaptations of a deflection."""
        convergence = []
        for k, step in enumerate(deflection.steps, 1):
            for fit in step.fits.adaptations:
                directions, rows = "".join(DIRECTIONS[c] for c in fit.components), fit.history
                pairs = tuple(row.n_centers for row in rows), tuple(row.max_residual for row in rows)
                convergence.append(Convergence(deflection.plan.surface, k, directions, *pairs))
        first = deflection.steps[0].fits.adaptations
        centres = {DIRECTIONS[c]: fit.interpolant.centers for fit in first for c in fit.components}
        return cls(tuple(convergence), centres)


@dataclass(frozen=True, slots=True, eq=False)
class MovedSurface:
    """A moving surface.

    Attributes
    ----------
    name, label : name of the surface, or else of its patches, and names of the patches, as figures have them.
    amount, unit : its amount, in degrees or as a share of a table.
    patches : names of its patches.
    nodes : (K,) its nodes.
    axis : its hinge, None without one.
    wider : the setting that blends it over a larger width, such as ``--strip 0.3``; empty without one.
    narrower : the setting that blends it over a smaller width; empty without one.
    control : name of the surface in a plan.
    panel : those of its patches that follow its root on the body.
    place : what a track's amount means in words, its angle and its shift; empty for other motions.
    """

    name: str
    amount: float
    unit: str
    patches: tuple[str, ...]
    nodes: IntArray = field(repr=False)
    axis: Axis | None = None
    wider: str = ""
    narrower: str = ""
    label: str = ""
    control: str = ""
    panel: tuple[str, ...] = ()
    place: str = ""

    @property
    def amount_text(self) -> str:
        """Amount and unit, with a minus sign and a degree sign; of a track the place there."""
        return self.place or signed(self.amount, self.unit)


@dataclass(frozen=True, eq=False)
class Box:
    """A confining hexahedron with the surfaces that move in it.

    Attributes
    ----------
    name : names of its surfaces, joined.
    surfaces : at least one.
    nodes : (M,) nodes that may move.
    sites : (K,) nodes of the surfaces that are data sites.
    affected : cells with such a node.
    zero : (Z, 3) data sites of zero displacement.
    tolerance : tolerance of the residual at the data sites, a length.
    """

    name: str
    surfaces: tuple[MovedSurface, ...]
    hexahedron: Hexahedron
    nodes: IntArray = field(repr=False)
    sites: IntArray = field(repr=False)
    affected: AffectedCells = field(repr=False)
    zero: FloatArray = field(repr=False)
    tolerance: float
    fits: FitRows = field(repr=False)

    @classmethod
    def of(cls, plan: BoxPlan, amounts: Amounts, name: str, fits: FitRows) -> "Box":
        """Return the box of a plan with its surfaces at some amounts."""
        surfaces = [
            MovedSurface(
                name=name_of(surface.plain_names) + surface.suffix,
                amount=amount,
                unit=moving.motion.unit,
                patches=surface.patches,
                nodes=surface.nodes,
                axis=moving.motion.axis,
                wider=wider_setting(moving.motion, plan.mesh.plane),
                narrower=narrower_setting(moving.motion, plan.mesh.plane),
                label=surface.label,
                control=control_name(moving, surface),
                panel=panels_of(moving, surface),
                place=_place(law, amount) if isinstance(law, TrackLaw) else "",
            )
            for (moving, surface), law, amount in zip(plan.moving, plan.boundary.laws, amounts, strict=True)
        ]
        return cls(
            name=name,
            surfaces=tuple(surfaces),
            hexahedron=plan.hexahedron,
            nodes=plan.movable,
            sites=plan.sites.moving,
            affected=plan.affected,
            zero=np.vstack([np.empty((0, 3)), *(part.points for part in plan.sites.zero)]),
            tolerance=plan.sites.tolerance,
            fits=fits,
        )


class ProposedHinge(NamedTuple):
    """A hinge of a patch, as `sdm quality` proposes it: two points, as words of the command line, and their places."""

    patch: str
    text: str
    ends: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that the page of a deflected mesh shows.

    Attributes
    ----------
    title : name of the surfaces and the mesh.
    subject : name of the mesh or of the case.
    facts : names and values at the top of the page.
    mesh : undeflected mesh.
    points : (N, 3) deflected coordinates.
    boxes : disjoint boxes.
    length : the mesh's unit.
    settings : content of the file `settings_file`, with which `repeat` repeats the run.
    tables : rows of settings with meanings, by table.
    middle : (3,) point that tells a surface's inner end from its outer end.
    drawn, hidden : names of patches in all pictures, and of those in the turnable picture only.
    quality_limit : smallest mean ratio that is accepted, None without a limit.
    interpolated : (N, 3) before a repair moved nodes, None if none did.
    motion : plan that moves the mesh to other amounts, or None.
    moves : command that moves the mesh, with AMOUNTS to replace.
    hinges, beside : of a mesh in which nothing moves: proposed hinges, and the patches that meet each patch.
    checks : the verdict; empty until the mesh is judged.
    figures : the content of metrics.json; empty until then.
    """

    title: str
    subject: str
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
    interpolated: FloatArray | None = field(default=None, repr=False)
    motion: MeshMotion | None = field(default=None, repr=False)
    moves: str = ""
    hinges: tuple[ProposedHinge, ...] = ()
    beside: dict[str, tuple[str, ...]] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    figures: Json = field(default_factory=dict, repr=False)

    @cached_property
    def near(self) -> "ReportData":
        """The data with only the cells that touch a box or that a slice can show."""
        around = [_bounds_of_slices(box.hexahedron.corners) for box in self.boxes]
        affected = with_near_cells(self.mesh, [box.affected for box in self.boxes], around)
        boxes = tuple(replace(box, affected=cells) for box, cells in zip(self.boxes, affected, strict=True))
        return replace(self, mesh=affected[0].mesh, boxes=boxes)

    @property
    def surfaces(self) -> tuple[MovedSurface, ...]:
        """The moving surfaces of all boxes."""
        return tuple(surface for box in self.boxes for surface in box.surfaces)

    @property
    def surface_size(self) -> float:
        """Largest extent of a moving surface; 0 without one."""
        return max(
            (float(np.ptp(self.mesh.points[surface.nodes], axis=0).max()) for surface in self.surfaces), default=0.0
        )

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return self.grade != "FAILED"

    @property
    def grade(self) -> Grade:
        """The verdict in a word."""
        return grade(self.checks)

    @cached_property
    def after(self) -> tuple[tuple[Quality, ...], ...]:
        """Quality of the affected cells of each box after, by type."""
        return tuple(box.affected.quality(self.points) for box in self.boxes)

    def worst(self) -> tuple[float, float] | None:
        """Return the smallest quality of the affected cells before and after, None without cells."""
        before = [quality.min for box in self.boxes for quality in box.affected.quality_before]
        after = [quality.min for some in self.after for quality in some]
        return (min(before), min(after)) if before and after else None

    @property
    def states(self) -> dict[str, FloatArray]:
        """Points (N, 3) by name: before, after the interpolation if a repair followed, and after all."""
        between = {} if self.interpolated is None else {"interpolated": self.interpolated}
        return {"before": self.mesh.points, **between, "after": self.points}

    @property
    def headline(self) -> str:
        """The title in a few words: the only surface with its amount, or the number of surfaces."""
        moved = [f"{surface.name} {surface.amount_text}" for surface in self.surfaces]
        return f"{self.subject}: {moved[0] if len(moved) == 1 else f'{len(moved)} surfaces deflected'}"

    def with_verdict(self, checks: tuple[Check, ...], figures: Json) -> "ReportData":
        """Return the data with the verdict and the content of metrics.json."""
        return replace(self, checks=checks, figures=figures)


def _place(law: TrackLaw, amount: float) -> str:
    """Return angle and shift of a track's first hinge point at an amount: ``+15°, shifted by (0.01, −0.02)``."""
    angle, *shift = law.track.place(amount)[:4].tolist()
    numbers = ", ".join(f"{value:.4g}" for value in shift[: 3 if shift[2] else 2]).replace("-", "\N{MINUS SIGN}")
    return signed(angle, "deg") + (f", shifted by ({numbers})" if any(shift) else "")


def _bounds_of_slices(corners: FloatArray) -> FloatArray:
    """Return the two corners (2, 3) of the region that slices show around a hexahedron (8, 3)."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = AROUND * float((high - low).max())
    return np.array([low - margin, high + margin])


def before_repair(points: FloatArray, moved: FloatArray | None) -> FloatArray | None:
    """Return nodes (N, 3) before a repair that `moved` them (N, 3); None if it moved none."""
    return None if moved is None or not moved.any() else points - moved


def in_view(mesh: Mesh, parts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the patches for pictures: `parts`, and others not much larger; a far field would hide them.

    So would a plane of symmetry: patches as wide as the mesh along two axes are left out.
    """
    reach, extent = LARGER * diagonal(mesh.points[mesh.on(*parts)]), np.ptp(mesh.points, axis=0)

    def is_near(nodes: IntArray) -> bool:
        across = np.ptp(mesh.points[nodes], axis=0) if len(nodes) else np.zeros(3)
        return diagonal(mesh.points[nodes]) <= reach and int(((across >= WIDE * extent) & (extent > 0.0)).sum()) < 2

    return tuple(p.name for p in mesh.patches if p.name in parts or is_near(p.nodes))


def diagonal(points: FloatArray) -> float:
    """Return the length of the extents of points (N, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def qualities(affected: AffectedCells, states: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """Return the quality (S, M) of the affected cells with their nodes at each of S states (N, 3), by type."""
    parts: dict[str, list[FloatArray]] = {}
    for block, rows, sign in zip(affected.mesh.cells, affected.rows, affected.orientation, strict=True):
        if len(rows):
            values = np.array([quality_of(points, block, rows, sign) for points in states])
            for shape, _, _, at in parts_of(block, rows):
                parts.setdefault(shape, []).append(values[:, at])
    return {shape: np.concatenate(blocks, axis=1) for shape, blocks in parts.items()}


def measure_in_words(boxes: Sequence[Box]) -> str:
    """Return the meaning of the colours of cells that touch boxes."""
    shapes: dict[str, set[str]] = {}
    for shape, _ in (pair for box in boxes for pair in box.affected.by_shape()):
        shapes.setdefault(MEASURES[shape], set()).add(shape)
    alone = len(shapes) == 1
    texts = [
        measure if alone else f"{measure} ({', '.join(sorted(names))})" for measure, names in sorted(shapes.items())
    ]
    return "; ".join(texts) or "quality"


def read_json(folder: Path) -> Json:
    """Return the content of metrics.json; InputError if it is missing or damaged."""
    path = folder / "metrics.json"
    with damaged(path, "table of figures"):
        figures = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(figures, dict):
            raise InputError("its figures have no names")
        return figures


def read_courses(folder: Path) -> dict[str, list[Convergence]]:
    """Return the adaptations in convergence.csv by surface; InputError if the file is missing or damaged."""
    path, courses = folder / "convergence.csv", {}  # type: tuple[Path, dict[str, list[Convergence]]]
    with damaged(path, "history of a run"), path.open(newline="", encoding="utf-8") as file:
        for key, group in groupby(
            csv.DictReader(file, strict=True), lambda r: (text_of(r["surface"]), int(r["step"]), r["direction"])
        ):
            rows, name = list(group), ", ".join(map(str, key))
            if [int(row["iteration"]) for row in rows] != list(range(len(rows))):
                raise InputError(f"the iterations of {name} do not count up")
            centres, errors = zip(*((int(row["centres"]), float(row["max_error"])) for row in rows), strict=True)
            if list(centres) != sorted(centres) or not np.isfinite(errors).all():
                raise InputError(f"the centres of {name} become fewer, or an error is no number")
            courses.setdefault(key[0], []).append(Convergence(*key, centres, errors))
        if not courses:
            raise InputError("there are no iterations")
    return courses


def read_figures(folder: Path) -> tuple[Json, tuple[Check, ...], list[FitRows]]:
    """Read metrics.json, its checks, and for each deflection convergence.csv and interpolant.npz.

    Raises InputError if a file is missing or damaged.
    """
    figures, courses, stored = read_json(folder), read_courses(folder), read_arrays(folder / "interpolant.npz")
    with damaged(folder, RUN):
        tags = [f"_{name}" if i else "" for i, name in enumerate(courses)]
        courses_and_tags = zip(courses.values(), tags, strict=True)
        first = [
            {d: stored[f"centers_{d}{tag}"].astype(np.float64) for d in _directions(own)}
            for own, tag in courses_and_tags
        ]
        if any(
            centres.ndim != 2 or centres.shape[1] != 3 or not np.isfinite(centres).all()
            for own in first
            for centres in own.values()
        ):
            raise ValueError("centres in interpolant.npz are no points")
        fits = [
            FitRows(tuple(course), by_direction) for course, by_direction in zip(courses.values(), first, strict=True)
        ]
        return figures, tuple(_check(row) for row in figures["validation"]["checks"]), fits


def stored_checks(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Return the checks of the fits, marked as stored, because only the run could make them."""
    errors = (check for check in checks if check.name.startswith("site_error"))
    return tuple(replace(check, where=f"{check.where}; measured by the run") for check in errors)


def _check(row: Json) -> Check:
    values: Json = {item.name: row[item.name] for item in fields(Check) if item.name in row}
    if row["verdict"] == "poor":  # runs of earlier versions have no other reservation, and do not write it
        values.setdefault("reservation", "poor cells")
    return Check(**values | {"value": nan if row["value"] is None else row["value"]})


def rows_of(settings: Mapping[str, Any], usual: Mapping[str, Any]) -> Rows:
    """Return settings as rows of a table, beside the `usual` ones; without units and meanings."""
    return [
        SettingRow(name, as_text(value), "", "", name not in usual or usual[name] != value)
        for name, value in settings.items()
    ]


def as_text(value: Any) -> str:
    """Return the value of a setting as text; of a long list only the beginning."""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {item}" for name, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(as_text, value[:9])) + (", ..." if len(value) > 9 else "") or "none"
    if is_dataclass(value):
        return " ".join(as_text(getattr(value, item.name)) for item in fields(value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _directions(courses: Sequence[Convergence]) -> list[str]:
    """Return the directions in which a box was fitted: a plane mesh has no z."""
    return sorted({direction for course in courses for direction in course.directions})

"""Additions to the report of an SDM case: settings in words, and a map of the distance from the CAD."""

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.numbers import apart
from sdm_deflect.base.schema import Range, Setting, settings_in
from sdm_deflect.cases.report import colours
from sdm_deflect.cases.report.data import (
    METRES,
    Box,
    FitRows,
    MovedSurface,
    ReportData,
    Rows,
    SettingRow,
    as_text,
    before_repair,
)
from sdm_deflect.cases.report.pictures import Exhibit, save_figure
from sdm_deflect.cases.report.slices import triangles_of
from sdm_deflect.cases.run.metrics import amounts
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.generate.parameters import FAR_FIELD

from .case import Case
from .job import BLOCK
from .metrics import case_toml
from .registry import CASES, case_named

MAP = colours.DISPLACEMENT
# Smallest drawn distance (m), and least ratio of the largest one to it on the colour scale.
LEAST, TOP = 1e-17, 1e2
# Distances (m) are shown in mm if the largest is above this.
SEEN = 1e-6
# Distances (m) below this are rounding; a surface with no larger ones gets no map.
ROUNDING = 1e-12
# The checks whose distances each map shows.
COMPARED = {"cad_map": ("surface_to_cad", "root_on_cylinder"), "rigid_cad_map": ("surface_to_rigid_cad",)}
# Settings of a case that a report shows first, with those that differ.
SAID = ("name", "angle", "scale", "strategy")
DEFLECTED, RIGID = "the deflected CAD, built again", "its CAD faces turned rigidly"


def report_data_of(case: Case, deflection: Deflection) -> ReportData:
    """Return the content of a case's report, without the verdict."""
    return case_data(
        case,
        deflection.plan,
        deflection.points,
        [FitRows.of(box) for box in deflection.boxes],
        deflection.moved_by_repair,
    )


def case_data(
    case: Case, plan: Plan, points: FloatArray, fits: Sequence[FitRows], repair: FloatArray | None
) -> ReportData:
    """Return the report's content for a mesh at points (N, 3), which a repair moved by (N, 3), or None."""
    mesh = plan.mesh
    return ReportData(
        title=f"{case.title[:1].upper()}{case.title[1:]}, {case.angle:+g}\N{DEGREE SIGN} ({case.way})",
        subject=case.name,
        facts=(
            ("case", case.name),
            ("scale, strategy", f"{case.scale}, {case.strategy.upper()}"),
            *amounts(plan, plan.pose),
        ),
        mesh=mesh,
        points=points,
        boxes=tuple(_box(*pair) for pair in zip(plan.boxes, fits, strict=True)),
        length=METRES,
        settings=case_toml(case, plan),
        settings_file="case.toml",
        repeat="sdm run --config case.toml",
        moves="sdm apply plan.npz --angle=AMOUNTS undeflected.vtu",
        tables=parameter_tables(case),
        middle=np.zeros(3),
        drawn=tuple(name for name in mesh.names if name not in (FAR_FIELD, BLOCK)),
        hidden=tuple(name for name in mesh.names if name == BLOCK),
        quality_limit=case.limits.quality_min,
        interpolated=before_repair(points, repair),
    )


def _box(plan: BoxPlan, fits: FitRows) -> Box:
    """Return the box of the control surface, the first patch that moves; a tail's panel follows it."""
    box, nodes = Box.of(plan, plan.job.amounts, plan.surface, fits), plan.mesh.patch(plan.surface).nodes
    moved = replace(box.surfaces[0], name=plan.surface, patches=(plan.surface,), nodes=nodes)
    return replace(box, surfaces=(moved,))


def draw_distances(data: ReportData, folder: Path) -> list[Exhibit]:
    """Draw the distances from the CAD that the validation found into `folder`."""
    return [
        save_figure(folder, part, surface.name, *map_drawn)
        for surface in data.surfaces
        for part in COMPARED
        for map_drawn in cad_map(data, surface, part)
    ]


def cad_distances(data: ReportData, surface: str, checks: Sequence[str]) -> tuple[FloatArray, float]:
    """Return the distance (N,) of each node from the CAD by some checks, nan without one, and the checks' limit."""
    distance, limit = np.full(len(data.mesh.points), np.nan), np.nan
    for check in data.checks:
        name, _, of = check.name.partition(":")
        if name in checks and of in ("", surface) and check.nodes is not None and check.distances is not None:
            distance[check.nodes] = np.fmax(distance[check.nodes], check.distances)
            limit = check.limit if name == checks[0] else limit
    return distance, limit


def cad_map(data: ReportData, surface: MovedSurface, part: str) -> Iterator[tuple[Figure, str]]:
    """Draw the map of a surface's measured distances; return it with a description."""
    checks = COMPARED[part]
    what = DEFLECTED if part == "cad_map" else RIGID
    distance, limit = cad_distances(data, surface.name, checks)
    known = distance[~np.isnan(distance)]
    if not len(known) or known.max() < ROUNDING:
        return
    triangles = triangles_of(data.mesh.patch(surface.name).faces)
    seen, up, sides = views(data.points, triangles)
    largest, median = float(known.max()), float(np.median(known))
    factor = METRES.factor if largest > SEEN else 1.0
    top, is_even = factor * largest, largest > limit / TOP
    norm = Normalize(0.0, top) if is_even else LogNorm(LEAST, max(TOP * LEAST, top))
    flat = 1e3 * data.points[:, seen]
    width, height = np.ptp(flat[np.unique(triangles)], axis=0)
    rows = 2 if width > 1.5 * height else 1
    figure = Figure(figsize=(9.6, 2.2 + 9.0 * height / width) if rows == 2 else (9.6, 4.8), layout="constrained")
    axes = figure.subplots(rows, 3 - rows, sharex=True, sharey=True, squeeze=False).ravel()
    for panel, side, name in zip(axes, (up, ~up), sides, strict=True):
        _side(panel, flat, triangles[side], factor * np.maximum(distance, LEAST), norm)
        panel.set(ylabel=f"{'xyz'[seen[1]]}, mm", aspect="equal")
        panel.set_title(f"{surface.name}, {name}", fontsize="medium")
    for panel in axes[rows - 1 :]:
        panel.set_xlabel(f"{'xyz'[seen[0]]}, mm")
    unit = METRES.shown if factor > 1.0 else METRES.name
    shown, allowed = apart(factor * largest, factor * limit)
    figure.colorbar(ScalarMappable(norm, MAP), ax=list(axes), label=f"distance, {unit}")
    yield (
        figure,
        (
            f"Distance of {len(known)} moved nodes of {surface.name} from {what}, on both sides: largest {shown} "
            f"{unit}, limit {allowed} {unit}; median {factor * median:.2g} {unit}."
        ),
    )


def views(points: FloatArray, triangles: IntArray) -> tuple[list[int], BoolArray, tuple[str, str]]:
    """Return the axes to draw, longer first; which inward triangles (F,) face the first viewer; names of the sides."""
    corners = points[triangles]
    normal = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = int(np.abs(normal).sum(axis=0).argmax())
    names = {0: ("rear side", "front side"), 1: ("starboard side", "port side"), 2: ("upper side", "lower side")}
    across = sorted((i for i in range(3) if i != axis), key=lambda i: -np.ptp(corners[..., i]))
    return across, normal[:, axis] > 0.0, names[axis]


def _side(axes: Axes, flat: FloatArray, triangles: IntArray, distance: FloatArray, norm: Normalize) -> None:
    """Draw triangles (F, 3) with nodes at `flat` (N, 2), coloured by distances (N,)."""
    nodes, triangles = np.unique(triangles, return_inverse=True)
    (x, y), known = flat[nodes].T, distance[nodes]
    shown = Triangulation(x, y, triangles.reshape(-1, 3))
    axes.tripcolor(shown, known, norm=norm, cmap=MAP, shading="gouraud")
    axes.scatter(x, y, c=known, norm=norm, cmap=MAP, s=6, edgecolors="0.15", linewidths=0.4)
    axes.triplot(shown, color="0.35", lw=0.3)


def parameter_tables(case: Case) -> dict[str, Rows]:
    """Return every parameter of a case with unit and meaning, by table as in case.toml.

    Usual are those of the registered case; the name and the angle of a case count as its own.
    """
    tables: dict[str, Rows] = {"case": []}
    usual = case_named(case.name, case.scale) if case.name in CASES else case
    for name, setting in settings_in(Case).items():
        value, other = setting.of(case), setting.of(usual)
        if is_dataclass(value):
            tables[name] = [_row(value, other, described) for described in settings_in(type(value)).values()]
        else:
            tables["case"].append(_row(case, usual, setting))
    return tables


def _row(table: Any, usual: Any, setting: Setting) -> SettingRow:
    within, value = setting.note(Range), setting.of(table)
    differs = setting.name in SAID or value != setting.of(usual)
    return SettingRow(setting.name, as_text(value), within.unit if within else "", setting.doc.text, differs)

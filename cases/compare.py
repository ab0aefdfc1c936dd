"""Comparison of finished runs: differences of figures and settings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose, isfinite
from pathlib import Path
from tomllib import loads
from typing import Any

import numpy as np

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.unpacking import damaged
from sdm_deflect.cases.report.data import RUN, ReportData, as_text
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.deform.checks import tally, verdict
from sdm_deflect.meshing.mesh.mesh import Mesh

from .finished import read_run

# Numbers of runs that are compared.
FEWEST, MOST = 2, 8
Value = float | int | str | None
# Numbers that differ by no more than this share are the same.
SAME = 1e-9
# Least ratio that is shown as a factor; smaller changes are percentages.
FACTOR = 2.0
# Smallest change that is shown as a percentage.
LEAST = 5e-4
# Letters of a text that is shown.
LONGEST = 60
DIRECTIONS = "xyz"


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """A finished run.

    Attributes
    ----------
    name : the name of its folder, or the path if several folders have that name.
    data : content of its report, with the checks that the run made.
    """

    name: str
    folder: Path
    data: ReportData = field(repr=False)


def read_runs(folders: Sequence[Path], progress: Progress = silent) -> tuple[ComparedRun, ...]:
    """Read the folders of `sdm run` or `sdm deflect`.

    Raises InputError or MeshFileError for too few or too many folders, one given twice, or one without a run.
    """
    if not FEWEST <= len(folders) <= MOST:
        raise InputError(f"{len(folders)} runs cannot be compared: give {FEWEST} to {MOST} folders of finished runs")
    places = [folder.resolve() for folder in folders]
    for folder, place in zip(folders, places, strict=True):
        if places.count(place) > 1:
            raise InputError(f"{folder} is given twice: name each run once")
    names = [place.name for place in places]
    alone = len(set(names)) == len(names)
    compared = []
    for i, (folder, name) in enumerate(zip(folders, names, strict=True)):
        progress(str(folder), i / len(folders))
        data = read_run(folder).report_data()
        with damaged(folder, RUN):
            sum(check.passed and len(check.name) for check in data.checks)  # InputError for a check of another kind
        compared.append(ComparedRun(name if alone else str(folder), folder, data))
    return tuple(compared)


def comparison(runs: Sequence[ComparedRun]) -> dict[str, Any]:
    """Return the content of the tables for JSON."""
    return {
        "runs": [
            {"name": run.name, "folder": run.folder, "title": run.data.title, "passed": run.data.passed} for run in runs
        ],
        "same_mesh": all(_same_mesh(run.data.mesh, runs[0].data.mesh) for run in runs),
        "tables": {
            table.title: [
                {"name": row.name, "unit": row.unit, "values": row.values, "same": row.same} for row in table.rows
            ]
            for table in tables(runs)
        },
        "settings": {row.name: row.values for row in differing_settings(runs)},
    }


def _same_mesh(first: Mesh, second: Mesh) -> bool:
    return (
        first.names == second.names
        and first.cell_counts == second.cell_counts
        and np.array_equal(first.points, second.points)
    )


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of every run.

    Attributes
    ----------
    name, unit : name and unit of the figure.
    values : value of each run; None if a run has none.
    form : format of numbers.
    """

    name: str
    values: tuple[Value, ...]
    unit: str = ""
    form: str = ","

    @property
    def same(self) -> bool:
        """True if all runs have the same."""
        return all(_alike(self.values[0], value) for value in self.values[1:])

    @property
    def label(self) -> str:
        """The name, with the unit in brackets."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def texts(self) -> tuple[str, ...]:
        """The values as text; all but the first with their difference from it."""
        return tuple(_written(value, self.form) + _change(self.values[0], value) for value in self.values)


@dataclass(frozen=True, slots=True)
class FigureTable:
    """Rows that belong together."""

    title: str
    rows: tuple[Row, ...]


def tables(runs: Sequence[ComparedRun]) -> tuple[FigureTable, ...]:
    """Return the figures of runs in tables; tables without any value are left out."""
    every = [FigureTable("What was run", tuple(_subject(runs)))]
    for title, blocks in _deflections(runs):
        place = f": {title}" if title else ""
        units = {run.data.length.name for run in runs}
        unit = units.pop() if len(units) == 1 else "each its unit"
        every += [
            FigureTable(f"Interpolation{place}", tuple(_interpolation(blocks, unit))),
            FigureTable(f"Mesh{place}", tuple(_mesh(blocks))),
        ]
    every += [FigureTable("Verdict", tuple(_verdict(runs))), FigureTable("Time", tuple(_time(runs)))]
    kept = [FigureTable(table.title, tuple(row for row in table.rows if set(row.values) != {None})) for table in every]
    return tuple(table for table in kept if table.rows)


def rows_by_table(runs: Sequence[ComparedRun], whole: bool) -> dict[str, list[tuple[str, ...]]]:
    """Return, by table, rows of a name and texts that differ between runs; with `whole` also equal ones."""
    every = (*tables(runs), FigureTable("Settings that differ", differing_settings(runs)))
    return {table.title: [(row.label, *row.texts) for row in table.rows if whole or not row.same] for table in every}


def differing_settings(runs: Sequence[ComparedRun]) -> tuple[Row, ...]:
    """Return the settings that differ between runs, by their names in the settings file."""
    settings = [dict(_flat(loads(run.data.settings))) for run in runs]
    names = dict.fromkeys(name for values in settings for name in values)
    rows = [Row(name, tuple(values.get(name) for values in settings), form="g") for name in names]
    return tuple(row for row in rows if not row.same)


def _subject(runs: Sequence[ComparedRun]) -> Iterator[Row]:
    data = [run.data for run in runs]
    yield Row("mesh", tuple(report.mesh.name for report in data))
    yield Row("moves", tuple("; ".join(f"{s.name} {s.amount_text}" for s in report.surfaces) for report in data))
    for name in ("points", "cells"):
        yield Row(name, _of([report.figures for report in data], "mesh", name))
    for name in ("scale", "strategy", "version"):
        yield Row(name, _of([report.figures for report in data], name))


def _interpolation(blocks: Sequence[Json], unit: str) -> Iterator[Row]:
    for name in ("name", "radius", "polynomial"):
        label, of_unit = (
            ("kernel", "") if name == "name" else (f"kernel {name}", unit) if name == "radius" else (name, "")
        )
        yield Row(label, _of(blocks, "kernel", name), of_unit, ".4g")
    for name in ("surface", "fixed", "sliding"):
        yield Row(f"data sites, {name}", _of(blocks, "sites", name))
    yield Row("data sites, box", _of(blocks, "sites", "hexahedron", "x"))
    yield Row("tolerance", _of(blocks, "sites", "tolerance"), unit, ".3g")
    for direction in DIRECTIONS:
        yield Row(f"centres, {direction}", _of(blocks, "adaptation", direction, "centers"))
    yield Row("condition", _largest(blocks, "condition"), "", ".1e")
    yield Row("error at the sites", _largest(blocks, "max_error"), unit, ".2e")
    yield Row("error between the sites, largest", _of(blocks, "error_between_sites", "max"), unit, ".2e")
    yield Row("error between the sites, 99 %", _of(blocks, "error_between_sites", "p99"), unit, ".2e")
    yield Row("steps", _of(blocks, "steps"))


def _mesh(blocks: Sequence[Json]) -> Iterator[Row]:
    yield Row("nodes in the box", _of(blocks, "confinement", "inside"))
    yield Row("cells affected", _of(blocks, "cells_touched"))
    states = [_at(block, "quality_inside", "after") for block in blocks]
    shapes = dict.fromkeys(shape for state in states if isinstance(state, Mapping) for shape in state)
    for shape in shapes:
        for state, words in (("before", "undeflected"), ("after", "deflected")):
            yield Row(f"{shape}: least quality, {words}", _of(blocks, "quality_inside", state, shape, "min"), "", ".3f")
        yield Row(f"{shape}: mean quality, deflected", _of(blocks, "quality_inside", "after", shape, "mean"), "", ".4f")
        yield Row(f"{shape}: inverted", _of(blocks, "quality_inside", "after", shape, "inverted"))
    yield Row("cells spoiled before the repair", _of(blocks, "repair", "spoiled"))
    yield Row("nodes moved by the repair", _of(blocks, "repair", "moved"))


def _verdict(runs: Sequence[ComparedRun]) -> Iterator[Row]:
    checks = [run.data.checks for run in runs]
    yield Row("verdict", tuple(map(verdict, checks)))
    yield Row("checks passed", tuple(map(tally, checks)))
    yield Row(
        "failed", tuple(", ".join(check.name for check in of_run if not check.passed) or "none" for of_run in checks)
    )


def _time(runs: Sequence[ComparedRun]) -> Iterator[Row]:
    figures = [run.data.figures for run in runs]
    deformation = [
        sum(block["seconds"] for block in _blocks(figure).values() if _is_number(block.get("seconds")))
        for figure in figures
    ]
    yield Row("deflection", tuple(deformation), "s", ".2f")
    yield Row("all stages", _of(figures, "total_seconds"), "s", ".1f")


def _deflections(runs: Sequence[ComparedRun]) -> Iterator[tuple[str, list[Json]]]:
    """Yield the figures of each deflection by run, empty if a run has none of that name; a single one has no name."""
    by_run = [_blocks(run.data.figures) for run in runs]
    if all(len(blocks) == 1 for blocks in by_run):
        yield "", [next(iter(blocks.values())) for blocks in by_run]
        return
    for name in dict.fromkeys(name for blocks in by_run for name in blocks):
        yield name, [blocks.get(name, {}) for blocks in by_run]


def _blocks(figures: Json) -> dict[str, Json]:
    deflections = figures.get("deflections")
    return {k: v for k, v in deflections.items() if isinstance(v, dict)} if isinstance(deflections, Mapping) else {}


def _of(figures: Sequence[Json], *path: str) -> tuple[Value, ...]:
    """Return the entry at a place in each run's figures; None without one."""
    return tuple(
        value if _is_number(value := _at(figure, *path)) or isinstance(value, str) else None for figure in figures
    )


def _largest(blocks: Sequence[Json], name: str) -> tuple[Value, ...]:
    """Return the largest of a figure over the directions of each run."""
    by_run = [
        [value for value in (_at(block, "adaptation", d, name) for d in DIRECTIONS) if _is_number(value)]
        for block in blocks
    ]
    return tuple(max(values, default=None) for values in by_run)


def _at(figures: Any, *path: str) -> Any:
    for name in path:
        figures = figures.get(name) if isinstance(figures, Mapping) else None
    return figures


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _flat(table: Any, name: str = "") -> Iterator[tuple[str, Value]]:
    """Yield the settings of nested tables by their names with dots."""
    if isinstance(table, Mapping):
        for key, value in table.items():
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    elif isinstance(table, list) and table and all(isinstance(entry, Mapping) for entry in table):
        for i, entry in enumerate(table):
            yield from _flat(entry, f"{name}[{i}]")
    else:
        yield name, table if _is_number(table) else as_text(table)


def _alike(first: Value, second: Value) -> bool:
    if isinstance(first, int | float) and isinstance(second, int | float):
        return isclose(first, second, rel_tol=SAME)
    return first == second


def _written(value: Value, form: str) -> str:
    if isinstance(value, int | float):
        return format(value, form if isinstance(value, float) or form != "g" else ",")
    if value is None:
        return "\N{EN DASH}"
    return value if len(value) <= LONGEST else f"{value[:LONGEST]}..."


def _change(first: Value, value: Value) -> str:
    """Return the difference of a number from the first, in brackets; empty without one."""
    if not isinstance(value, int | float) or not isinstance(first, int | float) or _alike(first, value):
        return ""
    if first * value <= 0.0:
        return f" ({value - first:+.3g})"
    ratio = value / first
    if not 1.0 / FACTOR < ratio < FACTOR:
        return f" (\N{MULTIPLICATION SIGN} {ratio:.3g})"
    return f" ({100.0 * (ratio - 1.0):+.2g} %)" if abs(ratio - 1.0) >= LEAST else " (by less than 0.05 %)"

"""Why the paper needs more centres than we do: one thing varied at a time, and how many centres it then takes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import ON_LINE, distance_to_line, panel_of
from sdm_deflect.cases.aircraft.pipeline import meshed
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IndexArray
from sdm_deflect.deform.base.threads import Progress
from sdm_deflect.deform.mesh.edges import edges_of, polygons_of
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.rbf.fitting import Polynomial
from sdm_deflect.deform.rbf.greedy import GreedyOptions, Worst, adapt
from sdm_deflect.deform.rbf.interpolant import direct
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.problem import DataSites
from sdm_deflect.deform.volume.step import initial_centers
from sdm_deflect.geometry import datum
from sdm_deflect.geometry.parameters import Fighter
from studies.loop import Ended, Gmres, adapted
from studies.measure import SiteGroups, scaled, sites_of
from studies.paper import Row, Table, paper
from studies.trials import GMRES, NOTHING, TOLERANCE, Trial

TABLES = ("table1", "table3", "table4")
FACTORS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""The tolerance is divided by them: as good as a model that is so many times larger, with all its displacements."""
SMALLER = 4.0
"""The factor with which GMRES is looked into: with about this one f_x and f_z of the ailerons are the paper's."""
ACCURACIES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
"""Residuals at which GMRES stops, relative to the right-hand side."""
FEW = (60, 100, 125, 150)
"""Iterations after which GMRES stops in any case."""
PATIENCE = 2
"""With GMRES an adaptation ends after so many times the paper's iterations."""
POLYNOMIALS: tuple[Polynomial, ...] = ("constant", "none")
UNITS = {"millimetres": 1e-3, "feet": 0.3048}
ROUGHNESS = (5e-5, 1e-4, 2e-4)
"""Metres by which each node of the fuselage panel is displaced at random, beside what it should be."""
SEED = 1


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Data sites of a case by direction, those of the surface first; `surface` is their number."""

    groups: dict[str, DataSites]
    surface: int

    @classmethod
    def of(cls, sites: SiteGroups) -> "Model":
        """Take the sites of a deflection."""
        return cls(sites.groups, len(sites.plan.sites.moving))

    def only(self, keep: BoolArray) -> "Model":
        """Return the model without the surface sites where keep (surface,) is False."""
        mask = {d: np.append(keep, np.ones(len(one) - self.surface, np.bool_)) for d, one in self.groups.items()}
        groups = {
            d: DataSites(one.points[mask[d]], one.values[mask[d]], one.components) for d, one in self.groups.items()
        }
        return Model(groups, int(keep.sum()))

    def displaced(self, change: Callable[[FloatArray, int], FloatArray]) -> "Model":
        """Return the model whose surface sites have the displacements change(values (surface,), direction)."""
        groups = {}
        for d in "xyz":
            one, values = self.groups[d], self.groups[d].values.copy()
            values[: self.surface, 0] = change(values[: self.surface, 0], "xyz".index(d))
            groups[d] = DataSites(one.points, values, one.components)
        return Model(groups, self.surface)

    def in_unit(self, metres: float) -> "Model":
        """Return the model with all lengths, displacements too, in another unit."""
        groups = {
            d: DataSites(one.points / metres, one.values / metres, one.components) for d, one in self.groups.items()
        }
        return Model(groups, self.surface)

    def with_midpoints(self, pairs: IndexArray) -> "Model":
        """Return the model with sites in the middle of edges (E, 2) of the surface, which move as the mean of ends."""
        groups = {}
        for d, one in self.groups.items():
            points = np.vstack([one.points[pairs].mean(axis=1), one.points])
            groups[d] = DataSites(points, np.vstack([one.values[pairs].mean(axis=1), one.values]), one.components)
        return Model(groups, self.surface + len(pairs))


@dataclass(frozen=True, slots=True)
class Demand:
    """A row of the paper to be repeated."""

    name: str
    table: Table
    row: Row

    def options(self, factor: float = 1.0, polynomial: Polynomial = "linear", unit: float = 1.0) -> GreedyOptions:
        """Return the paper's options with a tolerance divided by `factor`."""
        tolerance, limit = self.table.tolerance / factor / unit, self.table.max_centers
        add = self.row.setting.n_add
        return GreedyOptions(n_add=add, tol_add=tolerance, tol_stop=tolerance, max_centers=limit, polynomial=polynomial)

    def trial(self, change: str, value: str, ended: Ended, factor: float = 1.0) -> Trial:
        """Note what came of it."""
        setting, figures = self.row.setting, (ended.centers, ended.iterations, ended.max_error, ended.stop.name)
        return Trial(change, value, self.name, setting.columns, setting.angle, factor, self.row.centers, *figures)

    def first(self, model: Model) -> IndexArray:
        """Return the initial centres."""
        return initial_centers(model.groups[self.row.setting.columns], model.surface, self.row.setting.initial)

    def exact(self, model: Model, options: GreedyOptions, first: IndexArray | None = None) -> Ended:
        """Adapt with exact solves, from the initial centres of the model or from others."""
        group, first = model.groups[self.row.setting.columns], self.first(model) if first is None else first
        fit = adapt(group, ThinPlateSpline(), first, options, rule=Worst())
        return Ended(len(fit.chosen), fit.history[-1].iteration, fit.max_error, fit.stop)

    def inexact(self, model: Model, factor: float, solve: Gmres) -> Ended:
        """Adapt with GMRES, in metres."""
        options = replace(self.options(factor), max_iterations=PATIENCE * self.row.iterations)
        return adapted(model.groups[self.row.setting.columns], self.first(model), options, solve)


def demands(table: str, angle: float, columns: str = "xyz") -> list[Demand]:
    """Return the paper's rows at an angle, SQUV, with the fewest initial centres."""
    theirs = paper().tables[table]
    fewest = min(row.setting.initial for row in theirs.rows)
    rows = [row for row in theirs.rows if row.setting.initial == fewest and row.setting.angle == angle]
    return [
        Demand(table, theirs, row) for row in rows if len(row.setting.columns) == 1 and row.setting.columns in columns
    ]


def by_tolerance(models: dict[tuple[str, float], Model]) -> Iterator[Trial]:
    """Divide the tolerance."""
    for (table, angle), model in models.items():
        for one in demands(table, angle):
            for factor in FACTORS:
                yield one.trial(TOLERANCE, f"/ {factor:g}", one.exact(model, one.options(factor)), factor)


def by_solver(models: dict[tuple[str, float], Model]) -> Iterator[Trial]:
    """Stop GMRES early: f_z at some residuals, all directions after some iterations."""
    for (table, angle), model in models.items():
        for one in demands(table, angle, "z"):
            for factor in (1.0, SMALLER):
                for rtol in ACCURACIES:
                    yield one.trial(GMRES, f"{rtol:g}", one.inexact(model, factor, Gmres(rtol)), factor)
        for one in demands(table, angle):
            for most in FEW:
                ended = one.inexact(model, SMALLER, Gmres(ACCURACIES[-1], most))
                yield one.trial(GMRES, f"{most} iterations", ended, SMALLER)


def by_change(case: Case, table: str, mesh: Mesh) -> Iterator[Trial]:
    """Change the sites, or what they do, one thing at a time."""
    for change, value, model in variations(case, mesh):
        for one in demands(table, case.angle):
            yield one.trial(change, value, one.exact(model, one.options()))
    model = Model.of(sites_of(case, mesh))
    for one in demands(table, case.angle):
        for name, metres in UNITS.items():
            ended = one.exact(model.in_unit(metres), one.options(unit=metres), one.first(model))
            yield one.trial("unit of length", name, replace(ended, max_error=ended.max_error * metres))
        if table == "table1":
            for polynomial in POLYNOMIALS:
                group, options = model.groups[one.row.setting.columns], one.options(polynomial=polynomial)
                yield one.trial("polynomial", polynomial, adapted(group, one.first(model), options, direct))


def variations(case: Case, mesh: Mesh) -> Iterator[tuple[str, str, Model]]:
    """Yield what is changed, to what, and the sites."""
    surface, sites = case.deflections[0].surface, sites_of(case, mesh)
    model = Model.of(sites)
    yield NOTHING, "", model
    for share in (0.7, 0.5):
        smaller = replace(case, confinement=scaled(case.confinement, share))
        yield "margins of the hexahedron", f"x {share:g}", Model.of(sites_of(smaller, mesh))
    for share in (2.0, 0.5):
        spacing = replace(case.adaptation, spacing_edges=share * case.adaptation.spacing_edges)
        changed = replace(case, adaptation=spacing)
        yield "distance of zero sites", f"x {share:g}", Model.of(sites_of(changed, mesh))
    yield "surface sites", "every second", model.only(np.arange(model.surface) % 2 == 0)
    yield "surface sites", "and middles of edges", model.with_midpoints(edges(sites, surface))
    yield "sites on the trailing edge", "left out", model.only(~on_trailing_edge(sites, case.fighter, surface))
    if datum.hinged(surface):
        for share in (0.5, 0.25):
            narrower = replace(case, blending=replace(case.blending, strip=share * case.blending.strip))
            yield "strip beside the rib", f"x {share:g}", Model.of(sites_of(narrower, mesh))
        return
    panel = np.isin(sites.plan.sites.moving, sites.plan.boundary.mesh.patch(panel_of(surface)).nodes)
    yield "fuselage panel", "no sites", model.only(~panel)
    yield "fuselage panel", "does not move", model.displaced(lambda values, _: np.where(panel, 0.0, values))
    for metres in ROUGHNESS:
        noise = np.random.default_rng(SEED).uniform(-metres, metres, (len(panel), 3)) * panel[:, None]
        rough = model.displaced(lambda values, d, noise=noise: values + noise[:, d])  # type: ignore[misc]
        yield "fuselage panel", f"rough by {1e3 * metres:g} mm", rough


def edges(sites: SiteGroups, surface: str) -> IndexArray:
    """Return the edges (E, 2) of the moving surface, as rows of its sites."""
    mesh, moving = sites.plan.boundary.mesh, sites.plan.sites.moving
    pairs = np.searchsorted(moving, edges_of(polygons_of(mesh.faces_of([surface])))[0])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def on_trailing_edge(sites: SiteGroups, fighter: Fighter, surface: str) -> BoolArray:
    """True for the surface sites (K,) on the trailing edge."""
    points = sites.plan.boundary.mesh.points[sites.plan.sites.moving]
    return np.asarray(distance_to_line(points, datum.trailing_edge(fighter, surface)) < ON_LINE)


def write_trials(scale: str, folder: Path, watch: Stopwatch, cache: bool = True) -> str:
    """Write centres.csv: all trials for the paper's tables 1, 3 and 4; table 2 has the sites of table 1."""
    tables = paper().tables
    cases = {n: replace(case_named(tables[n].case, scale), angle=tables[n].rows[0].setting.angle) for n in TABLES}
    meshes = {name: meshed(case, watch, cache)[0] for name, case in cases.items()}
    with watch.stage("centres") as progress:
        trials = measured(cases, meshes, progress)
    names = [one.name for one in fields(Trial)]
    write_table(folder / "centres.csv", [names, *([getattr(one, name) for name in names] for one in trials)])
    return f"{len(trials)} adaptations, each with one thing changed"


def measured(cases: dict[str, Case], meshes: dict[str, Mesh], progress: Progress) -> tuple[Trial, ...]:
    """Carry out all trials on the meshes of the paper's tables 1, 3 and 4."""
    models = {}
    for name, case in cases.items():
        for angle in dict.fromkeys(row.setting.angle for row in paper().tables[name].rows):
            models[name, angle] = Model.of(sites_of(replace(case, angle=angle), meshes[name]))
    kept = {key: model for key, model in models.items() if key != ("table3", -12.0)}
    changes = [by_change(cases[name], name, meshes[name]) for name in ("table1", "table4")]
    trials = []
    for one in (trial for part in (by_tolerance(models), *changes, by_solver(kept)) for trial in part):
        trials.append(one)
        progress(f"{one.table}, f_{one.columns}, {one.change} {one.value}", min(1.0, len(trials) / EXPECTED))
    return tuple(trials)


EXPECTED = 250
"""Trials, about."""

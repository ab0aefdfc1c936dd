"""Why the paper needs more centres than we do: one thing varied at a time, and how many centres it then takes."""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IndexArray
from sdm_deflect.base.files import replacing
from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import fuselage_cylinder, panel_of
from sdm_deflect.cases.aircraft.pipeline import mesh_of_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.output import write_table
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.confined import initial_centers
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.greedy import adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions, Worst
from sdm_deflect.geometry import datum
from sdm_deflect.meshing.mesh.axis import Cylinder
from sdm_deflect.meshing.mesh.edges import edges_of, polygons_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.loop import Choice, Ended, Gmres, adapted, worst, worst_free
from studies.measure import SiteGroups, scaled, sites_of, table_case, with_sites
from studies.paper import Row, Table, paper

TABLES = ("table1", "table3", "table4")
# The tolerance is divided by them: as good as a model that is so many times larger, with all its displacements.
FACTORS = (1.0, 2.0, 4.0, 8.0, 16.0)
# Iterations of GMRES between restarts and in all, of which the paper says nothing.
SOLVERS = ((20, 300), (30, 300), (50, 300), (30, 900))
# Relative residual at which it stops earlier.
ACCURACY = 1e-10
# With GMRES an adaptation ends after so many times the paper's iterations.
PATIENCE = 2
# Step (5) of section 4: as here, and as the paper writes it.
CHOICES: dict[str, Choice] = {"": worst_free, ", centres may come twice": worst}
# Margins of a smaller hexahedron, over those of the case.
SHARES = (0.7, 0.5, 0.35, 0.25)
# Metres by which each node of the fuselage panel is displaced at random, beside what it should be.
ROUGHNESS = (1e-4, 2e-4)
# Degrees of a facet, if the cylinder of the panel is a polygon: the projection then moves nodes by up to 0.21 mm.
FACET = 9.0
SEED = 1
# Names of changes.
NOTHING, TOLERANCE, GMRES = "nothing changed", "tolerance", "GMRES"


@dataclass(frozen=True, slots=True)
class Trial:
    """One adaptation of a row of the paper with one thing changed.

    Attributes
    ----------
    change, value : what is changed, and to what.
    table, row : the table of the paper and its row.
    work : the adaptation.
    """

    change: str
    value: str
    table: str
    row: Row
    work: Callable[[], Ended]

    @property
    def key(self) -> tuple[str, ...]:
        """What it is known by in a .csv."""
        setting = self.row.setting
        return (self.change, self.value, self.table, setting.columns, f"{setting.angle:g}")


# Columns of centres.csv: those of the key, the paper's number of centres, and what came of the trial.
HEADS = (
    "scale",
    "change",
    "value",
    "table",
    "columns",
    "angle_deg",
    "paper",
    "centers",
    "iterations",
    "max_error",
    "stop",
)


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Data sites of a case by direction, those of the surface first; `surface` is their number."""

    groups: dict[str, DataSites]
    surface: int

    @classmethod
    def of(cls, sites: SiteGroups) -> "Model":
        """Take the sites of a deflection."""
        return cls(sites.groups, len(sites.plan.sites.moving))

    def displaced(self, change: Callable[[FloatArray, int], FloatArray]) -> "Model":
        """Return the model whose surface sites have the displacements change(values (surface,), direction)."""
        groups = {}
        for d in "xyz":
            one, values = self.groups[d], self.groups[d].values.copy()
            values[: self.surface, 0] = change(values[: self.surface, 0], "xyz".index(d))
            groups[d] = DataSites(one.points, values, one.components)
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

    def options(self, factor: float = 1.0) -> GreedyOptions:
        """Return the paper's options with a tolerance divided by `factor`."""
        tolerance, limit = self.table.tolerance / factor, self.table.max_centers
        return GreedyOptions(n_add=self.row.setting.n_add, tol_add=tolerance, tol_stop=tolerance, max_centers=limit)

    def trial(self, change: str, value: str, work: Callable[[], Ended]) -> Trial:
        """Plan an adaptation of this row."""
        return Trial(change, value, self.name, self.row, work)

    def first(self, model: Model) -> IndexArray:
        """Return the initial centres."""
        return initial_centers(model.groups[self.row.setting.columns], model.surface, self.row.setting.initial)

    def exact(self, model: Model, options: GreedyOptions) -> Ended:
        """Adapt with exact solves."""
        group = model.groups[self.row.setting.columns]
        fit = adapt(group, ThinPlateSpline(), self.first(model), options, rule=Worst())
        return Ended(len(fit.chosen), fit.history[-1].iteration, fit.max_error, fit.stop)

    def inexact(self, model: Model, solve: Gmres, choice: Choice) -> Ended:
        """Adapt with GMRES."""
        options = replace(self.options(), max_iterations=PATIENCE * self.row.iterations)
        return adapted(model.groups[self.row.setting.columns], self.first(model), options, solve, choice)


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
                yield one.trial(TOLERANCE, f"/ {factor:g}", partial(one.exact, model, one.options(factor)))


def by_solver(table: str, angle: float, model: Model) -> Iterator[Trial]:
    """Restart GMRES and stop it early, and take step (5) as it is written."""
    for one in demands(table, angle):
        for restart, most in SOLVERS:
            for words, choice in CHOICES.items():
                work = partial(one.inexact, model, Gmres(ACCURACY, restart, most), choice)
                yield one.trial(GMRES, f"({restart}), {most} iterations{words}", work)


def by_change(case: Case, table: str, mesh: Mesh) -> Iterator[Trial]:
    """Change the sites, or what they do, one thing at a time."""
    for change, value, model in variations(case, mesh):
        for one in demands(table, case.angle):
            yield one.trial(change, value, partial(one.exact, model, one.options()))


def variations(case: Case, mesh: Mesh) -> Iterator[tuple[str, str, Model]]:
    """Yield what is changed, to what, and the sites."""
    surface, sites = case.deflections[0].surface, sites_of(case, mesh)
    model = Model.of(sites)
    yield NOTHING, "", model
    for share in SHARES:
        smaller = replace(case, confinement=scaled(case.confinement, share))
        yield "margins", f"x {share:g}, zero sites as far apart", Model.of(sites_of(smaller, mesh))
        yield (
            "margins",
            f"x {share:g}, the paper's number of zero sites",
            Model.of(sites_of(with_sites(smaller, mesh), mesh)),
        )
    for share in (2.0, 0.5):
        spacing = replace(case.adaptation, spacing_edges=share * case.adaptation.spacing_edges)
        yield "distance of zero sites", f"x {share:g}", Model.of(sites_of(replace(case, adaptation=spacing), mesh))
    yield "surface sites", "and middles of edges", model.with_midpoints(edges(sites, surface))
    if datum.hinged(surface):
        narrower = replace(case, blending=replace(case.blending, strip=0.25 * case.blending.strip))
        yield "strip beside the rib", "x 0.25", Model.of(sites_of(narrower, mesh))
        return
    panel = np.isin(sites.plan.sites.moving, sites.plan.boundary.mesh.patch(panel_of(surface)).nodes)
    yield "fuselage panel", "does not move", model.displaced(lambda values, _: np.where(panel, 0.0, values))
    for metres in ROUGHNESS:
        noise = np.random.default_rng(SEED).uniform(-metres, metres, (len(panel), 3)) * panel[:, None]
        rough = model.displaced(lambda values, d, noise=noise: values + noise[:, d])  # type: ignore[misc]
        yield "fuselage panel", f"rough by {1e3 * metres:g} mm", rough
    outward = panel[:, None] * off_facets(model.groups["x"].points[: model.surface], fuselage_cylinder(case.fighter))
    yield "fuselage panel", f"of facets of {FACET:g} deg", model.displaced(lambda values, d: values + outward[:, d])


def off_facets(points: FloatArray, cylinder: Cylinder) -> FloatArray:
    """Return the way (N, 3) from facets, whose edges are on a cylinder, outward to the cylinder, at points on it."""
    radial = cylinder.axis.radial(points)
    angle = np.degrees(np.arctan2(radial[:, 2], radial[:, 1])) % FACET - 0.5 * FACET
    return np.asarray(radial * (1.0 - np.cos(np.radians(0.5 * FACET)) / np.cos(np.radians(angle)))[:, None])


def edges(sites: SiteGroups, surface: str) -> IndexArray:
    """Return the edges (E, 2) of the moving surface, as rows of its sites."""
    mesh, moving = sites.plan.boundary.mesh, sites.plan.sites.moving
    pairs = np.searchsorted(moving, edges_of(polygons_of(mesh.faces_of([surface])))[0])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def write_trials(scale: str, folder: Path, watch: Stopwatch, cache: bool = True) -> str:
    """Write centres.csv: trials for the paper's tables 1, 3 and 4; table 2 has the sites of table 1.

    Trials that the file holds already are not made again.
    """
    tables, path = paper().tables, folder / "centres.csv"
    cases = {n: replace(case_named(tables[n].case, scale), angle=tables[n].rows[0].setting.angle) for n in TABLES}
    meshes = {name: mesh_of_case(case, watch, cache)[0] for name, case in cases.items()}
    rows: list[list[object]] = [list(HEADS)]
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            rows = [list(row) for row in csv.reader(file)]
    folder.mkdir(parents=True, exist_ok=True)
    trials, done = list(planned(cases, meshes)), {tuple(row[:6]) for row in rows}
    with watch.stage("centres") as progress:
        for k, trial in enumerate(trials):
            progress(f"{trial.table}, f_{trial.row.setting.columns}, {trial.change} {trial.value}", k / len(trials))
            if (scale, *trial.key) not in done:
                ended = trial.work()
                figures = (
                    trial.row.centers,
                    ended.centers,
                    ended.iterations,
                    f"{ended.max_error:.6g}",
                    ended.stop.name,
                )
                rows.append([scale, *trial.key, *figures])
                with replacing(path) as scratch:
                    write_table(scratch, rows)
    return f"{len(trials)} adaptations, each with one thing changed"


def planned(cases: dict[str, Case], meshes: dict[str, Mesh]) -> Iterator[Trial]:
    """Yield all trials on the meshes of the paper's tables 1, 3 and 4; table 1 has its small hexahedron."""
    models = {}
    for name, case in cases.items():
        for angle in dict.fromkeys(row.setting.angle for row in paper().tables[name].rows):
            turned = table_case(name, replace(case, angle=angle), meshes[name])
            models[name, angle] = Model.of(sites_of(turned, meshes[name]))
    yield from by_tolerance(models)
    for name in ("table1", "table4"):
        yield from by_change(cases[name], name, meshes[name])
    tail = cases["table4"].angle
    yield from by_solver("table4", tail, models["table4", tail])

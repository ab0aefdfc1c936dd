"""Measurements that say why the paper's results and ours differ, and the figures that the reasons quote."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from statistics import median
from time import process_time

import numpy as np

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import panel_of, plan_of
from sdm_deflect.cases.aircraft.pipeline import meshed
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.run.progress import Show, Stopwatch
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.threads import SERIAL_PAIRS
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.interpolant import Interpolant
from sdm_deflect.deform.volume.deflection import deflected
from sdm_deflect.meshing.mesh import tets_of
from studies import centres
from studies.measure import GMRES, GROWN, REPETITIONS, Result, Task, sites_of
from studies.paper import Evaluation, Row, paper
from studies.stored import Calls, Page, Reasons, Spoiled
from studies.trends import among

TIMES = 20
"""Evaluations in a row that are timed as one: a single one is shorter than a clock is good for."""
TABLES = ("table1", "table3", "table4")
"""Those whose centres are looked into; table 2 has the sites of table 1."""


def measure_reasons(scale: str, show: Show, cache: bool = True) -> Reasons:
    """Carry out all measurements at a scale."""
    watch, tables = Stopwatch(show), paper().tables
    cases = {n: replace(case_named(tables[n].case, scale), angle=tables[n].rows[0].setting.angle) for n in TABLES}
    meshes = {name: meshed(case, watch, cache)[0] for name, case in cases.items()}
    with watch.stage("centres") as progress:
        trials = centres.measured(cases, meshes, progress)
    with watch.stage("cells of the tail"):
        spoiled = spoiled_cells(cases["table4"], meshes["table4"])
    with watch.stage("evaluation"):
        calls = calls_of(paper().evaluations[0], cases["table1"], meshes["table1"])
    return Reasons(scale, trials, spoiled, calls)


def spoiled_cells(case: Case, mesh: Mesh) -> Spoiled:
    """Deflect the tail with the paper's tolerance and an eighth of it, and see where cells are spoiled."""
    below = next(one.below for one in paper().quality if one.case == case.name)
    surface = case.deflections[0].surface
    panel = mesh.patch(panel_of(surface)).nodes
    root = np.intersect1d(mesh.patch(surface).nodes, panel)
    found = []
    for factor in (1.0, 8.0):
        adaptation = replace(case.adaptation, rule="worst", tolerance=case.adaptation.tolerance / factor)
        one = replace(case, repair="off", adaptation=adaptation)
        plan = plan_of(one, mesh)
        points = deflected(plan, plan.angle).points
        found.append(np.flatnonzero(mean_ratio(points, tets_of(mesh)) < below))
    cells = tets_of(mesh)[found[0]]
    middles, edge = mesh.points[cells].mean(axis=1), mesh.points[root[np.argmax(mesh.points[root, 0])]]
    away = np.linalg.norm(middles[:, None] - mesh.points[root], axis=2).min(axis=1)
    behind = middles[:, 0] > edge[0]
    on_panel = np.isin(cells, panel).any(axis=1)
    length = mesh.points[panel, 0].max() - edge[0]
    counts = (len(found[0]), len(found[1]), int(on_panel.sum()), int(behind.sum()))
    return Spoiled(*counts, float(away.max(initial=0.0)), float(length))


def calls_of(theirs: Evaluation, case: Case, mesh: Mesh) -> Calls:
    """Time the interpolant for f_x inside the hexahedron and on the whole mesh in turn, on one thread."""
    sites = sites_of(replace(case, angle=theirs.setting.angle), mesh)
    fit = Task.of(sites, theirs.setting, theirs, GROWN).run()
    inside = mesh.points[sites.plan.region.inside]
    evaluate = partial(_seconds, fit.interpolant)
    spent = [(evaluate(inside, TIMES), evaluate(mesh.points)) for _ in range(REPETITIONS)]
    seconds = (median(one for one, _ in spent), median(whole for _, whole in spent))
    return Calls((len(inside), len(mesh.points)), len(fit.chosen), seconds, SERIAL_PAIRS)


def _seconds(interpolant: Interpolant, points: FloatArray, times: int = 1) -> float:
    start = process_time()
    for _ in range(times):
        interpolant(points, threads=1)
    return (process_time() - start) / times


def figures_for(place: str, by: str, page: Page) -> dict[str, str]:
    """Return the figures that the reasons of a part of the page quote, for one loop where they depend on it."""
    assert page.reasons is not None
    if place in page.results:
        return FIGURES[place](page.results[place], by, page.reasons)
    if place == "figure7":
        one = page.reasons.spoiled
        names = ("count", "finer", "on_panel", "behind")
        return {name: str(getattr(one, name)) for name in names} | {"length_mm": f"{1e3 * one.length:.1f}"}
    calls = page.reasons.calls
    return {
        "pairs": f"{calls.points[0] * calls.centers:,}",
        "serial": f"{calls.serial:,}",
        "threads": str(page.stored.threads),
        "faster": f"{calls.seconds[1] / calls.seconds[0]:.0f}",
        "fewer": f"{calls.points[1] / calls.points[0]:.0f}",
    }


def _table1(result: Result, by: str, _reasons: Reasons) -> dict[str, str]:
    figures: dict[str, str] = {}
    for who, rows in (("here", result.by(GROWN)), ("paper", list(result.table.rows))):
        x, z = ([row.iterations for row in among(rows, d)] for d in "xz")
        figures |= {f"saved_{who}": f"{x[0] / max(x[-1], 1):.1f}", f"x_{who}": f"{x[0]}, then {x[-1]}"}
        figures[f"saved_z_{who}"] = f"{z[0] / max(z[-1], 1):.1f}"
    own, gmres = _by(result, by), result.by(GMRES)
    mv, alone = (sum(row.seconds for row in among(own, columns)) for columns in ("xyz", "z"))
    squv = sum(among(gmres, d)[0].seconds for d in "xyz")
    return figures | {"mv_over_z": f"{mv / alone:.2f}", "mv_gmres": f"{among(gmres, 'xyz')[0].seconds / squv:.1f}"}


def _table2(result: Result, by: str, _reasons: Reasons) -> dict[str, str]:
    figures = {"first_rise": _first_rise(_by(result, by))}
    for who, rows in (("here", result.by(GROWN)), ("paper", result.table.rows)):
        first, last = rows[0].centers, rows[-1].centers
        figures |= {f"grown_{who}": f"{last / first:.1f}", f"centers_{who}": f"{first} to {last}"}
    return figures


def _first_rise(rows: list[Row]) -> str:
    for a, b in pairwise(rows):
        if b.seconds > a.seconds:
            what = f"{100.0 * (b.seconds / a.seconds - 1.0):.0f} %, where {a.centers} centres become {b.centers}"
            return f"The time first rises at M_add = {b.setting.n_add}, by {what}."
    return "The time never rises."


def _table4(result: Result, _by: str, reasons: Reasons) -> dict[str, str]:
    counts = [row.centers for row in result.by(GROWN)]
    rough = [one for one in reasons.trials if one.value.startswith("rough") and one.columns == "z"][-1]
    theirs = among(result.table.rows, "z")[0]
    return {
        "tail_most": str(max(counts)),
        "tail_centers": ", ".join(map(str, counts)),
        "rough_mm": rough.value.split()[2],
        "rough_error": f"{rough.max_error:.2e}",
        "paper_error": f"{theirs.max_error:.2e}",
    }


FIGURES = {"table1": _table1, "table2": _table2, "table4": _table4}


def _by(result: Result, name: str) -> list[Row]:
    """Return the rows of a loop, by its name; those of the first where there is none."""
    return result.by(next((loop for loop in result.loops if loop.name == name), GROWN))

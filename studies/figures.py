"""What the page `docs/paper.md` quotes: tables and figures of the paper's section 5, and the numbers beside them."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from numba import get_num_threads
from scipy.spatial import cKDTree

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.files import hidden_folder, replacing
from sdm_deflect.base.threads import Stage
from sdm_deflect.cases.aircraft.case import Case, mesh_parameters
from sdm_deflect.cases.aircraft.job import panel_of
from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.cases.aircraft.pipeline import mesh_of_case, run_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.options import RepairMode
from sdm_deflect.deform.rbf.fitting import Strategy
from sdm_deflect.deform.surface.blended import BlendedLaw
from sdm_deflect.meshing.cache import cache_key
from sdm_deflect.meshing.mesh.labelled import tets_of, touching
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio, signed_volumes
from studies import pictures as aircraft
from studies.centres import write_trials
from studies.files import read_curves, read_rows, write_csv, write_curves, write_plot
from studies.machine import machine
from studies.measure import run_study, sites_of, timed
from studies.page import Numbers, blocks
from studies.paper import Counts, QualityStatement, paper
from studies.rendering import Picture, figure_of
from studies.trends import verdicts

FILE = "page.json"
# Share of the cells at the box that count as the worst: 1,740 of a mesh as large as the paper's, 18 of a small one.
WORST = 1e-3


@dataclass(frozen=True, slots=True)
class Sources:
    """Meshes and runs of one scale; runs write their files into `folder`."""

    scale: str
    folder: Path
    show: Stage
    cache: bool = True
    _runs: dict[tuple[str, float, Strategy], Run] = field(default_factory=dict)

    def mesh(self, name: str) -> Mesh:
        """Return the undeflected mesh of a case."""
        return mesh_of_case(case_named(name, self.scale), Stopwatch(self.show), self.cache)[0]

    def run(self, name: str, angle: float, strategy: Strategy = "squv") -> Run:
        """Return a finished run with the paper's rule of adding centres, unrepaired, validated like every run."""
        key = (name, angle, strategy)
        if key not in self._runs:
            self._runs[key] = self.repaired(name, angle, strategy, "off")
        return self._runs[key]

    def repaired(self, name: str, angle: float, strategy: Strategy, repair: RepairMode = "auto") -> Run:
        """Return the same with a repair; it is not kept for other sections."""
        case = case_named(name, self.scale)
        adaptation = replace(case.adaptation, rule="worst", strategy=strategy)
        case = replace(case, angle=angle, adaptation=adaptation, repair=repair)
        with TemporaryDirectory(dir=self.folder) as scratch:
            return run_case(case, Stopwatch(self.show), Path(scratch), self.cache, report=False)


# Measures a section into numbers, and writes its pictures and tables into a folder.
Measure = Callable[[Sources, Numbers, Path], None]


def write_page(scale: str, folder: Path, show: Stage, cache: bool = True) -> Numbers:
    """Write figures/ and tables/ into `folder`, with all other numbers in tables/page.json, and return these.

    Sections that the folder holds already are not measured again. Raises InputError if they are of other meshes.
    """
    for name in ("figures", "tables"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    numbers = _begun(scale, folder)
    with hidden_folder() as scratch:
        runs = Sources(scale, scratch, show, cache)
        for name, measure in SECTIONS.items():
            if name not in numbers["done"]:
                measure(runs, numbers, folder)
                numbers["done"].append(name)
                _keep(numbers, folder)
    numbers["trends"] = judged(folder / "tables", numbers)
    _keep(numbers, folder)
    (folder / "page.md").write_text("\n".join(blocks(folder / "tables", numbers)), encoding="utf-8")
    return numbers


def judged(tables: Path, numbers: Numbers) -> list[Numbers]:
    """Judge all that the paper says by the tables in a folder and the numbers of a page."""
    curves = read_curves(tables / "table1-curves.csv")
    return verdicts(lambda table, loop: read_rows(tables / f"{table}.csv", loop), curves, numbers)


def _begun(scale: str, folder: Path) -> Numbers:
    """Return the numbers that a folder holds of the meshes of a scale; empty ones at first."""
    cases = dict.fromkeys(table.case for table in paper().tables.values())
    meshes = {name: cache_key(mesh_parameters(case_named(name, scale))) for name in cases}
    if not (folder / "tables" / FILE).exists():
        numbers: Numbers = {"scale": scale, "meshes": meshes, "machine": machine(), "threads": get_num_threads()}
        lists: Numbers = {name: [] for name in ("counted", "counts", "sliding", "seen", "evaluations", "done")}
        return numbers | lists | {"sizes": {}, "worst": {}, "pictures": {}, "grounds": {}}
    numbers = json.loads((folder / "tables" / FILE).read_text(encoding="utf-8"))
    if numbers.get("meshes") != meshes:
        raise InputError(
            f"--out {folder}: its figures are of scale {numbers.get('scale')} or of other meshes than today's; "
            "give another folder, or delete this one"
        )
    return numbers


def _keep(numbers: Numbers, folder: Path) -> None:
    with replacing(folder / "tables" / FILE) as scratch:
        scratch.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")


def figure1(runs: Sources, numbers: Numbers, folder: Path) -> None:
    """The aircraft and the two blocks."""
    whole, block = runs.run("aileron", -12.0), runs.run("aileron-chimera", -12.0)
    for run in (whole, block):
        _sized(runs, numbers, run.case.name)
    _drawn(aircraft.blocks(whole, block), "figure1", numbers, folder)


def table(runs: Sources, numbers: Numbers, folder: Path, name: str) -> None:
    """A table of the paper."""
    result = run_study(name, runs.scale, Stopwatch(runs.show), runs.cache)
    write_csv(result, folder / "tables" / f"{name}.csv")
    write_curves(result, folder / "tables" / f"{name}-curves.csv")
    numbers["pictures"][name] = write_plot(result, folder / "figures" / f"{name}.png")
    numbers["grounds"][name] = asdict(result.ground)


Wanted = tuple[tuple[str, float, Strategy, str], ...]


def histograms(runs: Sources, numbers: Numbers, folder: Path, number: int, wanted: Wanted) -> None:
    """Histograms of some runs (case, angle, strategy, title), and the cells that the paper speaks of, repaired too."""
    found = [runs.run(name, angle, strategy) for name, angle, strategy, _ in wanted]
    for run in sorted(found, key=lambda run: run.case.adaptation.strategy, reverse=True):  # SQUV first
        repaired = runs.repaired(run.case.name, run.case.angle, run.case.strategy)
        theirs = [one for one in paper().quality if (one.figure, one.angle) == (number, run.case.angle)]
        numbers["counted"] += [counted(statement, one) for one in (run, repaired) for statement in theirs]
    figure, alternative = aircraft.histograms(found, [title for *_, title in wanted])
    _shown(figure, alternative, f"figure{number}", numbers, folder)


def counted(theirs: QualityStatement, run: Run) -> Numbers:
    """Count the cells below the paper's limit, before and after: of all, and near the box."""
    before, after = (mean_ratio(mesh.points, tets_of(mesh)) for mesh in (run.mesh, run.deflected))
    near = touching(run.mesh, run.deflection.boxes[0].plan.region.inside)
    sides = {"before": before, "after": after, "near_before": before[near], "near_after": after[near]}
    return {
        "statement": asdict(theirs), "strategy": run.case.strategy, "repair": run.case.repair, "cells": len(before),
        "near": int(near.sum()), "least": [float(before[near].min()), float(after[near].min())],
        **{name: int(np.sum(own < theirs.below)) for name, own in sides.items()},
    }  # fmt: skip


def figure5(runs: Sources, numbers: Numbers, folder: Path) -> None:
    """The gap at both angles; what sliding on the Chimera face gains, and where the worst cells are."""
    pair = [runs.run("aileron-chimera", angle) for angle in (-12.0, -30.0)]
    _checked(5, pair, ("outside_moved", "fixed_surfaces_moved", "planarity", "inverted_cells"), numbers)
    numbers["sliding"] = [sliding(run) for run in pair]
    numbers["worst"] = worst(pair[-1])
    _drawn(aircraft.gaps(pair), "figure5", numbers, folder)


def sliding(run: Run) -> Numbers:
    """Return least mean ratio, 1 % quantile and inverted cells of the box: before, with sliding, with pinned nodes."""
    before, after = run.deflection.plan.before[0], run.deflection.boxes[0].quality[0]
    sides = {"before": before, "sliding": after, "pinned": run.pinned}
    least = {side: {name: getattr(own, name) for name in ("min", "p01", "inverted")} for side, own in sides.items()}
    return {"angle": run.case.angle, **least}


def worst(run: Run) -> Numbers:
    """Return where the worst cells at the box are after a deflection: medians over `WORST` of them, in metres."""
    plan, mesh, tets = run.deflection.boxes[0].plan, run.deflected, tets_of(run.mesh)
    near = np.flatnonzero(touching(run.mesh, plan.region.inside))
    chosen = near[np.argsort(mean_ratio(mesh.points, tets[near]), kind="stable")[: round(WORST * len(near))]]
    middle, z = mesh.points[tets[chosen]].mean(axis=1), plan.hexahedron.corners[:, 2]
    surface = mesh.points[mesh.patch(plan.surface).nodes]
    volume = signed_volumes(mesh.points, tets[chosen]) / signed_volumes(run.mesh.points, tets[chosen])
    return {
        "angle": run.case.angle, "cells": len(chosen), "height": float(np.ptp(z)),
        "upper_half": float(np.mean(middle[:, 2] > 0.5 * (z.min() + z.max()))),
        "to_upper": float(np.median(z.max() - middle[:, 2])),
        "to_surface": float(np.median(cKDTree(surface).query(middle)[0])), "volume": float(np.median(volume)),
    }  # fmt: skip


def counts(runs: Sources, numbers: Numbers, _folder: Path) -> None:
    """Numbers of nodes of the surfaces, and how far the trailing edge goes."""
    for theirs in paper().counts:
        case = replace(case_named(theirs.case, runs.scale), angle=theirs.angle)
        numbers["counts"].append(asdict(counted_nodes(case, runs.mesh(theirs.case))))


def counted_nodes(case: Case, mesh: Mesh) -> Counts:
    """Count what the paper counts on the surface of a case."""
    boundary = sites_of(case, mesh).plan.boundary
    surface, law = boundary.surfaces[0], boundary.laws[0]
    if not isinstance(law, BlendedLaw):
        tail, panel = mesh.patch(surface.patches[0]), mesh.patch(panel_of(surface.patches[0]))
        return Counts(case.name, case.angle, tail=len(tail.nodes), panel=len(panel.nodes))
    follow = law.driven & ~law.strip
    found = Counts(case.name, case.angle, stay=int(law.held.sum()), follow=int(follow.sum()))
    if not case.fighter.aileron.gap:
        return found
    moved = np.abs(law.displacement(case.angle)[:, 2]).max()
    at_edge = np.isin(tets_of(mesh), surface.nodes[follow]).any(axis=1)
    ends = combinations(mesh.points[tets_of(mesh)[at_edge].T], 2)
    edge = np.median([np.linalg.norm(a - b, axis=1) for a, b in ends])
    return replace(found, gaps=float(moved / case.fighter.aileron.gap), edges=float(moved / edge))


def figure6(runs: Sources, numbers: Numbers, folder: Path) -> None:
    """The tail with its hexahedron and sites."""
    _sized(runs, numbers, "tail")
    _drawn(aircraft.confinement(runs.run("tail", 12.0)), "figure6", numbers, folder)


def figure8(runs: Sources, numbers: Numbers, folder: Path) -> None:
    """The mesh around the tail."""
    run = runs.run("tail", 12.0)
    _checked(
        8, [run], ("planarity", "cylindricity", "root_on_cylinder", "fixed_surfaces_moved", "outside_moved"), numbers
    )
    _drawn(aircraft.around(run), "figure8", numbers, folder)


def reasons(runs: Sources, _numbers: Numbers, folder: Path) -> None:
    """Why the paper needs more centres than we do."""
    write_trials(runs.scale, folder / "tables", Stopwatch(runs.show), runs.cache)


def timings(runs: Sources, numbers: Numbers, _folder: Path) -> None:
    """Filter and evaluation times for f_x."""
    for one in paper().evaluations:
        _sized(runs, numbers, one.case)
        own = timed(one, case_named(one.case, runs.scale), runs.mesh(one.case))
        numbers["evaluations"].append(asdict(own))


def _sized(runs: Sources, numbers: Numbers, name: str) -> None:
    """Note the sizes of the mesh and of the sites of a case."""
    if name not in numbers["sizes"]:
        mesh = runs.mesh(name)
        numbers["sizes"][name] = asdict(sites_of(case_named(name, runs.scale), mesh).size(name, mesh))


def _checked(number: int, runs: list[Run], names: tuple[str, ...], numbers: Numbers) -> None:
    for run in runs:
        for one in run.checks:
            if one.name in names:
                numbers["seen"].append({"figure": number, "angle": run.case.angle, **one.as_dict()})


def _drawn(picture: Picture, name: str, numbers: Numbers, folder: Path) -> None:
    _shown(figure_of(picture), picture.alternative, name, numbers, folder)


def _shown(figure: Figure, alternative: str, name: str, numbers: Numbers, folder: Path) -> None:
    write_png(figure, folder / "figures" / f"{name}.png")
    numbers["pictures"][name] = alternative


_AILERON: Wanted = (("aileron", -12.0, "mv", "MV"), ("aileron", -12.0, "squv", "SQUV"))
_CHIMERA: Wanted = tuple(("aileron-chimera", angle, "squv", f"{angle:+g} deg") for angle in (-12.0, -30.0))
_TAIL: Wanted = (("tail", 12.0, "squv", "+12 deg"),)


# The sections of the page, in the order in which they are measured.
SECTIONS: dict[str, Measure] = {
    **{f"table{number}": partial(table, name=f"table{number}") for number in (1, 2, 3, 4)},
    "figure1": figure1,
    "figure3": partial(histograms, number=3, wanted=_AILERON),
    "figure4": partial(histograms, number=4, wanted=_CHIMERA),
    "figure5": figure5,
    "figure6": figure6,
    "figure7": partial(histograms, number=7, wanted=_TAIL),
    "figure8": figure8,
    "counts": counts,
    "timings": timings,
    "centres": reasons,
}

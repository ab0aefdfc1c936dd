"""What the files of a finished run say, computed again: from its case, its undeflected mesh and its interpolants."""

import json
from collections.abc import Callable, Iterator, Sequence
from math import inf, isclose
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.metrics import MeshOrigin, Run, metrics
from sdm_deflect.cases.aircraft.reference import Reference
from sdm_deflect.cases.aircraft.run_folder import stored_repair
from sdm_deflect.cases.aircraft.validation import further_checks, validate
from sdm_deflect.cases.report.data import RUN, Convergence, read_courses, read_json
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.reading import damaged, read_arrays
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.rbf.greedy import Adaptation, Iteration, Stop
from sdm_deflect.deform.rbf.interpolant import Interpolant, check_finite
from sdm_deflect.deform.rbf.kernels import KERNEL, arrays_of
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.volume.deflection import Deflected, Deflection, Deflections, as_repaired, stepped
from sdm_deflect.deform.volume.plan import Plan, Planned
from sdm_deflect.deform.volume.sites import Sites
from sdm_deflect.deform.volume.step import DIRECTIONS, Fits, Step, solve
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.formats.vtu import read_vtu, vtu_arrays
from sdm_deflect.meshing.generate.assembly import FAR_FIELD
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.generate.topology import boundary_failures
from sdm_deflect.meshing.generate.verify import verify
from sdm_deflect.meshing.mesh import FREE_FORM, skin, tets_of

SAME = 1e-9
"""Nodes of a finished run are no further (m) from where its interpolants put them."""
ROUNDING, SHARE = 1e-12, 1e-9
"""A figure differs from the same computed again by no more than this, or than this share of it."""
WRITTEN = 1e-6
"""The same of a residual in convergence.csv, which is written with seven digits."""
NOT_AGAIN = frozenset({
    "after_pinned", "condition", "filter_seconds", "pairs_per_second", "peak_rss_bytes", "search_steps", "seconds",
    "timings", "total_seconds", "version", "where", "whole_mesh_seconds",
})  # fmt: skip
"""Names of what metrics.json tells of the run alone: its times, memory and factors, and rounding errors in words."""
NAMED = 3
"""So many faults a check names."""


def judged(
    folder: Path,
    case: Case,
    mesh: Mesh,
    deflected: Mesh,
    deflected_cad: Callable[[], Reference],
    models: Callable[[Case], tuple[CadModel, ...]],
) -> tuple[Check, ...]:
    """Return the checks of a finished run: those that it made itself, and those of its files.

    Parameters
    ----------
    mesh, deflected : of the folder, as `read_run` has them.
    deflected_cad, models : give the deflected CAD, and that of each mesh before; nothing is asked of them until all
        files are read.

    Raises
    ------
    InputError, MeshFileError
        If a file is missing or damaged, or is of another run.
    """
    meshes = [mesh, *([read_vtu(folder / "background.vtu")] if case.domain == "block" else [])]
    plan = plan_of(case, mesh)
    repair, arrays = stored_repair(folder, mesh), stored_arrays(folder, mesh, deflected)
    again = stored_deflection(folder, plan)
    if repair is not None:
        again = Deflections.of([as_repaired(box, repair) for box in again.boxes])
    figures = read_json(folder)
    parts = zip(
        ("undeflected_mesh", "background_mesh"), meshes, models(case), (case.mesh, case.background), strict=False
    )
    own = tuple(mesh_check(*part) for part in parts)
    background = meshes[1] if len(meshes) > 1 else None
    checks = validate(case, mesh, deflected, plan, deflected_cad(), background, repair)
    checks += further_checks(again, checks)
    run = Run(case, mesh, MeshOrigin(own[0].value, 1, 0.0), deflected, again, 0.0, checks)
    return (*checks, same_deflection(deflected, again), *own, arrays, stored_figures(figures, run))


def stored_deflection(folder: Path, plan: Planned) -> Deflected:
    """Carry out a plan with the interpolants of a finished run, whose histories are those of convergence.csv.

    Raises InputError if interpolant.npz or convergence.csv is of other surfaces, steps or boxes.
    """
    path = folder / "interpolant.npz"
    arrays, courses = read_arrays(path), read_courses(folder)
    with damaged(folder, RUN):
        found = [
            _deflection(box, courses.pop(box.surface), arrays, f"_{box.surface}" if i else "")
            for i, box in enumerate(plan.boxes)
        ]
        for name in (*(name for name in arrays if name != KERNEL), *courses):
            raise ValueError(f"{name} is of no surface or step of the run")
    return Deflections.of(found)


def _deflection(plan: Plan, courses: Sequence[Convergence], arrays: dict[str, Any], tag: str) -> Deflection:
    """Carry out a plan step by step, and take what it needs out of the arrays; KeyError if something is missing."""
    _check_kernel(plan, arrays, tag)
    corners = arrays.pop(f"hexahedron{tag}")
    if corners.shape != (8, 3) or not np.allclose(corners, plan.region.hexahedron.corners, rtol=0.0, atol=ROUNDING):
        raise ValueError(f"hexahedron{tag} is not that of the case")

    def take(k: int, points: FloatArray, move: FloatArray) -> Step:
        state, suffix = plan.state(points), tag + (f"_step{k}" if k > 1 else "")

        def fit(sliding: bool, values: FloatArray) -> Fits:
            pairs = zip(state.groups(values, sliding), (own for own in courses if own.step == k), strict=True)
            return Fits(tuple(_fit(*pair, arrays, suffix, plan.sites) for pair in pairs))

        return solve(state, move, fit)

    return stepped(plan, plan.angle, max(course.step for course in courses), take)


def _check_kernel(plan: Plan, arrays: dict[str, Any], tag: str) -> None:
    """Take the kernel's number out of the arrays; ValueError if their kernel is not that of the plan."""
    expected = arrays_of(plan.sites.kernel, tag)
    same = str(arrays[KERNEL]) == str(expected.pop(KERNEL))
    if not same or not all(np.isclose(arrays.pop(name), number, SHARE, 0.0) for name, number in expected.items()):
        raise ValueError("the kernel of interpolant.npz is not that of the case")


def _fit(group: DataSites, course: Convergence, arrays: dict[str, Any], suffix: str, sites: Sites) -> Adaptation:
    """Take the interpolant of one group of directions, and measure its error at all data sites."""
    names = [f"{DIRECTIONS[component]}{suffix}" for component in group.components]
    if course.directions != "".join(DIRECTIONS[component] for component in group.components):
        raise ValueError(f"convergence.csv has the directions {course.directions}, which the strategy has not")
    centers, beta, alpha = ([arrays.pop(f"{part}_{name}") for name in names] for part in ("centers", "beta", "alpha"))
    if not all(np.array_equal(one, centers[0]) for one in centers):
        raise ValueError(f"the centres of {' and '.join(names)} are not the same")
    check_finite(centers=centers[0], beta=np.column_stack(beta), alpha=np.column_stack(alpha))
    interpolant = Interpolant(sites.kernel, centers[0], np.column_stack(beta), np.column_stack(alpha))
    rows = zip(course.centres, course.errors, strict=True)
    history = tuple(Iteration(i, count, error, 0.0) for i, (count, error) in enumerate(rows))
    error = float(np.abs(interpolant(group.points) - group.values).max())
    chosen = np.arange(len(centers[0]))
    stop = Stop.CONVERGED if error <= sites.tolerance else Stop.MAX_CENTERS
    return Adaptation(interpolant, group.components, chosen, history, stop, error)


def same_deflection(deflected: Mesh, again: Deflected) -> Check:
    """Check that every node is where the interpolants put it, and the repair, if there was one, from there."""
    off = np.linalg.norm(deflected.points - again.points, axis=1)
    return Check("same_deflection", float(off.max()), SAME, "m", worst(off, again.plan.mesh.points))


def stored_arrays(folder: Path, mesh: Mesh, deflected: Mesh) -> Check:
    """Check that the arrays in deflected.vtu are those of its points; InputError if one is missing."""
    stored, quality = vtu_arrays(folder / "deflected.vtu"), mean_ratio(deflected.points, tets_of(deflected))
    expected = {
        "displacement": deflected.points - mesh.points,
        "quality": np.concatenate([quality, np.zeros(len(skin(mesh).triangles))]),
    }
    wrong = []
    for name, values in expected.items():
        if name not in stored or stored[name].shape != values.shape:
            raise InputError(f"{folder / 'deflected.vtu'} has no array {name} of shape {values.shape}")
        off = ~(np.abs(stored[name] - values) <= ROUNDING)
        wrong += [f"{name}[{row}]" for row in np.flatnonzero(off.reshape(len(off), -1).any(axis=1))]
    return faults("stored_arrays", wrong, "rows")


def mesh_check(name: str, mesh: Mesh, model: CadModel, parameters: MeshParameters) -> Check:
    """Check a mesh as a new one: it fills the flow domain without gap and overlap, and its boundary is on the CAD.

    Its value is the largest distance (m) of a boundary node from the CAD, infinite if anything else is wrong.
    """
    found = mesh_faults(mesh, model)
    if not found:
        measured = verify(mesh, model, parameters)
        if not measured.failures:
            return Check(name, measured.boundary_to_cad_max, FREE_FORM, "m", "filled, closed, on the CAD")
        found = list(measured.failures)
    return Check(name, inf, FREE_FORM, "m", "; ".join(found[:NAMED]))


def mesh_faults(mesh: Mesh, model: CadModel) -> list[str]:
    """Return what is wrong with the patches and the topology of a mesh, a sentence for each thing."""
    names = (*model.patches, *(() if model.fluid_inside else (FAR_FIELD,)))
    if mesh.names != names:
        return [f"the patches are {', '.join(mesh.names)}, those of the CAD {', '.join(names)}"]
    boundary = skin(mesh)
    patch_of_face = np.array([*(names.index(face.patch) for face in model.faces), len(names) - 1])
    if boundary.face.max(initial=-1) >= len(model.faces) or (patch_of_face[boundary.face] != boundary.patch).any():
        return ["triangles are on another patch than their CAD face"]
    unused = len(mesh.points) - len(distinct(tets_of(mesh)))
    return [f"{unused} nodes belong to no cell"] if unused else boundary_failures(mesh)


def stored_figures(figures: Json, run: Run) -> Check:
    """Check that the content of metrics.json, and the last rows of convergence.csv, are what comes out again."""
    wrong = list(differing(figures, json.loads(json.dumps(metrics(run))), "metrics.json"))
    for fit in (fit for box in run.deflection.boxes for step in box.steps for fit in step.fits.adaptations):
        last, place = fit.history[-1], "convergence.csv: " + "".join(DIRECTIONS[c] for c in fit.components)
        wrong += differing(last.n_centers, len(fit.chosen), f"{place}.centres")
        if not isclose(last.max_residual, fit.max_error, rel_tol=WRITTEN, abs_tol=ROUNDING):
            wrong.append(f"{place}.max_error is {last.max_residual}, again {fit.max_error}")
    return faults("stored_figures", wrong, "figures")


def differing(stored: Any, again: Any, place: str) -> Iterator[str]:
    """Yield where figures differ from the same computed again."""
    if isinstance(again, dict) and isinstance(stored, dict):
        for key in sorted((stored.keys() | again.keys()) - NOT_AGAIN):
            yield from differing(stored.get(key), again.get(key), f"{place}.{key}")
    elif isinstance(again, list) and isinstance(stored, list) and len(stored) == len(again):
        for i, pair in enumerate(zip(stored, again, strict=True)):
            yield from differing(*pair, f"{place}[{i}]")
    elif not _alike(stored, again):
        yield f"{place} is {stored}, again {again}"


def _alike(stored: Any, again: Any) -> bool:
    if isinstance(again, float) and isinstance(stored, float | int):
        return isclose(stored, again, rel_tol=SHARE, abs_tol=ROUNDING)
    return type(stored) is type(again) and stored == again


def faults(name: str, found: Sequence[str], unit: str) -> Check:
    """Return the check that there are no faults; it names the first ones."""
    return Check(name, float(len(found)), 0.0, unit, "; ".join(found[:NAMED]) or "none")

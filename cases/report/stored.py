"""What the files of a finished run say, computed again: from its settings, its mesh and its interpolants."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.report.data import RUN, Convergence, read_courses
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.reading import damaged, read_arrays
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.deform.rbf.greedy import Adaptation, Iteration, Stop
from sdm_deflect.deform.rbf.interpolant import Interpolant, check_finite
from sdm_deflect.deform.rbf.kernels import KERNEL, arrays_of
from sdm_deflect.deform.rbf.sites import DataSites
from sdm_deflect.deform.volume.deflection import Deflected, Deflection, Deflections, as_repaired, stepped
from sdm_deflect.deform.volume.plan import Plan, Planned
from sdm_deflect.deform.volume.step import DIRECTIONS, Fits, Step, solve
from sdm_deflect.meshing.formats.vtu import vtu_arrays

SAME = 1e-9
"""Nodes of a finished run are no further from where its interpolants put them: m, or shares of the largest box."""
ROUNDING, SHARE = 1e-12, 1e-9
"""A figure differs from the same computed again by no more than this (m, or a share of the largest box), or than this
share of it."""
WRITTEN = 1e-6
"""The same of a residual in convergence.csv, which is written with seven digits."""
NOT_AGAIN = frozenset({
    "after_pinned", "condition", "filter_seconds", "moved", "pairs_per_second", "peak_rss_bytes", "search_steps",
    "seconds", "timings", "total_seconds", "version", "where", "whole_mesh_seconds", "why",
})  # fmt: skip
"""Names of what metrics.json tells of the run alone: times, memory, factors, rounding errors in words, the origin
of the box; and how many nodes a repair moved, some of them by less than a file's digits."""
NAMED = 3
"""So many faults a check names."""


def stored_deflection(folder: Path, plan: Planned, repair: FloatArray | None = None) -> Deflected:
    """Carry out a plan with the interpolants of a finished run, whose histories are those of convergence.csv.

    Its repair, where it had one, moved each node by `repair` (N, 3).

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
    return Deflections.of(found if repair is None else [as_repaired(box, repair) for box in found])


def _deflection(plan: Plan, courses: Sequence[Convergence], arrays: dict[str, Any], tag: str) -> Deflection:
    """Carry out a plan step by step, and take what it needs out of the arrays; KeyError if something is missing."""
    _check_kernel(plan, arrays, tag)
    corners = arrays.pop(f"hexahedron{tag}")
    if corners.shape != (8, 3) or not _same_corners(corners, plan.region.hexahedron.corners):
        raise ValueError(f"hexahedron{tag} is not that of the settings")

    def take(k: int, points: FloatArray, move: FloatArray) -> Step:
        state, suffix = plan.state(points), tag + (f"_step{k}" if k > 1 else "")

        def fit(sliding: bool, values: FloatArray) -> Fits:
            prefix = "sliding_" if len(state.sites.slid) and not sliding else ""
            pairs = zip(state.groups(values, sliding), (own for own in courses if own.step == k), strict=True)
            return Fits(tuple(_fit(*pair, arrays, prefix, suffix, plan) for pair in pairs))

        return solve(state, move, fit)

    return stepped(plan, plan.angle, max(course.step for course in courses), take)


def _check_kernel(plan: Plan, arrays: dict[str, Any], tag: str) -> None:
    """Take the kernel's number out of the arrays; ValueError if their kernel is not that of the plan."""
    expected = arrays_of(plan.sites.kernel, tag)
    same = str(arrays[KERNEL]) == str(expected.pop(KERNEL))
    if not same or not all(np.isclose(arrays.pop(name), number, SHARE, 0.0) for name, number in expected.items()):
        raise ValueError("the kernel of interpolant.npz is not that of the settings")


def _same_corners(corners: FloatArray, expected: FloatArray) -> bool:
    return bool(np.allclose(corners, expected, rtol=0.0, atol=ROUNDING * max(1.0, diagonal(expected))))


def diagonal(corners: FloatArray) -> float:
    """Return the largest distance between the corners (8, 3) of a box, by their coordinates."""
    return float(np.linalg.norm(np.ptp(corners, axis=0)))


def _fit(
    group: DataSites, course: Convergence, arrays: dict[str, Any], prefix: str, suffix: str, plan: Plan
) -> Adaptation:
    """Take the interpolant of one group of directions, and measure its error at all data sites.

    Only the fit that has no prefix has its history in convergence.csv.
    """
    names = [f"{DIRECTIONS[component]}{suffix}" for component in group.components]
    if course.directions != "".join(DIRECTIONS[component] for component in group.components):
        raise ValueError(f"convergence.csv has the directions {course.directions}, which the strategy has not")
    centers, beta, alpha = (
        [arrays.pop(f"{prefix}{part}_{name}") for name in names] for part in ("centers", "beta", "alpha")
    )
    if not all(np.array_equal(one, centers[0]) for one in centers):
        raise ValueError(f"the centres of {' and '.join(names)} are not the same")
    check_finite(centers=centers[0], beta=np.column_stack(beta), alpha=np.column_stack(alpha))
    interpolant = Interpolant(plan.sites.kernel, centers[0], np.column_stack(beta), np.column_stack(alpha))
    error, chosen = float(np.abs(interpolant(group.points) - group.values).max()), np.arange(len(centers[0]))
    rows = [(len(chosen), error)] if prefix else zip(course.centres, course.errors, strict=True)
    history = tuple(Iteration(i, count, off, 0.0) for i, (count, off) in enumerate(rows))
    full = len(chosen) >= plan.job.fitting.max_centers
    stop = Stop.CONVERGED if error <= plan.sites.tolerance else Stop.MAX_CENTERS if full else Stop.ROUNDING
    return Adaptation(interpolant, group.components, chosen, history, stop, error)


def same_deflection(points: FloatArray, again: Deflected, size: float = 1.0, unit: str = "") -> Check:
    """Check that every node (N, 3) is where the interpolants put it, and the repair, if there was one, from there.

    The limit is a share of `size`, a length in the mesh's `unit`.
    """
    off = np.linalg.norm(points - again.points, axis=1)
    return Check("same_deflection", float(off.max()), SAME * size, unit, worst(off, again.plan.mesh.points))


def stored_arrays(path: Path, expected: Mapping[str, FloatArray]) -> Check:
    """Check the arrays of a .vtu file; InputError if one is missing."""
    stored, wrong = vtu_arrays(path), []
    for name, values in expected.items():
        if name not in stored or stored[name].shape != values.shape:
            raise InputError(f"{path} has no array {name} of shape {values.shape}")
        off = ~(np.abs(stored[name] - values) <= ROUNDING)
        wrong += [f"{name}[{row}]" for row in np.flatnonzero(off.reshape(len(off), -1).any(axis=1))]
    return faults("stored_arrays", wrong, "rows")


def stored_figures(
    figures: Json, expected: Json, again: Deflected, size: float = 1.0, but: Collection[str] = NOT_AGAIN
) -> Check:
    """Check that the content of metrics.json, and the last rows of convergence.csv, are what comes out again.

    Figures may differ by rounding of lengths as large as `size`; those that `but` names are not compared.
    """
    wrong = list(differing(figures, json.loads(json.dumps(expected)), "metrics.json", ROUNDING * size, but))
    for fit in (fit for box in again.boxes for step in box.steps for fit in step.fits.adaptations):
        last, place = fit.history[-1], "convergence.csv: " + "".join(DIRECTIONS[c] for c in fit.components)
        wrong += differing(last.n_centers, len(fit.chosen), f"{place}.centres")
        if not isclose(last.max_residual, fit.max_error, rel_tol=WRITTEN, abs_tol=ROUNDING * size):
            wrong.append(f"{place}.max_error is {last.max_residual}, again {fit.max_error}")
    return faults("stored_figures", wrong, "figures")


def differing(
    stored: Any, again: Any, place: str, rounding: float = ROUNDING, but: Collection[str] = NOT_AGAIN
) -> Iterator[str]:
    """Yield where figures differ from the same computed again."""
    if isinstance(again, dict) and isinstance(stored, dict):
        for key in sorted((stored.keys() | again.keys()) - set(but)):
            yield from differing(stored.get(key), again.get(key), f"{place}.{key}", rounding, but)
    elif isinstance(again, list) and isinstance(stored, list) and len(stored) == len(again):
        for i, pair in enumerate(zip(stored, again, strict=True)):
            yield from differing(*pair, f"{place}[{i}]", rounding, but)
    elif not _alike(stored, again, rounding):
        yield f"{place} is {stored}, again {again}"


def _alike(stored: Any, again: Any, rounding: float) -> bool:
    if isinstance(again, float) and isinstance(stored, float | int):
        return isclose(stored, again, rel_tol=SHARE, abs_tol=rounding)
    return type(stored) is type(again) and stored == again


def faults(name: str, found: Sequence[str], unit: str) -> Check:
    """Return the check that there are no faults; it names the first ones."""
    return Check(name, float(len(found)), 0.0, unit, "; ".join(found[:NAMED]) or "none")

"""What a report tells of: a run as it ends, or as its folder keeps it."""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from sdm_deflect.cases.finished import read_run
from sdm_deflect.cases.metrics import Json
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import plans_of
from sdm_deflect.cases.sdm.reference import reference
from sdm_deflect.cases.sdm.validation import validate
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.mesh import BoolArray, FloatArray
from sdm_deflect.deform.volume.deflection import Deflection, Plan
from sdm_deflect.deform.volume.step import DIRECTIONS
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.mesh import TetMesh

Centres = dict[str, dict[str, FloatArray]]
"""Centres (C, 3) of the first step by control surface and direction."""


@dataclass(frozen=True, slots=True)
class Course:
    """The adaptation of one group of directions in one step: centres and the largest residual (m) with them."""

    surface: str
    step: int
    directions: str
    centres: tuple[int, ...]
    errors: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """Everything that the page of a run shows.

    Attributes
    ----------
    mesh, deflected : before and after; same cells, same order.
    plans : what each control surface was to do.
    courses, centres : the adaptations.
    checks : the validation; empty until the run is judged.
    figures : the content of metrics.json; empty until then.
    """

    case: Case
    mesh: TetMesh
    deflected: TetMesh
    plans: tuple[Plan, ...]
    courses: tuple[Course, ...]
    centres: Centres
    checks: tuple[Check, ...] = ()
    figures: Json = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return all(check.passed for check in self.checks)

    def touching(self, plan: Plan) -> BoolArray:
        """True for cells (M,) with a node inside the hexahedron of a control surface."""
        return self.mesh.touching(plan.region.inside)

    def judged(self, checks: tuple[Check, ...], figures: Json) -> "ReportData":
        """Return the data with the validation and the content of metrics.json."""
        return replace(self, checks=checks, figures=figures)


def report_data_of(case: Case, mesh: TetMesh, deflected: TetMesh, deflections: Sequence[Deflection]) -> ReportData:
    """Return what a run has to show once its surfaces are deflected."""
    courses = [
        Course(
            one.plan.surface, k, "".join(DIRECTIONS[c] for c in fit.components),
            tuple(row.n_centers for row in fit.history), tuple(row.max_residual for row in fit.history),
        )
        for one in deflections for k, step in enumerate(one.steps, 1) for fit in step.fits.adaptations
    ]  # fmt: skip
    centres = {
        one.plan.surface: {
            DIRECTIONS[c]: fit.interpolant.centers for fit in one.steps[0].fits.adaptations for c in fit.components
        }
        for one in deflections
    }
    return ReportData(case, mesh, deflected, tuple(one.plan for one in deflections), tuple(courses), centres)


def report_data_of_folder(folder: Path) -> ReportData:
    """Return what the report of a finished run shows from its folder; the validation is made again.

    Raises
    ------
    InputError
        If a file is missing or damaged.
    """
    case, mesh, deflected = read_run(folder)
    background = read_vtu(folder / "background.vtu") if case.domain == "block" else None
    plans = plans_of(case, mesh.as_mesh(case.name))
    try:
        figures = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        courses = read_courses(folder / "convergence.csv")
        centres = read_centres(folder / "interpolant.npz", [plan.surface for plan in plans])
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{folder} is not the whole output folder of a run: {error}") from None
    with reference(case) as deflected_cad:
        checks = validate(case, mesh, deflected, plans, deflected_cad(), background)
    return ReportData(case, mesh, deflected, plans, courses, centres, checks, figures)


def read_courses(path: Path) -> tuple[Course, ...]:
    """Read convergence.csv."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for key, group in groupby(rows, key=lambda row: (row["surface"], int(row["step"]), row["direction"])):
        pairs = [(int(row["centres"]), float(row["max_error"])) for row in group]
        found.append(Course(*key, tuple(count for count, _ in pairs), tuple(error for _, error in pairs)))
    return tuple(found)


def read_centres(path: Path, surfaces: Sequence[str]) -> Centres:
    """Read the centres of each surface's first step from interpolant.npz."""
    with np.load(path, allow_pickle=False) as stored:
        return {
            surface: {d: stored[f"centers_{d}_{surface}" if i else f"centers_{d}"] for d in DIRECTIONS}
            for i, surface in enumerate(surfaces)
        }

"""The output folder of a case: writing, reading, and validation again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.report.data import FitRows, ReportData
from sdm_deflect.cases.report.finished import FinishedRun, moved_by_repair
from sdm_deflect.cases.report.folder import write_arrays
from sdm_deflect.cases.run.output import lacks
from sdm_deflect.deform.checks import Check, checks_of
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.formats.vtu import read_vtu, write_vtu
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case
from .job import plan_of
from .metrics import case_toml
from .reference import reference
from .registry import resolve
from .validation import mesh_check, validate

if TYPE_CHECKING:
    from sdm_deflect.cases.report.pictures import Exhibit
    from sdm_deflect.geometry.model import CadModel


def write_deformation(folder: Path, case: Case, deflection: Deflection, background: Mesh | None) -> None:
    """Write every file of the contract that needs no validation into `folder`."""
    (folder / "case.toml").write_text(case_toml(case, deflection.plan), encoding="utf-8")
    write_vtu(folder / "undeflected.vtu", deflection.plan.mesh)
    write_arrays(folder, deflection, whole=True)
    if background is not None:
        write_vtu(folder / "background.vtu", background)


def finished_case(folder: Path) -> FinishedRun:
    """Read the folder of a case.

    Raises InputError or MeshFileError if a file is missing or damaged, or the meshes before and after differ.
    """
    if not (folder / "case.toml").is_file():
        raise InputError(f"{folder} is not the output folder of a run: it has no case.toml")
    case = resolve("", config=folder / "case.toml")
    mesh, deflected = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
    before, after = (
        {"tets": tets_of(state), **skin(state)._asdict(), "names": state.names} for state in (mesh, deflected)
    )
    for what, values in before.items():
        if not np.array_equal(values, after[what]):
            raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in {what}")
    if mesh.points.shape != deflected.points.shape:
        raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in their number of points")
    plan = plan_of(case, replace(mesh, name=case.name))
    repair = moved_by_repair(folder / "deflected.vtu", len(mesh.points))
    return FinishedRun(folder, plan, deflected.points, repair, case_toml(case, plan), CadValidation(folder, case))


@dataclass(frozen=True, slots=True, eq=False)
class CadValidation:
    """See `Validation`: the meshes of a case are compared with its CAD.

    Attributes
    ----------
    folder : the folder of the run.
    case : as case.toml has it.
    """

    folder: Path
    case: Case

    @property
    def lacks(self) -> str:
        """Sentence naming what is not installed but needed to build CAD; empty if nothing is missing."""
        return lacks("aircraft")

    @property
    def background(self) -> Mesh | None:
        """The mesh around a Chimera block; None without one."""
        return read_vtu(self.folder / "background.vtu") if self.case.domain == "block" else None

    def page(self, plan: Plan, points: FloatArray, fits: Sequence[FitRows], repair: FloatArray | None) -> ReportData:
        """Return the content of the case's report, without the verdict."""
        from .report import case_data

        return case_data(self.case, plan, points, fits, repair)

    def checks(self, deflection: Deflection, cache: bool) -> tuple[Check, ...]:
        """Return all checks of the deflected mesh; without the CAD kernel those that need none."""
        mesh_checks = checks_of(deflection, unit="m")
        if self.lacks:
            return validate(self.case, deflection, mesh_checks, None)
        background = self.background
        with reference(self.case, cache) as deflected_cad:
            return validate(self.case, deflection, mesh_checks, deflected_cad(), background)

    def undeflected_checks(self, mesh: Mesh) -> tuple[Check, ...]:
        """Return the checks of the undeflected mesh, and of a background, against newly built CAD."""
        if self.lacks:
            return ()
        case, background = self.case, self.background
        meshes, grids = (mesh, *([background] if background else ())), (case.mesh, case.background)
        parts = zip(("undeflected_mesh", "background_mesh"), meshes, undeflected_models(case), grids, strict=False)
        return tuple(mesh_check(*part) for part in parts)

    def draw(self, data: ReportData, folder: Path) -> "Sequence[Exhibit]":
        """Draw the distances from the CAD into `folder`."""
        from .report import draw_distances

        return draw_distances(data, folder)


def undeflected_models(case: Case) -> "tuple[CadModel, ...]":
    """Build the CAD of a case's undeflected meshes: that of the case, then that of its background, if any."""
    from .cad import background_cad, undeflected_cad  # the CAD kernel

    return (undeflected_cad(case), *([background_cad(case)] if case.domain == "block" else []))

"""The output folder of a case: written, read back, validated again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.report.data import FitRows, ReportData, read_figures, stored_checks
from sdm_deflect.cases.report.finished import FinishedRun, moved_by_repair
from sdm_deflect.cases.report.folder import write_arrays
from sdm_deflect.cases.run.output import lacks
from sdm_deflect.deform.checks import Check, checks_of
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.meshing.formats.vtu import read_vtu, write_vtu
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case
from .job import plan_of
from .metrics import case_toml
from .reference import Reference, reference
from .registry import resolve
from .validation import mesh_check, validate

if TYPE_CHECKING:
    from sdm_deflect.cases.report.pictures import Exhibit
    from sdm_deflect.geometry.model import CadModel

STORED = "the checks and their values are those of the run, and there are no maps of distances from the CAD"


def write_deformation(folder: Path, case: Case, found: Deflection, background: Mesh | None) -> None:
    """Write every file of the contract that needs no validation into `folder`."""
    (folder / "case.toml").write_text(case_toml(case, found.plan), encoding="utf-8")
    write_vtu(folder / "undeflected.vtu", found.plan.mesh)
    write_arrays(folder, found, whole=True)
    if background is not None:
        write_vtu(folder / "background.vtu", background)


@dataclass(frozen=True, slots=True, eq=False)
class FinishedCase(FinishedRun):
    """A finished case.

    Attributes
    ----------
    case : as case.toml has it.
    deflected : its mesh after.
    """

    case: Case
    deflected: Mesh = field(repr=False)

    @classmethod
    def of(cls, folder: Path) -> "FinishedCase":
        """Read the folder of a run.

        Raises InputError or MeshFileError if a file is missing or damaged, or the meshes before and after differ.
        """
        if not (folder / "case.toml").is_file():
            raise InputError(f"{folder} is not the output folder of a run: it has no case.toml")
        case = resolve("", config=folder / "case.toml")
        mesh, deflected = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
        before, after = ({"tets": tets_of(one), **skin(one)._asdict(), "names": one.names} for one in (mesh, deflected))
        for what, values in before.items():
            if not np.array_equal(values, after[what]):
                raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in {what}")
        if mesh.points.shape != deflected.points.shape:
            raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in their number of points")
        plan = plan_of(case, replace(mesh, name=case.name))
        repair = moved_by_repair(folder / "deflected.vtu", len(mesh.points))
        return cls(folder, plan, deflected.points, repair, case_toml(case, plan), case, deflected)

    def _data(self, fits: Sequence[FitRows]) -> ReportData:
        from .report import case_data

        return case_data(self.case, self.plan, self.points, fits, self.repair)

    def fresh_report_data(self) -> ReportData:
        """Return what its report shows, with the checks of the meshes made again; those of the fits are stored ones."""
        data = self.report_data()
        if self.lacks:
            notes = [*data.figures.get("notes", ()), f"{STORED}; {self.lacks}"]
            return replace(data, figures={**data.figures, "notes": notes})
        with reference(self.case) as deflected_cad:
            fresh = {check.name: check for check in self.verdict(self.background, deflected_cad)}
        return replace(data, checks=(*(fresh.pop(one.name, one) for one in data.checks), *fresh.values()))

    def further_pictures(self, data: ReportData, folder: Path) -> "Sequence[Exhibit]":
        """Draw the distances from the CAD."""
        from .report import draw_distances

        return draw_distances(data, folder)

    @property
    def lacks(self) -> str:
        """Say what is not installed but needed to build CAD."""
        return lacks("aircraft")

    @property
    def background(self) -> Mesh | None:
        """The mesh around a Chimera block; None without one."""
        return read_vtu(self.folder / "background.vtu") if self.case.domain == "block" else None

    def verdict(self, background: Mesh | None, cad: Callable[[], Reference | None]) -> tuple[Check, ...]:
        """Return the checks of the mesh and those against the deflected CAD, which is built last."""
        found = Deflection.at(self.plan, self.points, self.repair)
        return validate(self.case, found, checks_of(found, unit="m"), cad(), background)

    def recheck(self) -> tuple[Check, ...]:
        """Repeat the run's checks, against newly built CAD where the kernel is installed, and check its files."""
        if self.lacks:
            return (*self.verdict(None, lambda: None), *stored_checks(read_figures(self.folder)[1]))
        with reference(self.case, cache=False) as deflected_cad:
            return self.recheck_with(deflected_cad, undeflected_models)

    def recheck_with(
        self, deflected_cad: Callable[[], Reference], models: "Callable[[Case], tuple[CadModel, ...]]"
    ) -> tuple[Check, ...]:
        """Return the checks as `recheck` does; all files are read before either CAD is built.

        Raises InputError or MeshFileError if a file is missing or damaged, or is of another run.
        """
        case, mesh, background = self.case, self.plan.mesh, self.background
        _, stored, _ = read_figures(self.folder)
        meshes, grids = (mesh, *([background] if background else ())), (case.mesh, case.background)
        parts = zip(("undeflected_mesh", "background_mesh"), meshes, models(case), grids, strict=False)
        own = tuple(mesh_check(*part) for part in parts)
        return (*self.verdict(background, deflected_cad), *stored_checks(stored), *own)


def undeflected_models(case: Case) -> "tuple[CadModel, ...]":
    """Build what the meshes of a case follow before the deflection: its own, then that of its background if any."""
    from .cad import background_cad, undeflected_cad  # the CAD kernel

    return (undeflected_cad(case), *([background_cad(case)] if case.domain == "block" else []))

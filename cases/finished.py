"""A finished output folder, read back."""

from pathlib import Path

import numpy as np

from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import plans_of
from sdm_deflect.cases.sdm.reference import reference
from sdm_deflect.cases.sdm.registry import resolve
from sdm_deflect.cases.sdm.validation import validate
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.errors import InputError
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.mesh import TetMesh


def validate_folder(folder: Path) -> tuple[Check, ...]:
    """Validate the meshes of a run against the CAD of its case.toml, both built afresh.

    Raises
    ------
    InputError
        If a file is missing or the two meshes do not belong together.
    """
    case, mesh, deflected = read_run(folder)
    background = read_vtu(folder / "background.vtu") if case.domain == "block" else None
    plans = plans_of(case, mesh.as_mesh(case.name))
    with reference(case) as deflected_cad:
        return validate(case, mesh, deflected, plans, deflected_cad(), background)


def read_run(folder: Path) -> tuple[Case, TetMesh, TetMesh]:
    """Return the case of a finished run and its mesh before and after."""
    if not (folder / "case.toml").is_file():
        raise InputError(f"{folder} is not the output folder of a run: it has no case.toml")
    case = resolve("", config=folder / "case.toml")
    mesh, deflected = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
    if mesh.points.shape != deflected.points.shape or not np.array_equal(mesh.tets, deflected.tets):
        raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in points or cells")
    return case, mesh, deflected

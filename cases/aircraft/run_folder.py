"""The output folder of a case: written, read back, validated again."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.metrics import Run, metrics
from sdm_deflect.cases.aircraft.reference import reference
from sdm_deflect.cases.aircraft.registry import resolve
from sdm_deflect.cases.run.output import write_convergence, write_interpolants
from sdm_deflect.cases.settings.conversion import to_toml
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Deflected
from sdm_deflect.meshing.formats.vtu import read_vtu, vtu_arrays
from sdm_deflect.meshing.formats.vtu_write import write_vtu
from sdm_deflect.meshing.mesh import skin, tets_of

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel


def write_deformation(folder: Path, case: Case, deflected: Mesh, found: Deflected, background: Mesh | None) -> None:
    """Write every file of the contract that needs no validation into `folder`."""
    (folder / "case.toml").write_text(to_toml(case), encoding="utf-8")
    write_vtu(folder / "undeflected.vtu", found.plan.mesh)
    arrays = {"displacement": deflected.points - found.plan.mesh.points}
    if (repair := found.moved_by_repair) is not None:
        arrays["repair"] = repair
    write_vtu(
        folder / "deflected.vtu",
        deflected,
        point_data=arrays,
        cell_data={"quality": mean_ratio(deflected.points, tets_of(deflected))},
    )
    if background is not None:
        write_vtu(folder / "background.vtu", background)
    write_interpolants(folder / "interpolant.npz", found.boxes)
    write_convergence(folder / "convergence.csv", found.boxes)


def write_metrics(run: Run, folder: Path) -> None:
    """Write metrics.json into `folder`."""
    (folder / "metrics.json").write_text(json.dumps(metrics(run), indent=2) + "\n", encoding="utf-8")


def validate_folder(folder: Path) -> tuple[Check, ...]:
    """Validate the files of a run against its interpolants, against each other, and against CAD built afresh.

    Raises InputError or MeshFileError if a file is missing or damaged, or the files do not belong together.
    """
    from sdm_deflect.cases.aircraft.stored import judged  # trimesh: a run loads it while its CAD is built

    case, mesh, deflected = read_run(folder)
    with reference(case) as deflected_cad:
        return judged(folder, case, mesh, deflected, deflected_cad, undeflected_models)


def undeflected_models(case: Case) -> "tuple[CadModel, ...]":
    """Build what the meshes of a case follow before the deflection: its own, then that of its background if any."""
    from sdm_deflect.cases.aircraft.cad import background_cad, undeflected_cad  # the CAD kernel

    return (undeflected_cad(case), *([background_cad(case)] if case.domain == "block" else []))


def read_run(folder: Path) -> tuple[Case, Mesh, Mesh]:
    """Return the case of a finished run and its mesh before and after; InputError if these are not one mesh."""
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
    return case, replace(mesh, name=case.name), deflected


def stored_repair(folder: Path, mesh: Mesh) -> FloatArray | None:
    """Return how far a repair moved each node (N, 3) of a finished run; None without one; InputError if damaged."""
    path = folder / "deflected.vtu"
    repair = vtu_arrays(path).get("repair")
    if repair is not None and (repair.shape != mesh.points.shape or not np.isfinite(repair).all()):
        raise InputError(f"{path}: its array repair is not {len(mesh.points)} finite vectors")
    return repair

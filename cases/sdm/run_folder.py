"""The output folder of a case: written, read back, validated again."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sdm_deflect.cases.output import write_convergence, write_interpolants
from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import deflected as carried_out
from sdm_deflect.cases.sdm.job import plans_of
from sdm_deflect.cases.sdm.metrics import Run, metrics
from sdm_deflect.cases.sdm.reference import reference
from sdm_deflect.cases.sdm.registry import resolve
from sdm_deflect.cases.settings import to_toml
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Deflection, combined
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.vtu_write import write_vtu
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.temporary import settle

SAME = 1e-9
"""Nodes of a finished run are no further (m) from where fitting again puts them."""


def write_deformation(
    folder: Path,
    case: Case,
    mesh: TetMesh,
    deflected: TetMesh,
    deflections: Sequence[Deflection],
    background: TetMesh | None,
) -> None:
    """Write every file of the contract that needs no validation into `folder`."""
    (folder / "case.toml").write_text(to_toml(case), encoding="utf-8")
    write_vtu(folder / "undeflected.vtu", mesh)
    write_vtu(
        folder / "deflected.vtu",
        deflected,
        point_data={"displacement": deflected.points - mesh.points},
        cell_data={"quality": mean_ratio(deflected.points, deflected.tets)},
    )
    if background is not None:
        write_vtu(folder / "background.vtu", background)
    write_interpolants(folder / "interpolant.npz", deflections)
    write_convergence(folder / "convergence.csv", deflections)


def write_metrics(run: Run, folder: Path) -> None:
    """Write metrics.json into `folder`."""
    (folder / "metrics.json").write_text(json.dumps(metrics(run), indent=2) + "\n", encoding="utf-8")


def validate_folder(folder: Path) -> tuple[Check, ...]:
    """Validate the meshes of a run against the CAD of its case.toml, both built afresh.

    Raises InputError if a file is missing or the two meshes do not belong together.
    """
    from sdm_deflect.cases.sdm.validation import site_checks, validate  # trimesh: a run loads it while its CAD is built

    case, mesh, deflected = read_run(folder)
    background = read_vtu(folder / "background.vtu") if case.domain == "block" else None
    plans = plans_of(case, mesh.as_mesh(case.name))
    with reference(case) as deflected_cad:
        again = carried_out(case, plans)
        off = np.linalg.norm(deflected.points - combined(plans[0].mesh, again), axis=1)
        same = Check("same_deflection", float(off.max()), SAME, "m", worst(off, mesh.points))
        checks = validate(case, mesh, deflected, plans, deflected_cad(), background)
    return (*checks, *site_checks(again), same)


def read_run(folder: Path) -> tuple[Case, TetMesh, TetMesh]:
    """Return the case of a finished run and its mesh before and after."""
    settle(folder)
    if not (folder / "case.toml").is_file():
        raise InputError(f"{folder} is not the output folder of a run: it has no case.toml")
    case = resolve("", config=folder / "case.toml")
    mesh, deflected = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
    if mesh.points.shape != deflected.points.shape or not np.array_equal(mesh.tets, deflected.tets):
        raise InputError(f"{folder}: undeflected.vtu and deflected.vtu differ in points or cells")
    return case, mesh, deflected

"""The contracts between the packages hold, and each is broken by an import that it forbids."""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("sdm_deflect", "cases", "deform", "geometry", "meshing")
CONTRACTS = {
    contract["name"]: contract
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
}
NUMERICS = "deform is pure numerics on arrays"
ONE_WAY = "data flows one way: cases, then meshing, then geometry"
ENGINE = "the engine in layers, from checks down to arrays"
GENERAL = "what serves any mesh knows no case of the aircraft"
CADQUERY = "only geometry knows CadQuery"
PLANTED = [
    (NUMERICS, "deform/volume/step.py", "sdm_deflect.meshing.mesh"),
    (NUMERICS, "deform/mesh/edges.py", "sdm_deflect.geometry.datum"),
    (NUMERICS, "deform/checks.py", "sdm_deflect.cases.run.metrics"),
    (NUMERICS, "deform/mesh/mesh.py", "meshio"),
    (NUMERICS, "deform/mesh/quality.py", "vtkmodules.vtkFiltersVerdict"),
    (ONE_WAY, "geometry/datum.py", "sdm_deflect.meshing.mesh"),
    (ONE_WAY, "meshing/formats/adapters.py", "sdm_deflect.cases.errors"),
    (ENGINE, "deform/rbf/greedy.py", "sdm_deflect.deform.surface.motions"),
    (ENGINE, "deform/mesh/axis.py", "sdm_deflect.deform.volume.job"),
    (ENGINE, "deform/volume/step.py", "sdm_deflect.deform.checks"),
    (GENERAL, "cases/api.py", "sdm_deflect.cases.aircraft.case"),
    (GENERAL, "cases/report/page.py", "sdm_deflect.geometry.datum"),
    (GENERAL, "meshing/formats/su2.py", "sdm_deflect.meshing.generate.parameters"),
    (CADQUERY, "cases/aircraft/cad.py", "cadquery"),
    (CADQUERY, "meshing/generate/surface.py", "OCP.gp"),
]
"""Contract, a file, and what it may not import."""


def linted(folder):
    """Return the exit code of import-linter in a folder, and the names of the contracts that it finds broken."""
    program = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([program, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert {name for name in CONTRACTS if f"{name} KEPT" in lines or f"{name} BROKEN" in lines} == set(CONTRACTS), (
        done.stdout + done.stderr
    )
    return done.returncode, {name for name in CONTRACTS if f"{name} BROKEN" in lines}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the packages, links kept as links."""
    folder = tmp_path_factory.mktemp("tree")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def test_the_packages_keep_every_contract(tree):
    assert linted(tree) == (0, set())


@pytest.mark.parametrize(("contract", "file", "module"), PLANTED, ids=lambda given: given.replace(" ", "-"))
def test_a_planted_import_breaks_its_contract(tree, contract, file, module):
    path = tree / file
    before = path.read_bytes()
    path.write_bytes(before + f"\n\ndef planted() -> None:\n    import {module}\n".encode())
    try:
        code, broken = linted(tree)
    finally:
        path.write_bytes(before)
    assert code == 1
    assert contract in broken


def test_every_contract_is_tried():
    assert {contract for contract, _, _ in PLANTED} == set(CONTRACTS)

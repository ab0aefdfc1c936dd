"""The contracts between the packages hold, and each is broken by an import that it forbids."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from graphlib import TopologicalSorter
from itertools import chain
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
ROOMS = "the rooms: cases, then deform, then meshing, then geometry, then base"
NUMERICS = "deform, mesh and repair are pure numerics on arrays"
METHOD = "the method in layers, from the plan down to the sums"
SUMS = "kernels, fits and the greedy choice know no mesh"
MESHING = "meshing in layers: formats beside generate, then repair, then mesh"
GENERAL = "what serves any mesh knows no case of the aircraft"
CADQUERY = "only geometry knows CadQuery"
# Contract, a file, and what it may not import.
PLANTED = [
    (ROOMS, "geometry/datum.py", "sdm_deflect.meshing.mesh.mesh"),
    (ROOMS, "meshing/formats/adapters.py", "sdm_deflect.cases.errors"),
    (ROOMS, "meshing/mesh/axis.py", "sdm_deflect.deform.volume.job"),
    (ROOMS, "meshing/repair/repair.py", "sdm_deflect.deform.checks"),
    (ROOMS, "deform/checks.py", "sdm_deflect.cases.run.metrics"),
    (ROOMS, "sdm_deflect/base/threads.py", "sdm_deflect.geometry.datum"),
    (NUMERICS, "deform/volume/step.py", "sdm_deflect.meshing.formats.registry"),
    (NUMERICS, "deform/mesh_motion.py", "sdm_deflect.meshing.generate.sizing"),
    (NUMERICS, "meshing/mesh/edges.py", "sdm_deflect.geometry.datum"),
    (NUMERICS, "meshing/mesh/mesh.py", "meshio"),
    (NUMERICS, "meshing/repair/energy.py", "h5py"),
    (NUMERICS, "meshing/mesh/quality.py", "vtkmodules.vtkFiltersVerdict"),
    (METHOD, "deform/rbf/greedy.py", "sdm_deflect.deform.surface.motions"),
    (METHOD, "deform/volume/step.py", "sdm_deflect.deform.checks"),
    (METHOD, "deform/around/bound.py", "sdm_deflect.deform.volume.plan"),
    (SUMS, "deform/rbf/problem.py", "sdm_deflect.meshing.mesh.mesh"),
    (MESHING, "meshing/mesh/layers.py", "sdm_deflect.meshing.repair.freedom"),
    (MESHING, "meshing/repair/region.py", "sdm_deflect.meshing.formats.shapes"),
    (GENERAL, "cases/api.py", "sdm_deflect.cases.aircraft.case"),
    (GENERAL, "cases/report/page.py", "sdm_deflect.geometry.datum"),
    (GENERAL, "meshing/formats/su2.py", "sdm_deflect.meshing.generate.parameters"),
    (CADQUERY, "cases/aircraft/cad.py", "cadquery"),
    (CADQUERY, "meshing/generate/volume.py", "OCP.gp"),
]


def linted(folder):
    """Return the exit code of import-linter in a folder, the contracts that it finds broken, and by which imports."""
    program = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([program, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert {name for name in CONTRACTS if f"{name} KEPT" in lines or f"{name} BROKEN" in lines} == set(CONTRACTS), (
        done.stdout + done.stderr
    )
    by: dict[str, set[tuple[str, str]]] = {}
    for line in lines[lines.index("Broken contracts") :] if "Broken contracts" in lines else []:
        if line in CONTRACTS:
            imports = by.setdefault(line, set())
        elif steps := re.search(r"(\S+) -> (\S+)", line):
            imports.add(steps.groups())
    return done.returncode, by


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the packages, links kept as links."""
    folder = tmp_path_factory.mktemp("tree")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def test_the_packages_keep_every_contract(tree):
    assert linted(tree) == (0, {})


@pytest.mark.parametrize("turn", range(max(Counter(contract for contract, *_ in PLANTED).values())))
def test_each_planted_import_breaks_its_contract(tree, turn):
    """One for each contract in turn: of several, import-linter would name some."""
    planted = [[one for one in PLANTED if one[0] == contract][turn : turn + 1] for contract in CONTRACTS]
    before = {file: (tree / file).read_bytes() for (_, file, _) in chain(*planted)}
    for _, file, module in chain(*planted):
        (tree / file).write_bytes(before[file] + f"\n\ndef planted() -> None:\n    import {module}\n".encode())
    code, broken = linted(tree)
    for file, content in before.items():
        (tree / file).write_bytes(content)
    assert code == 1
    for contract, file, module in chain(*planted):
        importer = "sdm_deflect." + file.removeprefix("sdm_deflect/").removesuffix(".py").replace("/", ".")
        targets = {to for by, to in broken[contract] if by == importer}
        assert targets & {module, module.partition(".")[0]}, (importer, module)


def test_every_contract_is_tried():
    assert {contract for contract, _, _ in PLANTED} == set(CONTRACTS)


def product():
    """Yield the name of each installed module without that of the package, its file, and its syntax tree."""
    for path in chain.from_iterable((ROOT / room).rglob("*.py") for room in ("sdm_deflect/base", *FOLDERS[1:])):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removeprefix("sdm_deflect.")
        yield name, path, ast.parse(path.read_text(encoding="utf-8"))


def test_a_method_without_a_docstring_has_one_in_another_class():
    classes = [node for *_, tree in product() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    methods = [one for own in classes for one in own.body if isinstance(one, ast.FunctionDef) and one.name[0] != "_"]
    said = {"save_overload", *(one.name for one in methods if ast.get_docstring(one))}  # a method of Numba
    assert {one.name for one in methods} <= said


def source_of(name, node):
    """Return the module that a statement in the module `name` imports from, without the name of the package."""
    if node.level:
        return ".".join([*name.split(".")[: -node.level], *filter(None, [node.module])])
    return node.module.removeprefix("sdm_deflect.")


def test_no_module_imports_one_that_imports_it():
    """Imports within functions, and those for the type checker alone, count as well."""
    trees = {name.removesuffix(".__init__"): tree for name, _, tree in product()}
    imports = {name: set() for name in trees}
    for name, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                start = source_of(name, node)
                wanted = {f"{start}.{one.name}" if f"{start}.{one.name}" in trees else start for one in node.names}
                imports[name] |= (wanted & trees.keys()) - {name}
    assert sum(map(len, imports.values())) > 500
    TopologicalSorter(imports).prepare()  # CycleError names a circle


def test_an_import_shows_whether_it_leaves_its_room():
    """Modules of the same folder are imported by a dot, all others by their whole name."""
    wrong, modules = [], {name for name, _, _ in product()}
    for name, path, tree in product():
        room = name.rpartition(".")[0]
        for node in (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)):
            source = source_of(name, node)
            inside = source == room or (source in modules and source.rpartition(".")[0] == room)
            if node.level > 1 or (node.level == 0 and inside and node.module.startswith("sdm_deflect.")):
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert wrong == []


def test_no_class_has_the_name_of_another():
    names = Counter(node.name for _, _, tree in product() for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert [name for name, count in names.items() if count > 1] == []

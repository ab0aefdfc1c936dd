"""The one import: what it loads, what it names, and a notebook that uses it as a newcomer would."""

import ast
import inspect
import re
import runpy
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import sdm_deflect as sd
from sdm_deflect.cases.settings.job_settings import BY_NAME, IN_PYTHON
from sdm_deflect.meshing.formats.adapters import to_meshio, to_pyvista
from sdm_deflect.meshing.formats.polyhedra import polyhedral_cells
from tests.deform.blocks import block_with_body, two_bodies

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "api" / "public.md"
HINGE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
CELL = """
import sdm_deflect as sd

mesh = sd.read("naca.msh")
results = sd.sweep(
    mesh, "flap", hinge=[[0.7, 0.6, 0], [0.7, 1.4, 0]], angles=[-10, 0, 10],
    motion="blended", fixed="wing", slide="symmetry:plane",
)
for result in results:
    result.save(f"naca{result.angle:+g}.cgns")
display(*results)
results[-1].plot()
"""


@pytest.fixture(scope="module")
def block():
    return block_with_body()


@pytest.fixture(scope="module")
def result(block):
    return sd.deflect(block, "body", HINGE, 10.0)


def test_the_import_loads_nothing_else():
    loaded = "import sys; before = set(sys.modules); import sdm_deflect; print(*(set(sys.modules) - before))"
    out = subprocess.run([sys.executable, "-c", loaded], capture_output=True, text=True, check=True).stdout
    assert {name.partition(".")[0] for name in out.split()} <= {"sdm_deflect", *sys.stdlib_module_names}


def test_public_names_are_those_that_a_type_checker_sees():
    assert dir(sd) == sorted(sd.__all__)
    assert all(getattr(sd, name) is not None for name in sd.__all__)
    assert re.fullmatch(r"\d+\.\d+.*", sd.__version__)
    with pytest.raises(AttributeError, match="no attribute 'deform_all'"):
        sd.deform_all  # noqa: B018
    blocks = [node for node in ast.parse(inspect.getsource(sd)).body if isinstance(node, ast.If)]
    typed = {alias.name for node in blocks[-1].body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed | {"__version__"} == set(sd.__all__)


@pytest.mark.parametrize("name", sorted(set(sd.__all__) - {"__version__"}))
def test_public_names_are_documented(name):
    """Every argument and every attribute has a line of its own, and the reference shows the path that users type."""
    thing = getattr(sd, name)
    assert re.search(rf"^\.\. auto(function|class|exception):: {name}$", REFERENCE.read_text(), re.MULTILINE)
    described = inspect.getdoc(thing) or ""
    if is_dataclass(thing):
        told = [one.name for one in fields(thing) if one.init]
        assert re.search("^(Attributes|Parameters)\n---", described, re.MULTILINE) or not told
    else:
        told = list(inspect.signature(thing).parameters) if inspect.isfunction(thing) else []
        assert ("Parameters\n---" in described) == bool(told)
        assert ("Raises\n---" in described) == bool(told)
    for argument in told:
        assert re.search(rf"^[\w, *]*\b{argument}\b[\w, *]*( :|$)", described, re.MULTILINE), argument
    for method, function in inspect.getmembers(thing, inspect.isfunction):
        assert method.startswith("_") or function.__doc__, method


def test_every_setting_is_described():
    told = set(re.findall(r"`(\w+)`", sd.deflect.__doc__)) | {"angle", "hinge"}
    assert BY_NAME.keys() - IN_PYTHON.keys() <= told


@pytest.mark.nightly
def test_a_notebook_of_one_cell(tmp_path):
    """It needs no display, and shows tables and a picture."""
    runpy.run_path(str(ROOT / "docs" / "examples" / "naca_wing.py"))["build"](tmp_path, fineness=0.7)
    impatient = "from sdm_deflect.cases.run import progress\n\nprogress.PATIENCE = 0.0\n"
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(f"{impatient}{CELL.strip()}")])
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    shown = [output.data for output in notebook.cells[0].outputs if "data" in output]
    assert shown[0].keys() == {"text/plain"}, "no progress"
    tables = [data["text/html"] for data in shown if "text/html" in data]
    assert "<iframe srcdoc=" in tables.pop()
    assert len(tables) == 3
    assert "flap of naca.msh at -10 deg: all validations passed" in tables[0]
    assert "site_error" in tables[2]
    assert "mean ratio" in tables[2]
    assert "FAILED" not in "".join(tables)

    mesh = sd.read(tmp_path / "naca.msh")
    kept = {angle: sd.read(tmp_path / f"naca{angle:+d}.cgns") for angle in (-10, 0, 10)}
    hinge = [[0.7, 0.6, 0], [0.7, 1.4, 0]]
    same = sd.sweep(mesh, "flap", hinge, [-10, 0, 10], motion="blended", fixed="wing", slide={"symmetry": "plane"})
    for one in same:
        assert np.array_equal(one.points, kept[int(one.angle)].points)
        assert kept[int(one.angle)].names == mesh.names
    assert np.array_equal(kept[0].points, mesh.points)


def test_settings_take_effect(block, result):
    """Each of them was once swallowed."""
    finer = sd.deflect(block, "body", HINGE, 10.0, tolerance=1e-9)
    assert finer.plan.boxes[0].sites.tolerance == 1e-9
    assert not np.array_equal(finer.points, result.points)
    common = sd.deflect(block, "body", HINGE, 10.0, strategy="mv")
    assert {key: len(result.deflection.boxes[0].steps[0].fits.adaptations) for key in ("squv",)} == {"squv": 3}
    assert len(common.deflection.boxes[0].steps[0].fits.adaptations) == 1
    with pytest.raises(sd.InputError, match="unknown setting tolerence; did you mean tolerance"):
        sd.deflect(block, "body", HINGE, 10.0, tolerence=1e-5)
    with pytest.raises(sd.InputError, match="unknown setting xyzzy"):
        sd.sweep(block, "body", HINGE, [1.0], xyzzy=1)
    with pytest.raises(sd.InputError, match="min_quality = 2 must be a number from 0 to 1"):
        sd.deflect(block, "body", HINGE, 10.0, min_quality=2)
    strict = sd.deflect(block, "body", HINGE, 10.0, min_quality=1.0)
    assert not strict.passed
    assert "FAILED: do not use this mesh; 1 of 6 checks: quality_min:hexahedron" in strict.title


def test_results_come_in_the_order_asked_for(block):
    angles = [5.0, -10.0, 5.0, 0.0]
    results = sd.sweep(block, "body", HINGE, angles)
    assert [one.angle for one in results] == angles
    nose = block.on("body")[0]
    for angle, one in zip(angles, results, strict=True):
        turned = sd.Rotation.about(*HINGE).axis.rotated(block.points[[nose]], angle)
        np.testing.assert_allclose(one.points[[nose]], turned, atol=1e-12)
    assert [one.angle for one in sd.sweep(block, "body", HINGE, "-4:4:4")] == [-4.0, 0.0, 4.0]


def test_surfaces_with_hinges_of_their_own():
    mesh = two_bodies()
    names = mesh.names[:2]
    hinges = [[[x, 0.0, 0.0], [x, 1.0, 0.0]] for x in (mesh.points[mesh.on(name)].mean(axis=0)[0] for name in names)]
    tables = [
        {"patches": name, "hinge": hinge, "angle": angle}
        for name, hinge, angle in zip(names, hinges, (12.0, -6.0), strict=True)
    ]
    (half,) = sd.sweep(mesh, tables, None, [4.0])
    for name, hinge, angle in zip(names, hinges, (4.0, -2.0), strict=True):
        nodes = mesh.on(name)
        turned = sd.Rotation.about(*hinge).axis.rotated(mesh.points[nodes], angle)
        np.testing.assert_allclose(half.points[nodes], turned, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (((np.eye(3), {"body": "abc"}), "body", HINGE, 5), {}, "patch body must be whole numbers"),
        (((np.eye(3), {"body": [0.5]}), "body", HINGE, 5), {}, "patch body must be whole numbers"),
        (
            ((np.full((4, 3), np.nan), {"body": [0]}), "body", HINGE, 5),
            {},
            "arrays: 4 points are not finite, the first",
        ),
        ((None, "flap", HINGE, 5), {}, "mesh: the surface 'flap' is no patch; the patches are body, x-"),
        ((None, "body", HINGE, 95), {}, "angle = 95 deg of body is out of range"),
        ((None, "body", HINGE, 5), {"progress": True}, "progress = True must be a function"),
        ((None, "body", HINGE, 5), {"motion": sd.Rotation}, "motion = "),
    ],
)
def test_mistakes_are_one_sentence(block, arguments, options, message):
    with pytest.raises(sd.InputError) as caught:
        sd.deflect(arguments[0] or block, *arguments[1:], **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "--" not in str(caught.value)


def test_values_are_made_of_lists():
    assert sd.Listed([3, 1]).nodes.dtype == np.intp
    assert sd.OnPatches("wing").names == ("wing",)
    corners = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    assert sd.Hexahedron(corners).contains(np.array([[0.5, 0.5, 0.5]])).all()
    cells = sd.Cells("tetra", [[0, 1, 2, 3]])
    mesh = sd.Mesh(np.eye(4, 3).tolist(), [cells], [sd.Patch("wall", [sd.Cells("triangle", [[0, 1, 2]])])])
    assert mesh.on("wall").tolist() == [0, 1, 2]


def test_a_file_is_saved_read_and_never_overwritten(result, tmp_path):
    assert result.save(tmp_path / "block.vtu") == tmp_path / "block.vtu"
    mesh = sd.read(str(tmp_path / "block.vtu"))
    assert np.array_equal(mesh.points, result.points)
    again = sd.deflect(str(tmp_path / "block.vtu"), "body", HINGE, -3.0)
    with pytest.raises(sd.InputError, match="this is a file that is read"):
        again.save(tmp_path / "block.vtu")
    with pytest.raises(sd.InputError, match="5 is no path"):
        again.save(5)
    with pytest.raises(sd.InputError, match="5 is no path"):
        sd.read(5)
    with pytest.raises(sd.InputError, match=r"no mesh format has the suffix '\.doc'"):
        again.save(tmp_path / "block.doc")


def test_a_mesh_of_a_file_shows_judges_and_saves_itself(result, tmp_path):
    result.save(tmp_path / "block.su2")
    mesh = sd.read(tmp_path / "block.su2")
    head, *rows = repr(mesh).splitlines()
    assert head == f"block.su2: {len(mesh.points)} points, {len(mesh.cells[0])} hexahedra"
    assert [row.split()[:3] for row in rows] == [[one.name, str(len(one)), "faces,"] for one in mesh.patches]
    assert mesh["body"] is mesh.patch("body")
    with pytest.raises(sd.InputError, match=r"did you mean body\?"):
        mesh["bdy"]
    (quality,) = mesh.quality()
    assert (quality.cells, quality.inverted) == (len(mesh.cells[0]), 0)
    again = sd.read(mesh.save(tmp_path / "same.cgns"))
    assert np.array_equal(again.points, mesh.points)
    assert isinstance(sd.deflect(mesh, "body", HINGE, 1.0).mesh, type(mesh))


def test_a_report_is_written_and_holds_no_other_folder(result, tmp_path):
    page = result.report(tmp_path / "report")
    assert page == tmp_path / "report" / "report.html"
    assert "body by +10\N{DEGREE SIGN}" in page.read_text()
    (tmp_path / "settings.toml").write_text("mine")
    with pytest.raises(sd.InputError, match="holds other files already"):
        result.report(tmp_path)
    assert (tmp_path / "settings.toml").read_text() == "mine"


def test_sensitivity_is_the_rate_of_the_points(result):
    ahead = sd.deflect(result.plan.mesh, "body", HINGE, 10.001).points
    nodes = result.plan.mesh.on("body")
    rate = (ahead - result.points)[nodes] / 1e-3
    np.testing.assert_allclose(result.sensitivity[nodes], rate, atol=1e-6)


def test_pyvista_and_meshio_take_a_result(result):
    grid, mesh = result.to_pyvista(), result.plan.mesh
    assert np.array_equal(grid.points, result.points)
    cells = len(mesh.cells[0])
    assert grid.n_cells == cells + sum(len(patch) for patch in mesh.patches)
    assert np.nanmin(grid.cell_data["quality"][:cells]) > 0.0
    assert np.isnan(grid.cell_data["quality"][cells:]).all()
    back = sd.deflect(grid, "body", HINGE, -10.0)
    np.testing.assert_allclose(back.points[mesh.on("body")], mesh.points[mesh.on("body")], atol=1e-12)
    other = result.to_meshio()
    assert set(other.cell_sets) == set(mesh.names)
    assert np.array_equal(other.points, result.points)


def test_polyhedra_keep_their_faces(block):
    mesh = sd.Mesh(block.points, (polyhedral_cells(block).cells,), block.patches)
    still = np.zeros_like(block.points)
    grids = [to_pyvista(one, still, (1.0,)) for one in (mesh, block)]
    volumes = [grid.compute_cell_sizes()["Volume"][: len(block.cells[0])] for grid in grids]
    np.testing.assert_allclose(*volumes)
    assert to_meshio(mesh, still).cells[0].type == "hexahedron"

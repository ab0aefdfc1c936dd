"""Two-dimensional meshes in files: SU2, Gmsh and VTK; other formats refuse them."""

from pathlib import Path

import numpy as np
import pytest

from sdm_deflect import deflect
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.run.inspection import file_figures
from sdm_deflect.cases.run.mesh_files import write_mesh
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, read
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.plates import plate
from tests.extras import Library
from tests.meshing.formats.alike import content

gmsh = Library("gmsh")

SUFFIXES = (".su2", ".msh", ".vtu")
BOX = [[-0.9, -0.9], [0.9, 0.9]]


def mixed(z=0.0):
    """Quads below, triangles above."""
    quads = plate(8, z=z)
    nodes = quads.cells[0].nodes
    low = quads.points[nodes].mean(axis=1)[:, 1] < 0.0
    halves = np.concatenate([nodes[~low][:, [0, 1, 2]], nodes[~low][:, [0, 2, 3]]])
    wobble = np.zeros_like(quads.points)
    wobble[:, :2] = 0.01 * np.sin(np.arange(2 * len(wobble)).reshape(-1, 2))
    return Mesh(quads.points + wobble, (Cells("quad", nodes[low]), Cells("triangle", halves)), quads.patches)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_round_trip_changes_coordinates_alone(suffix, tmp_path):
    mesh, path, out = mixed(), tmp_path / f"plate{suffix}", tmp_path / f"moved{suffix}"
    form = format_of(path)
    assert form.write(mesh, path) == ()
    found = read(path)
    assert found.plane
    assert content(found) == content(mesh)
    assert found.points.tobytes() == mesh.points.tobytes()
    form.rewrite(path, found.points, out)
    assert out.read_bytes() == path.read_bytes()
    points = found.points.copy()
    points[7, 0] += 0.125
    form.rewrite(path, points, out)
    assert read(out).points.tobytes() == points.tobytes()
    assert content(read(out)) == content(mesh)
    if suffix == ".su2":
        old, new = (file.read_text().splitlines() for file in (path, out))
        assert sum(a != b for a, b in zip(old, new, strict=True)) == 1


@pytest.mark.parametrize("suffix", SUFFIXES[1:])
def test_a_deflection_is_the_same_from_every_format(suffix, tmp_path):
    mesh = mixed()
    places = []
    for name in ("plate.su2", f"plate{suffix}"):
        format_of(tmp_path / name).write(mesh, tmp_path / name)
        result = deflect(str(tmp_path / name), "hole", hinge=[0.1, 0.0], angle=10, box=BOX)
        assert result.passed
        places.append(result.points.tobytes())
    assert places[0] == places[1]


@pytest.mark.parametrize("name", [name for name in FORMATS if name in ("ugrid", "tau", "openfoam")])
def test_formats_without_plane_meshes_say_so(name, tmp_path):
    form = FORMATS[name]
    out = tmp_path / ("case" if name == "openfoam" else f"plate{form.suffixes[0]}")
    with pytest.raises(MeshFileError, match="holds no two-dimensional meshes"):
        form.write(mixed(), out)
    assert not out.exists()


def test_cells_that_run_clockwise_are_turned_one_by_one(tmp_path):
    """As SU2 does: which way a file counts says nothing about the cell."""
    mesh, rng = mixed(), np.random.default_rng(3)
    cells = []
    for block in mesh.cells:
        nodes = block.nodes.copy()
        some = rng.random(len(nodes)) < 0.4
        nodes[some] = nodes[some][:, ::-1]
        cells.append(Cells(block.shape, nodes))
    path = tmp_path / "plate.su2"
    format_of(path).write(Mesh(mesh.points, tuple(cells), mesh.patches), path)
    assert [one["inverted"] for one in file_figures(path)["quality"]] == [0, 0]
    assert file_figures(path)["plane"]
    assert not file_figures(path)["left_handed"]


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("binary", [0, 1])
def test_files_of_gmsh(version, binary, tmp_path):
    """Named lines are patches; a surface in two groups is there once; nameless groups are curves."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        square = gmsh.model.occ.addRectangle(-1.0, -1.0, 0.5, 2.0, 2.0)
        hole = gmsh.model.occ.addDisk(0.0, 0.0, 0.5, 0.3, 0.3)
        gmsh.model.occ.cut([(2, square)], [(2, hole)])
        gmsh.model.occ.synchronize()
        lines = [tag for _, tag in gmsh.model.getEntities(1)]
        round_ = [tag for tag in lines if gmsh.model.getType(1, tag) != "Line"]
        gmsh.model.addPhysicalGroup(1, round_, name="hole")
        gmsh.model.addPhysicalGroup(1, [tag for tag in lines if tag not in round_], tag=77)
        for name in ("fluid", "again")[: 2 if version == 4.1 else 1]:  # Gmsh writes elements of two groups twice in 2.2
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], name=name)
        gmsh.model.mesh.generate(2)
        for option, value in (("MshFileVersion", version), ("Binary", binary)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(tmp_path / "disk.msh"))
        count = sum(map(len, gmsh.model.mesh.getElements(2)[1]))
    finally:
        gmsh.finalize()
    mesh = read(tmp_path / "disk.msh")
    assert mesh.plane
    assert mesh.names == ("hole", "curve_77")
    assert sum(map(len, mesh.cells)) == count
    result = deflect(mesh, "hole", hinge=[0.0, 0.1], angle=10, box=BOX)
    assert result.passed
    out = tmp_path / "moved.msh"
    write_mesh(tmp_path / "disk.msh", mesh, result.points, out)
    assert read(out).points.tobytes() == result.points.tobytes()


@pytest.mark.parametrize("library", ["meshio", "pyvista"])
def test_meshes_of_other_libraries(library, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    mesh = mixed(0.0 if library == "meshio" else 2.0)
    result = deflect(mesh, "hole", hinge=[0.1, 0.0], angle=10, box=BOX)
    still = deflect(mesh, "hole", hinge=[0.1, 0.0], angle=0, box=BOX)
    theirs = getattr(still, f"to_{library}")()
    if library == "meshio":
        theirs.points = theirs.points[:, :2]
    other = deflect(theirs, "hole", hinge=[0.1, 0.0], angle=10, box=BOX)
    assert other.plan.mesh.plane
    assert other.passed
    assert other.points.tobytes() == result.points.tobytes()
    assert np.array_equal(np.asarray(other.mesh.points), result.points[:, : 2 if library == "meshio" else 3])
    assert '<div id="turnable"' in result.plot().html
    assert opened[0].startswith("file:")
    Path(opened[0].removeprefix("file://")).unlink()

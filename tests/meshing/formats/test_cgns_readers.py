"""Other programs open the CGNS files that we write, and we open theirs."""

import subprocess

import numpy as np
import pytest

from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.su2 import Su2
from tests.extras import Library, needs_program
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid, polyhedral, with_gmsh

gmsh = Library("gmsh")
pv = Library("pyvista")
cgns = Library("vtkmodules.vtkIOCGNSReader")

needs_tools = needs_program("cgnscheck")


def complaints(path) -> list[str]:
    """Errors and warnings of cgnscheck, whose exit code is always 0."""
    done = subprocess.run(["cgnscheck", path], capture_output=True, text=True, check=True)
    assert "checking complete" in done.stdout
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.startswith(("ERROR", "WARNING"))]
    return [line for line in lines if line != "WARNING:dataclass not given"]


@needs_tools
@pytest.mark.parametrize("zones", [1, 2])
def test_cgnscheck_has_no_complaint(zones, tmp_path):
    Cgns().write(hybrid(zones), tmp_path / "mesh.cgns")
    assert complaints(tmp_path / "mesh.cgns") == []
    Cgns().rewrite(tmp_path / "mesh.cgns", hybrid(zones).points * 2.0, tmp_path / "moved.cgns")
    assert complaints(tmp_path / "moved.cgns") == []


@needs_tools
def test_cgnscheck_has_no_error_in_polyhedra(tmp_path):
    Cgns().write(polyhedral(hybrid()), tmp_path / "mesh.cgns")
    assert [line for line in complaints(tmp_path / "mesh.cgns") if line.startswith("ERROR")] == []


@pytest.mark.parametrize("zones", [1, 2])
def test_vtk_has_the_same_points_cells_and_patches(zones, tmp_path):
    mesh = hybrid(zones)
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    reader = cgns.vtkCGNSReader()
    reader.SetFileName(str(tmp_path / "mesh.cgns"))
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.EnableAllFamilies()
    reader.SetLoadBndPatch(True)
    reader.Update()
    read = pv.wrap(reader.GetOutput())["Base"]
    assert read.keys() == [zone.name or "Zone" for zone in mesh.zones]
    inside = [read[i]["Internal"] for i in range(zones)]
    np.testing.assert_array_equal(np.vstack([grid.points for grid in inside]), mesh.points)
    assert sum(grid.n_cells for grid in inside) == sum(map(len, mesh.cells))
    patches = [read[i]["Patches"] for i in range(zones)]
    boundary = {part.get_block_name(i): part[i].n_cells for part in patches for i in range(part.n_blocks)}
    assert boundary == {patch.name: len(patch) for patch in mesh.patches}


def test_gmsh_has_the_same_cells_and_patches(tmp_path):
    mesh = hybrid()
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "mesh.cgns"))
        tags, points, _ = gmsh.model.mesh.getNodes()
        counts = {
            gmsh.model.getEntityName(2, tag): sum(map(len, gmsh.model.mesh.getElements(2, tag)[1]))
            for _, tag in gmsh.model.getEntities(2)
        }
        kinds, cells, _ = gmsh.model.mesh.getElements(3)
        jacobians = [gmsh.model.mesh.getElementQualities(tags, "minSJ").min() for tags in cells]
    finally:
        gmsh.finalize()
    np.testing.assert_array_equal(points.reshape(-1, 3)[np.argsort(tags)], mesh.points)
    assert counts == {patch.name: len(patch) for patch in mesh.patches}
    assert dict(zip(kinds.tolist(), map(len, cells), strict=True)) == {4: 4, 5: 1, 6: 1, 7: 1}
    assert min(jacobians) > 0.5


def test_a_file_of_gmsh_is_the_mesh_of_its_su2_file(tmp_path):
    with_gmsh(tmp_path / "gmsh.su2", tmp_path / "gmsh.cgns")
    text, binary = Su2().read(tmp_path / "gmsh.su2"), Cgns().read(tmp_path / "gmsh.cgns")
    np.testing.assert_allclose(binary.points[order(binary)], text.points[order(text)], rtol=0, atol=1e-15)
    a, b = content(binary), content(text)
    assert {shape: len(cells) for shape, cells in a["cells"].items()} == {s: len(c) for s, c in b["cells"].items()}
    assert {name: len(faces) for name, faces in a["patches"].items()} == {n: len(f) for n, f in b["patches"].items()}


def order(mesh):
    return np.lexsort(np.round(mesh.points, 9).T)


def test_blocks_of_gmsh_are_the_mesh_of_its_su2_file(tmp_path):
    """Three boxes in an L, of different numbers of cells."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        model, mesh = gmsh.model, gmsh.model.mesh
        boxes = [(3, model.occ.addBox(*corner, *size)) for corner, size in BOXES]
        model.occ.fragment(boxes[:1], boxes[1:])
        model.occ.synchronize()
        for _, tag in model.getEntities(1):
            low, high = np.reshape(model.getBoundingBox(1, tag), (2, 3))
            mesh.setTransfiniteCurve(tag, 3 + int(np.argmax(high - low)))
        for _, tag in model.getEntities(2):
            mesh.setTransfiniteSurface(tag)
            mesh.setRecombine(2, tag)
        for _, tag in model.getEntities(3):
            mesh.setTransfiniteVolume(tag)
        outer = [tag for _, tag in model.getBoundary(model.getEntities(3), oriented=False)]
        model.addPhysicalGroup(3, [tag for _, tag in model.getEntities(3)], name="fluid")
        model.addPhysicalGroup(2, outer[:2], name="wall")
        model.addPhysicalGroup(2, outer[2:], name="far")
        mesh.generate(3)
        gmsh.write(str(tmp_path / "boxes.su2"))
        gmsh.option.setNumber("Mesh.CgnsExportStructured", 1)
        gmsh.write(str(tmp_path / "boxes.cgns"))
    finally:
        gmsh.option.setNumber("Mesh.CgnsExportStructured", 0)
        gmsh.finalize()
    text, blocks = Su2().read(tmp_path / "boxes.su2"), Cgns().read(tmp_path / "boxes.cgns")
    assert len(blocks.zones[0].blocks) == 3
    np.testing.assert_allclose(blocks.points[order(blocks)], text.points[order(text)], rtol=0, atol=1e-15)
    for mesh in (text, blocks):
        assert [block.shape for block in mesh.cells] == ["hexahedron"]
    assert len(blocks.cells[0]) == len(text.cells[0])
    assert {patch.name: len(patch) for patch in blocks.patches} == {patch.name: len(patch) for patch in text.patches}


BOXES = ((0, 0, 0), (1, 1, 1)), ((1, 0, 0), (2, 1, 1)), ((0, 1, 0), (1, 1, 1))

"""VTK grids: a round trip loses nothing; what others wrote is refused with the way out; damage is an error."""

import contextlib
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.vtu import Vtu, write_vtu
from sdm_deflect.meshing.mesh.cells import Polyhedra
from tests.extras import Library
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

meshio = Library("meshio")
pv = Library("pyvista")


def test_vtk_reads_the_same_cells(tmp_path):
    mesh = hybrid()
    Vtu().write(mesh, tmp_path / "mesh.vtu")
    grid = pv.read(tmp_path / "mesh.vtu")
    kinds = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
    for block in mesh.cells:
        np.testing.assert_array_equal(grid.cells_dict[kinds[block.shape]], block.nodes)
    assert bytes(grid.field_data["patch_names"]).decode().split("\0") == ["volume", *mesh.names, ""]


@pytest.mark.parametrize("patches", [True, False])
def test_meshio_reads_the_same_points_cells_arrays_and_names(tmp_path, patches):
    mesh = hybrid() if patches else replace(hybrid(), patches=())
    shift = np.linspace(0.0, 1.0, mesh.points.size).reshape(-1, 3)
    write_vtu(tmp_path / "mesh.vtu", mesh, {"displacement": shift})
    found = meshio.read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(found.points, mesh.points)
    np.testing.assert_array_equal(found.point_data["displacement"], shift)
    for block in mesh.cells:
        same = [np.sort(own.data).tolist() for own in found.cells]  # it counts those of a wedge in another order
        assert np.sort(block.nodes).tolist() in same
    if patches:
        assert bytes(found.field_data["patch_names"]).decode().split("\0") == ["volume", *mesh.names, ""]
        label = np.concatenate(found.cell_data["patch"])
        assert np.bincount(label).tolist() == [sum(map(len, mesh.cells)), *(len(patch) for patch in mesh.patches)]


def test_polyhedra_keep_cells_faces_and_patches(tmp_path):
    mesh = wing(cells=3).mesh
    OpenFoam().write(mesh, tmp_path / "case")
    source = OpenFoam().read(tmp_path / "case")
    Vtu().write(source, tmp_path / "mesh.vtu")
    again = Vtu().read(tmp_path / "mesh.vtu")
    cells = again.cells[0]
    assert isinstance(cells, Polyhedra)
    assert len(cells) == len(source.cells[0])
    assert len(cells.neighbour) == len(source.cells[0].neighbour)
    OpenFoam().write(again, tmp_path / "again")
    there = OpenFoam().read(tmp_path / "again").cells[0]
    np.testing.assert_array_equal(there.owner, source.cells[0].owner)
    np.testing.assert_array_equal(there.neighbour, source.cells[0].neighbour)
    grid = pv.read(tmp_path / "mesh.vtu")
    box = np.flatnonzero([len(grid.get_cell(i).faces) == 6 for i in range(50)])
    whole = pv.UnstructuredGrid({12: mesh.cells[0].nodes[:50]}, mesh.points).compute_cell_sizes()["Volume"]
    np.testing.assert_allclose(grid.compute_cell_sizes()["Volume"][:50][box], whole[box], rtol=0.1)


def test_a_file_of_others_is_refused_and_pyvista_is_the_way(tmp_path):
    mesh = hybrid()
    Vtu().write(mesh, tmp_path / "own.vtu")
    pv.read(tmp_path / "own.vtu").save(tmp_path / "other.vtu")
    with pytest.raises(MeshFileError, match=r"other\.vtu: this \.vtu file was not written by sdm-deflect; read"):
        Vtu().read(tmp_path / "other.vtu")
    grid, flap = pv.read(tmp_path / "other.vtu"), mesh.names[0]
    result = sdm_deflect.deflect(grid, flap, [[0, 0, 0], [0, 1, 0]], 0.0, fixed=mesh.names[1:], force=True)
    np.testing.assert_array_equal(result.points, mesh.points)
    (tmp_path / "text.vtu").write_text("NDIME= 3")
    with pytest.raises(MeshFileError, match="is not a VTK unstructured grid"):
        Vtu().read(tmp_path / "text.vtu")


def test_damaged_bytes_are_an_error_or_another_mesh_and_nothing_worse(tmp_path):
    Vtu().write(hybrid(), tmp_path / "mesh.vtu")
    data, random = (tmp_path / "mesh.vtu").read_bytes(), np.random.default_rng(9)
    for _ in range(600):
        damaged = bytearray(data)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            damaged[at] ^= 1 << random.integers(8)
        (tmp_path / "cut.vtu").write_bytes(damaged)
        with contextlib.suppress(MeshFileError, InputError):
            Vtu().read(tmp_path / "cut.vtu")


def test_a_bomb_is_refused(tmp_path):
    Vtu().write(hybrid(), tmp_path / "mesh.vtu")
    data = (tmp_path / "mesh.vtu").read_bytes()
    at = int(re.search(rb'Name="types"[^>]*offset="(\d+)"', data)[1]) + data.index(b"\n_") + 2
    part = zlib.compress(bytes(1 << 27))
    head = np.array([1, 1 << 27, 0, len(part)], "<u8").tobytes()
    (tmp_path / "bomb.vtu").write_bytes(data[:at] + head + part + b"\n</AppendedData>\n</VTKFile>\n")
    with pytest.raises(MeshFileError, match=r"the array types would take 134 MB"):
        Vtu().read(tmp_path / "bomb.vtu")

"""VTK grids: a round trip loses nothing, whatever the encoding; VTK's own filters agree with what we write."""

import contextlib
import re
from dataclasses import replace

import meshio
import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from sdm_deflect.deform.mesh.mesh import Mesh, Polyhedra
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.polyhedra import bounded
from sdm_deflect.meshing.formats.vtu import Vtu
from sdm_deflect.meshing.formats.vtu_write import write_vtu
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.wing import wing

NONE, ZLIB, LZ4, LZMA = range(4)
ENCODINGS = [("Ascii", NONE, 0, 32, 32), ("Binary", ZLIB, 0, 64, 64), ("Binary", LZ4, 0, 32, 32),
             ("Appended", NONE, 0, 64, 64), ("Appended", LZMA, 1, 32, 64)]  # fmt: skip


def encoded(grid, path, encoding):
    mode, compressor, base64, header, index = encoding
    writer = vtkXMLUnstructuredGridWriter()
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetCompressorType(compressor)
    writer.SetEncodeAppendedData(base64)
    writer.SetHeaderType(header)
    writer.SetIdType(index)
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.Write()
    return path


@pytest.fixture
def rich(tmp_path):
    """A grid with arrays of several types on points, cells and itself, lines, and a marker instead of names."""
    Vtu().write(hybrid(), tmp_path / "plain.vtu")
    grid = pv.read(tmp_path / "plain.vtu")
    grid.cell_data["Marker"] = grid.cell_data.pop("patch").astype(np.int16)
    del grid.field_data["patch_names"]
    grid.cell_data["cost"] = np.linspace(0.0, 1.0, grid.n_cells, dtype=np.float32)
    grid.point_data["wind"] = np.sin(grid.points)
    grid.point_data["wind"][0] = np.nan
    grid.field_data["angle"] = np.array([-12.5])
    grid.field_data["title"] = ["a wing & <more>"]
    return grid


def test_round_trip_loses_nothing(tmp_path):
    mesh = hybrid()
    assert Vtu().write(mesh, tmp_path / "mesh.vtu") == ()
    again = Vtu().read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(again.points, mesh.points)
    assert content(again) == content(mesh)
    assert [patch.name for patch in again.patches] == [patch.name for patch in mesh.patches]


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


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_rewritten_file_has_the_same_arrays_and_encoding(rich, encoding, tmp_path):
    source = encoded(rich, tmp_path / "source.vtu", encoding)
    before = source.read_bytes()
    mesh = Vtu().read(source)
    assert {patch.name for patch in mesh.patches} == {f"Marker_{i}" for i in range(1, 7)}
    Vtu().rewrite(source, mesh.points, tmp_path / "still.vtu")
    Vtu().rewrite(source, mesh.points + 1.0, tmp_path / "moved.vtu")
    for name in ("still", "moved"):
        again, data = pv.read(tmp_path / f"{name}.vtu"), (tmp_path / f"{name}.vtu").read_bytes()
        for kind in ("point_data", "cell_data", "field_data"):
            own, old = getattr(again, kind), getattr(rich, kind)
            assert own.keys() == old.keys()
            for key in own:
                np.testing.assert_array_equal(own[key], old[key])
                assert np.asarray(own[key]).dtype == np.asarray(old[key]).dtype
        for mark in (b'"appended"', b'"ascii"', b'"binary"', b"compressor", b'"raw"', b"UInt64", b'"Int32" Name="conn'):
            assert (mark in data) == (mark in before), mark
    np.testing.assert_array_equal(pv.read(tmp_path / "still.vtu").points, mesh.points)
    np.testing.assert_array_equal(pv.read(tmp_path / "moved.vtu").points, mesh.points + 1.0)
    assert source.read_bytes() == before


def test_single_precision_stays_single_and_faces_without_labels_are_one_patch(rich, tmp_path):
    single = rich.copy()
    single.points = rich.points.astype(np.float32)
    del single.cell_data["Marker"]
    source = encoded(single, tmp_path / "source.vtu", ENCODINGS[1])
    mesh = Vtu().read(source)
    assert [(patch.name, len(patch)) for patch in mesh.patches] == [("boundary", 18)]
    Vtu().rewrite(source, mesh.points + 1e-3, tmp_path / "out.vtu")
    assert pv.read(tmp_path / "out.vtu").points.dtype == np.float32


def test_voxels_and_pixels_are_hexahedra_and_quads(tmp_path):
    grid = pv.ImageData(dimensions=(3, 3, 2)).cast_to_unstructured_grid()
    face = pv.UnstructuredGrid(np.array([4, 0, 1, 3, 4]), np.array([8]), grid.points)
    encoded(grid.merge(face, merge_points=True), tmp_path / "image.vtu", ENCODINGS[0])
    mesh = Vtu().read(tmp_path / "image.vtu")
    assert [(block.shape, len(block)) for block in mesh.cells] == [("hexahedron", 4)]
    assert mesh.patches[0].faces[0].shape == "quad"


def test_lines_are_passed_over_and_wedges_of_either_hand_are_read(tmp_path):
    mesh = hybrid()
    nodes = {10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
    cells = {kind: next(b.nodes for b in mesh.cells if b.shape == shape) for kind, shape in nodes.items()}
    cells[13] = cells[13][:, [0, 2, 1, 3, 5, 4]]
    cells[3] = np.array([[0, 1]])
    encoded(pv.UnstructuredGrid(cells, mesh.points), tmp_path / "mesh.vtu", ENCODINGS[0])
    assert content(Vtu().read(tmp_path / "mesh.vtu"))["cells"] == content(mesh)["cells"]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.95])
def test_a_truncated_file_is_an_error_that_names_it(rich, encoding, fraction, tmp_path, capfd):
    data = encoded(rich, tmp_path / "source.vtu", encoding).read_bytes()
    (tmp_path / "cut.vtu").write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(MeshFileError, match=r"cut\.vtu"):
        Vtu().read(tmp_path / "cut.vtu")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_damaged_bytes_are_an_error_or_another_mesh_and_nothing_worse(rich, encoding, tmp_path, capfd):
    data = encoded(rich, tmp_path / "source.vtu", encoding).read_bytes()
    random = np.random.default_rng(9)
    for _ in range(150):
        damaged = bytearray(data)
        for at in random.integers(0, len(data), random.integers(1, 4)):
            damaged[at] ^= 1 << random.integers(8)
        (tmp_path / "cut.vtu").write_bytes(damaged)
        with contextlib.suppress(MeshFileError):
            Vtu().read(tmp_path / "cut.vtu")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (rb'NumberOfPoints="14" *', b'NumberOfPoints="99999999999"'),
        (rb'NumberOfCells="25" *', b'NumberOfCells="-5"'),
        (rb'(Name="Points" NumberOfComponents=)"3"', rb'\1"99999999999"'),
        (rb'(?<=Name="Points")(.*?)offset="\d+"', rb'\1offset="-1"'),
        (rb'(?<=Name="Points")(.*?)offset="\d+"', rb'\1offset="99999999999"'),
        (rb'(?<=Name="Points")(.*?)offset="\d+"', rb'\1offset="3"'),
        (rb"(?s)<Cells>.*</Cells>", b"<Cells></Cells>"),
        (rb'type="Float64" Name="Points"', b'type="Bit" Name="Points"'),
        (rb'type="UnstructuredGrid"', b'type="PolyData"'),
        (rb"<VTKFile", b"<!DOCTYPE a [<!ENTITY b 'c'>]><VTKFile"),
        (rb"vtkZLib", b"vtkOther"),
    ],
)
@pytest.mark.parametrize("packing", [NONE, ZLIB, LZ4, LZMA])
def test_false_counts_are_errors(rich, packing, old, new, tmp_path, capfd):
    data = encoded(rich, tmp_path / "source.vtu", ("Appended", packing, 0, 64, 64)).read_bytes()
    damaged = re.sub(old, lambda found: found.expand(new) if b"\\1" in new else new, data, count=1)
    if damaged == data:
        assert b"ZLib" in old
        return
    (tmp_path / "cut.vtu").write_bytes(damaged)
    with pytest.raises(MeshFileError, match=r"cut\.vtu: "):
        Vtu().read(tmp_path / "cut.vtu")
    assert capfd.readouterr() == ("", "")


def test_pieces_are_one_mesh(tmp_path):
    """Two grids side by side, as programs on many processors write them, polyhedra among them."""
    mesh = hybrid()
    solids = Mesh(mesh.points, (bounded(mesh).cells,), mesh.patches)
    for one in (mesh, solids):
        write_vtu(tmp_path / "one.vtu", one)
        grid = pv.read(tmp_path / "one.vtu")
        path = encoded(grid, tmp_path / "one.vtu", ENCODINGS[0])
        text = path.read_text()
        piece = text[text.index("<Piece") : text.index("</Piece>") + 8]
        path.write_text(text.replace(piece, piece + piece))
        both = Vtu().read(path)
        np.testing.assert_array_equal(both.points, np.tile(mesh.points, (2, 1)))
        assert sum(map(len, both.cells)) == 14
        assert {p.name: len(p) for p in both.patches} == {p.name: 2 * len(p) for p in mesh.patches}
        moved = np.vstack([mesh.points, mesh.points + 1.0])
        Vtu().rewrite(path, moved, tmp_path / "moved.vtu")
        np.testing.assert_array_equal(Vtu().read(tmp_path / "moved.vtu").points, moved)
        assert (tmp_path / "moved.vtu").read_text().count("\n") > 0.9 * path.read_text().count("\n")


def test_only_coordinates_that_changed_have_other_bytes_in_text(rich, tmp_path):
    source = encoded(rich, tmp_path / "source.vtu", ENCODINGS[0])
    points = Vtu().read(source).points
    points[3, 1] = np.pi
    Vtu().rewrite(source, points, tmp_path / "moved.vtu")
    old, new = (path.read_text().split() for path in (source, tmp_path / "moved.vtu"))
    other = [word for word in new if word not in old]
    assert other[:1] == [repr(np.pi)] or repr(np.pi) in other
    assert len(other) <= 3
    grid = pv.read(tmp_path / "moved.vtu")
    np.testing.assert_array_equal(grid.points, points)


def test_meshio_reads_what_has_no_names(tmp_path):
    mesh = hybrid()
    write_vtu(tmp_path / "mesh.vtu", replace(mesh, patches=()), {"rates": 2.0 * mesh.points})
    read = meshio.read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(read.points, mesh.points)
    np.testing.assert_array_equal(read.point_data["rates"], 2.0 * mesh.points)
    assert {block.type: len(block) for block in read.cells} == {block.shape: len(block) for block in mesh.cells}


def test_polygons_among_lines_are_a_patch(tmp_path):
    points = np.array([[np.cos(a), np.sin(a), z] for z in (0.0, 1.0) for a in np.arange(5) * 0.4 * np.pi])
    sides = [[4, i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5)]
    faces = [[5, 4, 3, 2, 1, 0], [5, 5, 6, 7, 8, 9], *sides]
    prism = [7, *(number for face in faces for number in face)]
    cells = np.array([2, 0, 1, len(prism), *prism, 5, 0, 1, 2, 3, 4])
    path = encoded(pv.UnstructuredGrid(cells, [3, 42, 7], points), tmp_path / "mesh.vtu", ENCODINGS[1])
    mesh = Vtu().read(path)
    assert [len(block) for block in mesh.cells] == [1]
    assert [(patch.name, len(patch)) for patch in mesh.patches] == [("boundary", 1)]


def test_damage_is_named(tmp_path):
    path = tmp_path / "mesh.vtu"
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.nan]])
    encoded(pv.UnstructuredGrid(np.array([4, 0, 1, 2, 3]), [10], corners), path, ENCODINGS[0])
    with pytest.raises(MeshFileError, match=r"mesh\.vtu: 1 points are not finite"):
        Vtu().read(path)
    text = path.read_text()
    line = next(line for line in text.splitlines() if line.split() == ["0", "1", "2", "3"])
    path.write_text(text.replace("nan", "1").replace(line, "0 1 2 99"))
    with pytest.raises(MeshFileError, match=r"mesh\.vtu: 1 nodes of cells are not among the 4 points"):
        Vtu().read(path)
    curved = pv.UnstructuredGrid(np.array([10, *range(10)]), [24], np.random.default_rng(0).random((10, 3)))
    encoded(curved, path, ENCODINGS[0])
    with pytest.raises(MeshFileError, match=r"mesh\.vtu: 1 cells are of VTK's type 24, which is not linear"):
        Vtu().read(path)
    for name, text in (("none.vtu", None), ("text.vtu", "hello"), ("empty.vtu", "")):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(MeshFileError, match=name):
            Vtu().read(tmp_path / name)

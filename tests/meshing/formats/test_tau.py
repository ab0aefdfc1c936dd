"""Grids of TAU: only coordinates change, names are those of the boundary mapping, and other libraries read them."""

import re
from contextlib import suppress
from dataclasses import replace

import h5py
import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.run.inspection import file_figures, inspect
from sdm_deflect.cases.run.mesh_files import OutputFiles
from sdm_deflect.meshing.formats import tau
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, read
from sdm_deflect.meshing.formats.tau import Tau, mapped_names
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.extras import Library
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid, polyhedral
from tests.meshing.formats.netcdf_files import KINDS, classic, parts, written
from tests.meshing.formats.test_hostile import complaint

numpy_support = Library("vtkmodules.util.numpy_support")
netcdf = Library("vtkmodules.vtkIONetCDF")

MAPPING = """
 -----------------------------------------------------
 BOUNDARY MAPPING   # of a wing: Markers and Names
 -----------------------------------------------------
            Markers: 1, 2     # Name: none
               Type: viscous wall
               Name: skin: lower
 block end
 ---------------------------
               Name: far_field
            Markers: 4
 block end
            Markers: 3
               Type: symmetry plane
 block end
            Markers: 5-6, all, 99999999999999999999
               Name: others
 block end
"""


def sorted_faces(mesh: Mesh) -> Mesh:
    """The mesh with triangles before quadrilaterals in each patch, as TAU has them."""
    patches = (replace(p, faces=tuple(sorted(p.faces, key=lambda f: f.shape, reverse=True))) for p in mesh.patches)
    return replace(mesh, patches=tuple(patches))


def test_cells_are_written_by_their_shapes_and_what_is_lost_is_said(tmp_path):
    mesh = hybrid(2)
    empty = replace(mesh, patches=(*mesh.patches, Patch("ünused", ())))
    assert Tau().write(empty, tmp_path / "mesh.grid") == (
        "patch ünused has no faces and is left out", "its zones are one mesh"
    )  # fmt: skip
    again = Tau().read(tmp_path / "mesh.grid")
    assert [block.shape for block in again.cells] == ["tetra", "wedge", "pyramid", "hexahedron"]
    assert content(again)["cells"] == content(mesh)["cells"]
    Tau().write(polyhedral(hybrid()), tmp_path / "mesh.grid")
    assert content(Tau().read(tmp_path / "mesh.grid"))["patches"] == content(sorted_faces(hybrid()))["patches"]
    OpenFoam().write(hybrid(), tmp_path / "case")
    Tau().write(OpenFoam().read(tmp_path / "case"), tmp_path / "mesh.grid")
    with pytest.raises(MeshFileError, match="no volume cells"):
        Tau().write(Mesh(mesh.points, (), ()), tmp_path / "none.grid")
    assert not (tmp_path / "none.grid").exists()


def test_prisms_of_the_file_have_the_order_of_cgns(tmp_path):
    """The first triangle's normal points into the cell, as the other three of TAU's shapes have their first face."""
    written(hybrid(), tmp_path / "mesh.grid")
    _, arrays, dimensions, attributes = parts(tmp_path / "mesh.grid")
    assert arrays["points_of_prisms"].tolist() == [[4, 7, 12, 5, 6, 13]]
    assert arrays["boundarymarker_of_surfaces"].tolist() == [1, 1, 2, 3, 3, 4, 4, 5, 5, 6, 6, 6, 1, 2, 4, 5, 6, 6]
    assert dimensions["no_of_elements"] == 7
    assert dimensions["no_of_surfaceelements"] == 18
    assert attributes["type"] == b"Primary Grid: Tau Format"
    assert attributes["marker_4"] == b"left wall"


def test_the_netcdf_library_reads_what_is_written_and_rewritten(tmp_path):
    mesh, out = hybrid(), tmp_path / "out.grid"
    for kind in KINDS:
        Tau().rewrite(written(mesh, tmp_path / "mesh.grid", kind), mesh.points * 3.0, out)
        for path, factor in ((tmp_path / "mesh.grid", 1.0), (out, 3.0)):
            reader = netcdf.vtkNetCDFReader()
            reader.SetFileName(str(path))
            reader.UpdateMetaData()
            reader.SetDimensions("(no_of_points)")
            reader.Update()
            found = numpy_support.vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("points_yc"))
            np.testing.assert_allclose(found, factor * mesh.points[:, 1], rtol=2e-7 if kind == "single" else 0)


def test_quality_and_names_of_other_endings(tmp_path):
    written(hybrid(), tmp_path / "wing.grid.def.1")
    assert format_of(tmp_path / "wing.grid.def.1") is FORMATS["tau"]
    assert (
        OutputFiles.of(tmp_path / "wing.grid.def.1", None, ((5.0,),)).out == tmp_path / "wing.grid.def-deflected.grid"
    )
    assert OutputFiles.of(tmp_path / "wing.taumesh", None, ((5.0,),)).out == tmp_path / "wing-deflected.taumesh"
    written(hybrid(), tmp_path / "wing", "hdf5")
    for name in ("wing", "wing.grid.def.1"):
        assert file_figures(tmp_path / name)["patches"]["roof"] == 5
        assert re.search(r"^1 prisms .* 0$", inspect(tmp_path / name), re.MULTILINE)


def test_cgns_is_kept_apart(tmp_path):
    Cgns().write(hybrid(), tmp_path / "mesh.cgns")
    assert format_of(tmp_path / "mesh.cgns").name == "cgns"
    (tmp_path / "mesh.cgns").rename(tmp_path / "mesh.dat")
    with pytest.raises(MeshFileError, match="no mesh format has the suffix"):
        format_of(tmp_path / "mesh.dat")
    assert "no variable points_xc; this is no primary grid" in complaint(Tau(), (tmp_path / "mesh.dat"))


def test_names_of_a_mapping():
    assert mapped_names(MAPPING) == {1: "skin: lower", 2: "skin: lower", 4: "far_field"}
    assert mapped_names("") == {}


def test_a_mapping_beside_the_grid_names_its_patches(tmp_path):
    (tmp_path / "wing.bmap").write_text(MAPPING)
    (tmp_path / "wing2.bmap").write_text(MAPPING.replace("far_field", "another"))
    for name in ("wing.grid", "wing-deflected_-12.grid", "wing.grid.def.1"):
        names = {patch.name: len(patch) for patch in read(written(hybrid(), tmp_path / name)).patches}
        assert names == {"skin: lower": 5, "outlet": 2, "far_field": 3, "right wall": 3, "roof": 5}
    other = read(written(hybrid(), tmp_path / "win.grid"))
    assert [patch.name for patch in other.patches] == ["floor", "inlet", "outlet", "left wall", "right wall", "roof"]
    (tmp_path / "win.bmap").write_text("Markers: 77\nName: of another grid\nblock end\n" + "#" * 2_000_000)
    (tmp_path / "win.para").write_text("Primary grid filename: win.grid\nblock end\nMarkers: 6\nName: top\n")
    assert read(tmp_path / "win.grid").patches[5].name == "top"
    (tmp_path / "win.bmap").write_bytes(b"Markers: 6\nName: t\0op\nblock end\nMarkers: 5\nName: \0\0\nblock end")
    assert [patch.name for patch in read(tmp_path / "win.grid").patches[4:]] == ["5", "top"]


def test_markers_without_a_name_are_numbers(tmp_path):
    path = written(hybrid(), tmp_path / "mesh.grid")
    names, arrays, _, _ = parts(path)
    arrays["boundarymarker_of_surfaces"] = arrays["boundarymarker_of_surfaces"] * 10 - 30
    classic(path, names, arrays, {"marker_30": b""}, 1)
    assert [patch.name for patch in read(path).patches] == ["-20", "-10", "0", "10", "20", "30"]


def test_a_grid_without_boundary(tmp_path):
    mesh = replace(hybrid(), patches=())
    assert read(written(mesh, tmp_path / "mesh.grid")).patches == ()


def changed(path, **values):
    """Write the grid anew with other variables; None leaves one out."""
    names, arrays, _, attributes = parts(path)
    names |= {name: tuple(f"{name}_{i}" for i in range(np.ndim(v))) for name, v in values.items() if v is not None}
    arrays = {name: values.get(name, array) for name, array in arrays.items()} | values
    classic(path, names, {name: np.asarray(a) for name, a in arrays.items() if a is not None}, attributes, 2)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"points_yc": None}, "no variable points_yc; this is no primary grid of TAU"),
        ({"points_yc": np.zeros(13)}, r"points_xc, points_yc, points_zc have different lengths: \[13, 14\]"),
        ({"points_yc": np.zeros(14, "i4")}, r"points_yc holds \(14,\) >i4, expected"),
        ({"points_xc": np.zeros((14, 2))}, r"points_xc holds \(14, 2\) >f8, expected"),
        ({"points_xc": 1.0}, r"points_xc holds \(\) >f8, expected"),
        ({"points_zc": np.full(14, np.nan)}, "14 points are not finite"),
        ({"points_of_pyramids": np.array([[1, 2, 6, 5, 14]], "i4")}, r"1 pyramid elements name .* the 14 \(0 to 13\)"),
        ({"points_of_pyramids": np.array([[1, 2, 6, 5, -1]], "i4")}, "1 pyramid elements name points"),
        ({"points_of_pyramids": np.array([[1, 2, 6, 5]], "i4")}, r"holds \(1, 4\) >i4, expected \(N, 5\) whole"),
        ({"points_of_pyramids": np.zeros((1, 5))}, "points_of_pyramids holds .* >f8, expected"),
        ({"points_of_pyramids": np.zeros((1, 5), "S1")}, r"points_of_pyramids holds .* \|S1, expected"),
        ({"points_of_pyramids": np.int32(7)}, r"points_of_pyramids holds \(\) >i4"),
        ({"points_of_surfacetriangles": np.array([[0, 1, 9]] * 12, "i4")}, "12 of .* are of no cell|faces of patch"),
        ({"boundarymarker_of_surfaces": None}, "no variable boundarymarker_of_surfaces, but there are 18 faces"),
        ({"boundarymarker_of_surfaces": np.zeros(17, "i4")}, "holds 17 markers of 18 triangles and quadrilaterals"),
        ({"boundarymarker_of_surfaces": np.zeros(18)}, r"holds \(18,\) >f8, expected"),
    ],
)  # fmt: skip
def test_what_contradicts_is_named(values, said, tmp_path):
    path = written(hybrid(), tmp_path / "mesh.grid")
    changed(path, **values)
    with pytest.raises(MeshFileError, match=f"{path}: .*({said})"):
        Tau().read(path)
    complaint(Tau(), path)


def test_a_shape_of_cells_that_is_not_known_is_missed(tmp_path):
    path = written(hybrid(), tmp_path / "mesh.grid")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"points_of_pyramids", b"points_of_octaeders"[:18]))
    assert "no_of_elements is 7, but 6 of the shapes that are supported are there" in complaint(Tau(), path)
    names, arrays, _, attributes = parts(path)
    names["boundarymarker_of_surfaces"] = ("no_of_surfaceelements",)
    del arrays["points_of_surfacetriangles"]
    classic(path, names, arrays, attributes, 1)
    assert "no_of_surfaceelements is 18, but 6 of the shapes" in complaint(Tau(), path)


def test_an_unlimited_dimension_is_refused(tmp_path):
    path = written(hybrid(), tmp_path / "mesh.grid")
    names, arrays, _, attributes = parts(path)
    classic(path, names, arrays, attributes, 2, growing="no_of_points")
    assert "points_xc has an unlimited dimension; fix its length with `nccopy -u" in complaint(Tau(), path)


def test_very_many_markers(tmp_path, monkeypatch):
    monkeypatch.setattr(tau, "MOST", 10)
    path = written(hybrid(), tmp_path / "mesh.grid")
    changed(path, boundarymarker_of_surfaces=np.arange(18, dtype="i4"))
    assert "holds 18 different markers, expected at most 10" in complaint(Tau(), path)


def test_any_number_in_the_header(tmp_path):
    """Each word of four bytes in the header takes values that few files can have."""
    good = written(hybrid(), tmp_path / "mesh.grid", "cdf1")
    data, mesh, path = good.read_bytes(), content(read(good)), tmp_path / "bad.grid"
    for at in range(4, data.index(b"points_zc"), 4):
        for value in (b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\0\x07"):
            path.write_bytes(data[:at] + value + data[at + 4 :])
            with suppress(MeshFileError):
                assert content(Tau().read(path))["cells"] == mesh["cells"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (h5py.SoftLink("/points_zc"), "points_xc is a link; only what lies in the file itself"),
        ({"shape": (14,), "dtype": "f8", "external": [("/dev/zero", 0, 112)]}, "points_xc holds data of other files"),
        ({"shape": (10**10,), "dtype": "f8", "chunks": (1000,)}, "the data of points_xc would take"),
        ({"shape": (10**6,), "dtype": "f8", "chunks": (1000,)}, "points_xc holds 0 of 1000 parts"),
        ({"data": h5py.Empty("f8")}, "points_xc holds no real numbers"),
        ({"data": np.zeros(14, "c16")}, "points_xc holds no real numbers"),
    ],
)
def test_data_that_are_not_in_the_file(given, said, tmp_path):
    path = written(hybrid(), tmp_path / "mesh.grid", "hdf5")
    with h5py.File(path, "r+") as file:
        del file["points_xc"]
        if isinstance(given, dict):
            file.create_dataset("points_xc", **given)
        else:
            file["points_xc"] = given
    with pytest.raises(MeshFileError, match=said):
        Tau().read(path)
    complaint(Tau(), path)

"""A file's name says its format, or what to do with it."""

import inspect
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.registration import REGISTERED, writable
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, read
from tests.meshing.formats.examples import hybrid


@pytest.mark.parametrize(
    ("name", "form"),
    [("a.su2", "su2"), ("a.CGNS", "cgns"), ("wing.v2.msh", "gmsh"), ("a.vtu", "vtu"), ("case.foam", "openfoam"),
     ("a.grid", "tau"), ("a.taumesh", "tau"), ("a.NC", "tau"),
     ("wing.lb8.UGRID", "ugrid"), ("a.ugrid", "ugrid"), ("a.msh.h5", "fluent"), ("wing.v2.CAS.H5", "fluent"),
     ("a.p3d", "plot3d"), ("n0012.p2dfmt", "plot3d"), ("a.XYZ", "plot3d"), ("a.x", "plot3d"), ("a.g", "plot3d"),
     ("a.ufmt", "plot3d"),
     ("new_case", "openfoam"), ("alpha-12.5", "openfoam"), ("flap_+0.5", "openfoam")],
)  # fmt: skip
def test_suffixes(name, form):
    assert format_of(Path(name)) is FORMATS[form]
    assert format_of(name) is FORMATS[form]


@pytest.mark.parametrize("form", FORMATS)
def test_what_is_known_of_a_format_before_it_is_loaded(form):
    assert (FORMATS[form].name, FORMATS[form].suffixes) == (form, REGISTERED[form].suffixes)
    assert FORMATS[form].written == REGISTERED[form].written
    assert FORMATS[form] is FORMATS[form]


@pytest.mark.parametrize("form", FORMATS)
def test_every_method_is_described_by_the_format_or_by_its_base(form):
    methods = inspect.getmembers(type(FORMATS[form]), inspect.isfunction)
    assert [name for name, one in methods if not name.startswith("_") and not inspect.getdoc(one)] == []


def test_a_file_loads_the_modules_of_its_own_format():
    ask = """
import sys
from pathlib import Path
from sdm_deflect.cases.run.mesh_files import OutputFiles

OutputFiles.of(Path("a.cgns"), None, ((1.0,),)).check()
print(*sys.modules)
"""
    loaded = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout.split()
    assert "sdm_deflect.meshing.formats.cgns" in loaded
    assert not {entry.module for name, entry in REGISTERED.items() if name != "cgns"} & set(loaded)


def test_any_folder_is_an_openfoam_case(tmp_path):
    (tmp_path / "alpha-12.5").mkdir()
    assert format_of(tmp_path / "alpha-12.5").name == "openfoam"


@pytest.mark.parametrize(
    ("name", "said"),
    [("a.cas", "fluentMeshToFoam"), ("a.med", r"gmsh a\.med -save"), ("a.stl", "volume cells"), ("a.vtk", "PyVista"),
     ("a.su2.gz", r"gunzip a\.su2\.gz"),
     ("a.off", r"known are \.cas\.h5, \.cgns, \.foam, \.g, \.grid, \.msh, \.msh\.h5, \.nc, \.p2d, \.p2dfmt, \.p3d, "
      r"\.p3dfmt, \.su2, \.taumesh, \.ufmt, \.ugrid, \.vtu, \.x, \.xyz")],
)  # fmt: skip
def test_other_files_are_refused_with_advice(name, said):
    with pytest.raises(MeshFileError, match=rf"{name}: no mesh format .*{said}"):
        format_of(Path(name))


def test_a_file_without_suffix_is_not_taken_for_a_case(tmp_path):
    (tmp_path / "mesh").touch()
    with pytest.raises(MeshFileError, match="known are"):
        format_of(tmp_path / "mesh")


@pytest.mark.parametrize("form", FORMATS)
def test_a_missing_file_is_an_error_that_names_it(form, tmp_path):
    path = tmp_path / f"none{FORMATS[form].suffixes[0]}"
    with pytest.raises(MeshFileError, match="none"):
        FORMATS[form].read(path if form != "openfoam" else tmp_path / "none")


@pytest.mark.parametrize("form", writable())
def test_a_mesh_bears_the_name_of_its_file(form, tmp_path, monkeypatch):
    path = tmp_path / ("case" if form == "openfoam" else f"wing{FORMATS[form].suffixes[0]}")
    FORMATS[form].write(hybrid(), path)
    for given in (path, str(path)):
        mesh = read(given)
        assert (mesh.name, mesh.source) == (path.name, str(path))
    if form == "openfoam":
        monkeypatch.chdir(path)
        assert read(".").name == "case"


def test_a_name_that_commands_a_terminal_is_shown_as_escapes(tmp_path):
    mesh = hybrid()
    named = replace(mesh.patches[0], name="\x1b[2J\x07floor")
    path = tmp_path / "wing.su2"
    FORMATS["su2"].write(replace(mesh, patches=(named, *mesh.patches[1:])), path)
    path.write_text(path.read_text().replace("5 1 2 8", "5 1 2 9"))
    with pytest.raises(MeshFileError, match=r"1 of 3 faces of patch \\x1b\[2J\\x07floor are of no cell"):
        read(path)

"""What holds for the files of every format, however they store numbers."""

from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.known import entries
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, read
from tests.meshing.formats import fluent_files, netcdf_files, plot3d_files
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.gmsh_files import gmsh_data

MADE = {
    "su2": "mesh.su2", "cgns": "mesh.cgns", "gmsh": "mesh.msh", "gmsh 4.1": "binary.msh", "ugrid": "mesh.ugrid",
    "ugrid b8": "mesh.b8.ugrid", "ugrid lr4": "mesh.lr4.ugrid", "tau": "mesh.grid", "tau hdf5": "hdf5.grid",
    "tau packed": "packed.grid", "fluent": "mesh.cas.h5", "fluent packed": "packed.msh.h5", "plot3d": "mesh.p3d",
    "plot3d text": "text.p3d", "vtu": "mesh.vtu", "openfoam": "case",
}  # fmt: skip
"""A file of each format, and of each way to store it."""
SINGLE = [name for name in MADE if name != "openfoam"]


def made(name: str, folder: Path) -> Path:
    """Write a small mesh of one of `MADE`."""
    path = folder / MADE[name]
    if name == "gmsh 4.1":
        path.write_bytes(gmsh_data(hybrid()))
    elif name.startswith("fluent"):
        fluent_files.written(hybrid(), path, **({"compression": "gzip", "chunks": True} if "packed" in name else {}))
    elif name.startswith("tau "):
        netcdf_files.written(hybrid(), path, name.split()[1])
    elif name.startswith("plot3d"):
        plot3d_files.written(path, [plot3d_files.box()], "text" if "text" in name else "<f8")
    else:
        format_of(path).write(hybrid(), path)
    return path


def bytes_of(path: Path) -> dict[Path, bytes]:
    """All files of a mesh."""
    return {file: file.read_bytes() for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file()}


def refused(path: Path) -> str:
    """The one sentence with which a file is refused; it stays as it is."""
    before = bytes_of(path)
    with pytest.raises(MeshFileError) as caught:
        format_of(path).read(path)
    assert bytes_of(path) == before
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_a_file_is_made_of_every_format():
    assert {name.split()[0] for name in MADE} == set(entries())


@pytest.mark.parametrize("name", [name for name in SINGLE if "plot3d" not in name])  # the half of a grid may be one
def test_a_file_cut_anywhere_is_not_read_in_part(name, tmp_path):
    path = made(name, tmp_path)
    data = path.read_bytes().rstrip()
    for size in (*range(0, 64, 3), *range(64, len(data) - 1, len(data) // 40)):
        path.write_bytes(data[:size])
        refused(path)


@pytest.mark.parametrize("name", SINGLE)
def test_other_content_is_refused(name, tmp_path):
    path = made(name, tmp_path)
    for content in (b"", b"\n", b"a = 1\n", b"\x89HDF\r\n\x1a\n\0\0" + bytes(range(256)), bytes(4000), b"<a><b>" * 9):
        path.write_bytes(content)
        refused(path)


@pytest.mark.parametrize("name", SINGLE)
def test_a_missing_file_and_a_folder_are_named(name, tmp_path):
    form = format_of(tmp_path / MADE[name])
    for path in (tmp_path / f"none-{MADE[name]}", tmp_path):
        with pytest.raises(MeshFileError, match=str(path)):
            form.read(path)


@pytest.mark.parametrize("name", MADE)
def test_unmoved_points_leave_every_byte(name, tmp_path):
    path, out = made(name, tmp_path), tmp_path / "out" / MADE[name]
    out.parent.mkdir()
    format_of(path).rewrite(path, read(path).points, out)
    assert {file.relative_to(out): data for file, data in bytes_of(out).items()} == {
        file.relative_to(path): data for file, data in bytes_of(path).items()
    }


@pytest.mark.parametrize("name", MADE)
def test_the_source_is_never_written(name, tmp_path):
    path = made(name, tmp_path)
    before, points = bytes_of(path), read(path).points + 1.0
    (tmp_path / "link").mkdir()
    link = tmp_path / "link" / MADE[name]
    link.symlink_to(path)
    for out in (path, link, tmp_path / ".." / tmp_path.name / MADE[name]):
        with pytest.raises(MeshFileError, match=r"write to another file|exists already|lies in the case"):
            format_of(path).rewrite(path, points, out)
    assert bytes_of(path) == before


@pytest.mark.parametrize("name", MADE)
@pytest.mark.parametrize("wrong", ["fewer", "not finite"])
def test_points_that_do_not_fit_leave_nothing_behind(name, wrong, tmp_path):
    path = made(name, tmp_path)
    points = read(path).points
    count, before = len(points), sorted(tmp_path.rglob("*"))
    given, said = (points[1:], f"the file has {count} points, but") if wrong == "fewer" else (
        np.where(np.arange(count)[:, None] == 3, np.nan, points), f"1 of the {count} points to write are not finite"
    )  # fmt: skip
    with pytest.raises(MeshFileError, match=said):
        format_of(path).rewrite(path, given, tmp_path / "new" / MADE[name])
    assert sorted(file for file in tmp_path.rglob("*") if file.name != "new") == before


@pytest.mark.parametrize("name", [name for name in MADE if " " not in name])
def test_progress_rises(name, tmp_path):
    path, told = made(name, tmp_path), []
    form, points = format_of(path), read(path).points
    form.read(path, lambda *said: told.append(said))
    form.rewrite(path, points * 2.0, tmp_path / f"a{MADE[name]}", lambda *said: told.append(said))
    if form.written:
        form.write(hybrid(), tmp_path / f"b{MADE[name]}", lambda *said: told.append(said))
    assert told
    for what in {what for what, _ in told}:
        fractions = [fraction for said, fraction in told if said == what]
        assert fractions == sorted(fractions) or what.startswith("reading")
        assert 0.0 <= min(fractions) <= max(fractions) <= 1.0


@pytest.mark.parametrize("name", [name for name in entries() if name != "openfoam" and entries()[name].written])
def test_a_folder_that_cannot_be_written_is_named(name, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MeshFileError, match="cannot be written"):
        FORMATS[name].write(hybrid(), tmp_path / "file" / MADE[name])


@pytest.mark.parametrize("name", ["tau", "plot3d", "ugrid lr4", "fluent"])
def test_single_precision_has_its_range(name, tmp_path):
    path = tmp_path / MADE[name]
    if name == "tau":
        netcdf_files.written(hybrid(), path, "single")
    elif name == "fluent":
        fluent_files.written(hybrid(), path, real="f4")
    elif name == "plot3d":
        plot3d_files.written(path, [plot3d_files.box()], ">f4")
    else:
        made(name, tmp_path)
    points = np.full_like(read(path).points, 1e39)
    with pytest.raises(MeshFileError, match="coordinates are too large for numbers of 4 bytes"):
        format_of(path).rewrite(path, points, tmp_path / f"out-{MADE[name]}")
    assert not (tmp_path / f"out-{MADE[name]}").exists()

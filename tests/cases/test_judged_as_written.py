"""What is judged is what is on the disk: rounded as the file rounds, read back, and of a source that did not change."""

import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from sdm_deflect import deflect, read
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.cases.run import deflect_file as command
from sdm_deflect.cases.run.mesh_files import OutputFiles
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.cases.settings.job_settings import settings_of
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.checks import layer_change
from sdm_deflect.meshing.formats.openfoam import MESH, write_list
from sdm_deflect.meshing.formats.registry import format_of, known_format
from tests.deform.blocks import block_with_body
from tests.limits import limited
from tests.meshing.formats import fluent_files, netcdf_files
from tests.meshing.formats.gmsh_files import gmsh_data
from tests.meshing.formats.wing import wing

BODY = {"surfaces": "body", "hinge": [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]}
FLAP = {"surfaces": "flap_*", "fixed": ["wing_*"], "slide": {"symmetry": "plane"}, "motion": "blended", "repair": "off"}


def single_cgns(mesh, path):
    format_of(path).write(mesh, path)
    with h5py.File(path, "r+") as file:
        for axis in "XYZ":
            node = file[f"Base/Zone/GridCoordinates/Coordinate{axis}"]
            values = node[" data"][()].astype("f4")
            del node[" data"]
            node.create_dataset(" data", data=values)
            node.attrs["type"] = np.bytes_("R4")


def single_case(mesh, path):
    format_of(path).write(mesh, path)
    write_list(path / MESH / "points", "vectorField", [mesh.points.astype("<f4")])
    text = (path / MESH / "points").read_bytes()
    (path / MESH / "points").write_bytes(text.replace(b"scalar=64", b"scalar=32"))


# Files that keep 32 bits of a coordinate.
SINGLE = {
    "mesh.lb4.ugrid": lambda mesh, path: format_of(path).write(mesh, path),
    "mesh.r4.ugrid": lambda mesh, path: format_of(path).write(mesh, path),
    "single.cgns": single_cgns,
    "single.grid": lambda mesh, path: netcdf_files.written(mesh, path, "single"),
    "single.cas.h5": lambda mesh, path: fluent_files.written(mesh, path, real="f4"),
    "single": single_case,
}
DOUBLE = {
    name: lambda mesh, path: format_of(path).write(mesh, path)
    for name in ("mesh.su2", "mesh.cgns", "mesh.msh", "mesh.ugrid", "mesh.lb8.ugrid", "mesh.grid", "mesh.vtu", "mesh")
} | {
    "binary.msh": lambda mesh, path: path.write_bytes(gmsh_data(mesh)),
    "mesh.cas.h5": lambda mesh, path: fluent_files.written(mesh, path),
}
# Coordinates by NumPy and the formats' own libraries.
ON_DISK = {
    "mesh.lb4.ugrid": lambda path, n: np.fromfile(path, "<f4", 3 * n, offset=28).reshape(n, 3),
    "mesh.r4.ugrid": lambda path, n: np.fromfile(path, ">f4", 3 * n, offset=40).reshape(n, 3),
    "single.cgns": lambda path, n: hdf5(path, *(f"Base/Zone/GridCoordinates/Coordinate{axis}/ data" for axis in "XYZ")),
    "single.grid": lambda path, n: netcdf(path),
    "single.cas.h5": lambda path, n: hdf5(path, fluent_files.COORDS)[:, 0],
    "single": lambda path, n: foam_points(path, n),
}


def hdf5(path, *names):
    with h5py.File(path) as file:
        return np.stack([file[name][()] for name in names], axis=1)


def netcdf(path):
    with netcdf_file(path, "r", mmap=False) as file:
        return np.stack([file.variables[f"points_{axis}c"].data.copy() for axis in "xyz"], axis=1)


def foam_points(path, n):
    data = (path / MESH / "points").read_bytes()
    return np.frombuffer(data, "<f4", 3 * n, data.index(b"%d\n(" % n) + len(b"%d\n(" % n)).reshape(n, 3)


def run(source, out, angle=5.0, **asked):
    """Deflect a file as the command does."""
    settings = settings_of(asked.pop("surfaces"), asked.pop("hinge"), angle, asked)
    return command.deflect_file(OutputFiles.of(source, out, ((angle,),)), jobs_of(settings), Stopwatch())


def value(checks, name):
    return next(check for check in checks if check.name == name)


@pytest.fixture(scope="module")
def thin():
    """A wing in an aircraft's frame: a number of 32 bits cannot tell a tenth of its first layer."""
    found = wing(cells=2, first_height=3e-4)
    shift = np.array([300.0, 0.0, 1500.0])
    return replace(found, mesh=found.mesh.with_points(found.mesh.points + shift), hinge=found.hinge + shift)


@pytest.mark.parametrize("name", SINGLE)
def test_the_verdict_is_of_the_numbers_on_the_disk(name, thin, tmp_path):
    SINGLE[name](thin.mesh, tmp_path / name)
    out = tmp_path / f"out{name.removeprefix('single').removeprefix('mesh')}"
    done = run(tmp_path / name, out, hinge=thin.hinge, **FLAP)
    points = ON_DISK[name](out, len(thin.mesh.points)).astype(np.float64)
    before = ON_DISK[name](tmp_path / name, len(points)).astype(np.float64)
    checks = {check.name: check for check in done.poses[0].checks}
    for quality in done.plan.affected.quality(points):
        assert checks[f"quality_min:{quality.shape}"].value == quality.min
    change = layer_change(done.plan.boxes[0], points)
    assert checks["layer_height"].value == change.changes.max()
    broken = [check for check in checks.values() if not check.passed]
    layers = checks["layer_height"]
    assert layers.verdict != "passed"
    assert layers.cause == "rounding"
    assert all("coordinates of 32 bits" in one.where and "double precision" in one.where for one in broken)
    assert checks["outside_moved"].value == 0.0
    moved = (points != before).any(axis=1)
    inside = np.zeros(len(points), dtype=bool)
    inside[done.plan.movable] = True
    assert moved.any()
    assert not moved[~inside].any()


def test_rounding_that_breaks_nothing_is_no_matter(tmp_path):
    """And a node that slides on a plane of any direction stays there as near as its numbers allow."""
    mesh = block_with_body()
    tilted = mesh.with_points(mesh.points @ np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0])
    format_of(tmp_path / "mesh.lb4.ugrid").write(tilted, tmp_path / "mesh.lb4.ugrid")
    hinge = tilted.points[tilted.patch("body").nodes].mean(axis=0) + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = deflect(tmp_path / "mesh.lb4.ugrid", "body", hinge, 4.0, slide={"y-": "plane"}, margin=1.6)
    rounded = found.stored_in(tmp_path / "out.lb4.ugrid")
    assert found.passed
    assert rounded.passed
    assert rounded.points.astype("f4").tolist() == rounded.points.tolist()
    assert (rounded.points != found.points).any()
    found.save(tmp_path / "out.lb4.ugrid")
    np.testing.assert_array_equal(read(tmp_path / "out.lb4.ugrid").points, rounded.points)


def test_a_result_is_not_saved_where_rounding_breaks_a_check_that_passed(thin, tmp_path):
    found = deflect(thin.mesh, hinge=thin.hinge, angle=5.0, **FLAP)
    assert found.passed
    with pytest.raises(InputError, match=r"wing.lb4.ugrid: .* is .* there, .*32 bits, .*such as wing.lb8.ugrid"):
        found.save(tmp_path / "wing.lb4.ugrid")
    assert not any(tmp_path.iterdir())
    rounded = found.stored_in(tmp_path / "wing.lb4.ugrid")
    assert not rounded.passed
    with pytest.warns(UserWarning, match="wing.lb4.ugrid: "):
        rounded.save(tmp_path / "wing.lb4.ugrid")
    np.testing.assert_array_equal(read(tmp_path / "wing.lb4.ugrid").points, rounded.points)


def other_point(points, changed, single):
    """Move one coordinate by the least that the file can tell."""
    moved, row = points.copy(), changed[len(changed) // 2]
    kind = np.float32 if single else np.float64
    moved[row, 1] = np.nextafter(kind(moved[row, 1]), kind(9.0))
    return moved


@pytest.fixture
def spoiled(monkeypatch):
    """Let what is written be another mesh than the one that is asked for."""
    genuine = command.write_mesh

    def spoil(single=False):
        def write(source, mesh, points, out, *more):
            changed = np.flatnonzero((points != mesh.points).any(axis=1))
            return genuine(source, mesh, other_point(points, changed, single), out, *more)

        monkeypatch.setattr(command, "write_mesh", write)

    return spoil


@pytest.mark.parametrize("large", [1 << 60, 0], ids=["whole", "pieces"])
@pytest.mark.parametrize("name", SINGLE | DOUBLE)
def test_a_copy_that_is_not_what_was_judged_is_discarded(name, large, spoiled, tmp_path, monkeypatch):
    source, folder = tmp_path / name, tmp_path / "new"
    (SINGLE | DOUBLE)[name](block_with_body(), source)
    folder.mkdir()
    limited(monkeypatch, file=large)
    spoiled(name in SINGLE)
    with pytest.raises(MeshFileError, match=r"out\S*: what was written does not read back as what was judged"):
        run(source, folder / f"out{name.removeprefix(name.partition('.')[0])}", **BODY)
    assert not any(folder.iterdir())


@pytest.mark.parametrize("name", [name for name in DOUBLE if not name.startswith("binary") and "cas" not in name])
def test_a_new_file_that_is_not_what_was_judged_is_discarded(name, spoiled, tmp_path):
    source, folder = tmp_path / ("source.lb8.ugrid" if name != "mesh.lb8.ugrid" else "source.su2"), tmp_path / "new"
    DOUBLE["mesh.su2"](block_with_body(), source)
    folder.mkdir()
    run(source, folder / f"good{name.removeprefix('mesh')}", **BODY)
    kept = sorted(folder.iterdir())
    spoiled()
    with pytest.raises(MeshFileError, match="does not read back as what was judged"):
        run(source, folder / f"out{name.removeprefix('mesh')}", **BODY)
    assert sorted(folder.iterdir()) == kept


def exchanged(path):
    """Put another mesh of as many bytes in the place of a file, without changing a byte of the old one."""
    new = path.with_name(f"new-{path.name}")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    new.write_bytes(data)
    new.replace(path)


def edited(path):
    """Change a byte in place, and its time by the least that there is."""
    time = path.stat().st_mtime_ns
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"x")
    os.utime(path, ns=(time, time + 1))


@pytest.mark.parametrize("change", [exchanged, edited, Path.unlink])
@pytest.mark.parametrize("large", [1 << 60, 0], ids=["whole", "pieces"])
@pytest.mark.parametrize(
    ("name", "file"),
    [("mesh.su2", "."), ("mesh.cgns", "."), ("mesh.lb8.ugrid", "mesh.mapbc"), ("mesh", MESH / "boundary")],
)
def test_a_source_that_changes_ends_the_command(name, file, large, change, tmp_path, monkeypatch):
    """The file is changed once the plan is made, from a callback: no clock, no other process."""
    source, folder = tmp_path / name, tmp_path / "new"
    DOUBLE[name](block_with_body(), source)
    folder.mkdir()
    limited(monkeypatch, file=large)
    path = source if file == "." else source / file if source.is_dir() else source.with_name(file)

    def planned(*words):
        found = genuine(*words)
        change(path)
        return found

    genuine = command.plan_file
    monkeypatch.setattr(command, "plan_file", planned)
    with pytest.raises((InputError, MeshFileError)) as error:
        run(source, folder / f"out{name.removeprefix('mesh')}", **BODY)
    assert str(path) in str(error.value)
    assert not any(folder.iterdir())


@pytest.mark.parametrize("name", ["mesh.cgns", "mesh"])
def test_a_source_that_changes_between_pieces_ends_the_command(name, tmp_path, monkeypatch):
    source = tmp_path / name
    DOUBLE[name](block_with_body(), source)
    path = source / MESH / "owner" if source.is_dir() else source
    with command.in_pieces(source) as mesh:
        assert mesh.pieces.coordinates(0, 9).shape == (9, 3)
        edited(path)
        for read_more in (lambda: mesh.pieces.coordinates(0, 9), lambda: mesh.pieces.cells_of(0, 0, 3)):
            with pytest.raises(InputError, match=rf"{path.name}: was changed or replaced while it was in use"):
                read_more()


def test_a_source_that_changed_since_it_was_read_is_not_copied(tmp_path):
    """But a file of another format can be written: it takes nothing from the source."""
    DOUBLE["mesh.su2"](block_with_body(), tmp_path / "mesh.su2")
    found = deflect(tmp_path / "mesh.su2", angle=5.0, **BODY)
    with (tmp_path / "mesh.su2").open("ab") as file:
        file.write(b"% a comment\n")
    with pytest.raises(InputError, match=r"mesh\.su2: was changed or replaced"):
        found.save(tmp_path / "out.su2")
    found.save(tmp_path / "out.cgns")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mesh.su2", "out.cgns"]


def test_every_format_that_can_be_rewritten_is_here():
    names = {known_format(Path(name)).name for name in (*SINGLE, *DOUBLE, "mesh.xyz") if "." in name}
    from sdm_deflect.meshing.formats.registry import FORMATS

    assert names | {"openfoam"} == set(FORMATS)

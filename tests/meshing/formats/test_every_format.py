"""What holds for the files of every format, however they store numbers."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product, repeat
from pathlib import Path

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.run.mesh_files import OutputFiles
from sdm_deflect.meshing.formats.registration import REGISTERED
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, read
from sdm_deflect.meshing.formats.ugrid_file import ENCODINGS
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import by_shape, find_orientation
from tests.deform.blocks import block_with_body
from tests.meshing.formats import fluent_files, netcdf_files, plot3d_files
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid, polyhedral
from tests.meshing.formats.gmsh_files import VARIANTS, by_gmsh, gmsh_data

# A file of each format, and of each way to store it.
MADE = {
    "su2": "mesh.su2", "cgns": "mesh.cgns", "gmsh": "mesh.msh", "gmsh 4.1": "binary.msh", "ugrid": "mesh.ugrid",
    "ugrid b8": "mesh.b8.ugrid", "ugrid lr4": "mesh.lr4.ugrid", "tau": "mesh.grid", "tau hdf5": "hdf5.grid",
    "tau packed": "packed.grid", "fluent": "mesh.cas.h5", "fluent packed": "packed.msh.h5", "plot3d": "mesh.p3d",
    "plot3d text": "text.p3d", "vtu": "mesh.vtu", "openfoam": "case",
}  # fmt: skip
SINGLE = [name for name in MADE if name != "openfoam"]


def made(name: str, folder: Path, mesh: Mesh | None = None) -> Path:
    """Write a small mesh of one of `MADE`."""
    path, mesh = folder / MADE[name], mesh or hybrid()
    if name == "gmsh 4.1":
        path.write_bytes(gmsh_data(mesh))
    elif name.startswith("fluent"):
        fluent_files.written(mesh, path, **(fluent_files.PACKED if "packed" in name else {}))
    elif name.startswith("tau "):
        netcdf_files.written(mesh, path, name.split()[1])
    elif name.startswith("plot3d"):
        plot3d_files.written(path, [plot3d_files.box()], "text" if "text" in name else "<f8")
    else:
        format_of(path).write(mesh, path)
    return path


def test_one_mesh_has_one_quality_in_every_format(tmp_path: Path) -> None:
    """In formats of faces the quality of a tetrahedron once was 1/4, whatever its shape."""
    mesh = hybrid()
    mesh = mesh.with_points(mesh.points + 0.03 * np.random.default_rng(26).normal(size=mesh.points.shape))
    expected = {quality.shape: quality for quality in by_shape(mesh.points, [(b, None, 1.0) for b in mesh.cells])}
    faces = replace(polyhedral(mesh), zones=())
    paths = [made(name, tmp_path, mesh) for name in ("su2", "cgns", "gmsh", "ugrid b8", "openfoam", "fluent", "vtu")]
    FORMATS["cgns"].write(faces, tmp_path / "ngon.cgns")
    assert len(expected) == 4
    for path in (*paths, tmp_path / "ngon.cgns"):
        stored = read(path)
        signs = [find_orientation(stored.points, block)[0] for block in stored.cells]
        found = by_shape(stored.points, zip(stored.cells, repeat(None), signs, strict=False))
        assert {quality.shape: quality.cells for quality in found} == {name: q.cells for name, q in expected.items()}
        for quality in found:
            own = expected[quality.shape]
            assert quality.inverted == own.inverted == 0
            np.testing.assert_allclose((quality.min, quality.p01, quality.mean), (own.min, own.p01, own.mean), 1e-12)


def encoded() -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Yield every other way to store the numbers of a hybrid mesh: a name, and what writes it into a folder."""
    for name in ENCODINGS:
        yield f"mesh.{name}.ugrid", lambda folder, name=name: write(folder / f"mesh.{name}.ugrid")
    for kind in netcdf_files.KINDS:
        yield f"{kind}.grid", lambda folder, kind=kind: netcdf_files.written(hybrid(), folder / f"{kind}.grid", kind)


def stored_otherwise() -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Yield as `encoded` every other way to store numbers, also of meshes by Gmsh, of faces and of blocks."""
    yield from encoded()
    for key in VARIANTS:
        yield f"gmsh-{key}", lambda folder, key=key: by_gmsh(write(folder / "ours.msh"), folder / "by.msh", *key)
    for own in product(fluent_files.LAYOUTS, ("<f8", ">f8", "<f4")):
        for packed in ({}, fluent_files.PACKED):
            name = "packed.msh.h5" if packed else "mesh.msh.h5"
            yield (
                f"{own}-{name}",
                lambda folder, own=own, name=name, packed=packed: fluent_files.written(
                    hybrid(), folder / name, *own, **packed
                ),
            )
    for variant in plot3d_files.BINARY:
        blocks = plot3d_files.cut(plot3d_files.box(), 0, 2)
        yield variant, lambda folder, own=variant, blocks=blocks: plot3d_files.written(folder / "a.p3d", blocks, own)


def write(path: Path) -> Path:
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
    assert {name.split()[0] for name in MADE} == set(REGISTERED)


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
    for other in (b"", b"\n", b"a = 1\n", b"\x89HDF\r\n\x1a\n\0\0" + bytes(range(256)), bytes(4000), b"<a><b>" * 9):
        path.write_bytes(other)
        refused(path)


@pytest.mark.parametrize("name", SINGLE)
def test_a_missing_file_and_a_folder_are_named(name, tmp_path):
    form = format_of(tmp_path / MADE[name])
    for path in (tmp_path / f"none-{MADE[name]}", tmp_path):
        with pytest.raises(MeshFileError, match=str(path)):
            form.read(path)


ALL = [*((name, partial(made, name)) for name in MADE), *stored_otherwise()]


@pytest.mark.parametrize("make", [make for _, make in ALL], ids=[name for name, _ in ALL])
def test_unmoved_points_leave_every_byte(make, tmp_path):
    path = make(tmp_path)
    out = tmp_path / "out" / path.name
    out.parent.mkdir()
    format_of(path).rewrite(path, read(path).points, out)
    assert {file.relative_to(out): data for file, data in bytes_of(out).items()} == {
        file.relative_to(path): data for file, data in bytes_of(path).items()
    }


BACK = [*((n, partial(made, n)) for n in MADE if n.split()[0] not in ("openfoam", "fluent", "plot3d")), *encoded()]


@pytest.mark.parametrize("make", [make for _, make in BACK], ids=[name for name, _ in BACK])
def test_a_mesh_comes_back(make, tmp_path):
    path = make(tmp_path)
    again = read(path)
    np.testing.assert_array_equal(again.points, hybrid().points.astype(format_of(path).real(path, path)))
    found, expected = (content(mesh) for mesh in (again, hybrid()))
    assert found["cells"] == expected["cells"]
    assert again.name == path.name
    sorts = format_of(path) in (FORMATS["ugrid"], FORMATS["tau"])  # triangles first
    assert [name.replace("_", " ") for name in again.names] == [name.replace("_", " ") for name in hybrid().names]
    for one, faces in zip(found["patches"].values(), expected["patches"].values(), strict=True):
        assert one == (sorted(faces, key=len) if sorts else faces)


@pytest.mark.parametrize("make", [make for _, make in ALL], ids=[name for name, _ in ALL])
def test_only_coordinates_that_moved_change(make, tmp_path):
    """24 bytes, or three lines of text; what is packed is packed anew, with the same content."""
    path = make(tmp_path)
    mesh, out, form = read(path), tmp_path / "out" / path.name, format_of(path)
    out.parent.mkdir()
    points = mesh.points.copy()
    points[3] += 0.1
    form.rewrite(path, points, out)
    again = read(out)
    np.testing.assert_array_equal(again.points, points.astype(form.real(out, path)))
    assert again.names == mesh.names
    for one, other in zip((*mesh.cells, *mesh.patches), (*again.cells, *again.patches), strict=True):
        for part in ("owner", "neighbour") if isinstance(one, Polyhedra) else ("nodes",):
            assert np.array_equal(getattr(one, part), getattr(other, part))
    for file, before in bytes_of(path).items() if path.suffix != ".vtu" and "packed" not in path.name else ():
        after = (out / file.relative_to(path)).read_bytes()
        if len(before) == len(after):
            assert np.count_nonzero(np.frombuffer(before, np.uint8) != np.frombuffer(after, np.uint8)) <= 24
        else:
            lines = zip(before.split(b"\n"), after.split(b"\n"), strict=True)
            assert sum(one != other for one, other in lines) <= 3


@pytest.mark.parametrize("name", [name for name in MADE if "plot3d" not in name and name != "ugrid lr4"])
def test_a_deflection_is_that_of_the_same_mesh_in_memory(name, tmp_path):
    job = {"hinge": [(0, -1, 0), (0, 1, 0)], "angle": 5.0, "fixed": "*[+-]"}
    expected = sdm_deflect.deflect(block_with_body(6), "body", **job)
    path, out = made(name, tmp_path, block_with_body(6)), tmp_path / "out" / MADE[name]
    out.parent.mkdir()
    sdm_deflect.deflect(path, "body", **job).save(out)
    assert np.abs(expected.displacement).max() > 0.01
    np.testing.assert_allclose(read(out).points, expected.points, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("name", "suffix"), [("fluent", ".msh.h5"), ("plot3d", ".p3d")])
def test_a_format_that_is_only_rewritten_says_so_before_anything_is_computed(name, suffix, tmp_path):
    with pytest.raises(MeshFileError, match=rf"b\{suffix}: only a mesh of this format can be written in it"):
        OutputFiles.of(tmp_path / "a.su2", tmp_path / f"b{suffix}", ((3.0,),))
    with pytest.raises(MeshFileError, match="only a mesh of this format"):
        FORMATS[name].write(hybrid(), tmp_path / f"b{suffix}")
    path = made(name, tmp_path)
    format_of("c.cgns").write(read(path), tmp_path / "c.cgns")
    assert sum(map(len, read(tmp_path / "c.cgns").patches)) == sum(map(len, read(path).patches))


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


@pytest.mark.parametrize("name", [name for name in REGISTERED if name != "openfoam" and REGISTERED[name].written])
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

"""Periodic pairs in files: every node of one side has its image on the other, by the motion that the file says."""

import h5py
import numpy as np
import pytest

from sdm_deflect.deform.surface.axis import Axis
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.registry import FORMATS, in_pieces, read
from tests.meshing.formats import fluent_files
from tests.meshing.formats.periodic_files import DEGREES, VARIANTS, box, carried, sector, square, write_periodic

X = Axis(np.zeros(3), np.array([1.0, 0.0, 0.0]))
ROUNDING = 1e-9
"""Gmsh places images by its own transformation."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("periodic")
    return {shape: write_periodic(folder, shape) for shape in (box, square, sector)}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("shape", [box, square, sector])
def test_gmsh_links_are_pairs_of_all_nodes_of_both_sides(files, shape, variant):
    mesh = Gmsh().read(files[shape][variant])
    (pair,) = mesh.periodic
    assert (pair.name, pair.patches, mesh.notes) == ("left", ("left", "right"), ())
    for side, name in zip(pair.nodes.T, pair.patches, strict=True):
        assert np.array_equal(np.sort(side), mesh.patch(name).nodes)
    assert carried(mesh) < ROUNDING
    turn = X.matrix(DEGREES) if shape is sector else np.eye(3)
    np.testing.assert_allclose(pair.rotation, turn, atol=ROUNDING)
    np.testing.assert_allclose(pair.shift, [shape is not sector, 0, 0], atol=ROUNDING)


@pytest.mark.parametrize("shape", [box, sector])
def test_pairs_of_a_file_in_pieces_are_those_of_the_whole_file(files, shape):
    path = files[shape][4.1, 1]
    whole = read(path)
    with in_pieces(path) as found:
        (pair,), (expected,) = found.periodic, whole.periodic
        assert (pair.name, pair.patches) == (expected.name, expected.patches)
        for part in ("nodes", "rotation", "shift"):
            assert np.array_equal(getattr(pair, part), getattr(expected, part))


@pytest.mark.parametrize("variant", VARIANTS)
def test_rewritten_file_keeps_the_bytes_of_its_links(files, variant, tmp_path):
    source, out = files[box][variant], tmp_path / "out.msh"
    mesh = Gmsh().read(source)
    Gmsh().rewrite(source, mesh.points * 1.25, out)
    links = [data[data.index(b"$Periodic") :] for data in (source.read_bytes(), out.read_bytes())]
    assert links[0] == links[1]


@pytest.mark.parametrize("shape", [box, square, sector])
def test_gmsh_file_written_has_the_pairs(files, shape, tmp_path):
    mesh = Gmsh().read(files[shape][4.1, 0])
    assert Gmsh().write(mesh, tmp_path / "new.msh") == ()
    again = Gmsh().read(tmp_path / "new.msh")
    assert np.array_equal(again.periodic[0].nodes, mesh.periodic[0].nodes)
    assert again.periodic[0].patches == mesh.periodic[0].patches


@pytest.mark.parametrize("name", ["su2", "ugrid", "tau", "vtu"])
def test_formats_without_pairs_say_that_they_are_lost(files, name, tmp_path):
    mesh = Gmsh().read(files[box][4.1, 0])
    lost = FORMATS[name].write(mesh, tmp_path / f"new{FORMATS[name].suffixes[0]}")
    assert "left and right are periodic, which the file does not say" in lost


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("count", [b"99999999999", b"-1"])
def test_links_that_lie_are_an_error_of_one_sentence(files, variant, count, tmp_path):
    data = files[box][variant].read_bytes()
    at = data.index(b"$Periodic\n") + len(b"$Periodic\n")
    binary = variant == (4.1, 1)
    wrong = int(count).to_bytes(8, "little", signed=True) if binary else count
    end = at + 8 if binary else data.index(b"\n", at)
    (tmp_path / "bad.msh").write_bytes(data[:at] + wrong + data[end:])
    with pytest.raises(MeshFileError, match=r"section \$Periodic holds fewer numbers|\$Periodic announces -1 links"):
        Gmsh().read(tmp_path / "bad.msh")


def test_link_of_nodes_that_are_not_there_is_an_error(files, tmp_path):
    data = files[box][4.1, 0].read_bytes()
    begin = data.index(b"\n2 2 1\n", data.index(b"$Periodic"))
    at = data.index(b"\n", begin + len(b"\n2 2 1\n16")) + 1
    first = data.index(b"\n", at) + 1
    (tmp_path / "bad.msh").write_bytes(data[:first] + b"7777 " + data[data.index(b" ", first) + 1 :])
    with pytest.raises(MeshFileError, match="1 pairs of surfaces 1 and 2 name nodes that are not among the"):
        Gmsh().read(tmp_path / "bad.msh")


def test_link_that_no_rigid_motion_fits_is_left_out_with_a_note(files, tmp_path):
    data = files[box][2.2, 0].read_bytes()
    lines = data.split(b"\n")
    row = lines.index(b"$Periodic") + 5
    lines[row], lines[row + 1] = (
        lines[row].split()[0] + b" " + lines[row + 1].split()[1],
        lines[row + 1].split()[0] + b" " + lines[row].split()[1],
    )
    (tmp_path / "bad.msh").write_bytes(b"\n".join(lines))
    mesh = Gmsh().read(tmp_path / "bad.msh")
    assert not mesh.periodic
    (note,) = mesh.notes
    assert "no rigid motion leads to all images" in note
    assert note.endswith("the pair is left out")


@pytest.mark.parametrize("layout", fluent_files.LAYOUTS)
@pytest.mark.parametrize("shape", [box, square, sector])
def test_periodic_zones_of_fluent_are_pairs_with_their_shadows(files, shape, layout, tmp_path):
    expected = Gmsh().read(files[shape][4.1, 0])
    path = fluent_files.written(expected, tmp_path / "mesh.cas.h5", layout)
    found = Fluent().read(path)
    (pair,) = found.periodic
    assert (pair.name, pair.patches, found.notes) == ("left", ("left", "right"), ())
    assert np.array_equal(found.points, expected.points)
    assert np.array_equal(pair.nodes, expected.periodic[0].nodes)
    np.testing.assert_allclose(pair.rotation, expected.periodic[0].rotation, atol=ROUNDING)


def test_shadow_is_the_zone_that_the_periodic_one_names(files, tmp_path):
    path = fluent_files.written(Gmsh().read(files[box][4.1, 0]), tmp_path / "mesh.cas.h5")
    for shadow, note in (("right", None), ("rest", "there is no zone of its images")):
        with h5py.File(path, "r+") as file:
            zones = file[fluent_files.ZONES]
            names = zones["name"][0].decode().split(";")
            zones["zoneType"][names.index("rest")] = 8
            zones["zoneType"][names.index("right")] = 8 if shadow == "right" else 3
            zones["shadowZoneId"][names.index("left")] = zones["id"][names.index(shadow)]
        mesh = Fluent().read(path)
        assert len(mesh.periodic) == (note is None)
        assert all(text.startswith("zone left is periodic, and its pair is left out: ") for text in mesh.notes)

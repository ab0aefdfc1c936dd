"""Periodic pairs in files: every node of one side has its image on the other, by the motion that the file says."""

import subprocess

import h5py
import numpy as np
import pytest

from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.registry import FORMATS, in_pieces, read
from sdm_deflect.meshing.mesh.axis import Axis
from tests.extras import Library, needs_program
from tests.meshing.formats import fluent_files
from tests.meshing.formats.blocks import write_blocks
from tests.meshing.formats.periodic_files import (
    DEGREES,
    VARIANTS,
    box,
    carried,
    ring_of_blocks,
    sector,
    square,
    write_periodic,
)

gmsh = Library("gmsh")

X = Axis(np.zeros(3), np.array([1.0, 0.0, 0.0]))
# Gmsh places images by its own transformation.
ROUNDING = 1e-9


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


@pytest.mark.parametrize("shape", [box, square, sector])
def test_gmsh_file_written_has_the_pairs(files, shape, tmp_path):
    mesh = Gmsh().read(files[shape][4.1, 0])
    assert Gmsh().write(mesh, tmp_path / "new.msh") == ()
    again = Gmsh().read(tmp_path / "new.msh")
    assert np.array_equal(again.periodic[0].nodes, mesh.periodic[0].nodes)
    assert again.periodic[0].patches == mesh.periodic[0].patches


@pytest.mark.parametrize("name", ["su2", "ugrid", "tau", "vtu", "cgns", "gmsh"])
def test_formats_without_pairs_say_that_they_are_lost(files, name, tmp_path):
    mesh = Gmsh().read(files[box][4.1, 0])
    lost = FORMATS[name].write(mesh, tmp_path / f"new{FORMATS[name].suffixes[0]}")
    assert ("left and right are periodic, which the file does not say" in lost) == (name not in ("cgns", "gmsh"))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("count", [b"99999999999", b"-1"])
def test_links_that_lie_are_left_out_with_a_note(files, variant, count, tmp_path):
    data = files[box][variant].read_bytes()
    at = data.index(b"$Periodic\n") + len(b"$Periodic\n")
    binary = variant == (4.1, 1)
    wrong = int(count).to_bytes(8, "little", signed=True) if binary else count
    end = at + 8 if binary else data.index(b"\n", at)
    (tmp_path / "bad.msh").write_bytes(data[:at] + wrong + data[end:])
    mesh = Gmsh().read(tmp_path / "bad.msh")
    assert not mesh.periodic
    (note,) = mesh.notes
    reason = "$Periodic announces -1 links" if int(count) < 0 else "section $Periodic holds fewer numbers"
    assert reason in note
    assert note.endswith("the periodic pairs are left out")


def test_links_of_nodes_that_are_not_there_are_left_out_with_a_note(files, tmp_path):
    data = files[box][4.1, 0].read_bytes()
    begin = data.index(b"\n2 2 1\n", data.index(b"$Periodic"))
    at = data.index(b"\n", begin + len(b"\n2 2 1\n16")) + 1
    first = data.index(b"\n", at) + 1
    (tmp_path / "bad.msh").write_bytes(data[:first] + b"7777 " + data[data.index(b" ", first) + 1 :])
    mesh = Gmsh().read(tmp_path / "bad.msh")
    assert not mesh.periodic
    assert "1 pairs of surfaces 1 and 2 name nodes that are not among the" in mesh.notes[0]


def test_links_of_version_2_are_read_as_gmsh_copies_them(files, tmp_path):
    """It keeps the section as text, with long lines broken within a number; in version 2.2 it renumbers nodes."""
    expected = Gmsh().read(files[sector][4.1, 0])
    Gmsh().write(expected, tmp_path / "ours.msh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.open(str(tmp_path / "ours.msh"))
        for version, binary in VARIANTS:
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(tmp_path / "copy.msh"))
            mesh = Gmsh().read(tmp_path / "copy.msh")
            for pair in mesh.periodic:
                assert len(pair.nodes) == len(expected.periodic[0].nodes)
                assert carried(mesh) < ROUNDING
            assert len(mesh.periodic) + len(mesh.notes) == 1
            assert mesh.periodic or version == 2.2
    finally:
        gmsh.finalize()


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


@pytest.mark.parametrize("shape", [box, square, sector])
def test_cgns_file_written_has_the_pairs(files, shape, tmp_path):
    mesh, out = Gmsh().read(files[shape][4.1, 0]), tmp_path / "new.cgns"
    assert Cgns().write(mesh, out) == ()
    found = Cgns().read(out)
    (pair,), (expected,) = found.periodic, mesh.periodic
    assert (pair.name, pair.patches, found.notes) == ("left", ("left", "right"), ())
    assert np.array_equal(pair.nodes, expected.nodes)
    np.testing.assert_allclose(pair.rotation, expected.rotation, atol=1e-15)


@needs_program("cgnscheck")
@pytest.mark.parametrize("shape", [box, square, sector])
def test_cgnscheck_has_no_error_in_pairs(files, shape, tmp_path):
    Cgns().write(Gmsh().read(files[shape][4.1, 0]), tmp_path / "new.cgns")
    report = subprocess.run(["cgnscheck", tmp_path / "new.cgns"], capture_output=True, text=True, check=False).stdout
    assert "checking complete" in report
    assert "ERROR" not in report


READINGS = {"radians": np.pi / 180.0, "degrees": 1.0, "backward": -np.pi / 180.0}


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("given", ["wrong donors", "faces", "points alone"])
def test_cgns_images_are_found_by_the_motion_where_the_file_lists_none(files, given, reading, tmp_path):
    mesh, out = Gmsh().read(files[sector][4.1, 0]), tmp_path / "new.cgns"
    Cgns().write(mesh, out)
    with h5py.File(out, "r+") as file:
        zone = file["Base/Zone"]
        zone["GridCoordinates/CoordinateY/ data"][:] += 0.4
        group = zone["ZoneGridConnectivity"]
        for node, side in ((group["Periodic 1 to"], "left"), (group["Periodic 1 from"], "right")):
            angle, centre = (
                node[f"GridConnectivityProperty/Periodic/{vector}/ data"]
                for vector in ("RotationAngle", "RotationCenter")
            )
            centre[1] = 0.4
            angle[0] = np.sign(angle[0]) * READINGS[reading] * DEGREES
            del node["PointListDonor"]
            if given == "wrong donors":
                create(node, "PointListDonor", "IndexArray_t", np.array([[10**8]], dtype=np.int32))
            if given == "faces":
                del node["PointList"], node["GridLocation"]
                create(node, "GridLocation", "GridLocation_t", "FaceCenter")
                first, last = zone[side]["ElementRange/ data"][:]
                create(node, "PointList", "IndexArray_t", np.arange(first, last + 1, dtype=np.int32)[:, None])
    (pair,) = Cgns().read(out).periodic
    assert np.array_equal(pair.nodes, mesh.periodic[0].nodes)


@pytest.mark.parametrize("orders", [((0, 1, 2), (0, 1, 2)), ((2, 0, 1), (-1, 2, 1))])
def test_periodic_ranges_of_blocks_are_pairs(orders, tmp_path):
    write_blocks(
        tmp_path / "ring.cgns",
        [block.transposed(*order) for block, order in zip(ring_of_blocks(), orders, strict=True)],
    )
    mesh = Cgns().read(tmp_path / "ring.cgns")
    (pair,) = mesh.periodic
    assert len(pair.nodes) == 12
    assert carried(mesh) < 1e-14
    np.testing.assert_allclose(pair.rotation, X.matrix(np.sign(pair.rotation[2, 1]) * 90.0), atol=1e-14)
    assert len(mesh.zones) == 1


def test_symmetry_planes_of_cgns_are_constraints(files, tmp_path):
    mesh, out = Gmsh().read(files[box][4.1, 0]), tmp_path / "new.cgns"
    Cgns().write(mesh, out)
    with h5py.File(out, "r+") as file:
        data = file["Base/rest/FamilyBC"]
        del data[" data"]
        data.create_dataset(" data", data=np.frombuffer(b"BCSymmetryPlane", dtype=np.int8))
    found = Cgns().read(out)
    assert [(one.name, one.constraint) for one in found.patches] == [("left", ""), ("right", ""), ("rest", "symmetry")]
    Cgns().write(found, tmp_path / "again.cgns")
    assert Cgns().read(tmp_path / "again.cgns").patch("rest").constraint == "symmetry"


MOTION = "GridConnectivityProperty/Periodic"


@pytest.mark.parametrize(
    ("change", "note"),
    [
        ((f"{MOTION}/RotationAngle", np.full(9, 1.0, np.float32)), "RotationAngle is no vector of three numbers"),
        ((f"{MOTION}/Translation", np.array([np.nan, 0, 0], np.float32)), "Translation is no vector of three numbers"),
        ((f"{MOTION}/Translation", np.array([1, 2, 3], np.int32)), "expected real numbers"),
        (("PointListDonor", np.array([[1], [2]], np.int32)), "every node is its own image; the pair is left out"),
    ],
)
def test_periodic_interfaces_that_lie_are_notes(files, change, note, tmp_path):
    Cgns().write(Gmsh().read(files[box][4.1, 0]), tmp_path / "bad.cgns")
    with h5py.File(tmp_path / "bad.cgns", "r+") as file:
        for name in ("to", "from"):
            node = file["Base/Zone/ZoneGridConnectivity"][f"Periodic 1 {name}"]
            own = node[change[0]]
            if "Donor" in change[0]:
                del node[f"{MOTION}/Translation"]
            del own[" data"]
            own.create_dataset(" data", data=change[1])
    mesh = Cgns().read(tmp_path / "bad.cgns")
    assert not mesh.periodic
    assert any(note in text for text in mesh.notes), mesh.notes


@pytest.mark.parametrize(("count", "said"), [(b"1", False), (b"3", True), (b"x", True)])
def test_points_beyond_periodic_markers_of_su2_are_a_note(files, count, said, tmp_path):
    path = tmp_path / "old.su2"
    FORMATS["su2"].write(Gmsh().read(files[box][4.1, 0]), path)
    path.write_bytes(path.read_bytes() + b"NPERIODIC= " + count + b"\nPERIODIC_INDEX= 0\n0 0 0\n0 0 0\n0 0 0\n")
    with in_pieces(path) as pieces:
        for mesh in (read(path), pieces):
            assert [note for note in mesh.notes if "SEND_RECEIVE" in note] == list(mesh.notes)
            assert bool(mesh.notes) == said

"""What is wrong with a CGNS file is said in one sentence that names the file."""

import h5py
import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.cgns_boundary import UNNAMED
from sdm_deflect.meshing.formats.cgns_hdf5 import create, describe
from tests.meshing.formats.alike import replace_data, zone_of
from tests.meshing.formats.examples import hybrid, polyhedral
from tests.meshing.formats.test_every_format import refused


@pytest.fixture
def path(tmp_path):
    Cgns().write(hybrid(), tmp_path / "mesh.cgns")
    return tmp_path / "mesh.cgns"


def set_first(node, value):
    stored = node[" data"]
    stored[(0,) * stored.ndim] = value


def letters(text):
    return np.frombuffer(text.encode(), dtype=np.int8)


DAMAGE = {
    "no base": (lambda zone: zone.file.__delitem__("Base"), "no CGNSBase_t"),
    "two dimensions": (lambda zone: set_first(zone.parent, 2), "hexahedron cells in a base of two dimensions"),
    "no zone": (lambda zone: zone.parent.__delitem__("Zone"), "no zones"),
    "structured": (lambda zone: replace_data(zone["ZoneType"], letters("Structured")), "size [14, 7, 0] does not fit"),
    "type": (lambda zone: replace_data(zone["ZoneType"], letters("UserDefined")), "it is of type 'UserDefined'"),
    "no grid": (lambda zone: zone.__delitem__("GridCoordinates"), "zone Zone: Base/Zone has no GridCoordinates"),
    "no y": (lambda zone: zone["GridCoordinates"].__delitem__("CoordinateY"), "has no CoordinateY"),
    "short y": (lambda zone: replace_data(zone["GridCoordinates/CoordinateY"], np.zeros(3)), "CoordinateY holds (3,)"),
    "no data": (lambda zone: zone["GridCoordinates/CoordinateY"].__delitem__(" data"), "CoordinateY holds no data"),
    "nan": (lambda zone: set_first(zone["GridCoordinates/CoordinateY"], np.nan), "1 points are not finite"),
    "no elements": (lambda zone: [zone.__delitem__(n) for n in list(zone) if "label" in zone[n].attrs
                                  and zone[n].attrs["label"] == b"Elements_t"], "it has no elements"),
    "no cells": (lambda zone: [zone.__delitem__(n) for n in list(zone) if n.startswith("cells")], "no volume cells"),
    "quadratic": (lambda zone: set_first(zone["cells tetra"], 11), "cells tetra holds elements of SIDS type 11"),
    "range": (lambda zone: set_first(zone["cells tetra/ElementRange"], 99), "section cells tetra has the range"),
    "connectivity": (
        lambda zone: replace_data(zone["cells tetra/ElementConnectivity"], np.arange(1, 10)),
        "section cells tetra has 4 elements of 4 nodes, but 9 nodes",
    ),
    "no connectivity": (
        lambda zone: zone["cells tetra"].__delitem__("ElementConnectivity"),
        "has no ElementConnectivity",
    ),
    "reals": (
        lambda zone: replace_data(zone["cells tetra/ElementConnectivity"], np.arange(16.0)),
        "holds float64, expected integers",
    ),
    "node 15": (
        lambda zone: set_first(zone["cells tetra/ElementConnectivity"], 15),
        "section cells tetra: 1 tetra elements name points that are not among the 14",
    ),
    "face of no cell": (
        lambda zone: set_first(zone["outlet/ElementConnectivity"], 1),
        "1 of 2 faces of patch outlet are of no cell",
    ),
    "size": (lambda zone: replace_data(zone, np.empty((0, 1), dtype=np.int32)), "its size has 0 numbers, expected 3"),
    "null space": (
        lambda zone: replace_data(zone["GridCoordinates/CoordinateX"], h5py.Empty("f8")),
        "CoordinateX holds no data",
    ),
    "letters": (lambda zone: replace_data(zone["ZoneType"], np.array(b"Unstructured")), "expected characters"),
    "same numbers": (
        lambda zone: zone["cells tetra/ElementRange/ data"].write_direct(np.array([2, 5], dtype=np.int32)),
        "have the same numbers",
    ),
}  # fmt: skip


def chunked(zone, **how):
    """New coordinates on x in chunks, none of which is there yet."""
    node = zone["GridCoordinates/CoordinateX"]
    del node[" data"]
    return node.create_dataset(" data", (14,), "f8", chunks=(14,), **how)


def claimed(zone):
    """A zone of 10^9 points without coordinates."""
    set_first(zone, 10**9)
    for axis in "XYZ":
        node = zone[f"GridCoordinates/Coordinate{axis}"]
        del node[" data"]
        node.create_dataset(" data", (10**9,), "f8", chunks=(1 << 20,))


DAMAGE |= {
    "no chunk": (chunked, "CoordinateX holds 0 of 1 parts of its data"),
    "large": (claimed, "CoordinateX would take 8e+03 MB of memory from a file"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named(damage, path):
    change, message = DAMAGE[damage]
    with h5py.File(path, "r+") as file:
        change(zone_of(file))
    assert message in refused(path)


CONDITIONS = {
    "beyond": (
        lambda zone: zone["ZoneBC/outlet/PointRange/ data"].write_direct(np.array([[12], [99]], dtype=np.int32)),
        "it is on elements 12 to 99, but they are numbered from 1 to 25",
    ),
    "zero": (
        lambda zone: zone["ZoneBC/outlet/PointRange/ data"].write_direct(np.array([[0], [12]], dtype=np.int32)),
        "it is on elements 0 to 12, but they are numbered from 1 to 25",
    ),
    "reversed": (
        lambda zone: zone["ZoneBC/outlet/PointRange/ data"].write_direct(np.array([[13], [12]], dtype=np.int32)),
        "it has the range [13, 12], which ends before it begins",
    ),
    "cells": (
        lambda zone: zone["ZoneBC/outlet/PointRange/ data"].write_direct(np.array([[1], [12]], dtype=np.int32)),
        "7 of its 12 elements are no faces",
    ),
    "nowhere": (lambda zone: zone["ZoneBC/outlet"].__delitem__("PointRange"), "it does not say where it is"),
    "points": (
        lambda zone: replace_data(zone["ZoneBC/outlet/GridLocation"], letters("Vertex")), "it is given by points",
    ),
    "numbers": (
        lambda zone: replace_data(zone["ZoneBC/outlet/PointRange"], np.arange(3, dtype=np.int32)),
        "its range has 3 numbers, expected 2",
    ),
    "reals": (
        lambda zone: replace_data(zone["ZoneBC/outlet/PointRange"], np.arange(2.0)), "holds float64, expected integers",
    ),
}  # fmt: skip


POLYHEDRAL_CONDITIONS = {
    "zero": (lambda zone: set_first(zone["ZoneBC/outlet/PointList"], 0), "it is on elements 0 to "),
    "nowhere": (lambda zone: zone["ZoneBC/outlet"].__delitem__("PointList"), "it does not say where it is"),
}


def with_one_bad_condition(mesh, change, path):
    """The mesh of a file before and after a change of the condition on the outlet."""
    Cgns().write(mesh, path)
    before = Cgns().read(path)
    with h5py.File(path, "r+") as file:
        change(zone_of(file))
    return before, Cgns().read(path)


@pytest.mark.parametrize(
    ("mesh", "damage"),
    [
        *((hybrid(), damage) for damage in CONDITIONS.values()),
        *((polyhedral(hybrid()), damage) for damage in POLYHEDRAL_CONDITIONS.values()),
    ],
    ids=[*CONDITIONS, *(f"polyhedra {name}" for name in POLYHEDRAL_CONDITIONS)],
)
def test_one_bad_condition_is_a_note_and_its_patch_is_absent(mesh, damage, tmp_path):
    """The faces of the patch are on another one still, and its name is refused with the reason."""
    change, message = damage
    before, after = with_one_bad_condition(mesh, change, tmp_path / "mesh.cgns")
    (note,) = after.notes
    assert note.startswith("patch outlet is absent: zone Zone: boundary condition outlet: ")
    assert message in note
    assert {*after.names} - {"part of outlet", UNNAMED} == {*before.names} - {"outlet"}
    assert sum(map(len, after.patches)) == sum(map(len, before.patches))
    with pytest.raises(InputError, match=r"the surface 'outlet' cannot be taken: patch outlet is absent: zone Zone"):
        after.expand(["outlet"], "the surface")
    assert after.expand(["*"], "fixed") == after.names
    Cgns().rewrite(tmp_path / "mesh.cgns", after.points * 2.0, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, after.points * 2.0)
    assert "\n" not in note
    pieces = Cgns().layout(tmp_path / "mesh.cgns")
    assert pieces is None or (pieces.notes, [patch.name for patch in pieces.patches]) == (after.notes, [*after.names])


def test_a_condition_on_nothing_takes_no_faces_away(path):
    with h5py.File(path, "r+") as file:
        zone = zone_of(file)
        node = create(zone["ZoneBC"], "empty", "BC_t", "FamilySpecified")
        create(node, "FamilyName", "FamilyName_t", "outlet")
        create(node, "PointRange", "IndexRange_t", np.array([[0], [-1]], dtype=np.int32))
        create(node, "GridLocation", "GridLocation_t", "FaceCenter")
    mesh = Cgns().read(path)
    assert mesh.notes == ("zone Zone: boundary condition empty: its range 0 to -1 holds nothing",)
    assert "outlet" in mesh.names


def test_there_are_few_notes_however_much_is_wrong(path):
    with h5py.File(path, "r+") as file:
        for i in range(100):
            create(zone_of(file)["ZoneBC"], f"bad {i}", "BC_t", "BCWall")
    notes = Cgns().read(path).notes
    assert len(notes) == 21
    assert notes[-1] == "80 more conditions and interfaces could not be read"


POLYHEDRAL = {
    "no faces": (lambda zone: zone.__delitem__("faces"), "but no faces (NGON_n)"),
    "no cells": (lambda zone: zone.__delitem__("cells"), "no ParentElements"),
    "other": (lambda zone: set_first(zone["cells"], 10), "NGON_n) and other elements (cells) in one zone"),
    "node": (lambda zone: set_first(zone["faces/ElementConnectivity"], 15), "points that are not there"),
    "face": (lambda zone: set_first(zone["cells/ElementConnectivity"], 999), "1 faces of cells are not in the file"),
    "twice": (
        lambda zone: zone["cells/ElementConnectivity/ data"].__setitem__(slice(0, 4), 1),
        "1 faces are of more than two cells",
    ),
    "first offset": (
        lambda zone: set_first(zone["faces/ElementStartOffset"], -4),
        "section faces: its elements do not fit its connectivity",
    ),
    "offsets": (
        lambda zone: replace_data(zone["faces/ElementStartOffset"], np.arange(5)),
        "section faces: its elements do not fit its connectivity",
    ),
}


@pytest.mark.parametrize("damage", POLYHEDRAL)
def test_damaged_polyhedra_are_named(damage, tmp_path):
    path = tmp_path / "mesh.cgns"
    Cgns().write(polyhedral(hybrid()), path)
    change, message = POLYHEDRAL[damage]
    with h5py.File(path, "r+") as file:
        change(zone_of(file))
    assert message in refused(path)


def test_other_content_is_no_cgns_file(tmp_path):
    path = tmp_path / "other.cgns"
    path.write_text("NDIME= 3\n")
    assert "this is no CGNS file, neither in HDF5 nor in ADF" in refused(path)
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(3)
    assert "no CGNSBase_t" in refused(path)


@pytest.mark.parametrize("name", ["GridCoordinates", "GridCoordinates/CoordinateX"])
def test_a_link_names_the_program_that_resolves_it(name, path):
    with h5py.File(path, "r+") as file:
        del zone_of(file)[name]
        describe(zone_of(file).create_group(name), name.split("/")[-1], "DataArray_t", "LK")
    assert "cgnsconvert -f -l" in refused(path)


def external(zone, name, other):
    """Put a part of a zone into another file, which this one links to."""
    with h5py.File(other, "w") as file:
        zone.copy(name, file, "part")
    del zone[name]
    zone[name] = h5py.ExternalLink(str(other), "/part")


def soft(zone, name, other):
    """Put a part of a zone elsewhere in the file, with a link in its place."""
    zone.move(name, "/part")
    zone[name] = h5py.SoftLink("/part")


def outside(zone, name, other):
    """Put the coordinates on x into a file of bytes."""
    node = zone["GridCoordinates/CoordinateX"]
    values = node[" data"][()]
    del node[" data"]
    other.write_bytes(values.tobytes())
    node.create_dataset(" data", values.shape, values.dtype, external=[(str(other), 0, values.nbytes)])


def virtual(zone, name, other):
    """Make the coordinates on x a view of a dataset in another file."""
    node = zone["GridCoordinates/CoordinateX"]
    values = node[" data"][()]
    del node[" data"]
    with h5py.File(other, "w") as file:
        file["x"] = values
    layout = h5py.VirtualLayout(values.shape, values.dtype)
    layout[:] = h5py.VirtualSource(str(other), "x", values.shape)
    node.create_virtual_dataset(" data", layout)


@pytest.mark.parametrize("name", ["GridCoordinates", "GridCoordinates/CoordinateX", "GridCoordinates/CoordinateX/ data",
                                  "cells tetra/ElementConnectivity", "ZoneBC"])  # fmt: skip
@pytest.mark.parametrize("link", [external, soft, outside, virtual])
def test_data_elsewhere_are_refused_and_never_written(link, name, path, tmp_path):
    other = tmp_path / "master.h5"
    with h5py.File(path, "r+") as file:
        link(zone_of(file), name, other)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    assert "is a link; `cgnsconvert -f -l" in refused(path)
    if name.startswith("GridCoordinates"):
        with pytest.raises(MeshFileError, match=r"mesh\.cgns: .* is a link"):
            Cgns().rewrite(path, hybrid().points * 2.0, tmp_path / "out.cgns")
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_two_volume_bases_are_one_too_many(path):
    with h5py.File(path, "r+") as file:
        create(file, "Second", "CGNSBase_t", np.array([3, 3], dtype=np.int32))
    assert "2 of 2 bases" in refused(path)


def test_a_file_of_cgns_3_0_is_refused_with_the_command_that_helps(tmp_path):
    Cgns().write(hybrid(), tmp_path / "a.cgns")
    with h5py.File(tmp_path / "a.cgns", "r+") as file:
        file["CGNSLibraryVersion/ data"][:] = 3.0
    with pytest.raises(MeshFileError, match=r"a\.cgns: is of CGNS 3\.0, .*: cgnsupdate OLD\.cgns NEW\.cgns"):
        Cgns().read(tmp_path / "a.cgns")

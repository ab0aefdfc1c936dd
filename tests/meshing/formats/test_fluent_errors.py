"""Damaged files of Fluent, and such as are not read: one sentence, soon."""

import re

import h5py
import numpy as np
import pytest

from sdm_deflect.meshing.formats.fluent import Fluent
from sdm_deflect.meshing.formats.registry import format_of, read
from tests.meshing.formats.examples import hybrid
from tests.meshing.formats.fluent_files import COORDS, PACKED, ZONES, plane_mesh, written
from tests.meshing.formats.test_hostile import complaint


def attribute(name, value, node="meshes/1"):
    return lambda file: file[node].attrs.__setitem__(name, value)


def data(name, values):
    def change(file):
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = values
        file[name].attrs.update(attributes)

    return change


def at(name, place, value):
    def change(file):
        file[name][place] = value

    return change


def without(name):
    return lambda file: file.__delitem__(name)


def linked(name, link):
    def change(file):
        del file[name]
        file[name] = link

    return change


def outside(file):
    del file[COORDS]
    file.create_dataset(COORDS, (14, 3), "f8", external=[("values.raw", 0, 336)])
    file[COORDS].attrs.update({"minId": np.array([1]), "maxId": np.array([14])})


def virtual(file):
    del file[COORDS]
    layout = h5py.VirtualLayout((14, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "coords", (14, 3))
    file.create_virtual_dataset(COORDS, layout)
    file[COORDS].attrs.update({"minId": np.array([1]), "maxId": np.array([14])})


def surface_alone(file):
    for name in ("c0", "c1"):
        file[f"meshes/1/faces/{name}/1"][...] = 0


NODES, C0 = "meshes/1/faces/nodes/1", "meshes/1/faces/c0/1"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (attribute("dimension", 4), "has 4 dimensions, expected 2 or 3"),
        (attribute("dimension", 2), r"coords/1 holds \(14, 3\) numbers, expected \(14, 2\)"),
        (attribute("nodeCount", 15), "coords ends at number 14, expected 15"),
        (attribute("nodeCount", "many"), "has no number nodeCount"),
        (attribute("cellCount", 8), "cellCount is 8, but faces are of 7 cells"),
        (attribute("maxId", 15, COORDS), "coords ends at number 15, expected 14"),
        (attribute("minId", 2, COORDS), "coords goes on with 2 to 14 at number 1"),
        (attribute("maxId", 24, NODES), "faces/nodes ends at number 24"),
        (attribute("maxId", 24, C0), r"faces/c0/1 holds 25 numbers, expected 24"),
        (data(COORDS, np.zeros((14, 2))), r"coords/1 holds \(14, 2\) numbers, expected \(14, 3\)"),
        (data(COORDS, np.zeros((14, 3), "i4")), "coords/1 holds no real numbers"),
        (at(COORDS, (3, 1), np.nan), "1 points are not finite"),
        (at(f"{NODES}/nnodes", 0, 5), r"has \d+ nodes of 25 faces, expected 25 faces of three nodes or more"),
        (at(f"{NODES}/nodes", 0, 0), "nodes"),
        (at(f"{NODES}/nodes", -1, 4_000_000_000), r"faces name nodes that are not among the 14 \(1 to 14\)"),
        (at(C0, 0, 4_000_000_000), "cells that 25 faces cannot bound"),
        (at(C0, 0, 8), "fewer than four faces"),
        (at(f"{ZONES}/maxId", 1, 26), "zone floor has the faces 8 to 26, but there are 25"),
        (data(f"{ZONES}/name", np.array([b"one;two"])), "has 7 first faces and 2 names"),
        (data(f"{ZONES}/zoneType", np.zeros(3, "i4")), "has 7 first faces"),
        (without("meshes/1/faces/c1"), "faces/c1 is missing"),
        (without(COORDS), "coords ends at number 0, expected 14"),
        (without("meshes"), "meshes/1 is missing"),
        (linked(COORDS, h5py.ExternalLink("other.h5", "/x")), "coords/1 is a link"),
        (linked("meshes/1/faces/c1", h5py.SoftLink("/meshes/1/faces/c0")), "faces/c1 is a link"),
        (linked(f"{NODES}/nodes", h5py.SoftLink("/settings/Version")), "nodes/1/nodes is a link"),
        (outside, "holds data of other files"), (virtual, "holds data of other files"),
        (lambda file: file.create_group("meshes/1/faces/interface/5"), "mesh interfaces .* delete them in Fluent"),
        (surface_alone, "there are no volume cells"),
        (lambda file: file.create_group("meshes/1/faces/tree/1"), "hanging nodes; convert them"),
        (lambda file: file.create_group("meshes/1/cells/tree/1"), "hanging nodes; convert them"),
    ],
)  # fmt: skip
def test_damaged_files(change, said, tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        change(file)
    assert re.search(said, complaint(Fluent(), path))


def test_files_that_are_no_such_mesh(tmp_path):
    path = tmp_path / "a.msh.h5"
    path.write_bytes(b"(0 comment)")
    assert "this is no file in HDF5" in complaint(Fluent(), path)
    (tmp_path / "b.msh").write_bytes(b' \n(0 "GAMBIT to Fluent File")\n(2 3)\n')
    assert "is a mesh of Fluent, not of Gmsh; write it as .cas.h5 or .msh.h5 in Fluent" in complaint(
        format_of("b.msh"), tmp_path / "b.msh"
    )
    data = written(hybrid(), path, **PACKED).read_bytes()
    for length in (0, 8, 96, 600, len(data) // 2, len(data) - 100):
        path.write_bytes(data[:length])
        assert complaint(Fluent(), path)


def test_a_dataset_that_claims_too_much(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        del file[COORDS]
        large = file.create_dataset(COORDS, (10**9, 3), "f8", chunks=(1000, 3), compression="gzip")
        large.attrs.update({"minId": np.array([1]), "maxId": np.array([10**9])})
        file["meshes/1"].attrs["nodeCount"] = np.array([10**9])
    assert "would take 2.4e+04 MB of memory" in complaint(Fluent(), path)


def test_a_part_of_the_coordinates_that_is_another(tmp_path):
    with h5py.File(written(hybrid(), tmp_path / "c.msh.h5", "meshing"), "r+") as file:
        del file["meshes/1/nodes/coords/1"]
        file["meshes/1/nodes/coords/1"] = file["meshes/1/nodes/coords/2"]
    assert "goes on with 1 to 7 at number 8" in complaint(Fluent(), tmp_path / "c.msh.h5")


def test_plane_cells_of_five_sides_and_torn_ones(tmp_path):
    path = written(plane_mesh(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        nodes = file["meshes/1/faces/nodes/1/nodes"][()]
        file["meshes/1/faces/nodes/1/nodes"][-1] = nodes[0]
    assert "plane cells do not close" in complaint(Fluent(), path)
    with h5py.File(path, "r+") as file:
        file["meshes/1/faces/c0/1"][-1] = 10
    assert "1 plane cells have more than four sides" in complaint(Fluent(), path)


def test_a_list_of_interfaces_may_be_empty(tmp_path):
    path = written(hybrid(), tmp_path / "a.cas.h5")
    with h5py.File(path, "r+") as file:
        group = file.create_group("meshes/1/faces/interface")
        group.attrs["nZones"] = np.array([0], "u8")
        group["nciTopology"] = np.empty(0, "u8")
    assert len(read(path).patches) == 6

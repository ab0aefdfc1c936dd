"""CGNS files in ADF: the same meshes, all bytes but those of coordinates kept, and damage told in a sentence."""

import gzip
import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.cgns import Cgns, open_tree
from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.cgns_nodes import AXES, child, children, data
from tests.deform.blocks import block_with_body, joined
from tests.meshing.formats.adf_files import in_adf
from tests.meshing.formats.alike import content, zone_of
from tests.meshing.formats.blocks import complaints, two_blocks, write_blocks
from tests.meshing.formats.examples import hybrid, polyhedral

LAYOUTS = [("<", 1, False), ("<", 3, False), (">", 1, False), (">", 2, False), ("<", 1, True), (">", 3, True)]


def write_two(path):
    left, right = two_blocks()
    left.conditions.append(("a", "wall", "BCWall", (1, 1, 1), (1, 3, 5), None))
    write_blocks(path, [left, right])


@pytest.fixture(params=LAYOUTS, ids=lambda given: "{}{}{}".format(*given[:2], "AB"[given[2]]))
def old(request, tmp_path):
    """Two blocks in ADF, in an order of bytes, data in some pieces, pointers as text (A) or in binary (B)."""
    write_two(tmp_path / "two.cgns")
    (tmp_path / "old.cgns").write_bytes(in_adf(tmp_path / "two.cgns", *request.param))
    return tmp_path / "old.cgns"


def coordinate_bytes(path):
    """Which bytes of an ADF file hold coordinates."""
    found = np.zeros(path.stat().st_size, dtype=bool)
    with open_tree(path) as root:
        for _, zone in children(next(base for _, base in children(root, "CGNSBase_t")), "Zone_t"):
            for axis in AXES:
                for place, length in data(child(child(zone, "GridCoordinates"), axis)).runs:
                    found[place : place + length] = True
    return found


def test_adf_holds_the_same_mesh_and_keeps_all_other_bytes(old, tmp_path):
    mesh, same = Cgns().read(tmp_path / "two.cgns"), Cgns().read(old)
    np.testing.assert_array_equal(same.points, mesh.points)
    assert content(same) == content(mesh)
    Cgns().rewrite(old, mesh.points, tmp_path / "copy.cgns")
    assert (tmp_path / "copy.cgns").read_bytes() == old.read_bytes()
    Cgns().rewrite(old, mesh.points * np.pi, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, mesh.points * np.pi)
    a, b = (np.frombuffer(path.read_bytes(), dtype=np.uint8) for path in (old, tmp_path / "moved.cgns"))
    assert not np.any((a != b) & ~coordinate_bytes(old))
    if shutil.which("cgnsdiff"):
        for path in (old, tmp_path / "copy.cgns"):
            done = subprocess.run(
                ["cgnsdiff", "-d", "-f", tmp_path / "two.cgns", path], capture_output=True, text=True, check=False
            )
            assert done.stdout.split() == ["/", "<>", "/", ":", "labels", "differ"]
        assert complaints(tmp_path / "moved.cgns") == []


@pytest.mark.parametrize("order", ["little", "big"])
def test_files_of_the_cgns_library_with_pointers_in_binary(order, tmp_path):
    """Written by libcgns 3.4 (``ADF_Database_Open`` with ``IEEE_LITTLE_64`` and ``IEEE_BIG_64``) from `write_two`."""
    path = tmp_path / "library.cgns"
    path.write_bytes(
        gzip.decompress((Path(__file__).parent / "data" / f"two-blocks-B02012-{order}.cgns.gz").read_bytes())
    )
    write_two(tmp_path / "two.cgns")
    mesh, same = Cgns().read(tmp_path / "two.cgns"), Cgns().read(path)
    np.testing.assert_array_equal(same.points, mesh.points)
    assert content(same) == content(mesh)
    Cgns().rewrite(path, mesh.points + 0.5, tmp_path / "moved.cgns")
    np.testing.assert_array_equal(Cgns().read(tmp_path / "moved.cgns").points, mesh.points + 0.5)
    a, b = (np.frombuffer(file.read_bytes(), dtype=np.uint8) for file in (path, tmp_path / "moved.cgns"))
    assert not np.any((a != b) & ~coordinate_bytes(path))
    if shutil.which("cgnscheck"):
        assert complaints(tmp_path / "moved.cgns") == []


@pytest.mark.parametrize("mesh", [hybrid(2), polyhedral(hybrid())], ids=["shapes", "polyhedra"])
def test_unstructured_zones_in_adf(mesh, tmp_path):
    Cgns().write(mesh, tmp_path / "mesh.cgns")
    (tmp_path / "old.cgns").write_bytes(in_adf(tmp_path / "mesh.cgns"))
    same, old = Cgns().read(tmp_path / "mesh.cgns"), Cgns().read(tmp_path / "old.cgns")
    np.testing.assert_array_equal(old.points, mesh.points)
    assert old.names == same.names
    assert [len(patch) for patch in old.patches] == [len(patch) for patch in same.patches]
    assert [len(block) for block in old.cells] == [len(block) for block in same.cells]


def test_damaged_adf_is_refused_in_a_sentence(old, tmp_path):
    whole, path = old.read_bytes(), tmp_path / "damaged.cgns"
    end = len(whole.rstrip())  # blocks of 4096 bytes are filled up with blanks
    for size in range(40, end, end // 61):
        path.write_bytes(whole[:size])
        with pytest.raises(MeshFileError, match=r"damaged\.cgns: "):
            Cgns().read(path)
    random = np.random.default_rng(1)
    for _ in range(100):
        data = bytearray(whole)
        for place in random.integers(0, len(data), 3):
            data[place] = random.choice([0, 48, 49, 70, 255])
        path.write_bytes(data)
        with suppress(MeshFileError):
            Cgns().read(path)


def test_a_node_of_two_parents_is_refused(old, tmp_path):
    data = old.read_bytes()

    def entry(name):
        """Place of a pointer in the table of a node's children."""
        name = name.ljust(32)
        return 32 + next(
            at for at in range(len(data)) if data.startswith(name, at) and not data.startswith(b"NoDe", at - 4)
        )

    to, place = entry(b"right"), entry(b"GridCoordinates")
    (tmp_path / "loop.cgns").write_bytes(data[:to] + data[place : place + 12] + data[to + 12 :])
    with pytest.raises(MeshFileError, match="is there twice"):
        Cgns().read(tmp_path / "loop.cgns")


def test_data_of_many_nodes_in_the_same_bytes_are_refused(tmp_path):
    """Each of a hundred sections has the same 8000 bytes."""
    path = tmp_path / "mesh.cgns"
    Cgns().write(hybrid(), path)
    with h5py.File(path, "r+") as file:
        for i in range(100):
            node = create(zone_of(file), f"more {i}", "Elements_t", np.array([5, 0], dtype=np.int32))
            create(node, "ElementRange", "IndexRange_t", np.array([1000 * i + 1000, 1000 * i + 1665], dtype=np.int32))
            create(node, "ElementConnectivity", "DataArray_t", np.ones(1998 if i == 0 else 1, dtype=np.int32))
    data = in_adf(path, binary=True)
    short, long = (b"I4".ljust(32) + b"01" + n.to_bytes(8, "little") + bytes(88) + b"0001" for n in (1, 1998))
    name = b"NoDeElementConnectivity".ljust(36) + b"DataArray_t".ljust(32)
    places = [at for at in range(len(data)) if data.startswith(name, at)]
    (full,) = (at for at in places if data.startswith(long, at + 96))
    changed = bytearray(data)
    for at in places:
        if data.startswith(short, at + 96):
            changed[at + 96 : at + 242] = data[full + 96 : full + 242]
    (tmp_path / "shared.cgns").write_bytes(changed)
    with pytest.raises(MeshFileError, match="have more data than the file"):
        Cgns().read(tmp_path / "shared.cgns")


@pytest.mark.skipif(not shutil.which("cgnsconvert"), reason="apt-get install cgns-convert")
@pytest.mark.parametrize("zones", [1, 2])
def test_a_deflected_file_has_the_coordinates_of_the_same_mesh_in_hdf5(zones, tmp_path):
    """Converted by the library's own program; deflected, its tools find the coordinates alone different."""
    new, old = tmp_path / "new.cgns", tmp_path / "old.cgns"
    mesh = block_with_body(8) if zones == 1 else joined(block_with_body(8), block_with_body(8))
    Cgns().write(mesh, new)
    subprocess.run(["cgnsconvert", "-a", new, old], capture_output=True, check=True)
    names = sorted(mesh.names)
    moved = [path.with_stem(f"{path.stem}-moved") for path in (new, old)]
    for source, out in zip((new, old), moved, strict=True):
        points = Cgns().read(source).points
        Cgns().rewrite(source, points + 0.1 * np.sin(3.0 * points[:, [1, 2, 0]]), out)
    first, second = (Cgns().read(path) for path in moved)
    np.testing.assert_array_equal(first.points, second.points)
    assert content(first) == content(second)
    assert sorted(second.names) == names
    a, b = (np.frombuffer(path.read_bytes(), dtype=np.uint8) for path in (old, moved[1]))
    assert not np.any((a != b) & ~coordinate_bytes(old))
    assert complaints(moved[1]) == []

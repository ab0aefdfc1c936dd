"""A format in one file: all that commands do with a format follows from its layout."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import sdm_deflect as sdm
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats.registration import REGISTERED
from sdm_deflect.meshing.formats.registry import FORMATS, format_of, in_pieces, read
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import block_with_body
from tests.meshing.formats.alike import content
from tests.meshing.formats.test_hostile import complaint

FILE = Path(__file__).parents[3] / "docs" / "examples" / "own_format.py"


@pytest.fixture
def tets():
    """The format, known for the time of a test."""
    spec = importlib.util.spec_from_file_location("own_format", FILE)
    sys.modules["own_format"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del REGISTERED["tets"], sys.modules["own_format"]


def test_it_is_read_rewritten_and_read_in_pieces(tets, tmp_path):
    mesh, path, out = tets.block(), tmp_path / "cube.tets", tmp_path / "out.tets"
    assert format_of(path) is FORMATS["tets"]
    assert FORMATS["tets"].write(mesh, path) == ()
    assert content(read(path)) == content(mesh)
    np.testing.assert_array_equal(read(path).points, mesh.points)
    moved = mesh.points.copy()
    moved[6] += np.pi
    FORMATS["tets"].rewrite(path, moved, out)
    old, new = (np.frombuffer(file.read_bytes(), np.uint8) for file in (path, out))
    assert np.ptp(np.flatnonzero(old != new)) < 24
    np.testing.assert_array_equal(read(out).points, moved)
    with in_pieces(path) as found:
        assert found.pieces.blocks == (("tetra", 6),)
        found.pieces.rewrite(np.array([6]), moved[6:7], tmp_path / "pieces.tets")
    assert (tmp_path / "pieces.tets").read_bytes() == out.read_bytes()


def split(mesh):
    """The mesh with six tetrahedra in place of each hexahedron, and two triangles in place of each quad."""
    around = (1, 2, 3, 7, 4, 5)
    ends = zip(around, (*around[1:], around[0]), strict=True)
    tets = np.concatenate([mesh.cells[0].nodes[:, (0, a, b, 6)] for a, b in ends])
    patches = []
    for patch in mesh.patches:
        quads = np.concatenate([block.nodes for block in patch.faces])
        rows = np.array([np.roll(quad, -np.argmin(quad)) for quad in quads])
        patches.append(
            Patch(patch.name, (Cells("triangle", np.concatenate([rows[:, [0, 1, 2]], rows[:, [0, 2, 3]]])),))
        )
    return Mesh(mesh.points, (Cells("tetra", tets),), tuple(patches))


def test_it_is_deflected_and_converted(tets, tmp_path):
    mesh = split(block_with_body(8))
    words = {"hinge": [(0, -1, 0), (0, 1, 0)], "angle": 5.0, "fixed": "*[+-]"}
    points = []
    for source, out in (("mesh.su2", "first.tets"), ("mesh.tets", "second.tets")):
        format_of(source).write(mesh, tmp_path / source)
        sdm.deflect(tmp_path / source, "body", **words).save(tmp_path / out)
        points.append(read(tmp_path / out).points)
    np.testing.assert_array_equal(*points)


def test_damage_is_said_in_a_sentence(tets, tmp_path):
    path = tmp_path / "cube.tets"
    FORMATS["tets"].write(tets.block(), path)
    data = path.read_bytes()
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        assert "TETS" in complaint(FORMATS["tets"], path) or "truncated" in complaint(FORMATS["tets"], path)
    at = data.index(np.array([0, 1, 3, 7], "<i4").tobytes())
    path.write_bytes(data[:at] + np.array([99], "<i4").tobytes() + data[at + 4 :])
    assert "1 tetra elements name points that are not among the 8 (0 to 7)" in complaint(FORMATS["tets"], path)
    with pytest.raises(MeshFileError, match="No such file"):
        FORMATS["tets"].read(tmp_path / "none.tets")

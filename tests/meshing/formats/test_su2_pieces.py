"""An SU2 file read in pieces is the mesh that is read whole; its errors are the same."""

import tracemalloc

import numpy as np
import pytest

from sdm_deflect.deform.mesh import Cells, Mesh
from sdm_deflect.deform.progress import silent
from sdm_deflect.meshing.formats import shapes, su2_read
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.shapes import mirrored
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.formats.su2_pieces import in_pieces
from sdm_deflect.meshing.formats.su2_read import Su2File, read_zones
from tests.deform.blocks import block_with_body
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid

PLANE = Mesh(np.eye(3) * [1.0, 1.0, 0.0], (Cells("triangle", np.array([[0, 1, 2]])),), ())


@pytest.fixture
def opened(tmp_path):
    """Open a file with some text."""
    files = []

    def give(text):
        (tmp_path / "mesh.su2").write_text(text)
        files.append((tmp_path / "mesh.su2").open("rb"))
        return Su2File.opened(files[-1], lambda fraction: silent("", fraction))

    yield give
    for file in files:
        file.close()


def written(mesh, tmp_path):
    Su2().write(mesh, tmp_path / "first.su2")
    return (tmp_path / "first.su2").read_text()


def mixed():
    """A mesh of all shapes, its tetrahedra inverted, between two blocks of cells of another."""
    mesh = hybrid()
    cells = [Cells(own.shape, mirrored(own.shape, own.nodes)) if own.shape == "tetra" else own for own in mesh.cells]
    return Mesh(mesh.points, (*cells, *mesh.cells[:1]), mesh.patches)


@pytest.mark.parametrize("chunk", [30, 1 << 20])
@pytest.mark.parametrize("of", [hybrid, mixed])
def test_pieces_together_are_the_mesh(of, chunk, opened, tmp_path, monkeypatch):
    monkeypatch.setattr(su2_read, "CHUNK", chunk)
    source = opened(written(of(), tmp_path))
    whole, pieces = read_zones(source), in_pieces(source)
    assert pieces.mesh.points.tobytes() == whole.points.tobytes()
    assert pieces.mesh.cells == ()
    assert content(pieces.mesh)["patches"] == content(whole)["patches"]
    assert list(pieces.counts.items()) == [(block.shape, len(block)) for block in whole.cells]
    assert ("tetra" in pieces.mirrored) == (of is mixed)
    for _ in range(2):
        found = {}
        for block in pieces.cells():
            found.setdefault(block.shape, []).append(block.nodes)
        for block in whole.cells:
            np.testing.assert_array_equal(np.concatenate(found.pop(block.shape)), block.nodes)
        assert not found


def test_two_passes_may_alternate(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(su2_read, "CHUNK", 30)
    pieces = in_pieces(opened(written(mixed(), tmp_path)))
    for one, other in zip(pieces.cells(), pieces.cells(), strict=True):
        np.testing.assert_array_equal(one.nodes, other.nodes)


def test_the_hand_is_told_by_the_same_sample(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(shapes, "SAMPLE", 10)
    monkeypatch.setattr(su2_read, "CHUNK", 300)
    asked = []
    told = shapes.left_handed
    for module in ("shapes", "su2_pieces"):
        monkeypatch.setattr(
            f"sdm_deflect.meshing.formats.{module}.left_handed",
            lambda points, shape, nodes: asked.append(nodes) or told(points, shape, nodes),
        )
    source = opened(written(block_with_body(), tmp_path))
    read_zones(source)
    in_pieces(source)
    first, second = asked
    np.testing.assert_array_equal(first, second)
    assert 10 <= len(first) < 20


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("NPOIN= 14", "NPOIN= 15"), ("NELEM= 7", "NELEM= 8"), ("NELEM= 7", "NELEM= 6"), ("NMARK= 6", "NMARK= 7"),
        ("9 4 5 13 12", "9 4 5 13 11"), ("14 1 2 6 5 8 1", "15 1 2 6 5 8 1"), ("14 1 2 6 5 8 1", "14 1 2 6 5 80 1"),
        ("-0.031157651599626007", "nan"), ("MARKER_TAG= roof", "MARKER_TAG= floor"),
        ("NDIME= 3\n", "NDIME= 3\nNZONE= 2\n"),
    ],
)  # fmt: skip
def test_errors_are_those_of_the_whole(old, new, opened, tmp_path):
    text = written(hybrid(), tmp_path)
    assert old in text
    source = opened(text.replace(old, new, 1))
    said = []
    for read in (read_zones, in_pieces):
        with pytest.raises((MeshFileError, ValueError)) as caught:
            read(source)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_a_mesh_without_cells_is_refused(opened, tmp_path):
    with pytest.raises(MeshFileError, match="no volume cells"):
        in_pieces(opened(written(Mesh(hybrid().points, (), ()), tmp_path)))


@pytest.mark.parametrize("mesh", [hybrid(2), PLANE])
def test_several_zones_and_plane_meshes_are_not_read_in_pieces(mesh, opened, tmp_path):
    assert in_pieces(opened(written(mesh, tmp_path))) is None


def test_memory_is_not_that_of_the_cells(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(su2_read, "CHUNK", 1 << 12)
    monkeypatch.setattr(shapes, "SAMPLE", 100)
    mesh = hybrid()
    many = Cells("tetra", np.tile(mesh.cells[2].nodes, (20_000, 1)))
    source = opened(written(Mesh(mesh.points, (*mesh.cells[:2], many, mesh.cells[3]), mesh.patches), tmp_path))
    tracemalloc.start()
    try:
        pieces = in_pieces(source)
        assert sum(len(block) for block in pieces.cells()) == sum(pieces.counts.values()) > 80_000
        assert tracemalloc.get_traced_memory()[1] < many.nodes.nbytes / 2
    finally:
        tracemalloc.stop()

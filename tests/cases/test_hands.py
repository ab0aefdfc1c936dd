"""Cells of one block that a file counts in either hand are judged, each by itself, as flow solvers read them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.mesh.cells import MIRRORED, Cells, Patch
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.quality import one_hand
from sdm_deflect.meshing.formats.registry import format_of
from tests.deform.blocks import block_with_body
from tests.deform.jobs import turn
from tests.deform.plates import plate
from tests.limits import limited

HINGE = [[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]


def half_mirrored(mesh, share=2):
    """The mesh with every `share`-th cell counted in the other hand."""
    (cells,) = mesh.cells
    nodes = cells.nodes.copy()
    nodes[::share] = nodes[::share][:, MIRRORED[cells.shape]]
    return replace(mesh, cells=(Cells(cells.shape, nodes),))


@pytest.mark.parametrize("share", [2, 3, 100])
def test_each_cell_is_judged_in_its_own_hand(share):
    mesh = block_with_body()
    one, other = (turn(each, hinge=HINGE, angle=80.0, repair="auto") for each in (mesh, half_mirrored(mesh, share)))
    np.testing.assert_array_equal(one.points, other.points)
    assert one.quality == other.quality
    assert one.boxes[0].repaired is not None
    assert np.count_nonzero(other.plan.touched.newly_inverted(other.boxes[0].interpolated)) > 0
    assert sum(other.plan.touched.inverted) == 0


def test_a_cell_that_is_good_in_neither_hand_stays():
    mesh = block_with_body()
    points = mesh.points.copy()
    (cells,) = mesh.cells
    points[cells.nodes[0, 6]] = points[cells.nodes[0, 0]] - 0.1
    assert one_hand(points, cells) is cells


@pytest.mark.parametrize("suffix", [".su2", ".cgns", ".lb8.ugrid", ".msh"])
@pytest.mark.parametrize("pieces", [False, True])
def test_files_keep_their_order(sdm, tmp_path, suffix, pieces, monkeypatch):
    path, out = tmp_path / f"mixed{suffix}", tmp_path / f"out{suffix}"
    format_of(path).write(half_mirrored(block_with_body()), path)
    words = ["--surface", "body", "--hinge", "0,-0.5,0", "0,0.5,0", "--angle", "5", "--no-report", "--out", out]
    if pieces:
        limited(monkeypatch, file=0, cells=100, points=100)
    code, table, err = sdm("deflect", path, *words)
    assert code == 0, table + err
    assert "note:" not in table
    before, after = (format_of(one).read(one).cells[0].nodes for one in (path, out))
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("suffix", [".su2", ".cgns", ".lb8.ugrid", ".msh"])
@pytest.mark.parametrize("triangles", [False, True])
def test_hexahedra_with_repeated_corners_are_the_prisms_that_they_are(sdm, tmp_path, suffix, triangles):
    flat, path, out = plate(8, "triangle"), tmp_path / f"folded{suffix}", tmp_path / f"out{suffix}"
    n, (cells,) = len(flat.points), flat.cells
    a, b, c = cells.nodes.T
    prisms = np.column_stack([a, b, c, a + n, b + n, c + n])
    patches = [
        Patch(name, (Cells("quad", np.hstack([lines.nodes, lines.nodes[:, ::-1] + n])),))
        for name, lines in ((one.name, one.faces[0]) for one in flat.patches)
    ]
    for name, nodes in (("low", cells.nodes[:, ::-1]), ("high", cells.nodes + n)):
        faces = Cells("triangle", nodes) if triangles else Cells("quad", nodes[:, [0, 0, 1, 2]])
        patches.append(Patch(name, (faces,)))
    points = np.vstack([flat.points, flat.points + np.array([0.0, 0.0, 1.0])])
    folded = Mesh(points, (Cells("hexahedron", prisms[:, [0, 0, 1, 2, 3, 3, 4, 5]]),), tuple(patches))
    format_of(path).write(folded, path)
    words = ["--surface", "hole", "--slide", "low:plane", "--slide", "high:plane", "--fixed", "rest,bottom"]
    code, table, err = sdm("deflect", path, *words, "--hinge", "0,0,0", "0,0,1", "--angle", "5", "--out", out, "--json")
    assert code == 0, table + err
    (found,) = [one for one in json.loads(sdm("quality", out, "--json")[1])["quality"] if one["cells"]]
    assert (found["shape"], found["cells"], found["inverted"]) == ("wedge", len(prisms), 0)

"""A mesh of any cells: what it holds, what it refuses, and how patches are named."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError, nearest
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons, Polyhedra, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh, meant

POINTS = np.arange(24.0).reshape(8, 3)
TRIANGLES = Cells("triangle", np.array([[0, 1, 2], [2, 1, 5]]))


def test_a_patch_has_the_nodes_of_its_faces_and_loose_ones_once():
    quads = Polygons(np.array([5, 6, 7, 1]), np.array([0, 4]))
    patch = Patch("p", (TRIANGLES, quads), np.array([3, 5]))
    assert patch.nodes.tolist() == [0, 1, 2, 3, 5, 6, 7]
    assert len(patch) == 3


def test_a_mesh_without_zones_is_one():
    mesh = Mesh(POINTS, (), (Patch("a", (TRIANGLES,)), Patch("b", (), np.array([7]))))
    assert [(zone.start, zone.stop) for zone in mesh.zones] == [(0, 8)]
    assert mesh.names == ("a", "b")
    assert mesh.on("a", "b").tolist() == [0, 1, 2, 5, 7]
    assert mesh.on().tolist() == []
    assert mesh.faces_of(("a", "b")) == (TRIANGLES,)
    with pytest.raises(KeyError):
        mesh.patch("c")


def test_moved_points_keep_all_else():
    mesh = Mesh(POINTS, (), (Patch("a", (TRIANGLES,)),), (Zone("one", 0, 8),), "wing.su2", "/wing.su2")
    moved = mesh.with_points(POINTS + 1.0)
    assert (moved.patches, moved.zones, moved.name) == (mesh.patches, mesh.zones, mesh.name)
    with pytest.raises(InputError, match=r"wing\.su2: points \(7, 3\) must be \(8, 3\)"):
        mesh.with_points(POINTS[:7])


def test_cells_and_faces_have_the_corners_of_their_shape():
    with pytest.raises(ValueError, match="shape 'prism' is not one of line, triangle"):
        Cells("prism", np.zeros((1, 6), dtype=int))
    with pytest.raises(ValueError, match=r"wedge nodes \(1, 5\) must be \(M, 6\)"):
        Cells("wedge", np.zeros((1, 5), dtype=int))
    for offsets in ([0, 1, 4], [0, 3], [1, 4], []):
        with pytest.raises(ValueError, match="offsets must rise from 0 to 4 in steps of 2 or more"):
            Polygons(np.arange(4), np.array(offsets, dtype=int))
    with pytest.raises(ValueError, match="1 faces need as many owners, got 2"):
        Polyhedra(Polygons(np.arange(3), np.array([0, 3])), np.zeros(2, dtype=int), np.zeros(0, dtype=int))


@pytest.mark.parametrize(
    ("owner", "neighbour", "message"),
    [
        ([0, 0, 0, -1], [], "cells -1 to 0; they count from 0"),
        ([0, 0, 0, 0], [-1], "cells -1 to 0; they count from 0"),
        ([0, 0, 0, 4], [], "cells 0 to 4; they count from 0, and 4 sides of faces bound at most as many cells"),
        ([0, 0, 0, 0], [2**40], "cells 0 to 1099511627776; they count from 0, and 5 sides"),
        ([0.0, 0.0, 0.0, 0.0], [], "owners must be whole numbers, not float64"),
    ],
)
def test_owners_and_neighbours_that_are_no_cells_are_refused(owner, neighbour, message):
    faces = Polygons(np.array([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]), np.array([0, 3, 6, 9, 12]))
    with pytest.raises(InputError, match=message):
        Mesh(POINTS, (Polyhedra(faces, np.array(owner), np.array(neighbour, dtype=int)),), ())


def test_rows_of_polygons_are_polygons():
    faces = Polygons(np.arange(11), np.array([0, 3, 7, 11]))
    part = faces.rows(1, 3)
    assert (part.nodes.tolist(), part.offsets.tolist()) == (list(range(3, 11)), [0, 4, 8])


def test_a_wildcard_stands_for_a_patch_in_every_zone_and_a_plain_name_does_not():
    names = ("block/wing_left", "background/wing_left", "wing_right", "tail")
    mesh = Mesh(POINTS, (), tuple(Patch(name, (), np.array([0])) for name in names), name="pair.cgns")
    assert mesh.expand(["wing*"], "fixed") == names[:3]
    assert mesh.expand(["block/*"], "fixed") == names[:1]
    assert mesh.expand(["tail", "t*", "tail"], "fixed") == ("tail",)
    assert mesh.expand([], "fixed") == ()
    with pytest.raises(InputError, match=r"pair\.cgns: fixed 'wing_left' is no patch; did you mean .*block/wing_left"):
        mesh.expand(["wing_left"], "fixed")
    with pytest.raises(InputError, match="fixed 'zzz' is no patch; the patches are block/wing_left, background"):
        mesh.expand(["zzz"], "fixed")


def test_a_name_with_brackets_stands_for_itself():
    mesh = Mesh(POINTS, (), (Patch("wing[1]", ()), Patch("wing1", ())))
    assert mesh.expand(["wing[1]"], "fixed") == ("wing[1]",)
    assert meant("wing[1]", "wing1")
    assert not meant("wing", "zone/wing")


def test_the_nearest_names_or_all():
    assert nearest("wnig", ("wing", "tail")) == "did you mean wing?"
    assert nearest("zzz", ("wing", "tail")) == "known are wing, tail"
    assert nearest("zzz", ()) == "known are none"

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.labelled import Skin, nodes_by_face, skin, tets_of, touching, triangles_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import signed_volumes
from tests.labelled import changed


def test_nodes_on_patches_are_sorted_distinct_and_the_union(cube: Mesh) -> None:
    low, rest = cube.on("low"), cube.on("rest")
    assert (np.diff(low) > 0).all()
    assert (cube.points[low, 0] == 0.0).all()
    assert len(low) == 16
    assert np.array_equal(cube.on("low", "rest"), np.union1d(low, rest))


def test_triangles_of_a_patch_are_only_its_own(cube: Mesh) -> None:
    assert len(triangles_of(cube, "low")) + len(triangles_of(cube, "rest")) == len(skin(cube).triangles)


def test_cells_that_touch_nodes_are_found(cube: Mesh) -> None:
    expected = [bool({0, 7} & set(cell)) for cell in tets_of(cube).tolist()]
    assert touching(cube, np.array([0, 7])).tolist() == expected
    assert 0 < sum(expected) < len(tets_of(cube))
    assert not touching(cube, np.array([], dtype=np.intp)).any()


def test_triangles_point_out_of_the_fluid(cube: Mesh) -> None:
    a, b, c = (cube.points[skin(cube).triangles[:, i]] for i in range(3))
    enclosed = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert enclosed == pytest.approx(signed_volumes(cube.points, tets_of(cube)).sum())


def test_moving_nodes_leaves_the_original_alone(cube: Mesh) -> None:
    before = cube.points.copy()
    moved = cube.with_points(cube.points + 1.0)
    assert np.array_equal(cube.points, before)
    assert np.array_equal(moved.points, before + 1.0)
    assert tets_of(moved) is tets_of(cube)


def test_unknown_patch_is_named(cube: Mesh) -> None:
    with pytest.raises(KeyError, match="wing"):
        triangles_of(cube, "wing")


def test_the_boundary_keeps_its_order_and_patches_without_triangles(cube: Mesh) -> None:
    order = np.random.default_rng(3).permutation(len(skin(cube).triangles))
    mixed = Skin(*(values[order] for values in skin(cube)))
    mesh = changed(cube, **mixed._asdict(), names=(*cube.names, "none"))
    assert mesh.names == ("low", "rest", "none")
    assert not len(mesh.patch("none"))
    for values, expected in zip(skin(mesh), mixed, strict=True):
        assert np.array_equal(values, expected)


def test_the_nodes_of_each_cad_face_are_those_of_its_triangles(cube: Mesh) -> None:
    (nodes,) = nodes_by_face(cube, "low")
    assert np.array_equal(nodes, cube.on("low"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((64, 2))}, r"points \(64, 2\)"),
        ({"points": np.full((64, 3), np.nan)}, "not finite"),
        ({"tets": np.array([[0, 1, 2, 64]])}, "tetra: nodes 0 to 64"),
        ({"triangles": np.full((108, 3), -1)}, "nodes -1 to -1"),
        ({"patch": np.zeros(3, dtype=np.intp)}, r"patch \(3,\)"),
        ({"patch": np.full(108, 2)}, "patch holds 2 ... 2, expected 0 ... 1"),
        ({"face": np.full(108, -2)}, "cad_face holds -2"),
        ({"names": ("low", "low")}, "distinct"),
    ],
)
def test_invariants_are_checked(cube: Mesh, change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        changed(cube, **change)


def test_other_cells_are_refused(cube: Mesh) -> None:
    with pytest.raises(ValueError, match="other cells than tetrahedra"):
        tets_of(replace(cube, cells=(Cells("pyramid", np.array([[0, 1, 2, 3, 4]])),)))

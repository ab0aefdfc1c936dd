from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.deform.mesh.quality import signed_volumes
from sdm_deflect.meshing.mesh import TetMesh


def test_nodes_on_patches_are_sorted_distinct_and_the_union(cube: TetMesh) -> None:
    low, rest = cube.on("low"), cube.on("rest")
    assert (np.diff(low) > 0).all()
    assert (cube.points[low, 0] == 0.0).all()
    assert len(low) == 16
    assert np.array_equal(cube.on("low", "rest"), np.union1d(low, rest))


def test_triangles_of_a_patch_are_only_its_own(cube: TetMesh) -> None:
    assert len(cube.triangles_of("low")) + len(cube.triangles_of("rest")) == len(cube.triangles)


def test_cells_that_touch_nodes_are_found(cube: TetMesh) -> None:
    expected = [bool({0, 7} & set(cell)) for cell in cube.tets.tolist()]
    assert cube.touching(np.array([0, 7])).tolist() == expected
    assert 0 < sum(expected) < len(cube.tets)
    assert not cube.touching(np.array([], dtype=np.intp)).any()


def test_triangles_point_out_of_the_fluid(cube: TetMesh) -> None:
    a, b, c = (cube.points[cube.triangles[:, i]] for i in range(3))
    enclosed = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert enclosed == pytest.approx(signed_volumes(cube.points, cube.tets).sum())


def test_moving_nodes_leaves_the_original_alone(cube: TetMesh) -> None:
    before = cube.points.copy()
    moved = cube.with_points(cube.points + 1.0)
    assert np.array_equal(cube.points, before)
    assert np.array_equal(moved.points, before + 1.0)
    assert moved.tets is cube.tets


def test_unknown_patch_is_named(cube: TetMesh) -> None:
    with pytest.raises(ValueError, match=r"no patch 'wing'.*low, rest"):
        cube.on("wing")
    with pytest.raises(ValueError, match="no patch 'volume'"):
        cube.triangles_of("volume")


def test_the_engine_sees_the_same_cells_and_the_patches_that_have_triangles(cube: TetMesh) -> None:
    mesh = replace(cube, names=("volume", "low", "rest", "none")).as_mesh("cube")
    assert (mesh.name, mesh.names) == ("cube", ("low", "rest"))
    assert mesh.points is cube.points
    assert [(block.shape, block.nodes.tolist()) for block in mesh.cells] == [("tetra", cube.tets.tolist())]
    for name in mesh.names:
        (faces,) = mesh.patch(name).faces
        assert np.array_equal(faces.nodes, cube.triangles_of(name))
        assert np.array_equal(mesh.on(name), cube.on(name))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((64, 2))}, r"points has shape \(64, 2\)"),
        ({"points": np.full((64, 3), np.nan)}, "not finite"),
        ({"tets": np.array([[0, 1, 2, 64]])}, "tets holds 0 ... 64"),
        ({"triangles": np.array([[0, 1, -1]])}, "triangles holds -1 ... 1"),
        ({"patch": np.zeros(3, dtype=np.intp)}, r"patch has shape \(3,\)"),
        ({"patch": np.zeros(108, dtype=np.intp)}, "patch holds 0 ... 0, expected 1"),
        ({"face": np.full(108, -2)}, "face holds -2"),
        ({"names": ("low", "rest")}, "names must start with 'volume'"),
        ({"names": ("volume", "low", "low")}, "distinct"),
    ],
)
def test_invariants_are_checked(cube: TetMesh, change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(cube, **change)  # type: ignore[arg-type]


def test_a_changed_number_of_nodes_is_refused(cube: TetMesh) -> None:
    with pytest.raises(ValueError, match=r"expected \(64, 3\)"):
        cube.with_points(np.zeros((3, 3)))

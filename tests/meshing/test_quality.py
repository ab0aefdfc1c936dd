import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.quality import BLOCK, mean_ratio, signed_volumes, summarise

REGULAR = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])
ONE = np.array([[0, 1, 2, 3]])
coordinates = arrays(np.float64, (4, 3), elements=st.floats(-1.0, 1.0, width=32))


def test_the_regular_tetrahedron_has_mean_ratio_one() -> None:
    assert mean_ratio(REGULAR, ONE) == pytest.approx(1.0, abs=1e-15)
    assert signed_volumes(REGULAR, ONE) == pytest.approx(8.0 / 3.0)


@given(coordinates)
def test_the_mean_ratio_lies_between_zero_and_one(points: np.ndarray) -> None:
    if np.ptp(points, axis=0).max() > 1e-3:
        assert 0.0 <= mean_ratio(points, ONE)[0] <= 1.0 + 1e-12


@given(coordinates, st.floats(1e-3, 1e3), st.floats(0.0, 6.0))
def test_the_mean_ratio_ignores_size_place_and_attitude(points: np.ndarray, scale: float, turn: float) -> None:
    if np.ptp(points, axis=0).max() < 1e-3:
        return
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    moved = scale * points @ rotation.T + scale
    assert mean_ratio(moved, ONE) == pytest.approx(mean_ratio(points, ONE), abs=1e-6)


def test_swapping_two_nodes_inverts() -> None:
    swapped = ONE[:, [1, 0, 2, 3]]
    assert signed_volumes(REGULAR, swapped) == -signed_volumes(REGULAR, ONE)
    assert mean_ratio(REGULAR, swapped)[0] == 0.0


def test_volumes_of_the_cells_fill_the_cube_across_blocks(cube: TetMesh) -> None:
    tets = np.tile(cube.tets, (1 + BLOCK // len(cube.tets), 1))
    assert len(tets) > BLOCK
    expected = len(tets) / len(cube.tets)
    assert signed_volumes(cube.points, tets).sum() == pytest.approx(expected)


def test_summary_counts_shares() -> None:
    summary = summarise(np.array([0.0, 0.1, 0.3, 0.9]))
    assert (summary.below_0_2, summary.below_0_4, summary.inverted) == (0.5, 0.75, 1)
    assert summary.min == 0.0
    assert summary.mean == pytest.approx(0.325)
    with pytest.raises(ValueError, match="no cells"):
        summarise(np.empty(0))

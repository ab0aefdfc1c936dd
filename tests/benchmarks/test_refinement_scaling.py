from dataclasses import replace

import numpy as np
import pytest

from benchmarks.refinement_scaling import Size, deformed, measured, table
from deform.hexahedron import box
from deform.interpolant import Interpolant
from deform.kernels import ThinPlateSpline
from meshing.mesh import TetMesh
from meshing.refine import split


@pytest.fixture
def corner() -> TetMesh:
    """The tetrahedron between the origin and the unit vectors, refined three times."""
    points = np.vstack([np.zeros(3), np.eye(3)])
    skin = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    one = TetMesh(points, np.array([[0, 1, 2, 3]]), skin, np.ones(4, int), np.full(4, -1), ("volume", "skin"))
    return split(split(split(one)))


@pytest.fixture
def pull() -> Interpolant:
    """A displacement by 0.1 in x."""
    alpha = np.zeros((4, 3))
    alpha[0, 0] = 0.1
    return Interpolant(ThinPlateSpline(), np.eye(3), np.zeros((3, 3)), alpha)


def test_a_rigid_motion_of_everything_keeps_the_quality(corner: TetMesh, pull: Interpolant) -> None:
    size = deformed(corner, pull, box(np.full(3, -1.0), np.full(3, 2.0)), (3, 1.0, 2))
    assert size.inside == size.points == len(corner.points)
    assert size.cells == 512
    assert size.quality_after == pytest.approx(size.quality_before)
    assert (size.refinements, size.refine_seconds, size.refine_peak_bytes) == (3, 1.0, 2)


def test_only_nodes_inside_move(corner: TetMesh, pull: Interpolant) -> None:
    size = deformed(corner, pull, box(np.full(3, -1.0), np.full(3, 0.3)), (3, 1.0, 2))
    assert size.inside == np.count_nonzero((corner.points <= 0.3).all(axis=1))
    assert size.quality_after < size.quality_before


def test_memory_of_an_action_is_seen() -> None:
    before = measured(lambda: None)[2]
    _, seconds, peak = measured(lambda: np.ones(20_000_000).sum())
    assert peak - before > 100e6
    assert seconds > 0.0


def test_table_gives_the_growth_of_time_with_size() -> None:
    small = Size(1, 1000, 5000, 100, 1.0, 10**9, 0.5, 0.5, 10**9, 0.4, 0.3)
    large = replace(small, refinements=2, points=10_000, filter_seconds=5.0, evaluation_seconds=5.0)
    text = table([small, large])
    assert "to the power of 1.00" in text
    assert text.count("| 5,000 | ") == 2
    assert "power" not in table([small])

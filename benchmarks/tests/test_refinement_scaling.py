import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.refinement_scaling import Size, fastest, measured, table
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.generate.generation import split
from sdm_deflect.meshing.mesh import Skin, tetrahedral


@pytest.fixture
def corner() -> Mesh:
    """The tetrahedron between the origin and the unit vectors, refined once."""
    points = np.vstack([np.zeros(3), np.eye(3)])
    skin = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    boundary = Skin(skin, np.zeros(4, int), np.full(4, -1))
    return split(tetrahedral(points, np.array([[0, 1, 2, 3]]), boundary, ("skin",)))


# In a process of its own: not every system lets a process forget the peak that other tests have left.
MEASURE = """
import numpy as np
from benchmarks.refinement_scaling import measured
_, nothing = measured(lambda: None)
_, much = measured(lambda: np.ones(20_000_000).sum())
print(much.peak_bytes - nothing.peak_bytes, much.processor_seconds)
"""


@pytest.mark.nightly
def test_memory_of_an_action_is_seen() -> None:
    done = subprocess.run([sys.executable, "-c", MEASURE], check=True, capture_output=True, text=True)
    peak, processor = map(float, done.stdout.split())
    assert peak > 100e6
    assert processor > 0.0


@pytest.mark.nightly
def test_the_fastest_is_no_slower_than_one(corner: Mesh) -> None:
    taken = [1_000_000, 1_000, 1_000_000]
    assert fastest(lambda: np.ones(taken.pop()).sum()) < measured(lambda: np.ones(50_000_000).sum())[1].seconds
    assert taken == []


@pytest.mark.nightly
def test_table_gives_the_growth_of_time_with_size() -> None:
    small = Size(1, 1000, 5000, 100, 1.0, 1.0, 10**9, 0.5, 0.5, 2.0, 2.0, 10**9, 300, 0.4, 0.3, 0)
    large = replace(small, refinements=2, points=10_000, filter_seconds=5.0, evaluation_seconds=5.0)
    text = table([small, large])
    assert "to the power of 1.00" in text
    assert text.count("| 5,000 | ") == 2
    assert "power" not in table([small])

import numpy as np
import pytest

from benchmarks import evaluation


@pytest.fixture
def small(monkeypatch):
    """Sizes that take no time."""
    for name, value in (("CENTERS", 64), ("INSIDE", 400), ("FEW", 16)):
        monkeypatch.setattr(evaluation, name, value)


def test_growth_begins_at_the_papers_sizes():
    assert evaluation.doubled(evaluation.INSIDE) == [80_261, 160_522, 321_044, 642_088, 1_284_176]
    assert evaluation.doubled(evaluation.CENTERS) == [2_200, 4_400, 8_800, 17_600, 35_200]


def test_growth_says_from_where_to_where(small):
    points, centers = evaluation._growth(1)
    assert (points.name, centers.name) == ("evaluation_exponent_points", "evaluation_exponent_centers")
    assert points.note.startswith("400 to 6,400: ")
    assert centers.note.startswith("64 to 1,024: ")
    assert np.isfinite([points.value, centers.value]).all()


def test_few_centres_stand_beside_many(small):
    (figure,) = evaluation._few_centers(1)
    assert figure.name == "evaluation_small_ns"
    assert figure.value > 0.0
    assert figure.note.startswith("16 centres; ")
    assert "with 64: " in figure.note


def test_all_centres_of_a_large_sum_differ():
    assert len(np.unique(evaluation.task(8, 35_200).centers, axis=0)) == 35_200

import numpy as np

from benchmarks import adaptation
from benchmarks.workloads import aileron, tail


def test_the_small_case_compares_equal_outcomes():
    seconds, ratio = adaptation._small(1)
    assert seconds.name == "small_adaptation_seconds"
    assert ratio.name == "small_adaptation_vs_resolve"
    assert "same centres" in ratio.note
    assert ratio.value > 0.0


def test_growth_is_measured_over_four_doublings():
    assert adaptation._doubled(4_800) == [300, 600, 1_200, 2_400, 4_800]
    runs = adaptation.Runs(tail(600))
    options = adaptation._options(12, 260)
    actions = {str(n): runs.grown(str(n), options, adaptation.Separated()) for n in (1, 2)}
    figure = adaptation._fitted("name", actions, [1, 2], 1)
    assert np.isfinite(figure.value)


def test_workloads_keep_their_one_direction():
    runs = adaptation.Runs(aileron(), component=1)
    assert runs.workload.sites.components == (1,)

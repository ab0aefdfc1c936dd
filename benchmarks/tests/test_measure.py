import json
from time import sleep

import numpy as np
import pytest

from benchmarks.measure import Times, exponent, side_by_side, warm
from benchmarks.results import Result, markdown, show, write
from studies.machine import machine


def test_ratios_are_taken_round_by_round():
    times = Times(("ours", "theirs"), np.array([[1.0, 2.0], [10.0, 40.0], [1.0, 3.0]]))
    assert times.ratio("theirs", "ours") == 3.0
    assert times.median("ours") == 1.0


def test_actions_take_turns():
    order = []
    actions = {"a": lambda: order.append("a"), "b": lambda: order.append("b")}
    warm(actions)
    times = side_by_side(actions, 2)
    assert "".join(order) == "ab" * 3
    assert times.seconds.shape == (2, 2)
    assert (times.seconds >= 0.0).all()


def test_actions_settle_before_they_are_timed():
    calls = []
    action = {"a": lambda: (calls.append("a"), sleep(0.02))}
    assert side_by_side(action, 2, settling=0.01).seconds.shape == (2, 1)
    assert len(calls) == 2 * (1 + 1)
    side_by_side(action, 2)
    assert len(calls) == 6


@pytest.mark.parametrize("power", [0.5, 1.0, 2.1])
def test_exponent_of_a_power_law(power):
    sizes = [1, 2, 4, 8, 16]
    assert exponent(sizes, [3.0 * n**power for n in sizes]) == pytest.approx(power)


def test_figures_are_written_whole(tmp_path, capsys):
    figures = [Result("evaluation_vs_c", 2.0, "their time / ours", 5, "note")]
    write(tmp_path / "out.json", figures)
    show("title", figures)
    expected = {"evaluation_vs_c": {"value": 2.0, "unit": "their time / ours", "median_of": 5, "note": "note"}}
    assert json.loads((tmp_path / "out.json").read_text()) == expected
    assert [f.name for f in tmp_path.iterdir()] == ["out.json"]
    assert "evaluation_vs_c" in capsys.readouterr().out
    assert "| `evaluation_vs_c` | 2 | their time / ours | 5 | note |" in markdown("title", figures).splitlines()
    assert "cores" in machine()

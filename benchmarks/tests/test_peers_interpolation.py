"""The interpolations that are compared interpolate the same, and what is not installed is named."""

import numpy as np
import pytest

from benchmarks import peers_interpolation as peers
from benchmarks.workloads import points_around, tail

WORK = tail(400)
POINTS = points_around(WORK.region, 300)


@pytest.fixture(scope="module")
def reference():
    return peers.METHODS[peers.OURS][0](WORK.sites.points, WORK.sites.values)(POINTS)


@pytest.mark.parametrize("name", [name for name in peers.installed()[0] if name != "ours, greedy"])
def test_all_that_are_installed_agree(name, reference):
    found = peers.METHODS[name][0](WORK.sites.points, WORK.sites.values)
    np.testing.assert_allclose(found(POINTS), reference, atol=1e-10)
    np.testing.assert_allclose(found(WORK.sites.points), WORK.sites.values, atol=1e-10)


def test_the_greedy_one_is_within_its_tolerance_at_the_sites():
    found = peers.METHODS["ours, greedy"][0](WORK.sites.points, WORK.sites.values)
    assert np.abs(found(WORK.sites.points) - WORK.sites.values).max() <= peers.TOLERANCE


def test_a_process_of_its_own_gives_the_same(tmp_path, reference):
    file = tmp_path / "given.npz"
    np.savez(file, sites=WORK.sites.points, values=WORK.sites.values, points=POINTS)
    found = peers.carried_out(peers.OURS, file, tmp_path)
    np.testing.assert_allclose(found.at_points, reference, atol=1e-13)
    assert found.peak > 1e7
    assert found.fit > 0.0


def test_what_is_not_installed_has_a_reason():
    found, missing = peers.installed()
    assert set(peers.METHODS) <= set(found) | set(missing)
    assert all(missing.values())


def test_the_page_has_a_row_of_each():
    text = (peers.Path(__file__).parents[2] / "benchmarks" / "peers.md").read_text(encoding="utf-8")
    assert all(text.count(f"| {name} |") == 2 for name in peers.METHODS)
    assert all(f"- {name}: {reason}." in text for name, reason in peers.ABSENT.items())

"""Equal lengths: their order decides, whatever their last bits are."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import farthest
from sdm_deflect.base.ties import EQUAL, clearly_less, first_largest, whole
from sdm_deflect.deform.box.face_sites import inner_sites, plane_axes
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.confined import zero_sites
from sdm_deflect.deform.rbf.rules import TIE, GreedyOptions, Separated, Worst

UNIT = box(np.zeros(3), np.ones(3))
# Seeds of shifts by a few units in the last place.
SEEDS = range(5)


@pytest.fixture(params=SEEDS)
def random(request):
    return np.random.default_rng(request.param)


def rounded(points, random):
    return points + random.integers(-3, 4, points.shape) * np.spacing(np.abs(points).max())


def test_the_first_of_equal_lengths_is_the_largest():
    lengths = np.array([1.0, 3.0, np.nextafter(3.0, 4.0), 2.0])
    assert first_largest(lengths) == 1
    assert first_largest(lengths[::-1].copy()) == 1
    assert first_largest(np.array([1.0, 3.0, 3.0 * (1.0 + 3.0 * EQUAL)])) == 2
    assert first_largest(np.zeros(3)) == 0


def test_equal_lengths_are_not_less():
    assert not clearly_less(np.nextafter(0.5, 0.0), 0.5)
    assert clearly_less(0.5 * (1.0 - 3.0 * EQUAL), 0.5)
    assert clearly_less(np.array([0.4, 0.5]), 0.5).tolist() == [True, False]


@pytest.mark.parametrize(("ratio", "count"), [(4.5, 5), (np.nextafter(4.5, 0.0), 5), (5.5, 6), (4.4999, 4), (0.2, 0)])
def test_the_larger_of_two_whole_numbers_equally_near(ratio, count):
    assert whole(ratio) == count


def test_points_of_a_lattice_are_chosen_in_one_order(random):
    lattice = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * 3), axis=-1).reshape(-1, 3)
    assert farthest(rounded(lattice, random), 100).tolist() == farthest(lattice, 100).tolist()


def test_many_points_are_chosen_as_few_are(random, monkeypatch):
    lattice = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 12)] * 3), axis=-1).reshape(-1, 3)
    few = farthest(lattice, 100).tolist()
    monkeypatch.setattr("sdm_deflect.base.arrays.FEW", 1000)
    assert farthest(rounded(lattice, random), 100).tolist() == few


@pytest.mark.parametrize("rule", [Separated(), Worst()])
def test_sites_with_equal_errors_become_centres_in_one_order(rule, random):
    lattice = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 11)] * 3), axis=-1).reshape(-1, 3)
    error = np.exp(-np.linalg.norm(lattice - [0.2, 0.0, 0.0], axis=1))
    options, chosen = GreedyOptions(n_add=60, tol_add=0.1, tol_stop=0.1), np.array([0, 1000])
    first = rule.choose(lattice, error, chosen, options)
    noisy = error + 1e-4 * TIE * options.tol_stop * random.uniform(-1.0, 1.0, error.shape)
    assert rule.choose(rounded(lattice, random), noisy, chosen, options).tolist() == first.tolist()
    assert len(first) >= 8


def test_errors_that_differ_decide_before_rows():
    options = GreedyOptions(n_add=4, tol_add=1.0, tol_stop=1.0)
    error = np.array([2.0, 2.0 + 3.0 * TIE, 5.0, 0.5, 5.0 + 0.5 * TIE])
    assert Worst().choose(np.zeros((5, 3)), error, np.array([], dtype=int), options).tolist() == [2, 4, 1, 0]


def test_sites_on_a_face_begin_at_one_edge(random):
    face = UNIT.face("z+")
    other = rounded(face, random)
    assert np.abs(plane_axes(other)[0] - plane_axes(face)[0]).max() < 1e-14
    for spacing in (0.25, 1.0 / 4.5, 0.4):
        assert np.abs(inner_sites(other, spacing) - inner_sites(face, spacing)).max() < 1e-14


def test_a_site_half_a_spacing_from_a_node_stays(random):
    sites, nodes = np.array([[0.1, 0.7, 0.3]]), np.array([[0.1, 0.7, 0.4]])
    assert len(zero_sites(rounded(sites, random), rounded(nodes, random), 0.2)) == 1
    assert not len(zero_sites(sites, nodes, 0.2001))


def test_a_point_on_a_face_is_inside(random):
    on = np.array([[1.0, 0.3, 0.4], [0.2, 0.0, 0.7], [0.0, 0.0, 0.0]])
    assert UNIT.contains(rounded(on, random)).all()
    assert not UNIT.contains(on + 1e-8 * np.sign(on - 0.5)).any()


def test_a_section_begins_at_one_corner(random):
    normal = np.array([0.0, 0.0, 1.0])
    section = UNIT.section(np.array([0.0, 0.0, 0.5]), normal)
    corners = box(rounded(np.zeros(3) + 1e-30, random), rounded(np.ones(3), random)).corners
    other = type(UNIT)(corners).section(np.array([0.0, 0.0, 0.5]), normal)
    assert np.abs(other - section).max() < 1e-14

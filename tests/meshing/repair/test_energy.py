"""The energy, its gradient and its curvature, against differences."""

import numpy as np
import pytest

from sdm_deflect.meshing.mesh.quality import mean_ratio
from sdm_deflect.meshing.repair.elements import REGULAR, RegionElements, Tetrahedra
from sdm_deflect.meshing.repair.energy import Energy
from tests.meshing.repair.meshes import inner, lattice

FORMS = [(0.0, 1), (0.0, 2), (0.0, 8), (0.3, 1), (0.01, 4)]


def energy_of(mesh, unknown):
    tets = mesh.cells[0].nodes
    parts = [(mesh.cells[0], np.arange(len(tets)), 1.0)]
    return Energy(RegionElements.of(Tetrahedra.of(mesh.points, parts), unknown, mesh.points, np.ones(len(tets))))


@pytest.fixture(scope="module")
def small():
    """A lattice, its energy and places: moved a little, and so far that cells are inverted."""
    mesh = lattice(counts=(4, 4, 4))
    one = energy_of(mesh, inner(mesh))
    rng = np.random.default_rng(7)
    places = mesh.points[one.elements.used]
    moves = rng.uniform(-1.0, 1.0, places.shape) * (np.arange(len(places)) < one.elements.unknown)[:, None]
    return mesh, one, places + 0.04 * moves, places + 0.3 * moves


def test_the_energy_is_that_of_the_mean_ratio(small):
    mesh, one, places, _ = small
    points = mesh.points.copy()
    points[one.elements.used] = places
    own = np.isin(mesh.cells[0].nodes, one.elements.used[: one.elements.unknown]).any(axis=1)
    quality = mean_ratio(points, mesh.cells[0].nodes[own])
    for power in (1, 4):
        assert one(places, 0.0, power)[0] == pytest.approx(np.sum(quality ** (-3.0 * power)), rel=1e-12)
    assert one.least(places) == pytest.approx(quality.min(), rel=1e-12)


@pytest.mark.parametrize(("eps", "power"), FORMS)
def test_the_gradient_is_that_of_differences(small, eps, power):
    _, one, places, torn = small
    at = torn if eps else places
    value, gradient = one(at, eps, power)
    assert np.isfinite(value)
    rng = np.random.default_rng(3)
    for _ in range(5):
        way = np.zeros_like(at)
        way[: len(gradient)] = rng.normal(size=gradient.shape)
        step = 1e-6
        ends = [one(at + sign * step * way, eps, power)[0] for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        assert np.vdot(gradient, way[: len(gradient)]) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(("eps", "power"), FORMS)
def test_the_curvature_is_the_positive_part_of_that_of_differences(eps, power):
    """For one element: with L = log(f^3 / chi^2), it is power E (3 f'' / f + 2 (log chi)'^2 + power L'^2)."""
    rng = np.random.default_rng(11)
    corners = np.vstack([np.zeros(3), REGULAR.T]) + 0.2 * rng.normal(size=(4, 3))

    def parts(points):
        edges = np.linalg.solve(REGULAR.T, points[1:] - points[0]).T
        size, d = np.sum(edges**2) / 3.0, np.linalg.det(edges)
        return size, np.log(0.5 * (d + np.hypot(d, eps)))

    for node in range(4):
        step, axes = 1e-4, np.eye(3)
        moved = [[parts(corners + s * step * np.outer(np.eye(4)[node], axis)) for s in (1, -1)] for axis in axes]
        size, bend = parts(corners)
        slopes = np.array([[(a - b) / (2.0 * step) for a, b in zip(*pair, strict=True)] for pair in moved])
        second = (moved[0][0][0] - 2.0 * size + moved[0][1][0]) / step**2
        whole = 3.0 * slopes[:, 0] / size - 2.0 * slopes[:, 1]
        value = np.exp(power * (3.0 * np.log(size) - 2.0 * bend))
        chi = np.outer(slopes[:, 1], slopes[:, 1])
        expected = power * value * (3.0 * second / size * np.eye(3) + 2.0 * chi + power * np.outer(whole, whole))
        elements = RegionElements(
            np.r_[node, np.delete(np.arange(4), node)], 1, np.array([_placed(node)]), _target(), np.zeros(1, int),
            np.array([0, 1]), np.array([node]),
        )  # fmt: skip
        found = Energy(elements).curvature(corners[elements.used], eps, power)[0]
        assert found == pytest.approx(expected[np.triu_indices(3)], rel=1e-5, abs=1e-5 * np.abs(expected).max())


def _placed(node):
    """Rows of the corners 0 to 3 when `node` comes first."""
    order = [node, *(k for k in range(4) if k != node)]
    return [order.index(k) for k in range(4)]


def _target():
    return np.append(np.linalg.inv(REGULAR).ravel(), 1.0)[None]


def test_the_bits_do_not_depend_on_the_number_of_threads(small, monkeypatch):
    mesh = lattice(counts=(12, 12, 12))
    one = energy_of(mesh, inner(mesh))
    rng = np.random.default_rng(1)
    at = mesh.points[one.elements.used] + 0.02 * rng.normal(size=(len(one.elements.used), 3))
    found = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("sdm_deflect.base.threads.available_threads", lambda threads=threads: threads)
        value, gradient = one(at, 0.1, 2)
        found.append((value, gradient.tobytes(), one.curvature(at, 0.1, 2).tobytes()))
    assert found[0] == found[1] == found[2]


def test_an_inverted_element_has_an_infinite_energy_without_eps(small):
    _, one, _, torn = small
    assert not np.isfinite(one(torn, 0.0, 1)[0])
    assert one.least(torn) == 0.0

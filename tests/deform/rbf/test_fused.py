"""One interpolant of several adaptations: a plate that turns, held by sites on the box around it."""

import numpy as np
import pytest

from sdm_deflect.base.arrays import farthest
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join, multivariate, univariate
from sdm_deflect.deform.rbf.greedy import adapt, fuse
from sdm_deflect.deform.rbf.kernels import Multiquadric, ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions
from sdm_deflect.meshing.mesh.axis import Axis

REGION = box(np.array([0.0, -1.0, -1.0]), np.array([2.0, 2.0, 1.0]))
OPTIONS = GreedyOptions(n_add=6, tol_add=1e-3, tol_stop=1e-3)
CLOUD = np.random.default_rng(0).uniform((-1, -2, -2), (3, 3, 2), (5_000, 3))


def _plate(n=12):
    """A unit plate whose leading edge is the hinge line x = 0."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    return np.column_stack([x, y, np.zeros(x.size)])


def _fits(group):
    surface = _plate()
    hinge = Axis(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    parts = [DataSites(surface, hinge.displacement(surface, -12.0)), fixed_sites(REGION.face_sites(0.4))]
    return [adapt(g, ThinPlateSpline(), farthest(g.points, 10), OPTIONS) for g in group(parts)]


@pytest.fixture(scope="module")
def squv():
    return _fits(univariate)


def test_the_fused_interpolant_is_its_parts(squv):
    whole = fuse(squv)(CLOUD)
    for fit in squv:
        alone = fit.interpolant(CLOUD)
        np.testing.assert_allclose(whole[:, list(fit.components)], alone, atol=1e-13)
    together = fuse(squv)
    assert len(together.centers) < sum(len(f.chosen) for f in squv)  # shared centres are taken once


def test_mv_and_squv_agree_to_the_tolerance(squv):
    surface = _plate()
    mv = fuse(_fits(multivariate))(surface)
    assert np.abs(mv - fuse(squv)(surface)).max() < 2e-3


def test_displacement_vanishes_at_pinned_faces(squv):
    sites = join([fixed_sites(REGION.face_sites(0.4))]).points
    assert np.abs(fuse(squv)(sites)).max() < 1e-3


def test_a_direction_without_fit_does_not_move(squv):
    assert not fuse(squv[2:])(CLOUD)[:, :2].any()


def test_fusing_checks_what_it_gets(squv):
    with pytest.raises(ValueError, match="no adaptation"):
        fuse([])
    with pytest.raises(ValueError, match="two adaptations hold one direction"):
        fuse([squv[0], squv[0]])
    surface = _plate()
    other = adapt(DataSites(surface, surface[:, :1], (0,)), Multiquadric(1.0), farthest(surface, 9), OPTIONS)
    with pytest.raises(ValueError, match="different kernels"):
        fuse([squv[1], other])

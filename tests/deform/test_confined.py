"""The paper's method once more, in NumPy: eqs. 5 and 6 solved densely on the chosen centres, and eq. 7 as a matrix."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.volume.deflection import deflect
from tests.frozen.test_frozen import frozen_mesh

# Largest difference of a coordinate, m; the control surfaces move by about 0.01 m.
SAME = 1e-9
# Nodes in one block of the evaluation matrix.
ROWS = 2000


def displaced(fits, known, displacement, points):
    """Return the displacement (M, 3) of points by dense fits: a centre is a known node, or a zero site."""
    tree, out = cKDTree(known), np.zeros_like(points)
    for one in fits.adaptations:
        centers = one.interpolant.centers
        apart, row = tree.query(centers)
        values = np.where(apart[:, None] < 1e-12, displacement[row], 0.0)[:, one.components]
        dense = fit(ThinPlateSpline(), centers, values)
        for start in range(0, len(points), ROWS):
            some = points[start : start + ROWS]
            r = cdist(some, centers)
            phi = r**2 * np.log(np.where(r > 0.0, r, 1.0))
            constant = np.column_stack([np.ones(len(some)), some])
            out[start : start + ROWS, one.components] = phi @ dense.beta + constant @ dense.alpha
    return out


@pytest.mark.parametrize(
    ("name", "angle", "strategy"),
    [
        ("aileron", -12.0, "squv"),
        ("aileron", -12.0, "mv"),
        ("aileron-chimera", -30.0, "mv"),
        ("aileron", -30.0, "squv"),
    ],
)
def test_nodes_go_where_dense_fits_on_the_same_centres_bring_them(name, angle, strategy):
    case = case_named(name)
    case = replace(case, angle=angle, adaptation=replace(case.adaptation, strategy=strategy), repair="off")
    plan = plan_of(case, frozen_mesh("block" if case.domain == "block" else "aircraft"))
    (found,) = deflect(plan).boxes
    sections = found.plan.region.sections
    assert bool(sections) == ("chimera" in name)
    points = plan.mesh.points
    for step in found.steps:
        start, expected = step.start, points.copy()
        expected[start.known] += step.known
        move = displaced(step.fits, points[start.known], step.known, points[start.free])
        for section, nodes in sections:
            move[np.isin(start.free, nodes), section.component] = 0.0
        expected[start.free] += move
        assert np.abs(move).max() > 1e-3
        assert np.abs(step.points - expected).max() < SAME
        points = step.points

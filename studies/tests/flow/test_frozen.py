"""The hinge moment at frozen pressures, and its derivative with the angle against differences."""

import numpy as np
import pytest

import sdm_deflect
from studies.flow.frozen import hinge_moment, hinge_moment_rate
from studies.flow.setup import Hinge
from tests.meshing.formats.wing import FLAP, wing

STEP = 1e-3
"""Degrees."""


def triangles_of(mesh, names):
    """Triangles of patches, quadrilaterals cut in two."""
    found = []
    for block in mesh.faces_of(names):
        nodes = block.nodes
        found += [nodes[:, :3]] if nodes.shape[1] == 3 else [nodes[:, :3], nodes[:, [0, 2, 3]]]
    return np.concatenate(found)


@pytest.fixture(scope="module")
def flap():
    whole = wing()
    triangles = triangles_of(whole.mesh, FLAP)
    pressure = np.random.default_rng(5).uniform(-2e4, 1e4, len(triangles))
    return whole, triangles, pressure


def deflected(whole, angle):
    return sdm_deflect.deflect(
        whole.mesh,
        FLAP,
        whole.hinge,
        angle,
        motion="blended",
        repair="off",
        fixed="wing_*",
        slide={"symmetry": "plane"},
    )


def test_a_uniform_pressure_on_one_square_has_the_moment_of_its_resultant():
    points = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    hinge = Hinge.through("flap", ["flap"], np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    up = np.array([[0, 1, 2], [0, 2, 3]])
    # 3 Pa on 1 m2, upwards, 1.5 m behind an axis along y: it lifts the trailing edge, left-handed about y
    assert hinge_moment(points, up, np.full(2, 3.0), hinge) == pytest.approx(-4.5)
    assert hinge_moment(points, up[:, ::-1], np.full(2, 3.0), hinge) == pytest.approx(4.5)


def test_a_surface_that_turns_as_a_whole_keeps_the_moment_of_frozen_pressures(flap):
    whole, triangles, pressure = flap
    hinge = Hinge.through("flap", FLAP, whole.hinge)
    rates = np.radians(1.0) * np.cross(hinge.axis, whole.mesh.points - hinge.point)
    size = abs(hinge_moment(whole.mesh.points, triangles, np.abs(pressure), hinge))
    assert hinge_moment_rate(whole.mesh.points, rates, triangles, pressure, hinge) == pytest.approx(0, abs=1e-12 * size)


def test_the_derivative_is_that_of_differences(flap):
    whole, triangles, pressure = flap
    hinge = Hinge.through("flap", FLAP, whole.hinge)
    middle, ahead, behind = (deflected(whole, 4.0 + step) for step in (0.0, STEP, -STEP))
    rate = hinge_moment_rate(middle.points, middle.sensitivity, triangles, pressure, hinge)
    moments = [hinge_moment(one.points, triangles, pressure, hinge) for one in (ahead, behind)]
    differences = (moments[0] - moments[1]) / (2.0 * STEP)
    size = abs(hinge_moment(middle.points, triangles, np.abs(pressure), hinge))
    assert rate == pytest.approx(differences, abs=1e-6 * size)
    assert abs(rate) > 1e-5 * size

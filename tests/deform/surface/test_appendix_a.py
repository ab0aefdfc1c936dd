"""Appendix A on a wedge aileron and on a plate through a cylinder."""

import numpy as np
import pytest

from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.deform.surface.appendix_a import blend, blend_strip, elongate, slide_panel
from sdm_deflect.meshing.mesh.axis import Axis, Cylinder

SPAN, CHORD, TAPER, HALF = 0.19, 0.022, 0.327, 0.0047
EPS = 1e-12


def _on_wedge(eta, xi, side):
    size = 1.0 + (TAPER - 1.0) * eta
    return np.stack([-CHORD * size * (1.0 - xi), eta * SPAN, side * HALF * size * (1.0 - xi)], axis=-1)


ETA, XI = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 7), indexing="ij"))
NODES = np.unique(np.vstack([_on_wedge(ETA, XI, s) for s in (1.0, -1.0)]), axis=0)
CHORDS = CHORD * (1.0 + (TAPER - 1.0) * NODES[:, 1] / SPAN)
HINGE, TRAILING = np.abs(NODES[:, 0] + CHORDS) < EPS, np.abs(NODES[:, 0]) < EPS
AXIS = Axis.through(*_on_wedge(np.array([0.0, 1.0]), np.zeros(2), 0.0))


def _out_of_plane(points):
    centered = points - points.mean(axis=0)
    return np.abs(centered @ np.linalg.svd(centered, full_matrices=False)[2][2]).max()


def _chordwise(degrees):
    moved_by = AXIS.displacement(NODES[TRAILING], degrees)
    return blend(NODES, NODES[HINGE], NODES[TRAILING], moved_by)


@pytest.mark.parametrize("degrees", [-30.0, -12.0, 5.0])
def test_chordwise_blending_is_affine(degrees):
    moved = NODES + _chordwise(degrees)
    for side in (1.0, -1.0):
        face = side * NODES[:, 2] >= -EPS
        assert _out_of_plane(moved[face]) < 1e-15
    np.testing.assert_allclose(moved[HINGE], NODES[HINGE], atol=1e-15)
    np.testing.assert_allclose(moved[TRAILING], AXIS.rotated(NODES[TRAILING], degrees), atol=1e-15)


def test_a_strip_connects_the_rib_and_leaves_the_rest_alone():
    chordwise = _chordwise(-12.0)
    strip, rib = NODES[:, 1] < 0.02, NODES[:, 1] < EPS
    blended = blend_strip(NODES, strip, chordwise, NODES[HINGE | rib])
    assert np.array_equal(blended[~strip], chordwise[~strip])
    np.testing.assert_allclose(blended[rib | HINGE], 0.0, atol=1e-15)
    tip = NODES[strip & TRAILING]
    rise = blended[strip & TRAILING][np.argsort(tip[:, 1]), 2]
    assert (np.diff(rise) > 0.0).all()  # from the rib to the full deflection without overshoot
    assert rise[-1] < chordwise[TRAILING, 2].max()


def test_without_the_strip_the_global_kernel_bends_the_faces():
    far, rib = TRAILING & (NODES[:, 1] > 0.02), NODES[:, 1] < EPS
    plain = blend(NODES, NODES[HINGE | rib], NODES[far], AXIS.displacement(NODES[far], -12.0))
    upper = (NODES[:, 2] >= -EPS) & (NODES[:, 1] > 0.05)
    assert _out_of_plane((NODES + plain)[upper]) > 1e-6


def test_a_strip_must_leave_something():
    for mask in (np.zeros(len(NODES), bool), np.ones(len(NODES), bool)):
        with pytest.raises(ValueError, match="lie in the strip"):
            blend_strip(NODES, mask, _chordwise(5.0), NODES[HINGE])


def test_blending_refuses_contradictions():
    with pytest.raises(ValueError, match="move differently"):
        blend(NODES, NODES[HINGE], NODES[HINGE], np.ones((int(HINGE.sum()), 3)))


RADIUS = 0.067
FUSELAGE = Cylinder(Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])), RADIUS)


def _root(n=31):
    """The line where a slightly inclined plate z = 0.1 y meets the cylinder."""
    x = np.linspace(0.80, 0.92, n)
    return FUSELAGE.projected(np.column_stack([x, np.full(n, 1.0), np.full(n, 0.1)]))


def _rotated_tail(degrees):
    """A plate of two slightly inclined halves through one apex, rotated; its root rows come first."""
    apex = np.array([0.87, 0.4, 0.05])
    root = np.vstack([_root(), _root() + np.array([0.0, 0.0, 0.002])])
    nodes = np.vstack([root + s * (apex - root) for s in np.linspace(0.0, 0.3, 11)])
    axis = Axis(np.array([0.87, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    return axis.rotated(nodes, degrees), len(root), axis.rotated(apex[None], degrees)[0]


def test_the_root_is_stretched_along_its_rays_and_the_tip_stays():
    rotated, count, apex = _rotated_tail(12.0)
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    onto = FUSELAGE.projected_along(rotated[:count], rays[:count])
    lengths = np.sum((onto - rotated[:count]) * rays[:count], axis=1, keepdims=True)
    region = box(np.array([0.7, 0.0, -0.1]), np.array([1.0, 0.1, 0.2]))
    by = elongate(rotated, region.contains(rotated), rotated[:count], lengths, region.sites_on("y+", 0.02)) * rays
    outside = ~region.contains(rotated)
    assert outside.any()
    assert not by[outside].any()
    np.testing.assert_allclose(FUSELAGE.distance((rotated + by)[:count]), 0.0, atol=1e-12)
    # Along rays to the apex, so planes through the apex are kept whatever the lengths.
    np.testing.assert_allclose(np.cross(rotated + by - apex, rotated - apex), 0.0, atol=1e-15)
    assert np.abs(by).max() > 1e-4


def test_displacements_may_be_stretched_too():
    rotated, count, _ = _rotated_tail(12.0)
    region = box(np.array([0.7, 0.0, -0.1]), np.array([1.0, 0.1, 0.2]))
    by = FUSELAGE.projected(rotated[:count]) - rotated[:count]
    moved = elongate(rotated, region.contains(rotated), rotated[:count], by, region.sites_on("y+", 0.02))
    assert moved.shape == rotated.shape
    np.testing.assert_allclose(moved[:count], by, atol=1e-12)


def test_the_panel_slides_on_the_cylinder():
    x, polar = (g.ravel() for g in np.meshgrid(np.linspace(0.77, 0.93, 33), np.radians(np.linspace(35, 145, 41))))
    nodes = np.column_stack([x, RADIUS * np.sin(polar), RADIUS * np.cos(polar)])
    border = (np.abs(x - 0.85) > 0.0799) | (np.abs(polar - np.pi / 2) > np.radians(54.9))
    root = _root()
    rolled = Axis(np.zeros(3), np.array([1.0, 0, 0])).displacement(root, 4.0)
    by = slide_panel(nodes, FUSELAGE, root, rolled, nodes[border])
    np.testing.assert_allclose(FUSELAGE.distance(nodes + by), 0.0, atol=1e-15)
    np.testing.assert_allclose(by[border], 0.0, atol=1e-14)
    assert np.abs(by).max() > 0.9 * np.abs(rolled).max()

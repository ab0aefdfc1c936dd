"""The hexahedra: planar, convex, around their surface and nothing else."""

import numpy as np
import pytest

from sdm_deflect.geometry.confinement import BlockParameters, Margins, block_corners, hexahedron_corners, rib_faces
from sdm_deflect.geometry.datum import SURFACES
from sdm_deflect.geometry.parameters import Aileron, Fighter, Rudder, Tail, Wing

FACES = {
    "x-": (0, 4, 6, 2),
    "x+": (1, 3, 7, 5),
    "y-": (0, 1, 5, 4),
    "y+": (2, 6, 7, 3),
    "z-": (0, 2, 3, 1),
    "z+": (4, 5, 7, 6),
}
VARIANTS = {
    "default": Fighter(),
    "gap": Fighter(aileron=Aileron(gap=0.0042672)),
    "short": Fighter(aileron=Aileron(gap=0.004, y_outboard=0.22), rudder=Rudder(z_outboard=0.18)),
    "wide": Fighter(wing=Wing(half_span=0.4), tail=Tail(anhedral=-10.0)),
}


def planes(corners):
    """Unit normals (6, 3) out of the hexahedron and offsets (6,) of its faces, from three corners each."""
    normals, offsets = [], []
    for quad in FACES.values():
        a, b, c, _ = corners[list(quad)]
        normal = np.cross(b - a, c - a)
        normals.append(normal / np.linalg.norm(normal))
        offsets.append(normals[-1] @ a)
    return np.array(normals), np.array(offsets)


def depth(corners, points):
    """How far points (N, 3) lie inside: negative outside."""
    normals, offsets = planes(corners)
    return (offsets - points @ normals.T).min(axis=1)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("surface", SURFACES)
def test_faces_are_planar_and_convex(variant, surface):
    corners = hexahedron_corners(VARIANTS[variant], surface, Margins())
    normals, offsets = planes(corners)
    for normal, offset, quad in zip(normals, offsets, FACES.values(), strict=True):
        height = offset - corners @ normal
        assert height[list(quad)] == pytest.approx(0.0, abs=1e-15)
        assert np.delete(height, quad).min() > 1e-3


@pytest.mark.parametrize("surface", SURFACES)
def test_the_surface_is_inside_and_touches_the_hinge_and_rib_faces(plain_model, fighter, surface):
    corners = hexahedron_corners(fighter, surface, Margins())
    points = np.concatenate([face.tessellation(1e-4)[0] for face in plain_model.faces_of(surface)])
    assert depth(corners, points).min() > -1e-12
    affected = {"x-", *rib_faces(fighter, surface)} if not surface.startswith("tail") else set()
    normals, offsets = planes(corners)
    distances = (offsets - points @ normals.T).min(axis=0)
    assert {name for name, d in zip(FACES, distances, strict=True) if d < 1e-12} == affected


@pytest.mark.parametrize("surface", SURFACES)
def test_a_hinged_surface_s_hexahedron_may_begin_ahead_of_the_hinge(fighter, surface):
    at, ahead = (hexahedron_corners(fighter, surface, Margins(ahead=value)) for value in (0.0, 0.01))
    moved = at - ahead
    front = 0.0 if surface.startswith("tail") else 0.01
    assert moved[list(FACES["x-"]), 0] == pytest.approx(front, abs=1e-15)
    moved[list(FACES["x-"]), 0] = 0.0
    assert not moved.any()


@pytest.mark.parametrize("surface", SURFACES)
def test_nothing_else_is_inside(plain_model, fighter, surface):
    corners = hexahedron_corners(fighter, surface, Margins())
    allowed = {surface, surface.replace("tail", "fuselage_panel")}
    for face in plain_model.faces:
        if face.patch not in allowed:
            assert depth(corners, face.tessellation(1e-4)[0]).max() < 1e-12, face.patch


def test_the_tail_s_panel_is_inside_but_for_its_rear_corners(plain_model, fighter):
    corners = hexahedron_corners(fighter, "tail_left", Margins())
    (panel,) = plain_model.faces_of("fuselage_panel_left")
    points, f = panel.tessellation(1e-4)[0], fighter.fuselage
    outside = points[depth(corners, points) < -1e-12]
    assert len(outside) > 0
    assert outside[:, 0].min() > fighter.tail.x_te - 0.01
    assert np.abs(outside[:, 1]).max() < f.radius
    widest_rear = np.array([[f.panel_rear, -f.radius, 0.0]])
    assert depth(corners, widest_rear) == pytest.approx(0.0, abs=1e-15)


def test_hexahedra_of_neighbours_do_not_overlap(fighter):
    """The midpoint grid of each hexahedron lies outside every other."""
    shares = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grids = {}
    for surface in SURFACES:
        corners = hexahedron_corners(fighter, surface, Margins())
        weights = [np.prod([s if i >> k & 1 else 1 - s for k, s in enumerate(shares.T)], axis=0) for i in range(8)]
        grids[surface] = corners, np.array(weights).T @ corners
    for one, (corners, _) in grids.items():
        for other, (_, grid) in grids.items():
            assert one == other or depth(corners, grid).max() < 0.0


def test_the_gap_s_hexahedron_begins_at_the_wing_s_rib(gapped):
    corners = hexahedron_corners(gapped, "aileron_left", Margins())
    assert corners[list(FACES["y+"]), 1] == pytest.approx(-gapped.wing.y_kink, abs=0.0)


def test_a_tail_outside_its_margins_is_refused():
    low = Fighter(tail=Tail(anhedral=30.0, half_span=0.17))
    with pytest.raises(ValueError, match=r"margins.down leaves the tail's tip"):
        hexahedron_corners(low, "tail_left", Margins(down=0.001))


def test_the_block_contains_the_hexahedron_but_for_its_root_side(gapped):
    """Section 5.2: all faces inside the block, but the root-facing one beyond the block's face in the gap."""
    block = block_corners(gapped, BlockParameters(), "aileron_left")
    inner = hexahedron_corners(gapped, "aileron_left", Margins())
    normals, offsets = planes(block)
    outside = {name for name, h in zip(FACES, (offsets - inner @ normals.T).min(axis=0), strict=True) if h < 0}
    assert outside == {"y+"}

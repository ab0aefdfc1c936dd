"""Control surfaces deflected in the CAD."""

import numpy as np
import pytest

from sdm_deflect.geometry.aircraft import build
from sdm_deflect.geometry.datum import ends, hinge_edges, hinge_line, trailing_edge
from sdm_deflect.geometry.deflected import CadTurn, rotate
from sdm_deflect.geometry.parameters import TE

ANGLES = {"aileron_left": -12.0, "aileron_right": 12.0, "tail_left": 12.0, "tail_right": -12.0, "rudder": 15.0}


def nearest(model, points):
    """Distances (N,) from points to the model's closest vertices."""
    return np.linalg.norm(points[:, None] - model.vertices, axis=2).min(axis=1)


@pytest.mark.parametrize("surface", ANGLES)
def test_rigid_trailing_edges_end_where_the_rotation_puts_them(rigid_model, fighter, surface):
    turned = rotate(trailing_edge(fighter, surface), hinge_line(fighter, surface), ANGLES[surface])
    exposed = turned[1:] if surface.startswith("tail") else turned
    assert nearest(rigid_model, exposed).max() < 1e-9


@pytest.mark.parametrize("surface", ["aileron_left", "aileron_right", "rudder"])
def test_blended_surfaces_keep_their_hinge_edges_and_turn_their_trailing_edge(blended_model, gapped, surface):
    turned = rotate(trailing_edge(gapped, surface), hinge_line(gapped, surface), ANGLES[surface])
    assert nearest(blended_model, turned).max() < 1e-9
    assert nearest(blended_model, hinge_edges(gapped, surface).reshape(-1, 3)).max() < 1e-9


def test_deflected_surfaces_stay_planar(rigid_model, blended_model):
    for model in (rigid_model, blended_model):
        for surface in ANGLES:
            for face in model.faces_of(surface):
                assert face.planar
                points = face.tessellation(1e-4)[0]
                assert np.abs(face.project(points) - points).max() < 1e-9


def test_rigid_tail_faces_are_the_rotated_ones(plain_model, rigid_model, fighter):
    axis = hinge_line(fighter, "tail_left")
    for before in plain_model.faces_of("tail_left"):
        centre = np.array([before.shape.Center().toTuple()])
        turned = rotate(centre, axis, 12.0)
        distances = [np.abs(after.project(turned) - turned).max() for after in rigid_model.faces_of("tail_left")]
        assert min(distances) < 1e-12


def test_the_rotated_root_lies_on_the_cylinder_and_on_the_tail(rigid_model, fighter):
    """The paper's elongation of the root onto the fuselage (section 5.3)."""
    faces = rigid_model.faces
    root = [e for e in rigid_model.edges if {faces[f].patch for f in e.faces} == {"tail_left", "fuselage_panel_left"}]
    assert len(root) == 6
    points = np.concatenate([edge.at(np.linspace(0.0, 1.0, 9)) for edge in root])
    assert np.hypot(points[:, 1], points[:, 2]) == pytest.approx(fighter.fuselage.radius, abs=1e-9)
    for edge in root:
        for face in edge.faces:
            assert (
                np.abs(faces[face].project(edge.at(np.linspace(0, 1, 9))) - edge.at(np.linspace(0, 1, 9))).max() < 1e-9
            )
    assert points[:, 0].min() == pytest.approx(0.7897, abs=1e-3)
    assert points[:, 0].max() == pytest.approx(0.9214, abs=1e-3)


def test_nothing_but_the_deflected_surfaces_and_their_seats_changes(plain_model, rigid_model):
    for patch in ("canopy", "inlet", "pedestal", "fuselage_rear", "strake_left", "ventral_right"):
        before, after = (sum(face.area for face in model.faces_of(patch)) for model in (plain_model, rigid_model))
        assert after == pytest.approx(before, rel=1e-9)


@pytest.mark.parametrize("angle", [-30.0, 20.0])
def test_large_deflections_build_without_a_gap(fighter, angle):
    model = build(fighter, {"aileron_left": CadTurn(angle)})
    turned = rotate(trailing_edge(fighter, "aileron_left"), hinge_line(fighter, "aileron_left"), angle)
    assert nearest(model, turned).max() < 1e-9


def test_an_opposite_deflection_is_the_mirror_image(fighter):
    """The whole aircraft is symmetric about z = 0 at the wing: TE up and TE down lie at opposite heights."""
    sections = ends(fighter, "aileron_left")
    axis = hinge_line(fighter, "aileron_left")
    up, down = (rotate(sections[:, TE], axis, angle) for angle in (-12.0, 12.0))
    assert up * [1, 1, -1] == pytest.approx(down, abs=1e-15)


def test_unusable_deflections_are_refused(fighter):
    with pytest.raises(ValueError, match=r"^angle = 95 deg must be a number from -85 to 85 deg$"):
        CadTurn(95.0)
    with pytest.raises(ValueError, match="mode = 'bent' must be rigid or blended"):
        CadTurn(5.0, "bent")
    with pytest.raises(ValueError, match=r"tail_left has no hinge edges"):
        build(fighter, {"tail_left": CadTurn(5.0, "blended")})

"""The Chimera block."""

import numpy as np
import pytest

from sdm_deflect.geometry.aircraft import chimera_block
from sdm_deflect.geometry.confinement import BlockParameters, block_corners, gap_faces
from sdm_deflect.geometry.parameters import Aileron, Fighter

SHORT = Fighter(aileron=Aileron(gap=0.004, y_outboard=0.22))


@pytest.fixture(scope="module")
def short_block():
    return chimera_block(SHORT, BlockParameters(), "aileron_right")


def body_volume(fighter, y):
    """Volume of wing and aileron between two stations inside the block's plan, by Simpson's rule (exact: cubic)."""
    w, p, a = fighter.wing, BlockParameters(), fighter.aileron

    def box_area(station):
        chord = w.root_chord + (w.tip_chord - w.root_chord) * station / w.half_span
        return w.thickness_ratio * chord * p.ahead

    def wedge_area(station):
        chord = w.root_chord + (w.tip_chord - w.root_chord) * station / w.half_span
        return 0.5 * w.thickness_ratio * chord * w.bevel_ratio * chord

    def integral(area, low, high):
        return (high - low) / 6 * (area(low) + 4 * area(0.5 * (low + high)) + area(high))

    inboard, outboard = w.y_kink + a.gap, a.y_outboard or w.half_span
    return integral(box_area, y[0], min(y[1], w.half_span)) + integral(wedge_area, inboard, outboard)


def hexahedron_volume(fighter, surface):
    corners = block_corners(fighter, BlockParameters(), surface)
    y = corners[[0, 2], 1]
    lengths = np.abs([corners[1, 0] - corners[0, 0], corners[3, 0] - corners[2, 0]])
    return lengths.mean() * abs(y[1] - y[0]) * (corners[4, 2] - corners[0, 2])


def test_the_block_s_volume_is_the_hexahedron_less_wing_and_aileron(gapped, block):
    y = np.sort(np.abs(block_corners(gapped, BlockParameters(), "aileron_left")[[0, 2], 1]))
    expected = hexahedron_volume(gapped, "aileron_left") - body_volume(gapped, y)
    assert block.solid.Volume() == pytest.approx(expected, rel=1e-9)


def test_the_block_with_two_gaps_too(short_block):
    y = np.sort(np.abs(block_corners(SHORT, BlockParameters(), "aileron_right")[[0, 2], 1]))
    expected = hexahedron_volume(SHORT, "aileron_right") - body_volume(SHORT, y)
    assert short_block.solid.Volume() == pytest.approx(expected, rel=1e-9)


def test_names_and_the_side_of_the_flow(block, short_block):
    assert set(block.patches) == {"chimera", "wing_left", "aileron_left"}
    assert set(short_block.patches) == {"chimera", "wing_right", "aileron_right"}
    assert block.fluid_inside
    assert all(face.planar for face in block.faces + short_block.faces)


def test_normals_point_out_of_the_flow(block, gapped):
    """On the block's outside away from its centre, on the wing's upper side downwards into the wing."""
    centre = block_corners(gapped, BlockParameters(), "aileron_left").mean(axis=0)
    for face in block.faces:
        middle = np.array([face.shape.Center().toTuple()])
        normal = face.normal_at(middle)[0]
        if face.patch == "chimera":
            assert normal @ (middle[0] - centre) > 0.0
        elif abs(normal[2]) > 0.5:
            assert normal[2] * middle[0, 2] < 0.0


@pytest.mark.parametrize(("surface", "fighter"), [("aileron_left", None), ("aileron_right", SHORT)])
def test_faces_in_the_gaps_are_perpendicular_to_y_and_60_percent_of_the_gap_away(request, gapped, surface, fighter):
    fighter = fighter or gapped
    model = request.getfixturevalue("block" if fighter is gapped else "short_block")
    stations = gap_faces(fighter, BlockParameters(), surface)
    assert len(stations) == (1 if fighter is gapped else 2)
    for station in stations:
        found = [f for f in model.faces_of("chimera") if abs(f.shape.Center().y - station) < 1e-9]
        assert len(found) == 1
        points = found[0].tessellation(1e-4)[0]
        assert np.all(points[:, 1] == pytest.approx(station, abs=1e-15))


def test_a_coplanar_crease_at_the_tip_has_a_sheet_behind_it(block, short_block):
    assert len(block.sheets) == 1
    assert len(short_block.sheets) == 0


def test_no_gap_no_block(fighter, gapped):
    with pytest.raises(ValueError, match=r"aileron.gap is 0"):
        chimera_block(fighter, BlockParameters())
    with pytest.raises(ValueError, match=r"surrounds an aileron, not 'rudder'"):
        chimera_block(gapped, BlockParameters(), "rudder")

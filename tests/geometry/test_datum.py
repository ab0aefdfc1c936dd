"""Hinge lines, edges and ribs as arrays."""

import subprocess
import sys

import numpy as np
import pytest

from sdm_deflect.geometry.datum import (
    SURFACES,
    cylinder,
    ends,
    hinge_edges,
    hinge_line,
    parent_ribs,
    ribs,
    trailing_edge,
)
from sdm_deflect.geometry.deflected import rotate
from sdm_deflect.geometry.parameters import MIRROR, Aileron, Fighter, Rudder

MOVED = {"aileron": [0.0, 0.0, -1.0], "tail": [0.0, 0.0, -1.0], "rudder": [0.0, -1.0, 0.0]}


def test_parameters_and_datum_do_not_import_the_cad_kernel():
    imports = "import sys; from sdm_deflect.geometry import datum, deflected"
    code = f"{imports}; sys.exit('cadquery' in sys.modules or 'OCP' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("surface", SURFACES)
def test_a_positive_turn_moves_the_trailing_edge_down_or_to_port(fighter, surface):
    before = trailing_edge(fighter, surface)[1]
    moved = rotate(before, hinge_line(fighter, surface), 1.0) - before
    assert moved @ MOVED[surface.split("_")[0]] > 0.9 * np.linalg.norm(moved) > 0.0


@pytest.mark.parametrize("surface", ["aileron_left", "aileron_right", "rudder"])
def test_the_hinge_line_is_the_middle_of_the_hinge_edges(gapped, surface):
    middle = hinge_edges(gapped, surface).mean(axis=0)
    line = hinge_line(gapped, surface)
    assert np.array_equal(np.sort(line, axis=0), np.sort(middle, axis=0))


def test_the_left_side_is_the_mirrored_right_side(gapped):
    for name in ("aileron", "tail"):
        assert np.array_equal(ends(gapped, f"{name}_left"), ends(gapped, f"{name}_right") * MIRROR)


def test_the_paper_s_proportions_of_the_aileron(gapped):
    """The trailing edge moves about 1 gap at -12 degrees and 2.6 gaps at -30 (section 5.2)."""
    edge, line = trailing_edge(gapped, "aileron_left")[0], hinge_line(gapped, "aileron_left")
    lifts = [rotate(edge, line, angle)[2] / gapped.aileron.gap for angle in (-12.0, -30.0)]
    assert lifts == pytest.approx([1.08, 2.6], abs=0.05)


def test_the_tail_turns_about_60_percent_of_its_root_chord(fighter):
    assert hinge_line(fighter, "tail_left")[0] == pytest.approx([0.8684, -0.06598, -0.0116], abs=5e-5)


def test_a_tail_has_neither_hinge_edges_nor_ribs(fighter):
    with pytest.raises(ValueError, match="tail_left has no hinge edges"):
        hinge_edges(fighter, "tail_left")
    assert len(ribs(fighter, "tail_left")) == 0


def test_unknown_surfaces_are_named(fighter):
    with pytest.raises(ValueError, match="no control surface 'flap'"):
        ends(fighter, "flap")


def test_ribs_face_each_other_across_the_gap(gapped):
    assert ribs(gapped, "aileron_left") == pytest.approx([-0.1162672])
    assert parent_ribs(gapped, "aileron_left") == pytest.approx([-0.112])
    short = Fighter(aileron=Aileron(gap=0.004, y_outboard=0.22), rudder=Rudder(z_outboard=0.18))
    assert parent_ribs(short, "aileron_right") - ribs(short, "aileron_right") == pytest.approx([-0.004, 0.004])
    assert ribs(short, "rudder") == pytest.approx([0.0955, 0.18])


def test_the_cylinder_is_that_of_the_rear_fuselage(fighter):
    point, axis, radius = cylinder(fighter)
    assert radius == fighter.fuselage.radius
    assert np.array_equal(axis, [1.0, 0.0, 0.0])
    assert np.array_equal(point[1:], [0.0, 0.0])

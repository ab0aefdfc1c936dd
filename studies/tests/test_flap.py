"""The panel method against flows that are known, and the figures that the page of the flap states."""

import csv
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from studies import flap

ROOT = Path(__file__).parents[2]


def test_the_speed_on_a_circle_without_lift_is_twice_the_sine():
    angle = np.linspace(0.0, -2.0 * np.pi, 721)
    z = np.exp(1j * angle)
    middle = 0.5 * (angle[1:] + angle[:-1])
    np.testing.assert_allclose(np.abs(flap.surface_speed(z)), 2.0 * np.abs(np.sin(middle)), atol=2e-3)


def test_a_plate_at_an_angle_has_the_lift_of_a_thin_aerofoil():
    """A profile of one per cent, turned as a whole by two degrees: 2 pi sin of the angle, at the quarter chord."""
    corners, c, s = flap.wall() * [1.0, 1.0 / 12.0], np.cos(np.radians(-2.0)), np.sin(np.radians(-2.0))
    found = flap.forces((corners - [0.25, 0.0]) @ np.array([[c, s], [-s, c]]) + [0.25, 0.0], flap.on_flap(corners))
    assert found.lift == pytest.approx(2.0 * np.pi * np.sin(np.radians(2.0)), rel=0.015)
    assert found.moment == pytest.approx(0.0, abs=2e-3 * found.lift)


def test_a_thin_flap_is_that_of_theory():
    corners = flap.wall() * [1.0, 1.0 / 12.0]
    found = flap.forces(flap.turned(corners, 1.0), flap.on_flap(corners))
    assert [found.lift, found.moment] == pytest.approx(flap.THEORY, rel=0.015)


def test_a_symmetric_profile_has_no_force():
    corners = flap.wall()
    assert max(map(abs, astuple(flap.forces(corners, flap.on_flap(corners))))) < 1e-12


@pytest.fixture(scope="module")
def found():
    return flap.measured()


def test_the_figures_of_the_page(found):
    slope = found[0].blended
    assert [slope.lift, slope.moment, slope.hinge_moment] == pytest.approx([0.0731, -0.01215, -0.01410], rel=0.01)
    for one in found:
        assert one.ratios == pytest.approx([0.990, 0.983, 0.960], rel=0.01)
        for ratio in one.ratios:
            assert ratio < 1.0


def test_the_page_states_what_was_measured(found):
    text = (ROOT / "docs" / "flap.md").read_text(encoding="utf-8")
    with (ROOT / "docs" / "tables" / "flap.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for one, row in zip(found, rows, strict=True):
        kept = [float(row[f"ratio_{name}"]) for name in ("lift", "moment", "hinge_moment")]
        assert one.ratios == pytest.approx(kept, rel=1e-6)
        assert f"| {one.angle:g}° | {' | '.join(f'{ratio:.3f}' for ratio in one.ratios)} |" in text


def test_the_flap_of_the_mesh_keeps_its_hinge_and_turns_its_trailing_edge():
    corners = flap.wall()
    moved, rigid = flap.deflected(corners, 10.0), flap.turned(corners, 10.0)
    np.testing.assert_array_equal(moved[corners[:, 0] <= flap.HINGE], corners[corners[:, 0] <= flap.HINGE])
    np.testing.assert_allclose(moved[0], rigid[0], atol=1e-15)

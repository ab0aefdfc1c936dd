"""Modes of plates and beams, from files as Nastran writes them to a plan with an amount for each."""

import nastran_modes
import numpy as np
import pytest

import sdm_deflect
from tests.calls import sdm

AMOUNTS = (0.15, -0.05, 0.03)


@pytest.fixture(scope="module")
def structures():
    return {"plate": nastran_modes.plate(), "beam": nastran_modes.beam()}


def test_frequencies_are_those_of_a_cantilever(structures):
    """Bending by Euler and Bernoulli, torsion by de Saint-Venant; the clamped edge stiffens the plate's torsion."""
    length, rotary = nastran_modes.SPAN, nastran_modes.CHORD**2 + nastran_modes.THICKNESS**2
    speed = np.sqrt(nastran_modes.YOUNG * nastran_modes.THICKNESS**2 / (12.0 * nastran_modes.DENSITY))
    bending = np.array([1.87510407, 4.69409113]) ** 2 * speed / (2.0 * np.pi * length**2)
    twist = np.sqrt(4.0 * nastran_modes.SHEAR * nastran_modes.THICKNESS**2 / (nastran_modes.DENSITY * rotary))
    torsion = twist / (4.0 * length)
    np.testing.assert_allclose(structures["beam"][1], [bending[0], torsion, bending[1]], rtol=1e-3)
    plate = structures["plate"][1]
    np.testing.assert_allclose(plate[[0, 2]], bending, rtol=0.01)
    assert 1.0 < plate[1] / torsion < 1.15


def test_files_come_back_and_other_tables_do_not_count(structures, tmp_path):
    points, frequencies, modes = structures["plate"]
    nastran_modes.write(tmp_path / "plate", points, frequencies, modes)
    path = tmp_path / "plate.f06"
    lines = path.read_text().splitlines()
    forces = ["   F O R C E S   O F   S I N G L E - P O I N T   C O N S T R A I N T", *lines[3:40]]
    path.write_text("\n".join([*forces, *lines, *forces]))
    given = (tmp_path / "plate.bdf").read_text().replace(" 0.12500", " 1.25-1 ", 1)
    (tmp_path / "plate.bdf").write_text(given.replace("GRID           1", "grid           1"))
    found = nastran_modes.read(tmp_path / "plate")
    np.testing.assert_array_equal(found[0], points.round(5))
    np.testing.assert_allclose(found[1], modes, atol=1e-6)
    assert nastran_modes.number("-7.+2") == -700.0


def test_a_plan_has_an_amount_for_each_mode_of_a_plate_and_of_a_beam(structures, tmp_path, capsys):
    """The surface is a sum of modes to 1e-12, its root stays, and sections of the beam turn as its elements do."""
    assert sdm("example", tmp_path) == 0
    mesh = tmp_path / "naca.su2"
    nastran_modes.main(mesh)
    assert capsys.readouterr().out.count("checks that failed: none") == 2
    undeflected = sdm_deflect.read(mesh)
    nodes = undeflected.on("wing", "flap")
    start = undeflected.points[nodes]
    moved = {}
    for name in ("plate", "beam"):
        plan = sdm_deflect.MeshMotion.load(tmp_path / f"{name}-modes.npz", undeflected.points)
        names = [control.name for control in plan.controls]
        assert names == [f"{name} {k}" for k in (1, 2, 3)]
        each = [(plan.at({one: 0.2}) - undeflected.points)[nodes] / 0.2 for one in names]
        moved[name] = (plan.at(AMOUNTS) - undeflected.points)[nodes]
        expected = sum(amount * one for amount, one in zip(AMOUNTS, each, strict=True))
        np.testing.assert_allclose(moved[name], expected, rtol=0.0, atol=1e-12)
        root = np.abs(moved[name][start[:, 1] == 0.0]).max()
        assert root < 2e-4 if name == "plate" else root == 0.0  # a plate's nodes are interpolated between its points
        assert np.abs(moved[name]).max() > 0.1
    points, _, modes = structures["beam"]
    twist, tip = AMOUNTS @ modes[:, -1, 4], start[:, 1] == points[-1, 1]
    front, back = (first(moved["beam"][tip, 2], start[tip, 0], place) for place in (min, max))
    assert front - back == pytest.approx(twist * np.ptp(start[tip, 0]), abs=1e-6)
    assert np.abs(moved["plate"] - moved["beam"]).max() < 0.1 * np.abs(moved["plate"]).max()


def first(values, places, chosen):
    """Return the value at the least or the largest place."""
    return float(values[list(places).index(chosen(places))])

"""Tracks: rigid through every place, joined between them, and sums of fixed fields."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation as Turned

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Automatic
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.surface.motions import Moving
from sdm_deflect.deform.surface.tracks import Places, Track, TrackLaw, shifts_of
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.job import Job
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.axis import Axis
from tests.deform.plates import plate

rng = np.random.default_rng(5)
HINGE = Axis.through(np.array([0.4, 0.0, 0.1]), np.array([0.5, 1.2, 0.0]))
POINTS = rng.random((40, 3))
FOWLER = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.2, 4.0, 0.02, 0.0, -0.001, 0.025, 0.0, 0.0],
    [0.5, 12.0, 0.05, 0.001, -0.006, 0.06, 0.0, -0.004],
    [1.0, 35.0, 0.09, 0.002, -0.02, 0.1, 0.0, -0.03],
])  # fmt: skip


@pytest.mark.parametrize("smooth", [True, False])
def test_a_track_is_rigid_and_its_hinge_points_go_where_the_rows_say(smooth):
    law = TrackLaw(Track(HINGE, FOWLER, smooth), np.vstack([POINTS, HINGE.point]))
    assert not law.displacement(0.0).any()
    for amount in (0.2, 0.37, 0.5, 0.9, 1.0):
        places = law.points + law.displacement(amount)
        np.testing.assert_allclose(pdist(places), pdist(law.points), atol=1e-14)
    for row in FOWLER:
        np.testing.assert_allclose(law.displacement(row[0])[-1], row[2:5], atol=1e-16)
    ends = TrackLaw(law.track, np.array([HINGE.point, HINGE.point + HINGE.length * HINGE.direction])).displacement(1.0)
    line = HINGE.length * HINGE.direction + FOWLER[-1, 5:] - FOWLER[-1, 2:5]
    np.testing.assert_allclose(
        np.diff(ends, axis=0)[0] + HINGE.length * HINGE.direction,
        line * HINGE.length / np.linalg.norm(line),
        atol=1e-14,
    )


def test_between_rows_cpacs_is_linear():
    track = Track(HINGE, FOWLER, smooth=False)
    middle = Track.straight(HINGE, 8.0, (FOWLER[1, 2:5] + FOWLER[2, 2:5]) / 2, (FOWLER[1, 5:] + FOWLER[2, 5:]) / 2)
    np.testing.assert_allclose(track.entries(0.35), middle.entries(1.0), atol=1e-15)


def test_any_rigid_motion_is_an_angle_and_two_shifts():
    """As in a table of rotations about x, y and z and a translation, at coordinates of 90."""
    points = 90.0 + 10.0 * POINTS
    turn = Turned.from_euler("xyz", [1.7, -27.0, 3.1], degrees=True)
    expected = turn.apply(points) + np.array([0.9, -0.2, 1.4])
    hinge = Axis.through(points[0], points[1])
    first, second = (expected - points)[:2]
    swung = Track.straight(hinge, 0.0, first, second).entries(1.0)[:9].reshape(3, 3) + np.eye(3)
    left = Turned.from_matrix(swung).inv() * turn
    angle = np.degrees(left.as_rotvec() @ hinge.direction)
    found = points + TrackLaw(Track.straight(hinge, angle, first, second), points).displacement(1.0)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.0, 0.6), (0.0, 0.15)])
def test_displacements_are_sums_of_independent_entries(smooth, low, high):
    law = TrackLaw(Track(HINGE, FOWLER, smooth), POINTS)
    functions = law.functions.within(low, high)
    reads = functions.reads(low, high)
    assert len(reads) == functions.count <= 12
    assert reads[-1] == high
    assert not functions.values(0.0).any()
    matrix = np.array([functions.values(amount) for amount in reads])
    fields = np.linalg.solve(matrix, np.array([law.displacement(amount).ravel() for amount in reads]))
    for amount in rng.uniform(low, high, 20):
        np.testing.assert_allclose(functions.values(amount) @ fields, law.displacement(amount).ravel(), atol=1e-9)
    cardinal = np.array([functions.values(amount) for amount in np.linspace(low, high, 200)]) @ np.linalg.inv(matrix)
    assert np.abs(cardinal).sum(axis=1).max() < 20.0  # by how much errors at the places read may grow


@pytest.mark.parametrize("smooth", [True, False])
def test_rates_are_derivatives(smooth):
    track, step = Track(HINGE, FOWLER, smooth), 1e-4
    functions = TrackLaw(track, POINTS).functions
    for amount in (0.11, 0.43, 0.77):
        around = [track.entries(amount + k * step) for k in (-2, -1, 1, 2)]
        difference = (around[0] - 8.0 * around[1] + 8.0 * around[2] - around[3]) / (12.0 * step)
        np.testing.assert_allclose(track.entries(amount, rate=True), difference, atol=1e-10)
        expected = track.entries(amount, rate=True) @ functions.basis
        np.testing.assert_allclose(functions.rates(amount), expected, atol=1e-8 * np.abs(expected).max())


def test_a_straight_shift_has_one_function_and_a_turn_with_it_three():
    shift = np.array([0.01, 0.0, -0.02])
    assert TrackLaw(Track.straight(HINGE, 0.0, shift, shift), POINTS).functions.count == 1
    assert TrackLaw(Track.straight(HINGE, 20.0, shift, shift), POINTS).functions.count == 3


@pytest.mark.parametrize(
    ("titles", "columns", "expected"),
    [
        ("parameter,angle,dx,dy", (0, 1, 2, 3), (2, 3)),
        ("parameter,angle,dx,dy,dz", (0, 1, 2, 3, 4), (2, 3, 4)),
        ("controlParameter,angle,dx,dy,dx2,dy2", (0, 1, 2, 3, 5, 6), (2, 3, 5, 6)),
        ("controlParameter,angle,dx,dy,dz,dx2,dy2,dz2", range(8), range(2, 8)),
    ],
)
def test_rows_are_read_by_their_number_of_columns(titles, columns, expected, tmp_path):
    rows = FOWLER[:, list(columns)]
    np.savetxt(tmp_path / "track.csv", rows[::-1], "%.17g", ",", header=titles, comments="")
    track = Track.read(tmp_path / "track.csv", HINGE)
    assert track.smooth == titles.startswith("parameter")
    assert track.rows[:, list(expected)].tolist() == FOWLER[:, list(expected)].tolist()
    if 5 not in expected:
        assert track.rows[:, 5:].tolist() == track.rows[:, 2:5].tolist()


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (FOWLER[1:], "the mesh stands at parameter 0"),
        (FOWLER + np.eye(8)[1], "the mesh stands at parameter 0"),
        (FOWLER[[0, 1, 1]], "a parameter occurs twice"),
        (FOWLER[:1], "two rows or more"),
        (FOWLER * (1.0 + 2.0 * np.eye(8)[1]), "105 deg is out of range"),
        (np.where(FOWLER == 35.0, np.nan, FOWLER), "track"),
    ],
)
def test_rows_that_cannot_be_are_one_sentence(rows, said):
    with pytest.raises(InputError, match=said):
        Track(HINGE, rows)


def test_amounts_beyond_the_rows_and_points_shifted_past_one_another_are_one_sentence():
    with pytest.raises(InputError, match=r"1\.2 is beyond the track, which goes from 0 to 1"):
        Track(HINGE, FOWLER).entries(1.2)
    with pytest.raises(InputError, match="the second hinge point is shifted past the first"):
        Track.straight(HINGE, 0.0, np.zeros(3), -2.0 * HINGE.length * HINGE.direction).entries(1.0)
    for shift in ((0.1,), np.zeros((3, 3)), "x"):
        with pytest.raises(InputError, match="shift"):
            shifts_of(shift)
    assert shifts_of((0.1, 0.2)).tolist() == [[0.1, 0.2, 0.0]] * 2


def test_a_plan_of_a_track_is_the_deflection_and_keeps_the_mesh_at_zero(tmp_path):
    mesh = plate()
    rows = np.zeros((3, 8))
    rows[1:, :4] = [[0.4, -4.0, 0.02, -0.01], [1.0, -9.0, 0.05, -0.04]]
    rows[:, 5:] = rows[:, 2:5]
    track = Track(Axis(np.array([0.0, -0.7, 0.0]), np.array([0.0, 0.0, 1.0])), rows)
    plan = Plan.of(mesh, [Job((Moving(("hole",), track, 1.0, (0.0, 1.0)),), box=Automatic(0.4))])
    held, tolerance = MeshMotion.of(plan), plan.boxes[0].sites.tolerance
    assert held.at(0.0).tolist() == mesh.points.tolist()
    assert np.abs(held.at(1.0) - deflect(plan, (1.0,)).points).max() < 20.0 * tolerance
    assert held.judged().passed(0) == (0.0, 1.0)
    hole = mesh.on("hole")
    for amount in (0.2, 0.55, 0.8):
        expected = TrackLaw(track, mesh.points[hole]).displacement(amount)
        np.testing.assert_allclose((held.at(amount) - mesh.points)[hole], expected, atol=1e-12)
        assert np.abs(held.at(amount) - deflect(plan, (amount,)).points).max() < 20.0 * tolerance
    held.save(tmp_path / "plan.npz")
    again = MeshMotion.load(tmp_path / "plan.npz")
    assert isinstance(again.controls[0].functions, Places)
    assert again.on(mesh.points).at((0.7,)).tolist() == held.at(0.7).tolist()

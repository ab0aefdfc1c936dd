"""The motion of a mesh: ends equal deflections, sums of fields hold between, derivatives are those of the sums."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect import InputError, MeshMotion, Table, deflect, plan
from sdm_deflect.deform.surface.motions import Turn
from sdm_deflect.deform.volume import snapshots
from tests.deform.blocks import two_bodies
from tests.deform.plates import plate
from tests.deform.volume.test_triangulated import SIDES, warped_block

HOLE = {"box": [[-0.55, -0.55], [0.55, 0.55]]}
PIVOT = [0.1, 0.0]
BOX = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]
SLAT_AND_FLAP = {
    "left": {"hinge": [[-1.25, -1, 0], [-1.25, 1, 0]], "range": (-6, 8)},
    "right": {"hinge": [[1.25, -1, 0], [1.25, 1, 0]], "range": (-5, 5)},
}
AROUND_BOTH = [[-3.5, -1.4, -1.8], [3.5, 1.4, 1.8]]


@pytest.fixture(scope="module")
def mesh():
    return plate(40, "triangle")


@pytest.fixture(scope="module")
def held(mesh):
    """A hole that turns; at 45 degrees in two steps, and repaired."""
    return plan(mesh, "hole", PIVOT, range=(-20, 45), **HOLE)


@pytest.fixture(scope="module")
def wing(inboard_wing):
    """A blended flap on prisms, with nodes that slide on the symmetry plane."""
    given = {"motion": "blended", "held": "wing_*", "fixed": "wing_*", "slide": "symmetry:plane", "box": BOX}
    return plan(inboard_wing.mesh, "flap_*", inboard_wing.hinge, range=(-10, 15), **given), given


def tolerance(held):
    return held.plan.boxes[0].sites.tolerance


def test_ends_are_deflections_and_zero_is_the_mesh(held, wing, mesh, inboard_wing):
    for one, given in (
        (held, (mesh, "hole", PIVOT, HOLE)),
        (wing[0], (inboard_wing.mesh, "flap_*", inboard_wing.hinge, wing[1])),
    ):
        source, name, hinge, options = given
        control = one.controls[0]
        for end in (control.low, control.high):
            expected = deflect(source, name, hinge, end, range=(control.low, control.high), **options)
            np.testing.assert_allclose(one.at(end), expected.points, atol=1e-12)
        assert one.at(0).tobytes() == source.points.tobytes()


def test_a_repair_at_one_end_fades_and_inverts_no_cell(held):
    assert any(one.repaired for one in held.snapshots[0].deflections)
    least = [min(row.least for row in held.measured[0] if row.amount in ends) for ends in ((-20.0,), (45.0,))]
    for amount in np.linspace(-20.0, 45.0, 20):
        found = held.deflection(amount)
        assert not found.inverted
        assert min(one.min for one in found.quality) > 0.98 * min(least)


@pytest.mark.parametrize("end", [60.0, -60.0])
def test_with_zero_at_an_end_the_other_one_is_exact_and_the_repair_fades(end, mesh):
    one = plan(mesh, "hole", PIVOT, range=tuple(sorted((0.0, end))), **HOLE)
    expected = deflect(mesh, "hole", PIVOT, end, **HOLE)
    assert expected.deflection.repairs
    np.testing.assert_allclose(one.at(end), expected.points, atol=1e-12)
    assert not any(one.deflection(share * end).inverted for share in np.linspace(0.05, 1.0, 20))


def test_surface_nodes_are_where_the_motion_has_them(wing):
    one, _ = wing
    box = one.plan.boxes[0]
    nodes = box.boundary.nodes
    for amount in (-8.0, 1.0, 11.0):
        move = one.at(amount)[nodes] - box.mesh.points[nodes]
        np.testing.assert_allclose(move, box.boundary.displacement((amount,)), atol=1e-14)
    plane = box.mesh.on("symmetry")
    np.testing.assert_allclose(one.at(11.0)[plane, 1], box.mesh.points[plane, 1], atol=1e-15)


def test_derivatives_are_those_of_the_sum_and_transposes_of_each_other(held, wing):
    rng = np.random.default_rng(3)
    for one in (held, wing[0]):
        for amount in (-9.0, 0.0, 12.0):
            h, found = 1e-3, one.jvp(amount, 1.0)
            difference = (one.at(amount + h) - one.at(amount - h)) / (2.0 * h)
            np.testing.assert_allclose(found, difference, atol=1e-8)
            gradient = rng.normal(size=found.shape)
            size = np.linalg.norm(gradient) * np.linalg.norm(found)
            assert abs(one.vjp(amount, gradient)[0] - np.sum(gradient * found)) <= 1e-14 * size


def test_the_sites_are_met_at_all_amounts(wing):
    one, _ = wing
    for row in one.measured[0]:
        assert row.site_error <= tolerance(one)
    ends = one.snapshots[0].deflections
    for row, end in ((one.measured[0][0], ends[0]), (one.measured[0][-1], ends[1])):
        assert row.amount == end.amounts[0]
        assert 0.5 * end.site_error <= row.site_error
        assert row.site_error <= end.site_error * (1.0 + 1e-9)  # sums of the same numbers in another order


def test_parts_have_the_bits_of_the_whole_whatever_was_asked_before(held, wing, tmp_path):
    rng = np.random.default_rng(4)
    for one in (held, wing[0]):
        points, first = one.plan.mesh.points, one.at(7.0)
        one.at(-3.0)
        assert one.at(7.0).tobytes() == first.tobytes()
        one.save(tmp_path / "plan.npz")
        again = MeshMotion.load(tmp_path / "plan.npz")
        assert again.on(points).at((7.0,)).tobytes() == first.tobytes()
        assert again.on(one.plan.mesh).at((7.0,)).tobytes() == first.tobytes()
        assert repr(again) == repr(one)
        for count in (2, 4):
            for rows in np.array_split(rng.permutation(len(points)), count):
                assert again.on(points[rows]).at((7.0,)).tobytes() == first[rows].tobytes()


def test_two_surfaces_add_up(tmp_path):
    mesh = two_bodies()
    both = plan(mesh, SLAT_AND_FLAP, box=AROUND_BOTH)
    assert [one.name for one in both.controls] == ["left", "right"]
    assert np.array_equal(both.at({"left": 3}), both.at((3, 0)))
    for pose in ((8.0, 5.0), (8.0, -5.0), (-6.0, 5.0), (-6.0, -5.0)):
        given = [
            {"patches": name, "angle": one} | own for (name, own), one in zip(SLAT_AND_FLAP.items(), pose, strict=True)
        ]
        expected = deflect(mesh, given, box=AROUND_BOTH)
        for name in ("left", "right"):
            nodes = mesh.on(name)
            np.testing.assert_allclose(both.at(pose)[nodes], expected.points[nodes], atol=1e-14)
        assert np.abs(both.at(pose) - expected.points).max() <= 2.5 * tolerance(both)  # between the sites
    gradient = np.ones(mesh.points.shape)
    found = [both.jvp((3.0, -2.0), speeds) for speeds in np.eye(2)]
    np.testing.assert_allclose(both.vjp((3.0, -2.0), gradient), np.sum(found, axis=(1, 2)), atol=1e-12)
    apart = plan(mesh, SLAT_AND_FLAP, box_each=True)
    assert len(apart.plan.boxes) == 2
    np.testing.assert_allclose(apart.at((8.0, 0.0))[mesh.on("left")], both.at((8.0, 0.0))[mesh.on("left")], atol=1e-14)
    for one in (apart, plan(mesh, dict(reversed(SLAT_AND_FLAP.items())), box_each=True)):
        assert one.on(mesh.points).at({"left": 8.0}).tobytes() == one.at({"left": 8.0}).tobytes()
    both.save(tmp_path / "both.npz")
    again = MeshMotion.load(tmp_path / "both.npz").on(mesh.points)
    assert again.at((3.0, -2.0)).tobytes() == both.at((3.0, -2.0)).tobytes()


def test_a_blended_flap_with_layers_takes_more_functions_for_a_wide_range(inboard_wing, wing):
    _, given = wing
    one = plan(inboard_wing.mesh, "flap_*", inboard_wing.hinge, range=(-30, 10), repair="off", **given)
    assert one.controls[0].functions == Turn(4)
    for end in (-30.0, 10.0):
        expected = deflect(inboard_wing.mesh, "flap_*", inboard_wing.hinge, end, range=(-30, 10), repair="off", **given)
        np.testing.assert_allclose(one.at(end), expected.points, atol=1e-12)
    h = 1e-3
    np.testing.assert_allclose(one.jvp(-7.0, 1.0), (one.at(-7.0 + h) - one.at(-7.0 - h)) / (2.0 * h), atol=1e-8)


def test_a_table_is_read_at_one_amount(mesh):
    points = mesh.points[mesh.on("hole")]
    table = Table(points, 0.05 * np.column_stack([points[:, 1], np.sin(points[:, 0]), 0.0 * points[:, 0]]))
    one = plan(mesh, "hole", motion=table, range=(-0.5, 1.0), **HOLE)
    assert len(one.snapshots[0].deflections) == 1
    expected = deflect(mesh, "hole", angle=1.0, motion=table, range=(-0.5, 1.0), **HOLE)
    np.testing.assert_allclose(one.at(1.0), expected.points, atol=1e-12)
    np.testing.assert_allclose(one.at(-0.5), mesh.points - 0.5 * (one.at(1.0) - mesh.points), atol=1e-15)


def test_a_plan_of_one_amount_is_the_deflection_to_the_bit(mesh, tmp_path):
    expected = deflect(mesh, "hole", PIVOT, 60, **HOLE)
    one = plan(mesh, "hole", PIVOT, 60, **HOLE)
    one.save(tmp_path / "one.npz")
    for found in (one, MeshMotion.load(tmp_path / "one.npz")):
        assert found.on(mesh.points).at((60.0,)).tobytes() == expected.points.tobytes()
        assert found.on(mesh.points).at((0.0,)).tobytes() == mesh.points.tobytes()
        with pytest.raises(InputError, match="59: the plan is of 60 alone; make one with a range"):
            found.on(mesh.points).at((59.0,))
        with pytest.raises(InputError, match="a plan of one amount has no derivative"):
            found.on(mesh.points).jvp((60.0,), (1.0,))


def test_a_triangulated_slide_has_a_plan_of_one_amount_alone():
    mesh, hinge = warped_block(), [[0, 0, 0], [0, 1, 0]]
    given = {"slide": dict.fromkeys(SIDES, "surface"), "box": [[-3.0] * 3, [3.0] * 3], "force": True}
    with pytest.raises(InputError, match=r"sums of 6 fields .* tolerance, and 0\.1 is allowed, as on a curved sl"):
        plan(mesh, "body", hinge, range=(-20, 20), **given)
    one = plan(mesh, "body", hinge, 20, **given)
    assert one.on(mesh.points).at((20.0,)).tobytes() == deflect(mesh, "body", hinge, 20, **given).points.tobytes()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (90.5, "hole = 90.5 deg is outside its range -20:45"),
        (np.nan, "hole = nan deg is outside its range"),
        ((1, 2), r"amounts = .*: the plan has 1 surfaces: hole"),
        ({"hole": 1, "slot": 2}, "'slot' is no surface of the plan; .*hole"),
    ],
)
def test_amounts_that_cannot_be_are_one_sentence(held, asked, said):
    with pytest.raises(InputError, match=said):
        held.at(asked)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"range": (5, 20)}, "range = 5:20 of hole must hold 0"),
        ({"range": (-91, 20)}, "at most 90 deg either way"),
        ({"range": (0, 0)}, "range = 0:0 of hole must hold"),
        ({"range": (-5, 5), "angle": 9}, "range = -5:5 of hole must hold 0 and 9"),
        ({"range": "5"}, "must be two numbers, such as -25:25"),
        ({}, "the angle of hole is missing"),
    ],
)
def test_ranges_that_cannot_be_are_one_sentence(mesh, given, said):
    with pytest.raises(InputError, match=said):
        plan(mesh, "hole", PIVOT, **given, **HOLE)


def test_a_mesh_is_deflected_to_an_angle_alone(mesh):
    with pytest.raises(InputError, match="the angle of hole is missing"):
        deflect(mesh, "hole", PIVOT, range=(-5, 5), **HOLE)


def test_a_plan_of_a_file_has_no_mesh(held, tmp_path):
    held.save(tmp_path / "plan.npz")
    with pytest.raises(InputError, match=r"has no mesh: give the undeflected points .* or take plan.on\(points\)"):
        MeshMotion.load(tmp_path / "plan.npz").at(3)


def test_what_passed_is_around_zero_and_says_what_failed_beyond(held):
    rows = held.measured[0]
    assert [row.amount for row in rows if row.amount == 0.0] == [0.0]
    bad = [replace(row, inverted=3, failed=("inverted_cells",)) for row in rows]
    worse = [row if row.amount < 30 else one for row, one in zip(rows, bad, strict=True)]
    one = replace(held, measured=(tuple(worse),))
    low, high = one.passed(0)
    assert (low, high) == (-20.0, max(row.amount for row in rows if row.amount < 30))
    (fault,) = one.faults((45.0,))
    assert fault == f"hole = 45 deg: outside -20:{high:g}, which passed; failed: inverted_cells"
    assert one.faults((10.0,)) == ()
    assert ", passed -20:" in repr(one)


def test_what_is_poor_is_told_with_the_amount_where_it_was_measured(held):
    first, *others = held.measured[0]
    poor = replace(first, reservations=("4 of 900 triangles poor",))
    one = replace(held, measured=((poor, *others),))
    between = 0.5 * (first.amount + others[0].amount)
    assert one.reservations((first.amount,)) == ("4 of 900 triangles poor",)
    assert one.reservations((between,)) == (f"4 of 900 triangles poor at {first.amount:g} deg",)
    assert one.reservations((others[0].amount,)) == ()
    assert one.reservations((others[-1].amount,)) == others[-1].reservations != ()


def test_a_range_too_narrow_for_its_functions_is_one_sentence(mesh):
    for low, high in ((0.0, 1e-300), (-1e-160, 1e-160), (0.0, 5e-324)):
        with pytest.raises(InputError, match=r"range = .* of hole is too narrow for a plan|must hold 0"):
            plan(mesh, "hole", PIVOT, range=(low, high), **HOLE)
    assert np.isfinite(plan(mesh, "hole", PIVOT, range=(0, 1e-9), **HOLE).at(1e-9)).all()


def test_a_wide_range_asks_for_a_smaller_one_and_names_no_slide(mesh, monkeypatch):
    monkeypatch.setattr(snapshots, "MISSED", -1.0)
    with pytest.raises(InputError, match=r"and -1 is allowed; try -40:42\.5, or plan one"):
        plan(mesh, "hole", PIVOT, range=(-80, 85), **HOLE)


def test_a_plan_is_measured_at_the_rows_of_its_track(tmp_path):
    """A row between two measured amounts, at which a cell is inverted, was said to pass."""
    spike = [[0, 0], [0.43, 1], [0.44, 85], [0.45, 1], [1, 2]]
    (tmp_path / "spike.csv").write_text("parameter,angle,dx,dy\n" + "".join(f"{s},{a},0,0\n" for s, a in spike))
    one = plan(
        plate(40, "triangle"), "hole", PIVOT, range=(0, 1), track=str(tmp_path / "spike.csv"), min_quality=0.5, **HOLE
    )
    assert {0.43, 0.44, 0.45} < {row.amount for row in one.measured[0]}
    (bad,) = (row for row in one.measured[0] if row.amount == 0.44)
    assert bad.failed
    assert one.passed(0) == (0.45, 1.0)  # around where it stands
    assert one.faults((0.44,))
    assert one.shortfalls == ("hole passed 0.45:1 of 0:1 of the track; try range 0:0.5",)
    rows = tuple((k / 500, 0.01 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(501))
    many = replace(one.controls[0], functions=replace(one.controls[0].functions, rows=rows))
    assert len(many.measured(9)) <= 69


def test_a_plan_meets_its_tolerance_at_its_own_ends(block_on_cylinder):
    """Centres that one reading added raised the error of another above the tolerance."""
    given = {"motion": "root", "on": "round", "shape": "cylinder", "fixed": "rest", "force": True}
    hinge = [[0.7, 0.72, 0.0], [1.05, 1.08, 0.0]]
    for ends in ((-6, 6), (-9, 4), (-12, 12), (-15, 3), (-4, 16)):
        one = plan(block_on_cylinder, "body", hinge, range=ends, **given)
        assert one.controls[0].functions.count > 2
        for row in (one.measured[0][0], one.measured[0][-1]):
            assert row.site_error <= tolerance(one)
            assert "site_error" not in row.failed


def test_a_plan_that_cannot_be_written_leaves_the_old_file(held, tmp_path, monkeypatch):
    path = tmp_path / "plan.npz"
    held.save(path)
    old = path.read_bytes()

    def full(file, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(InputError, match=r"plan.npz: cannot be written: No space"):
        held.save(path)
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_no_plan_is_one_sentence(held, tmp_path):
    path = tmp_path / "plan.npz"
    np.savez(path, kind=np.array("something"))
    with pytest.raises(InputError, match=r"plan\.npz: no plan: it holds something else"):
        MeshMotion.load(path)
    with pytest.raises(InputError, match="is there, and this program did not write it"):
        held.save(path)
    path.unlink()
    held.save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="no archive of arrays"):
        MeshMotion.load(path)

"""Tables on patches that move already: their displacements add up, on surfaces, in plans and in sensitivities."""

import numpy as np
import pytest

from sdm_deflect import InputError, deflect, plan

# Lengths that agree but for rounding, in chords of the wing.
SAME = 1e-15
WING = ["wing_*", "flap_*"]


@pytest.fixture(scope="module")
def wing(hybrid_wing):
    """The mesh, its hinge, and nodes of wing and flap."""
    mesh = hybrid_wing.mesh
    return mesh, hybrid_wing.hinge, mesh.on(*mesh.expand(WING, "")), mesh.on(*mesh.expand(["flap_*"], ""))


def bend(points, size=0.02):
    """Displacements (K, 3) that grow along the span."""
    return size * np.column_stack([0.0 * points[:, 1], 0.0 * points[:, 1], points[:, 1] ** 2])


def waves(points):
    """Displacements (K, 3) along the chord."""
    return 0.005 * np.column_stack([np.sin(5.0 * points[:, 1]) * points[:, 1], *np.zeros((2, len(points)))])


def tables(mesh, nodes, amounts=(1.0, 0.5), **more):
    points = mesh.points[nodes]
    shapes = ((points, shape(points)) for shape in (bend, waves))
    return [{"patches": WING, "table": table, "amount": a, **more} for table, a in zip(shapes, amounts, strict=True)]


def flap(hinge, angle=4.0, **more):
    return {"patches": ["flap_*"], "hinge": hinge, "angle": angle, "motion": "blended", "held": ["wing_*"], **more}


def test_two_tables_are_one_displacement(wing):
    mesh, _, nodes, _ = wing
    points = mesh.points[nodes]
    both, slide = tables(mesh, nodes), {"symmetry": "plane"}
    total = bend(points) + 0.5 * waves(points)
    result = deflect(mesh, both, slide=slide)
    whole = deflect(mesh, WING, None, 1.0, table=(points, total), slide=slide)
    assert np.abs(result.points[nodes] - points - total).max() < SAME
    assert np.abs(result.points - whole.points).max() < 1e-12
    rates = zip(result.sensitivity, (bend(points), waves(points)), strict=True)
    assert all(np.abs(rate[nodes] - shape).max() < SAME for rate, shape in rates)


def test_a_flap_turns_and_bends_with_its_wing(wing):
    mesh, hinge, nodes, on_flap = wing
    slide, wing_stays = {"symmetry": "plane"}, mesh.expand(["wing_*"], "")
    only = deflect(mesh, [flap(hinge)], fixed=wing_stays, slide=slide)
    result = deflect(mesh, [flap(hinge), tables(mesh, nodes)[0]], slide=slide)
    move = result.points - mesh.points
    assert np.abs(move[on_flap] - (only.points - mesh.points)[on_flap] - bend(mesh.points[on_flap])).max() < SAME
    alone = np.setdiff1d(nodes, on_flap)
    assert np.abs(move[alone] - bend(mesh.points[alone])).max() < SAME
    shares, without = (next(filter(None, each.figures()["motion"].values())) for each in (result, only))
    assert shares["mean"] == pytest.approx(without["mean"])  # what the flap reaches is measured without the table
    assert shares["off"] == pytest.approx(without["off"])


def test_a_table_beside_a_flap_falls_to_zero_or_names_both(wing):
    mesh, hinge, _, on_flap = wing
    near = mesh.on(*mesh.expand(["wing_*"], ""))
    points = mesh.points[near]
    border = np.isin(near, on_flap)
    table = {"patches": ["wing_*"], "table": (points, bend(points)), "amount": 1.0}
    with pytest.raises(
        InputError, match="differently there; name both patches for the table, which adds to a turn, or"
    ):
        deflect(mesh, [flap(hinge), table], slide={"symmetry": "plane"})
    low, high = points[border].min(axis=0), points[border].max(axis=0)
    away = np.linalg.norm(np.maximum(0.0, np.maximum(low - points, points - high)), axis=1)
    fading = bend(points) * np.minimum(4.0 * away, 1.0)[:, None]
    result = deflect(mesh, [flap(hinge), {**table, "table": (points, fading)}], slide={"symmetry": "plane"})
    assert np.abs(result.points[near] - points - fading).max() < SAME


def test_a_plan_of_two_tables_has_an_amount_for_each(wing):
    mesh, _, nodes, _ = wing
    moves = plan(mesh, tables(mesh, nodes, range=(-1.0, 1.0)), slide={"symmetry": "plane"})
    first, second = (control.name for control in moves.controls)
    assert second == f"{first} (2)"
    points = mesh.points[nodes]
    moved = moves.at({first: 0.4, second: -0.3})[nodes]
    assert np.abs(moved - points - 0.4 * bend(points) + 0.3 * waves(points)).max() < SAME
    name = moves.controls[0].patches[0]
    with pytest.raises(InputError, match=rf"'{name}' belongs to several surfaces; say {first} or"):
        moves.at({name: 1.0})


def test_turns_do_not_add_up(wing):
    mesh, hinge, _, _ = wing
    with pytest.raises(InputError, match=r"patch flap_\w+ belongs to two moving surfaces; only tables add up"):
        deflect(mesh, [flap(hinge), flap(hinge, angle=2.0)], fixed=["wing_*"], slide={"symmetry": "plane"})

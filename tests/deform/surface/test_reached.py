"""How much of its angle a surface reaches, beside what follows from its shape."""

import numpy as np
import pytest

from sdm_deflect.cases.run.metrics import deflection_figures, motions
from sdm_deflect.deform.surface.blended import Blended, Rib
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.deform.surface.reached_share import ReachedShare
from sdm_deflect.deform.surface.surface import OnPatches, Surface
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.meshing.mesh.cells import Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.jobs import blended, job

SPAN, HALF, STATIONS = 2.0, 0.1, 81
HINGE = Rotation.about([0.0, 0.0, 0.0], [0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def wedge():
    """A wedge of chord 1 between ribs at y = 0 and 2: hinge edges at z = 0.1 and -0.1, trailing edge at x = 1."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, SPAN, STATIONS), indexing="ij")
    top = np.column_stack([u.ravel(), v.ravel(), HALF * (1.0 - u.ravel())])
    points = np.unique(np.vstack([top, top * [1, 1, -1]]), axis=0)
    nodes, (x, y, _) = np.arange(len(points)), points.T
    own = {"wedge": x >= 0.0, "hinge": x == 0.0, "edge": x == 1.0, "rib": (y == 0.0) | (y == SPAN)}
    mesh = Mesh(points, (), tuple(Patch(name, (), nodes[rows]) for name, rows in own.items()))
    return Surface.of(mesh, ("wedge",))


def reached(surface, motion, angle):
    law = motion.law(surface)
    return ReachedShare.of(surface.points, law.displacement(angle), HINGE.axis, angle, law)


def between_ribs(strip):
    held, ribs = OnPatches(("hinge", "rib")), Rib(OnPatches(("rib",)), share=strip)
    return Blended(HINGE, held, OnPatches(("edge",)), ribs, OnPatches(("hinge",)))


@pytest.mark.parametrize("angle", [3.0, -40.0])
@pytest.mark.parametrize("strip", [0.05, 0.1, 0.2])
def test_strips_at_both_ends_cost_their_share_of_the_span(wedge, strip, angle):
    """The angle grows nearly linearly over each strip: half of it is lost there."""
    found = reached(wedge, between_ribs(strip), angle)
    spacing = 1.0 / (STATIONS - 1)
    assert found.full == pytest.approx(1.0 - 2.0 * strip, abs=2.0 * spacing)
    assert found.mean == pytest.approx(1.0 - strip, abs=0.01 + spacing)


@pytest.mark.parametrize("angle", [3.0, -40.0])
def test_the_hinge_edges_are_what_is_farthest_from_a_rigid_turn(wedge, angle):
    """They stay, and would go by 2 h sin(angle / 2), which is measured in chords of 1."""
    found = reached(wedge, between_ribs(0.1), angle)
    assert found.off == pytest.approx(2.0 * HALF * abs(np.sin(np.radians(angle / 2.0))), rel=1e-9)
    assert found.place[0] == 0.0
    assert 0.1 * SPAN <= found.place[1] <= 0.9 * SPAN


def test_a_rigid_turn_is_reached_everywhere(wedge):
    found = reached(wedge, HINGE, 20.0)
    assert (found.full, found.mean) == (1.0, pytest.approx(1.0))
    assert found.off == 0.0
    assert found.text == "turns by the full angle"


def test_a_longer_unit_of_length_changes_nothing_but_the_place(wedge):
    mesh = wedge.mesh.with_points(1e3 * wedge.mesh.points)
    one, other = (reached(own, between_ribs(0.21), 10.0) for own in (wedge, Surface.of(mesh, ("wedge",))))
    assert (other.full, other.mean, other.off) == pytest.approx((one.full, one.mean, one.off))


def test_figures_of_a_job_have_it_for_each_surface(inboard_wing):
    w = inboard_wing
    plan = Plan.of(w.mesh, [job(("flap_*",), **blended(w))])
    found = deflection_figures(deflect(plan, (10.0,)))["motion"]
    (name,) = found
    assert 0.0 < found[name]["full"] <= found[name]["mean"] < 1.0
    assert found[name].keys() == {"full", "mean", "off", "place", "near"}
    ((named, text),) = motions(plan, plan.largest)
    assert named == name
    full, mean = (f"{100 * found[name][key]:.0f} %" for key in ("full", "mean"))
    share = f"full angle over {full} of the span, {mean} on average"
    assert text.startswith(f"{share}; distance from a rigid turn: up to ")
    assert list(motions(plan, plan.largest, whole=False)) == [(name, share)]


def test_displacements_of_a_table_have_no_angle(inboard_wing):
    w = inboard_wing
    nodes = w.mesh.on("flap_upper", "flap_lower", "flap_base")
    table = Table(w.mesh.points[nodes], np.zeros((len(nodes), 3)))
    plan = Plan.of(w.mesh, [job(("flap_*",), angle=1.0, **{**blended(w), "motion": table})])
    assert list(motions(plan, plan.largest)) == []
    assert [one for _, one in plan.boxes[0].boundary.reaches((1.0,))] == [None]
    still = Plan.of(w.mesh, [job(("flap_*",), angle=0.0, **blended(w))])
    assert [one for _, one in still.boxes[0].boundary.reaches((0.0,))] == [None]

"""The displacement field is the deflection, bit for bit, whatever part of the mesh is given."""

import numpy as np
import pytest

from sdm_deflect import deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import silent
from sdm_deflect.deform.volume.deflection import Deflection, deflect_in_steps
from sdm_deflect.deform.volume.deflection import deflect as carried_out
from sdm_deflect.deform.volume.field import Field
from sdm_deflect.deform.volume.plan import Plan
from tests.deform.blocks import two_bodies
from tests.deform.jobs import FLAP, blended, job
from tests.deform.plates import plate

BOX = [[0.2, -0.2, -0.5], [1.6, 0.95, 0.5]]


@pytest.fixture(scope="module")
def plan(inboard_wing):
    """Prisms, sliding nodes on the symmetry plane, a blended flap."""
    return Plan.of(inboard_wing.mesh, [job(FLAP, inboard_wing.hinge, 12.0, **blended(inboard_wing, box=BOX))])


def two_steps(plan):
    return Deflection(plan, (deflect_in_steps(plan.boxes[0], (12.0,), 2, silent),))


@pytest.mark.parametrize("how", [lambda plan: carried_out(plan, (12.0,)), two_steps])
def test_it_is_the_deflection_to_the_bit(plan, how, tmp_path):
    one = how(plan)
    found, points = Field.of(one.boxes), plan.mesh.points
    assert found.apply(points).tobytes() == one.points.tobytes()
    order = np.random.default_rng(5).permutation(len(points))
    for rows in np.array_split(order, 7):
        assert found.apply(points[rows]).tobytes() == one.points[rows].tobytes()
    for row in order[:50]:
        assert found.apply(points[row : row + 1]).tobytes() == one.points[row : row + 1].tobytes()
    np.savez(tmp_path / "field.npz", **found.arrays("_a"))
    with np.load(tmp_path / "field.npz") as stored:
        assert Field.from_arrays(stored, "_a").apply(points).tobytes() == one.points.tobytes()


def test_what_a_repair_has_moved_is_told_outright():
    mesh = plate(40, "triangle")
    box = [[-0.55, -0.55], [0.55, 0.55]]
    result = deflect(mesh, "hole", hinge=[0.1, 0.0], angle=60, box=box, max_steps=1)
    assert len(result.deflection.boxes[0].repaired.moved)
    assert Field.of(result.deflection.boxes).apply(mesh.points).tobytes() == result.points.tobytes()


def test_two_surfaces_and_no_near_wall():
    mesh = two_bodies()
    places = {"left": -1.25, "right": 1.25}
    wanted = [{"patches": name, "hinge": [[x, -1, 0], [x, 1, 0]], "angle": 3 * x} for name, x in places.items()]
    result = deflect(mesh, wanted, near_wall=False, box=[[-3.5, -1.4, -1.8], [3.5, 1.4, 1.8]])
    assert Field.of(result.deflection.boxes).apply(mesh.points).tobytes() == result.points.tobytes()


def test_what_is_no_points_is_one_sentence(plan):
    found = Field.of(carried_out(plan, (12.0,)).boxes)
    with pytest.raises(InputError, match="not finite"):
        found.apply(np.full((1, 3), np.nan))
    with pytest.raises(InputError, match=r"must be \(N, 3\)"):
        found.apply(np.zeros((4, 2)))

"""Room between two walls: layers are rigid to their top where there is some; where there is none, the run says so."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect import Mesh, Patch, deflect
from sdm_deflect.meshing.mesh.cells import Cells
from tests.deform.plates import plate

# Radii of the inner and the outer wall, number of cells around, and of cells between the two stacks.
INNER, OUTER, AROUND, BETWEEN = 1.0, 1.3, 30, 6


def annulus(stack: float) -> Mesh:
    """A plane ring of quadrilaterals, with five layers of a common height ``stack`` on each of its walls."""
    layers = stack * np.linspace(0.0, 1.0, 6)
    middle = np.linspace(INNER + stack, OUTER - stack, BETWEEN + 1)
    radii = np.concatenate([INNER + layers, middle[1:-1], OUTER - layers[::-1]])
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    r, phi = (grid.ravel() for grid in np.meshgrid(radii, angle, indexing="ij"))
    ring = np.arange(AROUND)
    lines = np.column_stack([ring, np.roll(ring, -1)])
    quads = [np.hstack([k * AROUND + lines, ((k + 1) * AROUND + lines)[:, ::-1]]) for k in range(len(radii) - 1)]
    patches = [Patch(name, (Cells("line", lines + k * AROUND),)) for name, k in (("hub", 0), ("duct", len(radii) - 1))]
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi), 0.0 * r])
    return Mesh(points, (Cells("quad", np.concatenate(quads)),), tuple(patches), name="ring")


def turned(stack, angle=2.0):
    return deflect(annulus(stack), "hub", [0.1, 0.0], angle, fixed="duct", repair="off")


def changes(result):
    (check,) = (check for check in result.checks if check.name == "layer_height")
    return check


@pytest.mark.parametrize("stack", [0.02, 0.06, 0.095])
def test_layers_keep_their_heights_where_two_stacks_have_room(stack):
    """A fifth of the way to the middle, which was rigid whatever the layers, ends at .05 from each wall."""
    result = turned(stack)
    assert changes(result).value < 0.01
    assert result.deflection.plan.boxes[0].crowding is None


def test_layers_without_room_are_named_with_the_room_there_is():
    said = (
        r"layers 4 to 5 of hub have no room .* layers are 0.13 thick there, and keep their heights up to 0.1, a third"
    )
    with pytest.warns(UserWarning, match=said):
        result = turned(0.13)
    assert changes(result).value > 0.01


def test_a_patch_without_a_role_to_which_the_box_gives_way_is_named():
    """The plate below its hole is pressed to a tenth: its lower side is .075 from the hole, which is one wide."""
    mesh = plate()
    points, y = mesh.points * [2.0, 1.0, 1.0], mesh.points[:, 1]
    points[:, 1] = np.where(y < -0.25, -0.25 + 0.1 * (y + 0.25), y)
    pressed = replace(mesh, points=points)
    said = r"bottom is 0.075 from hole and has no role: the box ends before it, .* in fixed or slide \(bottom:plane\)"
    with pytest.warns(UserWarning, match=said):
        deflect(pressed, "hole", [0.0, 0.0], 0.5, fixed="rest", repair="off")
    assert deflect(mesh, "hole", [0.0, 0.0], 10.0).passed

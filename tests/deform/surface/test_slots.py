"""Gap and overlap of two elements: measured by hand, prescribed, and met to rounding."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.surface.slots import Slot, SlotSetting
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

HINGE = Axis(np.array([0.9, -0.05, 0.0]), np.array([0.0, 0.0, 1.0]))
# An element with a blunt trailing edge, whose lower corner is (1, 0.004).
MAIN = np.array([[0.0, 0.0], [0.5, 0.06], [1.0, 0.01], [1.0, 0.004], [0.5, -0.05]])


def flap_at(x=0.98, y=-0.06):
    """A flap of 60 lines with a round nose."""
    t = np.linspace(0.0, 2.0 * np.pi, 61)[:-1]
    return np.column_stack([x + 0.15 * (1.0 - np.cos(t)), y + 0.02 * np.sin(t) * (1.0 + np.cos(t))])


def elements(flap, main=MAIN):
    """A plane mesh of one far cell, with the lines of two elements as patches ``main`` and ``flap``."""
    corners = np.array([[9.0, 9.0], [9.1, 9.0], [9.1, 9.1], [9.0, 9.1]])
    points = np.pad(np.vstack([main, flap, corners]), ((0, 0), (0, 1)))
    loops = (np.arange(len(main)), len(main) + np.arange(len(flap)))
    lines = [Cells("line", np.column_stack([loop, np.roll(loop, -1)])) for loop in loops]
    patches = tuple(Patch(name, (own,)) for name, own in zip(("main", "flap"), lines, strict=True))
    return Mesh(points, (Cells("quad", len(points) - 4 + np.arange(4)[None]),), patches)


def measured(edge, skin):
    """Gap by sampling the skin finely, and overlap."""
    start, end = skin[:, None, 0], skin[:, None, 1]
    fine = start + np.linspace(0.0, 1.0, 20_001)[None, :, None] * (end - start)
    return np.linalg.norm(fine.reshape(-1, 2) - edge, axis=1).min(), edge[0] - skin[..., 0].min()


def test_the_lower_corner_of_a_blunt_edge_counts_whichever_patch_is_named_first():
    mesh = elements(flap_at())
    for names in (("main", "flap"), ("flap", "main")):
        slot = Slot.of(mesh, *names)
        assert slot.edge.tolist() == [1.0, 0.004]
        gap, overlap = measured(slot.edge, slot.skin)
        assert slot.setting.gap == pytest.approx(gap, rel=1e-6)
        assert slot.setting.overlap == pytest.approx(overlap, abs=1e-15)


@pytest.mark.parametrize("angle", [-20.0, -5.0, 0.0, 10.0])
@pytest.mark.parametrize(("gap", "overlap"), [(0.012, 0.003), (0.02, -0.01), (0.05, 0.02), (None, 0.0), (0.03, None)])
def test_a_flap_goes_to_a_setting(angle, gap, overlap):
    mesh = elements(flap_at())
    before = Slot.of(mesh, "main", "flap").setting
    law = SlotSetting(HINGE, "main", angle, gap, overlap).law(Surface.of(mesh, ["flap"]))
    moved = mesh.points.copy()
    moved[law_nodes(mesh, "flap")] += law.displacement(1.0)
    after = Slot.of(mesh.with_points(moved), "main", "flap").setting
    assert after.gap == pytest.approx(before.gap if gap is None else gap, abs=1e-12)
    assert after.overlap == pytest.approx(before.overlap if overlap is None else overlap, abs=1e-12)
    assert law.track.rows[-1, 1] == angle
    assert not law.displacement(0.0).any()


def law_nodes(mesh, name):
    return Surface.of(mesh, [name]).nodes


def test_an_element_ahead_of_its_slot_goes_to_a_setting():
    mesh = elements(flap_at())
    hinge = Axis(np.array([0.3, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    law = SlotSetting(hinge, "flap", 6.0, 0.02, -0.004).law(Surface.of(mesh, ["main"]))
    moved = mesh.points.copy()
    moved[law_nodes(mesh, "main")] += law.displacement(1.0)
    after = Slot.of(mesh.with_points(moved), "main", "flap").setting
    assert (after.gap, after.overlap) == pytest.approx((0.02, -0.004), abs=1e-12)


def test_settings_that_cannot_be_are_one_sentence():
    mesh = elements(flap_at())
    with pytest.raises(InputError, match="no place of the element has them"):
        Slot.of(mesh, "main", "flap").shift(0.01, -5.0)
    for gap, overlap in ((0.0, None), (-0.1, None), (np.nan, None), (0.1, np.inf)):
        with pytest.raises(InputError, match=r"(gap|overlap) = .* must be a"):
            SlotSetting(HINGE, "main", 0.0, gap, overlap)
    with pytest.raises(InputError, match="slot 'none' is no patch"):
        Slot.of(mesh, "main", "none")
    solid = Mesh(np.zeros((1, 3)), (), ())
    with pytest.raises(InputError, match="measured in a plane mesh"):
        Slot.of(solid, "main", "flap")

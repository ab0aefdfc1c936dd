"""What contradicts itself, says nothing, or refers to itself, is refused in one sentence."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.api import deflect, plan, sweep
from tests.deform.blocks import two_bodies
from tests.deform.plates import plate

LEFT = [[-1.25, -1.0, 0.0], [-1.25, 1.0, 0.0]]
NAN = float("nan")


@pytest.fixture(scope="module")
def pair():
    return two_bodies()


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"angle": 5, "down": 5}, "give one of the three"),
        ({"down": 5, "up": 5}, "give one of the three"),
        ({"down": NAN}, "down = nan is not a finite number"),
        ({"down": 95}, "angle = 95 deg of left is out of range"),
        ({"down": 5, "vertical": "y"}, "the hinge lies along y, or along the flow, x: set vertical = z"),
        ({"down": 5, "hinge": [[-2, 0, 0], [2, 0, 0]]}, "or along the flow, x: set vertical = y"),
        ({"angle": 5, "shift": [0, 0]}, "the hinge lies in space, so give dx,dy,dz"),
        ({"angle": 5, "shift": [0, NAN, 0]}, "nan is not a finite number"),
        ({"angle": 5, "shift": []}, "shift"),
        ({"angle": 5, "shift": [[0, 0, 0]] * 3}, "shift"),
        ({"angle": 5, "shift": [0, 0, 0.1], "track": "track.csv"}, "give one of them"),
        ({"track": "none.csv"}, "none.csv"),
        ({"angle": 5, "gap": 0.1}, "gap and overlap need slot"),
        ({"angle": 5, "on": "right"}, "on = 'right': a rigid motion has no use for it"),
        (
            {"angle": 5, "motion": "root"},
            "give one patch of the tail, the hinge, and in `on` other patches, of the body",
        ),
        ({"angle": 5, "motion": "root", "on": "left"}, "in `on` other patches, of the body"),
        ({"angle": 5, "motion": "root", "on": "right"}, "left shares no node with right, on which it turns"),
        ({"angle": 5, "motion": "root", "on": "right", "depth": -1}, "depth = -1"),
        ({"angle": 5, "motion": "root", "on": "right", "shape": "cone"}, "shape = 'cone' is not one of"),
        (
            {"angle": 5, "motion": "root", "on": "right", "mirror": "right"},
            "mirror = 'right': a root motion has no use for it",
        ),
        ({"angle": 5, "mirror": "left"}, "mirror: name other patches than the surface's own"),
        ({"angle": 5, "mirror": "right", "sign": 2}, "sign = 2"),
        ({"angle": 5, "device": "right,0.1,0.5,0.7"}, "with one new name of the surface, and no hinge"),
        ({"angle": 5, "strip": "wide"}, "strip"),
    ],
)
def test_wrong_settings_of_a_motion_are_one_sentence(pair, settings, complaint):
    given = {"hinge": LEFT, **settings}
    with pytest.raises(InputError) as caught:
        deflect(pair, "left", given.pop("hinge"), given.pop("angle", None), **given)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"slot": "hole", "gap": 0.1}, "slot = hole: this is the surface itself"),
        ({"slot": "outer", "gap": NAN}, "gap = nan is not a finite number"),
        ({"slot": "nothing", "gap": 0.1}, "'nothing' is no patch"),
        ({"slot": "hole", "shift": [0.1, 0.0], "gap": 0.1}, "give one of them"),
    ],
)
def test_wrong_settings_of_a_slot_are_one_sentence(settings, complaint):
    with pytest.raises(InputError) as caught:
        deflect(plate(), "hole", [0.0, 0.0], 5.0, margin=0.4, **settings)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("angles", "complaint"),
    [
        ([], "angles is empty"),
        ([[]], "rows of 1 amounts"),
        ([[1.0, 2.0]], "rows of 1 amounts, one for each surface"),
        ([[NAN]], "1 to 1000 rows of finite numbers"),
        ([[1.0], [2.0, 3.0]], "angles"),
        ([["five"]], "angles"),
        (np.zeros((1001, 1)), "1 to 1000 rows of finite numbers"),
        ("none.csv", "none.csv: no table of amounts"),
    ],
)
def test_wrong_rows_are_one_sentence(pair, angles, complaint):
    with pytest.raises(InputError, match=complaint):
        sweep(pair, "left", LEFT, angles)


def test_a_reflection_beyond_no_plane_is_refused(pair):
    with pytest.raises(InputError, match="mirror: the box crosses the plane y = 0"):
        plan(pair, "left", LEFT, mirror="right", range=(-5, 5))


@pytest.mark.parametrize(("name", "sign"), [("down", -1.0), ("up", 1.0)])
def test_down_and_up_turn_the_trailing_edge(pair, name, sign):
    for hinge in (LEFT, LEFT[::-1]):
        result = deflect(pair, "left", hinge, None, margin=0.4, **{name: 5.0})
        nodes = pair.on("left")
        aft = nodes[np.argmax(pair.points[nodes, 0])]
        assert sign * result.displacement[aft, 2] > 0.01


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_surface_ahead_of_its_hinge_has_no_down(pair, way):
    """Droop noses, and flaps in a flow along -x, went up by --down."""
    mesh = pair.with_points(pair.points * [way, 1.0, 1.0])
    nodes = mesh.points[mesh.on("left")]
    front, rear = nodes[:, 0].min(), nodes[:, 0].max()
    for word in ("down", "up"):
        with pytest.raises(InputError, match="down and up are of trailing edges, and left lies ahead of its hinge"):
            deflect(mesh, "left", [[rear, -1, 0], [rear, 1, 0]], None, margin=0.4, **{word: 5.0})
    middle = 0.4 * front + 0.6 * rear  # an all-moving tail turns about 60 % of its chord
    for station in (front, middle):
        found = deflect(mesh, "left", [[station, -1, 0], [station, 1, 0]], None, margin=0.4, down=5.0)
        aft = mesh.on("left")[np.argmax(nodes[:, 0])]
        assert found.displacement[aft, 2] < -0.01

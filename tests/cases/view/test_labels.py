"""What the page says and draws, without a browser."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from sdm_deflect.cases.report.scene3d import change_rgb, moved_rgb
from sdm_deflect.cases.view.labels import BINS, facts, histogram, parsed, verdict
from sdm_deflect.cases.view.page import Control, Wish
from sdm_deflect.cases.view.pieces import RED, ClipPlane, ViewPieces
from sdm_deflect.cases.view.run import Span, Spans
from sdm_deflect.deform.base.errors import InputError

pytestmark = pytest.mark.mesher
SPANS = Spans(Span(-26.5, 36.5, "it leaves its hexahedron", "its root leaves the fuselage"), Span(-3.5, 12.0))


@pytest.mark.parametrize(("text", "angle"), [("12", 12.0), (" -3,5° ", -3.5), ("\u22122.25", -2.25), ("36.5", 36.5)])
def test_angles_are_read(text, angle):
    assert parsed(text, SPANS) == angle


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("75", "75° is outside -26.5° to 36.5°: its root leaves the fuselage"),
        ("-30", "-30° is outside -26.5° to 36.5°: it leaves its hexahedron"),
        ("nan", "nan° is outside"),
        ("steep", "'steep' is not a number of degrees"),
        ("", "'' is not a number"),
    ],
)
def test_other_angles_are_refused_with_a_sentence(text, message):
    with pytest.raises(ValueError, match="^" + message.replace("(", r"\(")):
        parsed(text, SPANS)


def test_the_verdict_follows_the_frame(aileron):
    good, far = aileron.at(-12.0), aileron.at(50.0)
    assert verdict(good, aileron)[0] == "success"
    assert verdict(far, aileron)[0] == "warning"
    assert "above the run's tolerance of 80 µm" in verdict(far, aileron)[1]
    broken = replace(good, inverted=np.arange(2))
    kind, sentence = verdict(broken, aileron)
    assert kind == "error"
    assert "2 inverted cells" in sentence
    assert {row["id"]: row["value"] for row in facts(broken, aileron, ViewPieces.of(aileron))}["inverted"] == "2"


def test_the_histogram_has_a_bar_for_each_bin_and_is_well_formed(aileron):
    drawn = ElementTree.fromstring(histogram(aileron.at(-12.0).quality, aileron.at(0.0).quality, "mean ratio"))
    assert len(drawn.findall("rect")) == len(BINS) - 1
    assert "smallest" in drawn.attrib["aria-label"]


def test_inverted_cells_are_red_in_the_section_and_shown_whole(aileron):
    pieces, frame = ViewPieces.of(aileron), aileron.at(-12.0)
    cell = aileron.mesh.cells[0].nodes[aileron.touched.rows[0][5]]
    middle = frame.points[cell].mean(axis=0)
    broken = replace(frame, inverted=np.array([5]))
    shown = pieces.moving(broken, ClipPlane(1, middle[1]), None)
    assert np.count_nonzero((shown["section"].rgb == RED).all(axis=1)) == 1
    assert len(shown["inverted"].points) == 12
    assert np.allclose(shown["marks"].points, middle)
    worst = replace(frame, quality=np.where(np.arange(len(frame.quality)) == 5, 0.0, 1.0))
    assert np.allclose(pieces.worst(worst), middle)
    assert pieces.moving(frame, None, None)["inverted"].empty


def test_colours_follow_what_they_stand_for(aileron):
    control = Control.of(aileron)
    plane, pieces = ClipPlane(1, control.first().position), control.pieces
    still, turned = aileron.at(0.0), aileron.at(-12.0)
    for colour, at_rest in (("change", change_rgb(np.zeros(1))), ("displacement", moved_rgb(np.zeros(1)))):
        assert (pieces.moving(still, plane, None, colour)["section"].rgb == at_rest).all()
        assert len(np.unique(pieces.moving(turned, plane, None, colour)["section"].rgb, axis=0)) > 10
        assert (pieces.standing(plane, None, colour)["around"].rgb == at_rest).all()
    surface = pieces.moving(turned, plane, None, "displacement")["surface"].rgb
    assert len(np.unique(surface, axis=0)) > 10
    farthest = 1e3 * np.linalg.norm(turned.points - aileron.mesh.points, axis=1).max()
    shown = control.show(Wish(-12.0, "y", plane.position, colour="displacement"))
    assert shown["key_title"] == "displacement, mm"
    assert float(shown["key_ends"][2]) == pytest.approx(farthest, rel=5e-3)


def test_walls_beyond_the_section_are_cut_away(aileron):
    pieces, plane = ViewPieces.of(aileron), ClipPlane(1, -0.2)
    piece = pieces.standing(plane, plane)["body"]
    middles = piece.points[piece.nodes.reshape(-1, 3)].mean(axis=1)
    assert 0 < len(middles) < len(pieces.body.faces)
    assert np.all(middles[:, 1] >= -0.2)


def test_only_what_an_input_concerns_is_made_again(aileron, monkeypatch):
    control = Control.of(aileron)
    wish = control.first()
    assert {"status", "facts", "histogram"} <= control.show(wish).keys()
    monkeypatch.setattr(ViewPieces, "standing", lambda *_: pytest.fail("the body does not depend on the angle"))
    assert control.show(replace(wish, angle=3.0))
    assert control.frame.angle == 3.0
    monkeypatch.undo()
    before = control.frame
    assert control.show(Wish(3.0, wish.axis, wish.position + 0.01)) == {}
    assert control.frame is before


def test_an_angle_without_a_motion_leaves_the_picture_as_it_was(tail):
    control = Control.of(tail)
    wish = control.first()
    control.show(wish)
    with pytest.raises(InputError):
        control.show(replace(wish, angle=45.0))
    assert control.shown == wish
    assert control.frame.angle == wish.angle

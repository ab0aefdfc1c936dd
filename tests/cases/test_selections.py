"""Choosing what moves where a file has one marker: from the command line, TOML and Python, and for a report."""

import json
from tomllib import loads

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.run.inspection import file_figures, inspect
from sdm_deflect.cases.settings.job_settings import job_settings
from sdm_deflect.cases.settings.jobs import jobs_of, selection
from sdm_deflect.cases.settings.spellings import selections_of
from sdm_deflect.meshing.formats.registry import FORMATS, read
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.selection import Before, Component, Within
from tests.deform.blocks import two_bodies

HINGE = ["--hinge", "1.25,-1,0", "1.25,1,0", "--angle", "6", "--quiet"]


@pytest.fixture(scope="module")
def channel(tmp_path_factory):
    """Two plates in a channel, all in the marker ``wall`` of an SU2 file: the channel, then two plates of one size."""
    mesh = two_bodies()
    faces = np.vstack([mesh.patch(name).faces[0].nodes for name in ("right", "left", "wall")])
    path = tmp_path_factory.mktemp("channel") / "channel.su2"
    FORMATS["su2"].write(Mesh(mesh.points, mesh.cells, (Patch("wall", (Cells("quad", faces),)),)), path)
    return path


def moved(source, out):
    """The nodes that moved."""
    return np.flatnonzero((read(source).points != read(out).points).any(axis=1))


def test_quality_lists_connected_components_with_their_extent(channel, sdm):
    text = inspect(channel)
    assert "wall has 3 connected components" in text
    assert "  wall#2 64, (0.75, -0.5, -0.2) to (1.75, 0.5, 0.2)" in text
    found = file_figures(channel)
    assert found["components"] == {"wall": 3}
    assert [one["name"] for one in found["parts"]] == ["wall#1", "wall#2", "wall#3"]
    assert sum(one["faces"] for one in found["parts"]) == found["patches"]["wall"]
    assert found["parts"][2]["high"] == pytest.approx([-0.75, 0.5, 0.2])
    more = json.loads(sdm("quality", channel, "--select", "ahead=wall#2 side:1.25,0,0,1,0,0", "--json")[1])
    assert more["parts"][-1]["name"] == "ahead"
    assert more["patches"]["wall"] + more["patches"]["ahead"] == found["patches"]["wall"]
    assert "ahead~1" in sdm("quality", channel, "--select", "ahead=wall#2 side:1.25,0,0,1,0,0 sharp:40")[1]


WAYS = {
    "number": ["--surface", "wall#2", "--fixed", "wall"],
    "name": ["--select", "flap=wall#2", "--surface", "flap", "--fixed", "wall"],
    "box": ["--select", "flap=wall box:0.5,-1,-1,2,1,1", "--surface", "flap", "--fixed", "wall"],
    "components": ["--surface", "wall#2", "--fixed", "wall#*"],
    "regions": ["--select", "side=wall#2 sharp:40", "--surface", "side~*", "--fixed", "wall"],
}


@pytest.mark.parametrize("way", WAYS)
def test_each_way_to_choose_a_plate_moves_its_nodes(way, channel, sdm, tmp_path):
    out = tmp_path / "turned.su2"
    code, table, complaint = sdm("deflect", channel, *WAYS[way], *HINGE, "--out", out, "--no-report")
    assert code == 0, table + complaint
    whole = two_bodies()
    nodes = moved(channel, out)
    assert len(np.setdiff1d(whole.on("right"), nodes)) <= 10  # those on the hinge line
    assert not len(np.intersect1d(whole.on("left", "wall"), nodes))
    assert read(out).names == ("wall",)


def test_a_report_repeats_the_choice(channel, sdm, tmp_path):
    """settings.toml holds it: for --config, for the report anew, and as a choice for another job."""
    out, again = tmp_path / "turned.su2", tmp_path / "again.su2"
    words = ["--select", "flap=wall box:0.5,-1,-1,2,1,1", "--surface", "flap", "--fixed", "wall#3,wall"]
    assert sdm("deflect", channel, *words, *HINGE, "--out", out)[0] == 0
    settings = tmp_path / "turned-report" / "settings.toml"
    assert loads(settings.read_text())["select"] == {"flap": "wall box:0.5,-1,-1,2,1,1"}
    finished = FinishedRun.of(settings.parent)
    plan, points = finished.plan, finished.points
    assert set(plan.mesh.names) == {"wall", "flap", "wall#3"}
    assert (points == read(out).points).all()
    assert finished.motion.controls[0].patches == ("flap",)
    assert sdm("deflect", channel, "--config", settings, "--out", again, "--no-report", "-q")[0] == 0
    assert again.read_bytes() == out.read_bytes()
    chosen = ["--select", settings, "--surface", "flap", "--fixed", "wall"]
    code, table, _ = sdm("deflect", channel, *chosen, *HINGE, "--angle", "2", "--dry-run")
    assert code == 0
    assert "moves by +2 deg" in table


def test_a_configuration_and_an_option_together(channel, sdm, tmp_path):
    (tmp_path / "job.toml").write_text(
        'fixed = ["wall", "other"]\nselect = { flap = "wall#3" }\n'
        "[[surface]]\npatches = ['flap']\nhinge = [[1.25, -1, 0], [1.25, 1, 0]]\nangle = 6\n"
    )
    words = ["--config", tmp_path / "job.toml", "--select", "flap=wall#2", "--select", "other=wall#3"]
    code, table, complaint = sdm("deflect", channel, *words, "--dry-run", "-q")
    assert code == 0, complaint
    assert len([line for line in table.splitlines() if line.startswith(" flap") and "moves by +6 deg" in line]) == 1


@pytest.mark.parametrize("select", [{"flap": "wall#2"}, "flap=wall#2", ["flap=wall#2"]])
def test_the_same_from_python(select, channel):
    hinge = [[1.25, -1, 0], [1.25, 1, 0]]
    result = sdm_deflect.deflect(channel, "flap", hinge, 6, select=select, fixed="wall")
    plain = sdm_deflect.deflect(sdm_deflect.read(channel), "wall#2", hinge, 6, fixed="wall*")
    assert result.passed
    assert (result.points == plain.points).all()
    assert result.mesh.names == ("wall",)
    assert plain.plan.mesh.names == ("wall", "wall#2")


def test_components_are_meant_wherever_a_patch_is_named():
    surface = {"patches": "a#1", "motion": "blended", "hinge": [[0, 0, 0], [0, 1, 0]], "angle": 1}
    surface |= {"held": ["b#2"], "driven": ["c#3"]}
    slides = {"slide": {"e#5": "plane"}, "repair_slide": {"f#6": "surface"}}
    section = [{"patch": "g#7", "point": [0, 0, 0], "axis": "x"}]
    job = jobs_of(job_settings({"surface": [surface], "fixed": "d#4", **slides, "section": section}))[0]
    assert sorted(job.names) == ["a#1", "b#2", "c#3", "d#4", "e#5", "f#6", "g#7"]


def test_expressions_become_tests():
    one = selection("flap", ' "left wall"#2 and box:1,2,3,0,0,-inf   side:0,0,0,0,0,1 #3 sharp:25')
    assert (one.name, one.patch, one.sharp) == ("flap", "left wall#2", 25.0)
    assert one.conditions == (
        Within((0.0, 0.0, -np.inf), (1.0, 2.0, 3.0)),
        Before((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        Component(3),
    )
    plane = selection("flap", "wall box:1,2,3,0 side:1,2,0,-1")
    assert plane.conditions == (
        Within((1.0, 0.0, -np.inf), (3.0, 2.0, np.inf)),
        Before((1.0, 2.0, 0.0), (0.0, -1.0, 0.0)),
    )


WRONG = {
    "flap": "must be NAME=PATCH",
    "flap=": "select.flap is empty",
    "a b=wall": "named by letters",
    "flap=wall box:1,2,3": "must be two opposite corners, box:x,y,z,x,y,z",
    "flap=wall side:1,2,3,0,0,0": "the normal not zero",
    "flap=wall sharp:40 #1": "sharp: must come last",
    "flap=wall sharp:200": "degrees between 0 and 180",
    "flap=wall box:1,2,3,4,5": "of a plane mesh without z",
    "flap=wall near:1": "'near:1' is unknown",
    "flap='wall": "quotation mark is not closed",
    "missing.toml": "missing.toml",
    "flap=wall#7": "there is no component 7; there are wall#1",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_choice_is_one_sentence(text, channel, sdm):
    code, out, complaint = sdm("quality", channel, "--select", text)
    assert (code, out) == (2, "")
    assert WRONG[text] in complaint
    assert complaint.count("\n") == 1


def test_a_name_is_selected_once():
    with pytest.raises(InputError, match="flap is selected twice"):
        selections_of(["flap=wall#1", "flap=wall#2"])
    with pytest.raises(InputError, match="select = 3"):
        sdm_deflect.deflect("x.su2", "flap", [[0, 0, 0], [0, 1, 0]], 1, select=3)


def test_a_file_without_a_choice_is_refused(tmp_path):
    (tmp_path / "job.toml").write_text("fixed = ['wall']\n")
    with pytest.raises(InputError, match="the file has no table select"):
        selections_of(str(tmp_path / "job.toml"))

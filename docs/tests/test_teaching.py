"""The lesson: its commands run as they are printed, and its answers are what they give."""

import re
import shlex

import numpy as np
import pytest
import rigid

import sdm_deflect
from tests import calls
from tests.docs.commands import ROOT

LESSON = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
HANDOUT = (ROOT / "docs" / "handout.md").read_text(encoding="utf-8")
FLAGS = {"aileron": "--surface aileron_left", "tail": "--surface tail_left"}


def commands(text):
    """The commands `sdm deflect` of a page, in their order, without what a shell continues."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("sdm deflect")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the fighter."""
    folder = tmp_path_factory.mktemp("lesson")
    assert calls.sdm("example", folder, "--fighter") == 0
    return folder


@pytest.fixture
def lesson(folder, monkeypatch, sdm):
    """Carry out a command there; return its code and what it says, without line breaks."""
    monkeypatch.chdir(folder)

    def carried_out(words):
        code, out, err = sdm(*words, *([] if "--no-report" in words else ["--no-report"]))
        return code, " ".join((out + err).split())

    return carried_out


def test_the_hand_out_has_the_commands_of_the_lesson():
    own = commands(LESSON)
    for words in commands(HANDOUT):
        if "roll.toml" not in words and "fuselage_panel_left" in words and "root" not in words:
            continue  # the one that is refused, which the lesson describes
        assert words in own or "roll.toml" in words, words


def test_every_row_of_the_hand_out_has_an_answer_in_the_lesson():
    rows = re.findall(r"^\| (\d*) \| \| \| (\d*) ?\| \| \|$", HANDOUT, re.MULTILINE)
    asked = [(name, row[k]) for k, name in enumerate(("aileron", "tail")) for row in rows if row[k]]
    answered = re.findall(r"^\| (aileron|tail) \| (\d+) \| [^|]+ \| [^|]+ \|$", LESSON, re.MULTILINE)
    assert asked == answered
    assert len(asked) == 9


def test_exercise_1_is_answered(lesson, folder):
    code, told = lesson(commands(LESSON)[0])
    assert code == 0
    assert "towards -z" in told
    assert "70 % of the span turns by the full angle; the mean over the span is 86 % of it" in told
    before, after = (sdm_deflect.read(folder / name).points for name in ("fighter.su2", "fighter-deflected.su2"))
    moved = int((before != after).any(axis=1).sum())
    assert f"{moved} moved and {len(before) - moved:,} did not" in LESSON
    kept = (folder / "fighter.toml").read_text().split("[[surface]]")
    (folder / "roll.toml").write_text("[[surface]]".join(kept[:3]))
    code, told = lesson(["deflect", "fighter.su2", "--config", "roll.toml"])
    assert code == 0
    assert re.search(r"aileron_left moves by up to \S+ at \([^)]*\) towards \+z", told)
    assert re.search(r"aileron_right moves by up to \S+ at \([^)]*\) towards -z", told)


def test_exercise_2_is_answered(lesson):
    words = next(words for words in commands(LESSON) if "root" in words)
    assert lesson(words)[0] == 0
    left_out = [word for word in words if word not in ("--motion", "root", "--on")]
    left_out.insert(left_out.index("fuselage_panel_left"), "--fixed")
    code, told = lesson(left_out)
    assert code == 2
    shared, by = re.search(r"(\d+) nodes shared by .* would move by up to (\S+);", told).groups()
    assert f"{shared} nodes belong to the tail and to the panel" in LESSON
    assert f"by up to {1e3 * float(by):.0f} mm" in LESSON


@pytest.mark.nightly
def test_the_table_of_exercise_3_is_what_the_commands_give(lesson):
    rows = re.findall(r"^\| (aileron|tail) \| (\d+) \| ([^|]+) \| ([^|]+) \|$", LESSON, re.MULTILINE)
    assert len(rows) == 9
    for surface, degrees, *expected in rows:
        words = next(words for words in commands(LESSON) if FLAGS[surface].split()[1] in words and "--out" not in words)
        words = [degrees if word == "12" else word for word in words]
        for more, text in zip((["--repair", "off"], []), expected, strict=True):
            code, told = lesson([*words, *more, "--out", "a.su2"])
            assert code == int(text.startswith("fails")), (surface, degrees, told)
            if not code:
                assert f"to {text.strip()}," in told.partition("tetrahedra: least ")[2][:30], (surface, degrees, told)
            elif count := re.search(r"\d+", text):
                assert re.search(rf"(inverted_cells|surfaces_crossed) +{count[0]}\b", told), (surface, degrees, told)


def test_exercise_4_is_answered(lesson):
    words = next(words for words in commands(LESSON) if "wrong.su2" in words)
    code, told = lesson(words)
    assert code == 0
    assert "towards +z" in told
    first = words.index("--hinge") + 1
    code, told = lesson([*words[:first], "0.672,-0.3048,0", "0.657,-0.11627,0", *words[first + 2 :]])
    assert code == 0
    assert "is it the right one?" in told
    assert "moves by up to 0.008654," in told


def test_exercise_5_is_answered(folder):
    node, farthest = rigid.main(str(folder / "fighter.su2"))
    assert f"\n{1e3 * farthest:.2f} mm, at the inboard end" in LESSON
    assert node == pytest.approx([0.699, -0.1162672, 0.0], abs=1e-6)
    edge = np.array([0.699, -0.1162672, 0.0])
    axis = (rigid.SECOND - rigid.FIRST) / np.linalg.norm(rigid.SECOND - rigid.FIRST)
    arm = np.linalg.norm(np.cross(edge - rigid.FIRST, axis))
    assert f"2 · {1e3 * arm:.1f} mm · sin 6° = {2e3 * arm * np.sin(np.radians(6)):.2f} mm" in LESSON

"""The figure of the method and the numbers that texts quote are measured, and agree."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from docs.fly import facts, lesson, pictures, texts
from docs.fly.figure import FEW, MORE, compact
from docs.fly.tail import SECTION, Tail, cut, outline
from sdm_deflect.cases.report.colours import INK, MOVES, WORSE
from tests.docs.commands import ROOT

FIGURE = ROOT / "docs" / "figures" / "method.svg"


@pytest.fixture(scope="module")
def kept():
    return json.loads(facts.KEPT.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tail():
    return Tail.at()


def test_every_text_has_the_numbers_of_the_file(kept):
    for path in texts.TEXTS:
        text = path.read_text(encoding="utf-8")
        assert text.count("<!-- facts ") == text.count("<!-- end -->") > 0
    assert texts.stale(kept) == []
    used = set(re.findall(r"<!-- facts (\w+) -->", "".join(path.read_text(encoding="utf-8") for path in texts.TEXTS)))
    assert used == set(texts.BLOCKS)


def test_a_stale_number_is_found(kept):
    path = texts.TEXTS[0]
    text = path.read_text(encoding="utf-8").replace("cells are inside out", "cells are broken")
    assert texts.with_facts(text, kept) != text


@pytest.mark.nightly
def test_the_exercises_are_those_of_this_version(kept):
    """All but seconds, and nearly the bytes: compression differs. The tests of the lesson run its commands."""
    own, said = lesson.lesson(), kept["lesson"]
    assert own["page"] == pytest.approx(said["page"], rel=1e-6)
    assert own["roll"] == said["roll"]
    for name in ("margins", "tolerances"):
        for key, one in own[name].items():
            assert one.pop("centres", None) == said[name][key].pop("centres", None)
            assert one == pytest.approx(said[name][key], rel=1e-6), (name, key)
    for key, one in own["files"].items():
        assert one["centres"] == said["files"][key]["centres"]
        assert one["bytes"] == pytest.approx(said["files"][key]["bytes"], rel=0.01)
    assert numbers(own["angles"]) == pytest.approx(numbers(said["angles"]), abs=0.0011)


def numbers(angles):
    """The last number of each entry: the worst cell after a repair, whose third digit may differ by one, or a count."""
    return [float(re.findall(r"[\d.]+", one)[-1]) for key in sorted(angles) for one in angles[key]]


def test_the_steps_of_the_tail_are_those_of_this_version(kept, tail):
    """All but seconds and the choice of centres of the other surfaces, which is nightly."""
    own = facts.of_tail()
    assert own["sites"] == kept["tail"]["sites"]
    assert own["motion"] == pytest.approx(kept["tail"]["motion"], rel=1e-9)
    assert own["jump"] == pytest.approx(kept["tail"]["jump"], rel=1e-6)
    assert own["stretched"] == pytest.approx(kept["tail"]["stretched"], rel=1e-6)
    few = tail.judged(tail.moved(tail.greedy(facts.COARSE).interpolant))
    assert few.least > own["with_box"]["least"]  # as the page says
    assert own["without_box"] == pytest.approx(kept["tail"]["without_box"], rel=1e-6)
    for count, one in own["centres"].items():
        assert one == pytest.approx(kept["tail"]["centres"][count], rel=1e-6), count
    assert own["without_box"]["inverted"] > 0 == own["with_box"]["inverted"]


@pytest.mark.nightly
def test_centres_of_all_surfaces_are_those_of_this_version(kept):
    for name, both in kept["strategies"].items():
        for strategy, one in facts.strategies(name):
            assert one["centres"] == both[strategy]["centres"], (name, strategy)


def test_the_figure_says_what_is_measured(kept, tail):
    text = FIGURE.read_text(encoding="utf-8")
    assert len(text.encode()) < 150_000
    assert "http" not in re.sub(r"xmlns[:\w]*=\"[^\"]*\"|<!DOCTYPE[^>]*>", "", text)
    said = " ".join(re.findall(r">([^<>]+)</text>", text))
    assert f"a jump of {1e3 * kept['tail']['jump']:.0f} mm" in said
    assert f"all {kept['tail']['sites']:,} sites, none inside out" in said
    for count in (FEW, MORE):
        found = tail.greedy(count).interpolant
        inverted = tail.judged(tail.moved(found)).inverted
        text = f"{count} centres: {1e3 * tail.error(found).max():.1f} mm off, {inverted or 'none'} inside out"
        assert text in said


def test_a_section_cuts_cells_and_skin_in_its_plane(tail):
    section = cut(tail, tail.mesh.points, tail.cells)
    assert len(section.rows) == len(section.polygons) > 100
    assert {len(polygon) for polygon in section.polygons} == {3, 4}
    heights = tail.mesh.points[tail.tets[section.rows]][:, :, 1] - SECTION
    assert (heights.min(axis=1) < 0.0).all()
    assert (heights.max(axis=1) >= 0.0).all()
    assert len(outline(tail, tail.mesh.points)) > 10


def test_a_path_is_the_same_with_relative_coordinates():
    text = '<path d="M 1.04 2\nL 3.26 2\nL 3 5\nz\nM 7 7\nL 8 6.51\n" style="fill: none"/>'
    assert compact(text) == '<path d="m1 2l2.3 0l-0.3 3zm6 5l1-0.5" style="fill: none"/>'


def test_the_check_ends_with_1_for_a_stale_text(tmp_path):
    path = tmp_path / "a.md"
    path.write_text("<!-- facts box -->nothing<!-- end -->", encoding="utf-8")
    program = "import pathlib\nfrom docs.fly import facts, texts\n"
    program += f"texts.TEXTS = (pathlib.Path({str(path)!r}),)\nfacts.main()"
    done = subprocess.run([sys.executable, "-c", program, "--check"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr.strip()) == (1, "stale: a.md")


def test_pictures_of_the_slides_say_what_is_measured(kept):
    axes = pictures.draw_directions().axes[0]
    heights = [round(bar.get_height()) for bar in axes.patches]
    rows = ([*both["squv"]["centres"], *both["mv"]["centres"]] for both in kept["strategies"].values())
    assert heights == [count for row in rows for count in row]
    left, right = pictures.draw_sum().axes
    assert right.get_legend() is not None
    (_, _, _, _, total, known) = right.get_lines()
    for x, y in zip(*known.get_data(), strict=True):
        assert np.interp(x, *total.get_data()) == pytest.approx(y, abs=1e-4)
    assert left.get_lines()[0].get_ydata().max() == 0.0


def test_the_slide_on_cad_has_the_distance_of_the_lesson():
    said = [text.get_text() for text in pictures.draw_rigid().axes[0].texts]
    lesson = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
    (distance,) = re.findall(r"^([\d.]+ mm), at the inboard end", lesson, re.MULTILINE)
    assert said == [f"{distance}: the closed rib stays"]


def test_the_slide_on_the_hinge_shows_both_ways():
    ends = {}
    for line in pictures.draw_hinge().axes[0].get_lines():
        x, z = line.get_data()
        if max(x) > 0.69:
            colour = line.get_color()
            ends[colour] = max(ends.get(colour, (0.0, 0.0)), *zip(x, z, strict=True))
    assert ends[MOVES][1] < ends[INK][1] == pytest.approx(0.0, abs=1e-4)
    assert ends[WORSE][1] == pytest.approx(-ends[MOVES][1], abs=1e-3)

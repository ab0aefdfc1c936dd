"""A sweep of two surfaces: each page, row and line says how the surfaces move at its own amounts."""

import contextlib
import io
import json
import re

import numpy as np
import pytest

from sdm_deflect import read
from tests import calls

POSES = [(-10.0, 0.0), (0.0, 5.0), (-0.0, -0.0), (7.0, -3.0)]
SETTINGS = """
fixed = ["wing_*", "fin", "fuselage"]
box_each = true
[[surface]]
patches = "aileron_left"
hinge = [[0.69180885, -0.3048, 0.0], [0.676698453, -0.1162672, 0.0]]
motion = "blended"
[[surface]]
patches = "rudder"
hinge = [[0.946420106, 0.0, 0.2133], [0.876717066, 0.0, 0.0955]]
motion = "blended"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    assert calls.sdm("example", folder, "--fighter") == 0
    (folder / "two.toml").write_text(SETTINGS)
    rows = "\n".join(",".join(map(str, pose)) for pose in POSES)
    (folder / "poses.csv").write_text(f"aileron_left,rudder\n{rows}\n")
    return folder


@pytest.fixture(scope="module")
def told(folder):
    """What the terminal says of the sweep."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "160")
        words = ("--config", folder / "two.toml", "--angles", folder / "poses.csv", "--report", "--quiet")
        assert calls.sdm("deflect", folder / "fighter.su2", *words) == 0
    return out.getvalue()


def largest(before, after, patch):
    """The largest displacement of a patch's nodes, from the files of both meshes."""
    nodes = before.on(patch)
    moves = after.points[nodes] - before.points[nodes]
    return moves[np.argmax(np.linalg.norm(moves, axis=1))]


@pytest.mark.parametrize("pose", POSES)
def test_a_page_says_how_its_mesh_moves(folder, told, pose):
    name = "fighter-deflected_" + "_".join(f"{amount + 0.0:+g}" for amount in pose)
    before, after = read(folder / "fighter.su2"), read(folder / f"{name}.su2")
    report = folder / f"{name}-report"
    page, figures = (report / "report.html").read_text(), json.loads((report / "metrics.json").read_text())
    (row,) = (
        line for line in told.splitlines() if line.strip().startswith(", ".join(f"{x + 0.0:+g}" for x in pose) + "  ")
    )
    for patch, amount in zip(("aileron_left", "rudder"), pose, strict=True):
        move = largest(before, after, patch)
        assert figures["farthest"][patch]["move"] == pytest.approx(move.tolist(), abs=1e-12)
        (text,) = re.findall(rf"{patch} moves by up to</td><td>([^<]+)<", page)
        if not amount:
            assert not move.any()
            assert text == "0"
            continue
        axis = int(np.argmax(np.abs(move)))
        way = f"{'-' if move[axis] < 0.0 else '+'}{'xyz'[axis]}"
        size = f"{np.linalg.norm(move):.4g}"
        assert text.startswith(f"{size} towards {way}, at (")
        assert f"{size} to {way}" in row
    assert "no sliders: a sweep makes no plan for each page" in page


def test_the_line_names_the_amounts_that_it_is_for(told):
    line = next(line for line in told.splitlines() if "moves by up to 0.0" in line)
    assert re.match("aileron_left +\N{MINUS SIGN}10\N{DEGREE SIGN}: moves by up to 0.003309 towards ", line)


def test_no_file_is_named_by_minus_zero(folder, told):
    assert told
    assert not list(folder.glob("*-0*.su2"))

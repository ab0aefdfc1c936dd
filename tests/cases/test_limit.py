"""The largest deflection of any mesh: at it a run passes every check, half a step beyond it one fails."""

import json

import pytest

from sdm_deflect.meshing.formats.registry import format_of
from tests.deform.blocks import block_with_body, two_bodies
from tests.deform.plates import plate
from tests.meshing.formats.examples import polyhedral
from tests.meshing.formats.wing import wing

TURN = ["--surface", "body", "--hinge", "0,-0.5,0", "0,0.5,0"]
MESHES = {
    "block.su2": (block_with_body, TURN),
    "polyhedra.vtu": (lambda: polyhedral(block_with_body()), TURN),
    "plate.su2": (lambda: plate(shape="triangle"), ["--surface", "hole", "--hinge", "0.2,0", "--margin", "0.5"]),
    "bodies.cgns": (two_bodies, ["--surface", "left", "--hinge", "-1.25,0,0", "-1.25,1,0", "--margin", "0.4"]),
    "wing.lb8.ugrid": (
        lambda: wing(flap=(0.0, 0.5), cells=4).mesh,
        ["--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--hinge", "0.75,0,0", "0.75,1,0",
         "--motion", "blended"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly) if name.startswith("wing") else name for name in MESHES]
)
def test_runs_on_both_sides_confirm_it(name, sdm, tmp_path):
    (make, words), resolution = MESHES[name], 12.0 if "wing" in name else 6.0
    path = tmp_path / name
    format_of(path).write(make(), path)
    code, text, err = sdm("limit", path, *words, "--resolution", resolution, "--json")
    assert code == 0, err
    found = json.loads(text)
    assert [(one["repair"], one["angle"] > 0.0) for one in found["limits"]] == [
        (mode, positive) for mode in ("off", "auto") for positive in (False, True)
    ]
    for one in found["limits"]:
        sizes = [abs(trial["angle"]) for trial in one["trials"]]
        beyond = one["trials"][sizes.index(abs(one["angle"])) + 1 :][:1]
        assert bool(beyond) == bool(one["end"])
        assert not beyond or abs(beyond[0]["angle"]) - abs(one["angle"]) <= resolution
        assert passes(sdm, path, words, one["repair"], one["angle"])
        for trial in beyond:
            assert not passes(sdm, path, words, one["repair"], trial["angle"])
    assert {file.name for file in path.with_name(f"{name.partition('.')[0]}-limit").iterdir()} == {
        "limit.csv", "limit.png"
    }  # fmt: skip


def passes(sdm, path, words, repair, angle):
    """Whether a run to an angle passes every check."""
    out = path.with_name(f"out{path.name.removeprefix(path.name.partition('.')[0])}")
    code, text, _ = sdm(
        "deflect", path, *words, "--angle", angle, "--repair", repair, "--no-report", "--json", "--out", out
    )
    assert code == 2 or json.loads(text)["passed"] == (code == 0)  # 2: no mesh, the surface leaves the box
    return code == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["aileron", "--surface", "flap"], "--surface is of a mesh, and aileron is a case"),
        (["block.su2", *TURN, "--quality", "0.3"], "--quality is of a case, and block.su2 is a mesh"),
        (["block.su2", *TURN, "--resolution", "40"], "--resolution 40 must be between 0 and 30"),
        (["block.su2", "--surface", "flap", *TURN[2:]], "the surface 'flap' is no patch"),
    ],
)
def test_what_does_not_belong_is_one_sentence(words, said, sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    format_of(tmp_path / "block.su2").write(block_with_body(), tmp_path / "block.su2")
    code, _, err = sdm("limit", *words)
    assert (code, said in err) == (2, True), err

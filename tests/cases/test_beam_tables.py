"""Tables of a beam from the command line: rotations, what is missing without them, and settings that are run again."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sdm_deflect import read
from sdm_deflect.meshing.formats.registry import FORMATS

PATCHES = ["--surface", "wing_*", "--surface", "flap_*", "--slide", "symmetry:plane"]


@pytest.fixture
def bent(hybrid_wing, tmp_path, monkeypatch):
    """A wing, and eleven points of a beam in it that bends by .05 of the square of y, as Nastran titles them."""
    monkeypatch.chdir(tmp_path)
    FORMATS["su2"].write(hybrid_wing.mesh, tmp_path / "wing.su2")
    y = np.linspace(0.0, 1.0, 11)
    none = np.zeros(11)
    rows = np.column_stack([none + 0.4, y, none, none, none, 0.05 * y**2, np.arctan(0.1 * y), 0.1 * y, none])
    np.savetxt("beam.csv", rows, "%.6g", ",", header="x,y,z,T1,T2,T3,R1,R2,R3", comments="")
    np.savetxt("line.csv", rows[:, :6], "%.6g", ",", header="x,y,z,dx,dy,dz", comments="")
    return rows


def test_a_beam_turns_sections_and_its_settings_do_so_again(sdm, bent):
    words = ["--table", "beam.csv", "--out", "bent.su2", "--report"]
    code, text, _ = sdm("deflect", "wing.su2", *PATCHES, *words, "--json")
    assert (code, json.loads(text)["warnings"]) == (0, [])
    old, new = (read(name) for name in ("wing.su2", "bent.su2"))
    tip = old.points[:, 1] == 1.0
    tip &= np.isin(np.arange(len(tip)), old.on("wing_upper", "wing_lower"))
    front, back = (int(np.flatnonzero(tip)[choose(old.points[tip, 0])]) for choose in (np.argmin, np.argmax))
    before, after = (mesh.points[front] - mesh.points[back] for mesh in (old, new))
    assert np.abs(after - Rotation.from_rotvec(bent[-1, 6:]).apply(before)).max() < 1e-6  # the file has six digits
    again = [
        "deflect",
        "wing.su2",
        "--config",
        "bent-report/settings.toml",
        "--out",
        "again.su2",
        "--no-report",
        "--quiet",
    ]
    assert sdm(*again)[0] == 0
    assert np.array_equal(read("again.su2").points, new.points)


def test_a_line_without_rotations_is_warned_of_in_text_and_json(sdm, bent):
    words = ["deflect", "wing.su2", *PATCHES, "--table", "line.csv", "--out", "bent.su2", "--no-report"]
    said = "table: its points lie on a line and have no rotations, so that sections of wing_"
    code, text, _ = sdm(*words, "--json")
    assert code == 0
    assert json.loads(text)["warnings"][0].startswith(said)
    for more in ([], ["--range", "-1:1", "--plan", "p.npz", "--dry-run"]):
        code, text, _ = sdm(*words, *more)
        assert code == 0
        assert said in " ".join(text.split())

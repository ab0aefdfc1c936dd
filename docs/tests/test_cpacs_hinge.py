"""The hinge line of a device in CPACS: wings whose hinge points are known without it."""

import subprocess
import sys

import cpacs_hinge
import numpy as np
import pytest
from cpacs_hinge import hinge
from cpacs_wing import WING, positioning, section, transformation, written


def test_the_hinge_of_a_tapered_wing(tmp_path):
    """Chord 1 at y = 0, 0.5 at y = 2; at eta 0.25 the chord is 0.875, at 0.75 it is 0.625."""
    found = hinge(written(tmp_path), "flap")
    skin = 0.06 + 0.5 * (0.01 - 0.06)  # at three quarters of the chord
    assert found == pytest.approx(np.array([[0.4375, 0.5, 0.0], [0.75 * 0.625, 1.5, 0.625 * skin]]))


@pytest.mark.parametrize(
    ("sweep", "dihedral", "along"), [(30, 0, (0.5, 0.75**0.5, 0)), (0, 30, (0, 0.75**0.5, 0.5)), (90, 45, (1, 0, 0))]
)
def test_positionings_are_lengths_with_sweep_and_dihedral(sweep, dihedral, along, tmp_path):
    inner = {"inner": "<hingeXsi>0</hingeXsi><hingeRelHeight>0.5</hingeRelHeight>"}
    path = written(
        tmp_path,
        sections=section(1) + section(2),
        positionings=positioning(1, 0.0) + positioning(2, 4.0, sweep, dihedral),
        **inner,
        outer=inner["inner"],
    )
    assert hinge(path, "flap") == pytest.approx(np.outer([1.0, 3.0], along), abs=1e-12)


def test_transformations_scale_turn_and_shift_in_this_order(tmp_path):
    """A wing upright: turned about x by 90 degrees, which takes y to z, and z to -y."""
    wing = transformation((2, 2, 2), (90, 0, 0), (5, 0, 1), "absGlobal")
    plain, turned = (hinge(written(tmp_path, wing=one), "flap") for one in (WING["wing"], wing))
    x, y, z = plain.T
    assert turned == pytest.approx(np.column_stack([2 * x + 5, -2 * z, 2 * y + 1]))
    euler = transformation(rotation=(10, 20, 30), kind="absGlobal")
    found = hinge(written(tmp_path, wing=euler), "flap")
    a, b, c = np.radians([10, 20, 30])
    rows = [
        [np.cos(b) * np.cos(c), -np.cos(b) * np.sin(c), np.sin(b)],
        [np.cos(a) * np.sin(c) + np.sin(a) * np.sin(b) * np.cos(c),
         np.cos(a) * np.cos(c) - np.sin(a) * np.sin(b) * np.sin(c), -np.sin(a) * np.cos(b)],
        [np.sin(a) * np.sin(c) - np.cos(a) * np.sin(b) * np.cos(c),
         np.sin(a) * np.cos(c) + np.cos(a) * np.sin(b) * np.sin(c), np.cos(a) * np.cos(b)],
    ]  # fmt: skip
    assert found == pytest.approx(plain @ np.array(rows).T)


def test_the_devices_are_listed(tmp_path):
    path = written(tmp_path)
    for uid in ("", "flaps", "wing"):
        with pytest.raises(KeyError, match="is no device with a hinge; there are: flap'"):
            hinge(path, uid)
    (tmp_path / "other.xml").write_text("not xml")
    for words, said in (
        [[path], "there are: flap"],
        [["none.xml"], "No such file"],
        [[tmp_path / "other.xml"], "syntax"],
    ):
        done = subprocess.run(
            [sys.executable, cpacs_hinge.__file__, *words], capture_output=True, text=True, check=False
        )
        assert (done.returncode, said in done.stderr, "Traceback" in done.stderr) == (1, True, False), done.stderr

"""The guide's example: a mesh of another mesher, end to end."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.meshing.formats.registry import format_of
from tests.docs.commands import ROOT

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def naca(tmp_path_factory):
    """Gmsh's NACA wing, coarse."""
    folder = tmp_path_factory.mktemp("naca")
    runpy.run_path(str(EXAMPLES / "naca_wing.py"))["build"](folder, fineness=0.7)
    return folder / "naca.msh"


def test_the_example_of_the_guide(naca, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["deflect_naca.py", str(naca)])
    runpy.run_path(str(EXAMPLES / "deflect_naca.py"))
    assert "FAILED" not in capsys.readouterr().out
    old, new = (format_of(path).read(path) for path in (naca, naca.with_stem("naca-15")))
    edge = np.setdiff1d(old.on("flap"), old.on("wing"))
    edge = edge[old.points[edge, 0] > 1.0 - 1e-9]
    turned = np.linalg.norm(new.points[edge] - old.points[edge], axis=1)
    assert turned.max() == pytest.approx(2.0 * 0.3 * np.sin(np.radians(7.5)), rel=0.01)


def test_the_python_of_the_first_page_runs_as_pasted_after_its_example(naca):
    text = (ROOT / "docs" / "own-mesh.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    subprocess.run([sys.executable, "-c", code], cwd=naca.parent, check=True)
    old, new = (format_of(path).read(path) for path in (naca.with_suffix(".su2"), naca.with_name("naca-10.cgns")))
    moved = new.points - old.points
    assert moved[np.abs(moved).max(axis=1).argmax(), 2] > 0.04


def test_a_positive_angle_is_trailing_edge_down_as_the_first_page_says(naca):
    """x aft, z up, the hinge's points in order of growing y."""
    sdm_deflect.deflect(
        naca, "flap", [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]], angle=5.0, motion="blended", fixed="wing",
        slide="symmetry:plane",
    ).save(naca.with_name("down.msh"))  # fmt: skip
    old, new = (format_of(path).read(path) for path in (naca, naca.with_name("down.msh")))
    moved = new.points - old.points
    assert moved[np.abs(moved).max(axis=1).argmax(), 2] < -0.02

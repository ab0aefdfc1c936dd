"""The guide's example: a mesh of another mesher, end to end."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing.formats.registry import format_of

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


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

"""Whoever changes a mesh of a finished run is noticed: a check of a name fails, or a sentence says what is wrong."""

import shutil

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.aircraft.run_folder import undeflected_models
from sdm_deflect.cases.errors import is_reported
from sdm_deflect.meshing.formats.vtu import read_vtu, write_vtu
from sdm_deflect.meshing.mesh.labelled import tets_of
from tests.cases.sdm.deflected_cad import rechecked
from tests.labelled import changed

pytestmark = pytest.mark.mesher


@pytest.fixture(scope="module")
def finished(finish):
    """A run and its folder."""
    return finish(case_named("aileron"), "aileron-bare")


@pytest.fixture(scope="module")
def judge(finished):
    """Validate a folder against CAD built once; return the names of the checks that fail, or what is said."""
    case = finished[0].case
    models = undeflected_models(case)

    def call(folder):
        try:
            checks = rechecked(folder, case, models)
        except (RuntimeError, ValueError) as error:
            if is_reported(error):
                return str(error)
            raise
        return [check.name for check in checks if not check.passed]

    return call


def moved(place):
    """Move a node of deflected.vtu: `place(before, after)` returns its number and where it goes."""

    def edit(folder):
        before, after = read_vtu(folder / "undeflected.vtu"), read_vtu(folder / "deflected.vtu")
        points = after.points.copy()
        node, at = place(before, after)
        points[node] = at
        write_vtu(folder / "deflected.vtu", after.with_points(points), {"displacement": points - before.points})

    return edit


def inverted(before, after):
    free = np.setdiff1d(np.flatnonzero((before.points != after.points).any(axis=1)), before.on(*before.names))[0]
    return free, after.points[free] + [0.0, 0.0, 0.05]


def outside(before, after):
    node = np.setdiff1d(np.flatnonzero((before.points == after.points).all(axis=1)), before.on(*before.names))[0]
    return node, np.nextafter(after.points[node], 9.0)


def fixed(before, after):
    node = before.on("fin")[0]
    return node, np.nextafter(after.points[node], 9.0)


def undone(before, after):
    return slice(None), before.points


def cells(change, *names):
    """Change the cells of files."""

    def edit(folder):
        for name in names:
            mesh = read_vtu(folder / name)
            write_vtu(folder / name, changed(mesh, tets=change(tets_of(mesh))))

    return edit


BOTH = ("undeflected.vtu", "deflected.vtu")
EDITS = {
    "inverted": (moved(inverted), "inverted_cells"),
    "an outside node by one bit": (moved(outside), "outside_moved"),
    "a wall node elsewhere by one bit": (moved(fixed), "outside_moved"),
    "not deflected": (moved(undone), "exact_to_cad"),
    "a tetrahedron less in both": (cells(lambda tets: tets[1:], *BOTH), "undeflected_mesh"),
    "another order": (cells(lambda tets: tets[::-1], BOTH[1]), "differ in tets"),
}


def test_an_unchanged_run_passes(finished, judge):
    assert judge(finished[1]) == []


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_noticed(finished, judge, tmp_path, name):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    edit, by = EDITS[name]
    edit(folder)
    assert by in judge(folder)


@pytest.mark.parametrize("name", ["case.toml", "metrics.json", "interpolant.npz", "convergence.csv", *BOTH])
def test_a_damaged_file_is_a_sentence(finished, judge, tmp_path, name):
    folder = shutil.copytree(finished[1], tmp_path / "run")
    data = (folder / name).read_bytes()
    for damage in (data[: len(data) // 2], b"junk"):
        (folder / name).write_bytes(damage)
        assert judge(folder)
    (folder / name).unlink()
    assert name in judge(folder)

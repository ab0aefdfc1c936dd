"""The deflected CAD built in a process of its own is the one built here."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.base.compiled import FOLDER_VARIABLE
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.cases.aircraft import reference as aircraft_reference
from sdm_deflect.cases.aircraft.case import SurfaceTurn
from sdm_deflect.cases.aircraft.reference import ReferenceFace, parameters, reference
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.quantity import CadError
from sdm_deflect.meshing.cache import cache_key
from tests.cases.sdm.deflected_cad import built


def test_both_processes_build_the_same_and_the_second_run_reads_it(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    case = case_named("aileron")
    with reference(case) as wait:
        found = wait()
    monkeypatch.setattr(aircraft_reference, "start", None)  # a second process would fail
    with reference(case) as wait:
        kept = wait()
    for which in ("undeflected", "deflected", "still"):
        mine, other, read = (getattr(one, which) for one in (built(case), found, kept))
        assert list(mine) == list(other) == list(read) == ["wing_left" if which == "still" else "aileron_left"]
        for faces in zip(*(one[next(iter(mine))] for one in (mine, other, read)), strict=True):
            for part in ReferenceFace.__slots__:
                for one in faces[1:]:
                    np.testing.assert_array_equal(getattr(faces[0], part), getattr(one, part))


def test_an_error_beside_kept_cad_is_passed_on_and_a_damaged_entry_is_built_again(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    case = case_named("tail")
    with reference(case) as wait:
        wait()
    with pytest.raises(MeshFileError, match="of another"), reference(case):
        raise MeshFileError("of another")
    (path,) = tmp_path.glob("cad-*.npz")
    path.write_bytes(path.read_bytes()[:-1])
    with reference(case) as wait:
        assert wait().undeflected.keys() == {"tail_left"}


def test_another_angle_is_built_again():
    case = case_named("aileron")
    other = replace(case, angle=-11.0)
    assert cache_key(parameters(case)) != cache_key(parameters(other))
    assert cache_key(parameters(case)) == cache_key(parameters(replace(case, scale="paper", repair="off")))


def test_planes_have_normals_out_of_the_body():
    (faces,) = built(case_named("tail")).undeflected.values()
    assert built(case_named("tail")).deflected.keys() == {"tail_left"}
    middle = np.vstack([face.points for face in faces]).mean(axis=0)
    for face in faces:
        corners = face.points[face.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (normals @ face.normal > 0.0).all()
        assert (face.points[0] - middle) @ face.normal > 0.0


def test_a_failure_says_what_failed():
    wrong = replace(case_named("tail"), deflections=(SurfaceTurn("nose"),))
    with reference(wrong) as wait, pytest.raises(CadError, match=r"the deflected CAD: .* no control surface 'nose'"):
        wait()

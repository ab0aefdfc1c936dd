"""The deflected CAD built in a process of its own is the one built here."""

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.case import SurfaceTurn
from sdm_deflect.cases.aircraft.reference import ReferenceFace, reference, variants
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.errors import CadError
from tests.cases.sdm.deflected_cad import built


def test_both_processes_build_the_same():
    case = case_named("aileron")
    with reference(case) as wait:
        found = wait()
    for mode in ("rigid", "blended"):
        mine, other = getattr(built(case), mode), getattr(found, mode)
        assert list(mine) == list(other) == ["aileron_left"]
        for one, two in zip(mine["aileron_left"], other["aileron_left"], strict=True):
            for part in ReferenceFace.__slots__:
                np.testing.assert_array_equal(getattr(one, part), getattr(two, part))
    tips = [np.vstack([face.points for face in faces["aileron_left"]]) for faces in (found.rigid, found.blended)]
    assert np.ptp(tips[0], axis=0) != pytest.approx(np.ptp(tips[1], axis=0), abs=1e-6)


def test_a_tail_is_built_once():
    assert len(variants(case_named("tail"))) == 1
    assert len(variants(case_named("all"))) == 2


def test_planes_have_normals_out_of_the_body():
    (faces,) = built(case_named("tail")).rigid.values()
    assert built(case_named("tail")).blended.keys() == {"tail_left"}
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

"""Mirrored surfaces: the new mesh is its own mirror image, to the bit, or mirrors the opposite deflection."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import HERE
from sdm_deflect.cases.api import deflect, plan, sweep
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.settings.job_settings import settings_of
from sdm_deflect.cases.settings.jobs import jobs_of
from sdm_deflect.deform.loop import run
from sdm_deflect.deform.volume.job import pose_of
from sdm_deflect.deform.volume.mirror import FLIP
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.deform.volume.submesh import submesh
from sdm_deflect.meshing.formats.registry import FORMATS, read
from tests.deform.blocks import two_bodies
from tests.deform.volume.test_submesh import in_pieces

HINGE = [[-1.0, 1.25, 0.0], [1.0, 1.25, 0.1]]
OPTIONS = {"mirror": "left", "margin": 0.4}


@pytest.fixture(scope="module")
def mesh():
    """Two bodies at y = 1.25 and -1.25 in a block whose lattice is symmetric to the bit."""
    mesh = two_bodies()
    x, y, z = mesh.points.T
    return mesh.with_points(np.column_stack([y, -x, z]) + 0.0)


@pytest.fixture(scope="module")
def image(mesh):
    """The mirror image (N,) of each node."""
    distance, row = cKDTree(mesh.points).query(mesh.points * FLIP)
    assert not distance.any()
    return row


def side(mesh):
    """Which of the two is at y > 0, and the other one."""
    names = ("left", "right")
    return names if mesh.points[mesh.on("left"), 1].mean() > 0.0 else names[::-1]


def turned(mesh, angle, sign=1, **more):
    one, other = side(mesh)
    return deflect(mesh, one, HINGE, angle, **{**OPTIONS, "mirror": other, "sign": sign, **more})


def test_equal_angles_give_a_symmetric_mesh(mesh, image):
    result = turned(mesh, 8.0)
    assert result.passed
    assert result.deflection.amounts == (8.0, 8.0)
    assert np.abs(result.displacement).max() > 0.05
    assert np.array_equal(result.points[image] * FLIP, result.points)
    both, other = result.sensitivity
    assert np.array_equal(both[image] * FLIP, other)


def test_opposite_angles_are_the_reflection_of_the_opposite_deflection(mesh, image):
    result, opposite = turned(mesh, 8.0, -1), turned(mesh, -8.0, -1)
    assert result.deflection.amounts == (8.0, -8.0)
    assert np.array_equal(opposite.points[image] * FLIP, result.points)
    assert not np.array_equal(result.points[image] * FLIP, result.points)


def test_a_sweep_and_rows_take_the_amounts_of_the_named_surface(mesh):
    one, other = side(mesh)
    found = sweep(mesh, one, HINGE, (-4.0, 6.0), mirror=other, sign=-1, margin=0.4)
    assert [result.deflection.amounts for result in found] == [(-4.0, 4.0), (6.0, -6.0)]
    assert all(result.passed for result in found)


def test_a_mesh_that_is_not_its_image_to_the_bit_is_fitted_and_said_to_be(mesh):
    one, other = side(mesh)
    points = mesh.points.copy()
    points[points[:, 1] < 0.0] *= 1.0 + 1e-12
    result = deflect(mesh.with_points(points), one, HINGE, 8.0, mirror=other, margin=0.4)
    assert result.passed
    assert any(f"{other} is fitted by itself" in note for note in result.notes)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_submesh_has_all_that_both_boxes_need(mesh, sign):
    one, other = side(mesh)
    jobs = jobs_of(settings_of(one, HINGE, 8.0, {"mirror": other, "sign": sign, "margin": 0.4}))
    part = submesh(in_pieces(mesh), jobs, (pose_of(jobs),), HERE)
    whole, found = (next(run(Plan.of(given, jobs))).deflection for given in (mesh, part))
    assert np.array_equal(found.points, whole.points[part.numbers(np.arange(len(part.points)))])
    assert found.quality == whole.quality


def test_a_report_repeats_a_mirrored_surface(mesh, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    FORMATS["su2"].write(mesh, tmp_path / "pair.su2")
    one, other = side(mesh)
    ends = [",".join(map(str, end)) for end in HINGE]
    words = ["--surface", one, "--mirror", other, "--sign", "-1", "--hinge", *ends, "--angle", "8", "--margin", "0.4"]
    common = ["deflect", "pair.su2", "-q", "--out"]
    assert cli([*common, "out.su2", *words], standalone_mode=False) == 0
    again = [*common, "again.su2", "--no-report", "--config", "out-report/settings.toml"]
    assert cli(again, standalone_mode=False) == 0
    assert np.array_equal(read("out.su2").points, read("again.su2").points)


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ({"sign": 0}, "sign is 1 for equal angles"),
        ({"shift": [0.0, 0.1, 0.0]}, "no table, track, shift or held nodes"),
        ({"margin": 1.0}, "the box crosses the plane y = 0"),
        ({"mirror": "nothing"}, "'nothing' is no patch"),
    ],
)
def test_what_has_no_reflection_is_one_sentence(mesh, more, complaint):
    with pytest.raises(InputError, match=complaint):
        turned(mesh, 8.0, **more)


def test_a_plan_of_a_mirrored_surface_is_refused(mesh):
    one, other = side(mesh)
    with pytest.raises(InputError, match="a plan holds no mirrored surface"):
        plan(mesh, one, HINGE, mirror=other, margin=0.4, range=(-8, 8))

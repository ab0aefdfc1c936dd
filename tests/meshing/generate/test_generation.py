"""Whole meshes: the box without the body, named faces, the area and volume of the CAD."""

import math
from dataclasses import replace

import numpy as np
import pymeshlab
import pytest

from sdm_deflect.cases.aircraft.cad import undeflected_cad
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.generate import generation
from sdm_deflect.meshing.generate.assembly import unit_normals
from sdm_deflect.meshing.generate.generation import Generated, generate, harder
from sdm_deflect.meshing.generate.parameters import FAR_FIELD, MeshParameters
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import signed_volumes


def test_the_flow_around_a_body_is_the_box_without_the_body(made: Generated, body: CadModel) -> None:
    mesh = made.mesh
    far = mesh.points[mesh.on(FAR_FIELD)]
    box = np.prod(far.max(axis=0) - far.min(axis=0))
    a, b, c = (mesh.points[skin(mesh).triangles[skin(mesh).face >= 0][:, i]] for i in range(3))
    inside = -np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert signed_volumes(mesh.points, tets_of(mesh)).sum() == pytest.approx(box - inside, rel=1e-9)
    assert inside == pytest.approx(body.solid.Volume(), rel=0.04)


def test_every_patch_carries_its_own_faces(made: Generated, body: CadModel) -> None:
    mesh = made.mesh
    assert mesh.names == (*body.patches, FAR_FIELD)
    for index, face in enumerate(body.faces):
        own = skin(mesh).triangles[skin(mesh).face == index]
        assert len(own)
        assert {mesh.names[i] for i in skin(mesh).patch[skin(mesh).face == index]} == {face.patch}
        inward = unit_normals(mesh.points, own)
        agreement = np.einsum("ij,ij->i", -inward, face.normal_at(mesh.points[own].mean(axis=1)))
        assert agreement.min() > (1.0 - 1e-9 if face.planar else 0.9)
        area = np.linalg.norm(np.cross(*np.diff(mesh.points[own], axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
        assert area == pytest.approx(face.area, rel=0.06)


def test_the_report_tells_how_it_went(made: Generated) -> None:
    report = made.report
    assert report.verification.failures == ()
    assert report.verification.boundary_to_cad_max < 1e-12
    assert report.attempts == len(report.rejected) + 1
    if not report.unseeded:  # else each run makes another mesh
        assert (len(made.mesh.points), len(tets_of(made.mesh)), report.attempts) == (1680, 7998, 1)
    assert report.seconds > 0.0
    assert report.peak_bytes > 1e7


@pytest.mark.nightly
def test_the_flow_inside_a_chamber_has_no_far_field(chamber: CadModel, coarse: MeshParameters) -> None:
    stages: list[tuple[str, float]] = []
    mesh = generate(chamber, coarse, lambda stage, done: stages.append((stage, done))).mesh
    assert mesh.names == ("chimera", "wing_right")
    assert (skin(mesh).face >= 0).all()
    volume = signed_volumes(mesh.points, tets_of(mesh)).sum()
    assert volume == pytest.approx(chamber.solid.Volume(), rel=1e-9)
    outward = unit_normals(mesh.points, skin(mesh).triangles)
    for index, face in enumerate(chamber.faces):
        centres = mesh.points[skin(mesh).triangles[skin(mesh).face == index]].mean(axis=1)
        assert np.einsum("ij,ij->i", outward[skin(mesh).face == index], face.normal_at(centres)).min() > 0.999
    assert stages[0] == ("surface mesh", 0.0)
    assert math.isnan(stages[1][1])


@pytest.mark.nightly
def test_a_mesh_that_fails_is_never_returned(
    body: CadModel, monkeypatch: pytest.MonkeyPatch, coarse: MeshParameters
) -> None:
    impossible = replace(coarse, accept_min=0.99, max_attempts=2)
    aims: list[float] = []
    fill = generation.fill

    def watched(surface, field, box, parameters):
        aims.append(parameters.aim)
        if len(aims) == 2:
            raise MeshingError("the mesher crashed")
        return fill(surface, field, box, parameters)

    monkeypatch.setattr(generation, "fill", watched)
    with pytest.raises(
        MeshingError, match=r"no usable mesh in 2 attempts: attempt 1: smallest mean ratio .* attempt 2: the mesher"
    ):
        generate(body, impossible)
    assert aims[1] > aims[0]


@pytest.mark.nightly
def test_refinements_halve_the_edges_and_stay_on_the_cad(body: CadModel, coarse: MeshParameters) -> None:
    once = generate(body, replace(coarse, refinements=1))
    assert len(tets_of(once.mesh)) % 8 == 0
    assert once.report.verification.failures == ()


def test_each_attempt_aims_higher_up_to_a_limit(coarse: MeshParameters) -> None:
    aims = [harder(coarse, attempt).aim for attempt in range(1, 20)]
    assert aims[0] == coarse.aim
    assert (np.diff(aims) >= 0.0).all()
    assert aims[-1] <= 0.5


FAR = "far_field"


def meshlab(mesh: Mesh, triangles: np.ndarray) -> pymeshlab.MeshSet:
    nodes, corners = np.unique(triangles, return_inverse=True)
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.points[nodes], corners.reshape(-1, 3)))
    return meshes


@pytest.mark.mesher
def test_body_and_far_field_are_closed_two_manifold_spheres(aileron_mesh):
    mesh = aileron_mesh[0]
    far = skin(mesh).patch == mesh.names.index(FAR)
    for triangles in (skin(mesh).triangles[far], skin(mesh).triangles[~far]):
        measures = meshlab(mesh, triangles).get_topological_measures()
        assert measures["is_mesh_two_manifold"]
        assert measures["boundary_edges"] == measures["number_holes"] == 0
        assert measures["connected_components_number"] == 1
        assert measures["genus"] == 0
        assert measures["unreferenced_vertices"] == 0


@pytest.mark.mesher
def test_the_body_has_the_area_and_volume_of_the_cad(aileron_mesh):
    mesh = aileron_mesh[0]
    body = skin(mesh).triangles[skin(mesh).patch != mesh.names.index(FAR)]
    measured = meshlab(mesh, body[:, ::-1]).get_geometric_measures()
    cad = undeflected_cad(case_named("aileron"))
    faces = [face.tessellation(1e-5) for face in cad.faces]
    corners = np.concatenate([points[triangles] for points, triangles in faces])
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    volume = abs(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    assert measured["surface_area"] == pytest.approx(area, rel=0.01)
    assert abs(measured["mesh_volume"]) == pytest.approx(volume, rel=0.01)

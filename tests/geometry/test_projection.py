"""Nearest points on the faces and edges of the model."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from OCP.BRep import BRep_Tool
from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
from OCP.gp import gp_Pnt

from sdm_deflect.geometry.projection import CylinderSurface, PlaneSurface, Segment

coordinate = st.floats(-1.0, 1.0)
point = st.tuples(coordinate, coordinate, coordinate).map(lambda p: np.array([p]))


@given(point, point)
def test_the_nearest_point_of_a_plane_is_nearer_than_any_other(far, other):
    normal = np.array([0.6, 0.0, 0.8])
    plane = PlaneSurface(np.array([0.1, 0.2, 0.3]), normal)
    near = plane.nearest(far)
    assert (near - plane.origin) @ normal == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(far - near) <= np.linalg.norm(far - plane.nearest(other)) + 1e-15


@given(point, point)
def test_the_nearest_point_of_a_cylinder_is_nearer_than_any_other(far, other):
    axis, origin = np.array([1.0, 0.0, 0.0]), np.array([0.0, 3.0, 0.0])
    cylinder = CylinderSurface(origin, axis, 0.5, 1.0)
    near = cylinder.nearest(far)
    assert np.linalg.norm((near - origin)[:, 1:], axis=1) == pytest.approx(0.5, abs=1e-14)
    assert np.linalg.norm(far - near) <= np.linalg.norm(far - cylinder.nearest(other)) + 1e-14


def test_a_point_on_a_cylinder_s_axis_is_refused():
    with pytest.raises(ValueError, match="axis of a cylinder"):
        CylinderSurface(np.zeros(3), np.array([1.0, 0.0, 0.0]), 1.0, 1.0).nearest(np.array([[2.0, 0.0, 0.0]]))


@given(point, st.floats(0.0, 1.0))
def test_the_nearest_point_of_a_segment_is_clamped_to_it(far, share):
    segment = Segment(np.array([0.1, 0.0, 0.0]), np.array([0.4, 0.4, 0.0]))
    near, distance = segment.nearest(far)
    assert 0.0 <= distance[0] <= 0.5
    assert segment.at(distance / 0.5) == pytest.approx(near, abs=1e-15)
    assert np.linalg.norm(far - near) <= np.linalg.norm(far - segment.at(np.array([share]))) + 1e-15


def test_projections_on_free_forms_are_at_least_as_near_as_the_kernel_s_own(plain_model, rng):
    free = [face for face in plain_model.faces if face.free_form]
    assert {face.patch for face in free} == {"fuselage", "canopy", "inlet"}
    for face in free:
        points = face.tessellation(1e-4)[0]
        points = points[rng.integers(0, len(points), 20)] + rng.normal(0.0, 3e-4, (20, 3))
        ours = np.linalg.norm(face.project(points) - points, axis=1)
        surface = BRep_Tool.Surface_s(face.shape.wrapped)
        kernel = [GeomAPI_ProjectPointOnSurf(gp_Pnt(*p), surface).LowerDistance() for p in points.tolist()]
        assert np.all(ours <= np.array(kernel) + 1e-12)


def test_faces_contain_their_own_tessellation(plain_model):
    for face in plain_model.faces:
        points = face.tessellation(1e-4)[0]
        assert np.abs(face.project(points) - points).max() < 2e-7
        if face.planar:
            assert np.abs(face.project(points) - points).max() < 1e-12


def test_normals_point_out_of_the_solid_as_the_triangles_do(plain_model):
    for face in plain_model.faces:
        points, triangles = face.tessellation(1e-3)
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1)
        large = length > 1e-3 * length.max()
        projected = np.sum(normals * face.normal_at(corners.mean(axis=1)), axis=1)
        assert (projected[large] / length[large]).min() > 0.5, face.patch


def test_edges_project_their_own_points_onto_themselves(plain_model):
    shares = np.linspace(0.0, 1.0, 6)
    for edge in plain_model.edges:
        points = edge.at(shares)
        near, parameters = edge.project(points)
        assert np.abs(near - points).max() < 1e-12
        assert np.all(np.diff(parameters) > 0.0)
        assert np.abs(points[[0, -1]] - plain_model.vertices[list(edge.vertices)]).max() < 1e-6


def test_edge_projections_are_nearer_than_dense_samples(plain_model, rng):
    curved = [edge for edge in plain_model.edges if "canopy" in [plain_model.faces[f].patch for f in edge.faces]]
    for edge in curved:
        points = edge.at(rng.random(10)) + rng.normal(0.0, 1e-3, (10, 3))
        near, _ = edge.project(points)
        samples = edge.at(np.linspace(0.0, 1.0, 400))
        sampled = np.linalg.norm(points[:, None] - samples, axis=2).min(axis=1)
        assert np.all(np.linalg.norm(near - points, axis=1) <= sampled + 1e-12)


def test_points_of_the_wrong_shape_are_refused(plain_model):
    with pytest.raises(ValueError, match=r"points have shape \(3,\), expected \(N, 3\)"):
        plain_model.faces[0].project(np.zeros(3))

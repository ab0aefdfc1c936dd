"""MeshLab, which made none of it, judges the boundary of a real mesh."""

import numpy as np
import pymeshlab
import pytest

from sdm_deflect.cases.cad import undeflected_cad
from sdm_deflect.cases.registry import case_named
from sdm_deflect.meshing.mesh import TetMesh

FAR = "far_field"


def meshlab(mesh: TetMesh, triangles: np.ndarray) -> pymeshlab.MeshSet:
    nodes, corners = np.unique(triangles, return_inverse=True)
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.points[nodes], corners.reshape(-1, 3)))
    return meshes


@pytest.mark.mesher
def test_body_and_far_field_are_closed_two_manifold_spheres(aileron_mesh):
    mesh = aileron_mesh[0]
    far = mesh.patch == mesh.names.index(FAR)
    for triangles in (mesh.triangles[far], mesh.triangles[~far]):
        measures = meshlab(mesh, triangles).get_topological_measures()
        assert measures["is_mesh_two_manifold"]
        assert measures["boundary_edges"] == measures["number_holes"] == 0
        assert measures["connected_components_number"] == 1
        assert measures["genus"] == 0
        assert measures["unreferenced_vertices"] == 0


@pytest.mark.mesher
def test_the_body_has_the_area_and_volume_of_the_cad(aileron_mesh):
    mesh = aileron_mesh[0]
    body = mesh.triangles[mesh.patch != mesh.names.index(FAR)]
    measured = meshlab(mesh, body[:, ::-1]).get_geometric_measures()
    cad = undeflected_cad(case_named("aileron"))
    faces = [face.tessellation(1e-5) for face in cad.faces]
    corners = np.concatenate([points[triangles] for points, triangles in faces])
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    volume = abs(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    assert measured["surface_area"] == pytest.approx(area, rel=0.01)
    assert abs(measured["mesh_volume"]) == pytest.approx(volume, rel=0.01)

"""Edges of faces of any shape: lengths, areas, and where two faces meet at an angle."""

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Polygons
from sdm_deflect.meshing.mesh.edges import area_vectors, edges_of, median_edge, polygons_of, sharp_edges


def test_area_vectors_edges_and_lengths_of_mixed_faces():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1]], dtype=float)
    quad, triangle = Cells("quad", np.array([[0, 1, 2, 3]])), Cells("triangle", np.array([[0, 1, 3]]))
    faces = polygons_of((quad, Polygons(np.array([1, 4, 5, 2]), np.array([0, 4])), triangle))
    np.testing.assert_allclose(area_vectors(points, faces), [[0, 0, 1], [-1, 0, 0], [0, 0, 0.5]])
    edges, face = edges_of(faces)
    assert edges.tolist()[:4] == [[0, 1], [1, 2], [2, 3], [3, 0]]
    assert face.tolist() == [0] * 4 + [1] * 4 + [2] * 3
    assert median_edge(points, [triangle]) == 1.0
    assert np.isnan(median_edge(points, []))
    bent = polygons_of((Cells("quad", np.array([[0, 1, 2, 3], [1, 4, 5, 2]])),))
    assert sharp_edges(points, bent, 40.0).tolist() == [[1, 2]]
    assert len(sharp_edges(points, bent, 100.0)) == 0


def test_faces_that_walk_along_their_edge_the_same_way_meet_at_the_same_angle():
    """Whichever way the second face is numbered, the two turn by a right angle, or not at all."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1], [2, 0, 0], [2, 1, 0]], float)
    for up in ([1, 4, 5, 2], [2, 5, 4, 1]):
        faces = polygons_of((Cells("quad", np.array([[0, 1, 2, 3], up])),))
        assert sharp_edges(points, faces, 89.0).tolist() == [[1, 2]]
        assert not len(sharp_edges(points, faces, 91.0))
    for ahead in ([1, 6, 7, 2], [2, 7, 6, 1]):
        assert not len(sharp_edges(points, polygons_of((Cells("quad", np.array([[0, 1, 2, 3], ahead])),)), 1.0))

"""The interpolation with all boundary nodes puts them where they shall be."""

import numpy as np

from benchmarks.foam_motion import GivenBoundary
from benchmarks.peers_motion import all_boundary_nodes


def test_boundary_nodes_go_where_they_shall(hybrid_wing, tmp_path):
    mesh, moving = hybrid_wing.mesh, hybrid_wing.mesh.names[0]
    nodes = mesh.patch(moving).nodes
    given = GivenBoundary(tmp_path, mesh, moving, np.full((len(nodes), 3), 1e-3), ())
    moved = all_boundary_nodes(given).points
    others = np.setdiff1d(mesh.on(*mesh.names), nodes)
    np.testing.assert_allclose(moved[nodes], mesh.points[nodes] + 1e-3)
    np.testing.assert_array_equal(moved[others], mesh.points[others])
    inner = np.setdiff1d(np.arange(len(mesh.points)), mesh.on(*mesh.names))
    assert 0.0 < np.abs(moved[inner] - mesh.points[inner]).max() < 1e-2

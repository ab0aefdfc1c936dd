"""The meshes that the format tests start from are what they claim to be."""

from collections import Counter

import pytest

from tests.meshing.formats.examples import grid, hybrid


def outward_faces(mesh) -> Counter:
    """Faces of all cells, as VTK orients them, that no second cell has."""
    faces = Counter()
    whole = grid(mesh)
    for i in range(whole.n_cells):
        faces.update(turned(face.point_ids) for face in whole.get_cell(i).faces)
    return Counter({face: n for face, n in faces.items() if turned(reversed(face)) not in faces})


def turned(nodes) -> tuple[int, ...]:
    """The same corners, the smallest first."""
    nodes = list(nodes)
    first = nodes.index(min(nodes))
    return tuple(int(n) for n in nodes[first:] + nodes[:first])


def test_every_cell_has_a_positive_volume_and_jacobian():
    whole = grid(hybrid())
    assert whole.compute_cell_sizes()["Volume"].min() > 0.1
    assert whole.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.2


def test_patches_cover_the_boundary_once_with_normals_out_of_the_flow():
    mesh = hybrid()
    given = Counter(turned(row) for patch in mesh.patches for faces in patch.faces for row in faces.nodes)
    assert given == outward_faces(mesh)


@pytest.mark.parametrize("zones", [1, 2, 3])
def test_zones_have_points_of_their_own(zones):
    mesh = hybrid(zones)
    assert [(zone.start, zone.stop) for zone in mesh.zones] == [(14 * i, 14 * i + 14) for i in range(zones)]
    assert len(mesh.patches) == 6 * zones

from dataclasses import replace

import numpy as np
import pytest

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.generate.attachment import attach, snap
from sdm_deflect.meshing.generate.generation import Generated
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.generate.verify import EXACT, verify
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.labelled import changed


def failures(mesh: Mesh, body: CadModel, coarse: MeshParameters) -> str:
    return "; ".join(verify(mesh, body, coarse).failures)


def moved(mesh: Mesh, node: int, step: np.ndarray) -> Mesh:
    points = mesh.points.copy()
    points[node] += step
    return mesh.with_points(points)


def body_attachment(mesh: Mesh, body: CadModel):
    own = skin(mesh).face >= 0
    return attach(mesh.points, skin(mesh).triangles[own], skin(mesh).face[own], body)


def test_a_good_mesh_has_no_failures(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    assert failures(made.mesh, body, coarse) == ""


def test_worst_cells_are_where_they_are_said_to_be(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    checked = verify(made.mesh, body, coarse)
    assert set(checked.worst) == set(made.mesh.names)
    assert min(worst.quality for worst in checked.worst.values()) >= checked.quality.min


@pytest.mark.parametrize("kind", ["face", "edge", "vertex"])
def test_a_node_off_the_cad_is_noticed(made: Generated, body: CadModel, kind: str, coarse: MeshParameters) -> None:
    attachment = body_attachment(made.mesh, body)
    node = attachment.nodes[getattr(attachment, kind) >= 0][0]
    assert failures(moved(made.mesh, node, np.array([3.0, 2.0, 1.0]) * EXACT), body, coarse)
    assert failures(moved(made.mesh, node, np.full(3, 1e-3 * EXACT)), body, coarse) == ""


def test_a_turned_cell_is_noticed(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    tets = tets_of(made.mesh).copy()
    tets[0, :2] = tets[0, 1::-1]
    assert "1 cells are inverted" in failures(changed(made.mesh, tets=tets), body, coarse)


def test_triangles_under_a_wrong_face_are_noticed(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    mesh = made.mesh
    face = skin(mesh).face.copy()
    edge = next(edge for edge in body.edges if edge.faces[0] != edge.faces[1])
    face[np.flatnonzero(face == edge.faces[0])[0]] = edge.faces[1]
    assert "m off CAD face" in failures(changed(mesh, face=face), body, coarse)
    unknown = next(
        (a, b)
        for a in range(len(body.faces))
        for b in range(len(body.faces))
        if a != b and not any({a, b} == set(edge.faces) for edge in body.edges)
    )
    face = np.where(skin(mesh).face == unknown[0], unknown[1], skin(mesh).face)
    assert f"no boundary triangle is on CAD face {unknown[0]}" in failures(changed(mesh, face=face), body, coarse)


def test_nodes_that_swap_places_along_an_edge_are_noticed(
    made: Generated, body: CadModel, coarse: MeshParameters
) -> None:
    attachment = body_attachment(made.mesh, body)
    index = np.bincount(attachment.edge[attachment.edge >= 0]).argmax()
    first, second = attachment.nodes[attachment.edge == index][:2]
    points = made.mesh.points.copy()
    points[[first, second]] = points[[second, first]]
    noticed = failures(made.mesh.with_points(points), body, coarse)
    assert "folded over others" in noticed or "cross others" in noticed


def test_a_near_far_field_is_noticed(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    demanding = replace(coarse, far_field=2.0)
    assert "the far field is only" in "; ".join(verify(made.mesh, body, demanding).failures)
    assert made.report.verification.far_distance >= 0.5


def test_quality_limits_are_those_of_the_parameters(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    strict = replace(coarse, accept_min=0.9, accept_mean=0.95, accept_below=0.0)
    found = "; ".join(verify(made.mesh, body, strict).failures)
    assert "smallest mean ratio" in found
    assert "average mean ratio" in found
    assert "below mean ratio 0.4" in found


def test_snapping_undoes_what_moves_nodes_off_the_cad(made: Generated, body: CadModel, coarse: MeshParameters) -> None:
    mesh = made.mesh
    own = mesh.on(*mesh.names[:-1])
    noise = np.zeros_like(mesh.points)
    noise[own] = 1e-4 * (np.random.default_rng(0).random((len(own), 3)) - 0.5)
    shaken = mesh.with_points(mesh.points + noise)
    assert failures(shaken, body, coarse)
    restored = shaken.with_points(snap(shaken.points, body_attachment(shaken, body), body))
    assert failures(restored, body, coarse) == ""

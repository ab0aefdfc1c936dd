"""MeshLab judges boundaries: each fault that is planted in a good one is named."""

import re
from functools import partial

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.cad import undeflected_cad
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.generate import meshlab, meshlab_worker
from sdm_deflect.meshing.generate.attachment import attach
from sdm_deflect.meshing.generate.meshlab import DEFLECTION, meshlab_failures, surface_failures
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.labelled import changed

NO_CAD = {
    "cad_points": np.empty((0, 3)),
    "cad_triangles": np.empty((0, 3), dtype=np.intp),
    "cad_face": np.empty(0, dtype=np.intp),
}


def faults(mesh: Mesh) -> str:
    face = np.zeros(len(skin(mesh).triangles), dtype=np.intp)
    question = {"points": mesh.points, "triangles": skin(mesh).triangles, "face": face, **NO_CAD}
    return "; ".join(surface_failures(mesh, meshlab_worker.judge(question)))


def with_triangles(mesh: Mesh, triangles: np.ndarray) -> Mesh:
    labels = np.ones(len(triangles), dtype=np.intp)
    return changed(mesh, triangles=triangles, patch=labels, face=labels)


def without_one(mesh):
    return changed(mesh, triangles=skin(mesh).triangles[1:], patch=skin(mesh).patch[1:], face=skin(mesh).face[1:])


def flipped(mesh):
    return changed(mesh, triangles=np.vstack([skin(mesh).triangles[:1, ::-1], skin(mesh).triangles[1:]]))


def inside_out(mesh):
    return changed(mesh, triangles=skin(mesh).triangles[:, ::-1])


def doubled(mesh):
    return with_triangles(mesh, np.vstack([skin(mesh).triangles, skin(mesh).triangles[:1]]))


def pushed_through(mesh):
    """The middle of one side goes out through the opposite one."""
    points = mesh.points.copy()
    points[np.argmin(np.linalg.norm(points - [0.0, 1 / 3, 1 / 3], axis=1))] = [1.2, 0.4, 0.45]
    return mesh.with_points(points)


def touching(mesh):
    """Two tetrahedra that share a node."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)
    tets = np.array([[0, 1, 2, 3], [0, 5, 4, 6]])
    sides = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    triangles = tets[:, sides].reshape(-1, 3)
    labels = np.ones(len(triangles), dtype=np.intp)
    return changed(mesh, points=points, tets=tets, triangles=triangles, patch=labels, face=labels)


def cell_less(mesh):
    return changed(mesh, tets=tets_of(mesh)[1:])


def test_a_cube_is_closed_oriented_and_crosses_nothing(cube: Mesh) -> None:
    assert faults(cube) == ""


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (without_one, "the boundary is not closed: 3 edges have one triangle"),
        (flipped, "boundary triangles are turned against their neighbours"),
        (inside_out, r"the boundary encloses -1 m\^3, the cells fill 1 m\^3"),
        (doubled, "boundary triangles are at edges that more than two share"),
        (pushed_through, "boundary triangles cross others, the first at"),
        (touching, "the boundary touches itself at 1 nodes"),
        (cell_less, r"the boundary encloses 1 m\^3, the cells fill 0.99"),
    ],
)
def test_what_is_wrong_with_a_surface_is_named(cube: Mesh, change, fault: str) -> None:
    assert re.search(fault, faults(change(cube)))


def test_neighbours_in_a_plane_cross_nothing_however_they_lie() -> None:
    """MeshLab takes some for crossing in one orientation."""
    rng = np.random.default_rng(3)
    n = 60
    flat = np.stack(np.meshgrid(*[np.arange(n + 1.0)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    flat += rng.uniform(-0.2, 0.2, flat.shape)
    points = np.column_stack([flat, flat @ [0.3, 0.7]])
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, n + 1, 1], corner[:, None] + [1, n + 1, n + 2]])
    assert len(meshlab_worker.crossing(points, triangles, np.zeros(len(triangles), dtype=bool))) == 0


def test_meshlab_that_fails_is_a_fault(made, body, monkeypatch) -> None:
    def fails(*_):
        raise MeshingError("sdm_deflect.meshing.generate.meshlab_worker ended with code -11: no message")

    monkeypatch.setattr(child, "call", fails)
    (fault,) = meshlab_failures(made.mesh, body)
    assert fault.startswith("MeshLab cannot judge the boundary: ")
    assert fault.endswith("code -11: no message")


@pytest.fixture(scope="module")
def judge(make_mesh):
    """Judge the mesh of a case after a change of it, in this process, with the CAD built once."""
    cads, parts, triangulated = {}, {}, meshlab.triangulate

    def call(name, change=lambda mesh, cad: mesh):
        mesh, _ = make_mesh(case_named(name))
        if name not in cads:
            cads[name] = undeflected_cad(case_named(name))
            parts[id(cads[name])] = triangulated(cads[name])
        return "; ".join(meshlab_failures(change(mesh, cads[name]), cads[name]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "call", lambda module, question, seconds: meshlab_worker.judge(question))
        patch.setattr(meshlab, "triangulate", lambda model: parts[id(model)])
        yield call


def node_off(step, mesh, cad):
    points = mesh.points.copy()
    points[mesh.on("wing_left")[7]] += [0.0, 0.0, step]
    return mesh.with_points(points)


def other_face(mesh, cad):
    face = skin(mesh).face.copy()
    edge = next(edge for edge in cad.edges if edge.faces[0] != edge.faces[1])
    face[np.flatnonzero(face == edge.faces[0])[0]] = edge.faces[1]
    return changed(mesh, face=face)


def no_face(mesh, cad):
    return changed(mesh, face=np.where(skin(mesh).face == 0, 1, skin(mesh).face))


def swapped(mesh, cad):
    """Two neighbours on a CAD edge in each other's place."""
    own = skin(mesh).face >= 0
    attachment = attach(mesh.points, skin(mesh).triangles[own], skin(mesh).face[own], cad)
    index = np.bincount(attachment.edge[attachment.edge >= 0]).argmax()
    nodes = attachment.nodes[attachment.edge == index]
    _, parameter = cad.edges[index].project(mesh.points[nodes])
    pair = nodes[np.argsort(parameter)][:2]
    points = mesh.points.copy()
    points[pair] = points[pair[::-1]]
    return mesh.with_points(points)


@pytest.mark.mesher
@pytest.mark.parametrize("name", ["aileron", "aileron-chimera"])
def test_kept_meshes_have_a_sound_boundary(judge, name: str) -> None:
    assert judge(name) == ""


@pytest.mark.mesher
@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda mesh, cad: without_one(mesh), "the boundary is not closed"),
        (lambda mesh, cad: flipped(mesh), "turned against their neighbours"),
        (swapped, "folded over others|cross others"),
        (partial(node_off, 5.0 * DEFLECTION), "m off CAD face .* of wing_left, which they belong to"),
        (other_face, "m off CAD face"),
        (no_face, "no boundary triangle is on CAD face 0"),
    ],
)
def test_what_is_wrong_with_a_real_boundary_is_named(judge, change, fault: str) -> None:
    assert re.search(fault, judge("aileron-chimera", change))

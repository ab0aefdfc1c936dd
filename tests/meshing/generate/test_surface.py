import numpy as np
import pytest

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.generate import volume
from sdm_deflect.meshing.generate.attachment import TRIANGLE_EDGES, encode
from sdm_deflect.meshing.generate.sizing import background, size_field
from sdm_deflect.meshing.generate.volume import InputSurface, mesh_surface


@pytest.fixture(scope="module")
def sizes(body: CadModel):
    field = size_field(body.vertices, np.full(len(body.vertices), 0.03), 0.3, 0.1)
    return background(field, body.vertices.min(axis=0) - 0.1, body.vertices.max(axis=0) + 0.1)


@pytest.fixture(scope="module")
def meshed(body: CadModel, sizes) -> InputSurface:
    return mesh_surface(body, sizes)


def test_the_outer_surface_is_closed_and_conforming(meshed: InputSurface) -> None:
    directed = meshed.outer[:, TRIANGLE_EDGES].reshape(-1, 2)
    forward, backward = np.sort(encode(directed)), np.sort(encode(directed[:, ::-1]))
    assert np.array_equal(forward, backward)
    assert (np.diff(forward) > 0).all()


def test_it_encloses_the_solid_and_points_outward(meshed: InputSurface, body: CadModel) -> None:
    a, b, c = (meshed.points[meshed.outer[:, i]] for i in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(body.solid.Volume(), rel=0.05)
    assert set(meshed.face) == set(range(len(body.faces)))


def test_its_nodes_lie_on_the_cad_and_its_edges_follow_the_sizes(meshed: InputSurface, body: CadModel, sizes) -> None:
    for index, face in enumerate(body.faces):
        nodes = meshed.points[np.unique(meshed.outer[meshed.face == index])]
        assert np.linalg.norm(face.project(nodes) - nodes, axis=1).max() < 1e-7
    ends = meshed.points[meshed.outer[:, [0, 1]]]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert 0.02 < np.median(lengths) < 0.06


def test_mixed_up_faces_are_noticed(body: CadModel, sizes, monkeypatch: pytest.MonkeyPatch) -> None:
    call = child.call

    def shuffled(module, question, seconds):
        answer = call(module, question, seconds)
        return answer | {"face": (answer["face"] + 1) % len(body.faces)}

    def short(module, question, seconds):
        answer = call(module, question, seconds)
        return answer | {"areas": answer["areas"][:-1]}

    monkeypatch.setattr(volume.child, "call", shuffled)
    with pytest.raises(MeshingError, match="m off the CAD face on"):
        mesh_surface(body, sizes)
    monkeypatch.setattr(volume.child, "call", short)
    with pytest.raises(MeshingError, match="gmsh found 8 faces in a CAD model of 9"):
        mesh_surface(body, sizes)

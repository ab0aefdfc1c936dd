"""Verification of a finished mesh against the CAD, independent of all steps before."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.numbers import percent
from sdm_deflect.meshing.mesh.labelled import FREE_FORM, skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import Quality, mean_ratio, summarise

from .attachment import Attachment, attach, boundary_failures
from .meshlab import meshlab_failures
from .parameters import MeshParameters

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel

# Largest allowed distance in metres.
EXACT = 1e-7


@dataclass(frozen=True, slots=True)
class WorstCell:
    """The smallest mean ratio of the cells that touch a patch, and the place (metres) of that cell."""

    quality: float
    place: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Exactness:
    """Largest distances (metres) of boundary nodes, freshly projected, from the CAD.

    Attributes
    ----------
    exact, edge, free_form : from planes and cylinders, from CAD edges, from all other faces
    matched_vertices : how many CAD vertices have a node on them
    """

    exact: float
    edge: float
    free_form: float
    matched_vertices: int

    def failures(self) -> list[str]:
        """Return a sentence for each limit that is exceeded."""
        limits = (
            ("planes and cylinders", self.exact, EXACT),
            ("CAD edges", self.edge, EXACT),
            ("free-form faces", self.free_form, FREE_FORM),
        )
        return [f"boundary nodes are up to {value:.1e} m off {what}" for what, value, limit in limits if value > limit]


@dataclass(frozen=True, slots=True)
class Verification:
    """Figures of a mesh, and what is wrong with it.

    Attributes
    ----------
    quality : summary of the mean ratio
    worst : the worst cell that touches each patch
    exactness : how far boundary nodes are from the CAD
    far_distance : smallest distance in metres from the body's bounding box to the far field; inf if there is none
    failures : one sentence for each violated requirement; empty for a usable mesh
    """

    quality: Quality
    worst: dict[str, WorstCell]
    exactness: Exactness
    far_distance: float
    failures: tuple[str, ...]

    @property
    def boundary_to_cad_max(self) -> float:
        """Largest distance in metres of any boundary node from the CAD."""
        return max(self.exactness.exact, self.exactness.edge, self.exactness.free_form)


def verify(mesh: Mesh, model: "CadModel", parameters: MeshParameters) -> Verification:
    """Check quality, boundary, far field, and how exactly the boundary follows the CAD."""
    quality = mean_ratio(mesh.points, tets_of(mesh))
    summary = summarise(quality)
    boundary = skin(mesh)
    body = boundary.face >= 0
    triangles, face = boundary.triangles[body], boundary.face[body]
    attachment = attach(mesh.points, triangles, face, model)
    measured = exactness(mesh.points, attachment, model)
    far_distance = _far_distance(mesh)
    failures = [
        *_quality_failures(summary, parameters),
        *boundary_failures(mesh),
        *measured.failures(),
        *meshlab_failures(mesh, model),
    ]
    if len(attachment.lost):
        failures.append(f"{len(attachment.lost)} nodes touch faces that share no CAD edge")
    unmatched = len(model.vertices) - measured.matched_vertices
    if unmatched:
        failures.append(f"{unmatched} CAD vertices have no node")
    length = float(np.ptp(mesh.points[triangles].reshape(-1, 3), axis=0).max())
    if far_distance < parameters.far_field * length:
        failures.append(f"the far field is only {far_distance:.3f} m away from the body")
    return Verification(summary, _worst(mesh, quality), measured, far_distance, tuple(failures))


def _far_distance(mesh: Mesh) -> float:
    """Return the distance between the bounding boxes of the body and of the nearest far-field triangle."""
    triangles, _, face = skin(mesh)
    body, far = mesh.points[triangles[face >= 0]].reshape(-1, 3), mesh.points[triangles[face < 0]]
    if not len(far):
        return np.inf
    apart = np.maximum(body.min(axis=0) - far.max(axis=1), far.min(axis=1) - body.max(axis=0))
    return float(np.linalg.norm(np.maximum(apart, 0.0), axis=1).min())


def _worst(mesh: Mesh, quality: FloatArray) -> dict[str, WorstCell]:
    """Return the worst cell that touches each patch, from mean ratios (M,)."""
    order = np.argsort(-quality, kind="stable")
    worst_cell = np.zeros(len(mesh.points), dtype=np.intp)
    worst_cell[tets_of(mesh)[order]] = order[:, None]
    worst = {}
    for name in mesh.names:
        cells = worst_cell[mesh.on(name)]
        if len(cells):
            cell = cells[np.argmin(quality[cells])]
            x, y, z = mesh.points[tets_of(mesh)[cell]].mean(axis=0)
            worst[name] = WorstCell(float(quality[cell]), (float(x), float(y), float(z)))
    return worst


def _quality_failures(summary: Quality, parameters: MeshParameters) -> Iterator[str]:
    if summary.inverted:
        yield f"{summary.inverted} cells are inverted"
    if summary.min < parameters.accept_min:
        yield f"smallest mean ratio {summary.min:.3f} is below {parameters.accept_min:g}"
    if summary.mean < parameters.accept_mean:
        yield f"average mean ratio {summary.mean:.3f} is below {parameters.accept_mean:g}"
    if summary.below_0_4 >= parameters.accept_below:
        yield f"{percent(summary.below_0_4, 3)} of the cells are below mean ratio 0.4"


def exactness(points: FloatArray, attachment: Attachment, model: "CadModel") -> Exactness:
    """Measure all boundary nodes of points (N, 3)."""
    edge, away = 0.0, {True: 0.0, False: 0.0}
    for index, face in enumerate(model.faces):
        nodes = points[attachment.incidence[attachment.incidence[:, 1] == index, 0]]
        away[face.free_form] = max(away[face.free_form], _largest(face.project(nodes) - nodes))
    for index in np.unique(attachment.edge[attachment.edge >= 0]):
        nodes = points[attachment.nodes[attachment.edge == index]]
        edge = max(edge, _largest(model.edges[index].project(nodes)[0] - nodes))
    on_vertex = attachment.vertex >= 0
    apart = points[attachment.nodes[on_vertex]] - model.vertices[attachment.vertex[on_vertex]]
    matched = int(np.count_nonzero(np.linalg.norm(apart, axis=1) <= EXACT))
    return Exactness(away[False], edge, away[True], matched)


def _largest(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))

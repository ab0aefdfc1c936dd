"""Whether a mesh is fit for use: checked on the finished mesh against the CAD, trusting no step before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.attachment import attach
from sdm_deflect.meshing.boundary import boundary_failures
from sdm_deflect.meshing.chains import broken_chains
from sdm_deflect.meshing.exactness import exactness
from sdm_deflect.meshing.mesh import FloatArray, TetMesh
from sdm_deflect.meshing.parameters import MeshParameters
from sdm_deflect.meshing.quality import QualitySummary, mean_ratio, summarise


@dataclass(frozen=True, slots=True)
class Worst:
    """The smallest mean ratio of cells that touch a patch, and where (metres) that cell is."""

    quality: float
    place: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Verification:
    """Figures of a mesh, and what is wrong with it.

    Parameters
    ----------
    quality
        Summary of the mean ratio.
    worst
        The worst cell that touches each patch.
    exact_distance, edge_distance, free_form_distance
        Largest distance in metres of a boundary node from its planes and cylinders, from its CAD edge, from
        its other CAD faces.
    clean_edges, edges
        CAD edges that are one clean chain of mesh edges, and all of them.
    matched_vertices, vertices
        CAD vertices with a node on them, and all of them.
    far_distance
        Smallest distance in metres from the body's bounding box to the far field; inf if there is none.
    failures
        One sentence for each violated requirement; empty for a usable mesh.
    """

    quality: QualitySummary
    worst: dict[str, Worst]
    exact_distance: float
    edge_distance: float
    free_form_distance: float
    clean_edges: int
    edges: int
    matched_vertices: int
    vertices: int
    far_distance: float
    failures: tuple[str, ...]

    @property
    def boundary_to_cad_max(self) -> float:
        """Largest distance in metres of any boundary node from the CAD."""
        return max(self.exact_distance, self.edge_distance, self.free_form_distance)


def verify(mesh: TetMesh, model: CadModel, parameters: MeshParameters) -> Verification:
    """Check quality, boundary, far field, and how exactly the boundary follows the CAD."""
    quality = mean_ratio(mesh.points, mesh.tets)
    summary = summarise(quality)
    body = mesh.face >= 0
    triangles, face = mesh.triangles[body], mesh.face[body]
    attachment = attach(mesh.points, triangles, face, model)
    broken = broken_chains(mesh.points, triangles, face, attachment, model)
    measured = exactness(mesh.points, attachment, model)
    far_distance = _far_distance(mesh)
    failures = [
        *_quality_failures(summary, parameters),
        *boundary_failures(mesh),
        *measured.failures(),
        *(_place(index, model) + problem for index, problem in broken.items()),
    ]
    if len(attachment.lost):
        failures.append(f"{len(attachment.lost)} nodes touch faces that share no CAD edge")
    unmatched = len(model.vertices) - measured.matched_vertices
    if unmatched:
        failures.append(f"{unmatched} CAD vertices have no node")
    length = float(np.ptp(mesh.points[triangles].reshape(-1, 3), axis=0).max())
    if far_distance < parameters.far_field * length:
        failures.append(f"the far field is only {far_distance:.3f} m away from the body")
    return Verification(
        quality=summary,
        worst=_worst(mesh, quality),
        exact_distance=measured.exact,
        edge_distance=measured.edge,
        free_form_distance=measured.free_form,
        clean_edges=len(model.edges) - sum(index >= 0 for index in broken),
        edges=len(model.edges),
        matched_vertices=measured.matched_vertices,
        vertices=len(model.vertices),
        far_distance=far_distance,
        failures=tuple(failures),
    )


def _far_distance(mesh: TetMesh) -> float:
    """Distance between the bounding boxes of the body and of the far-field triangle next to it."""
    body = mesh.points[mesh.triangles[mesh.face >= 0]].reshape(-1, 3)
    far = mesh.points[mesh.triangles[mesh.face < 0]]
    if not len(far):
        return np.inf
    apart = np.maximum(body.min(axis=0) - far.max(axis=1), far.min(axis=1) - body.max(axis=0))
    return float(np.linalg.norm(np.maximum(apart, 0.0), axis=1).min())


def _worst(mesh: TetMesh, quality: FloatArray) -> dict[str, Worst]:
    order = np.argsort(-quality, kind="stable")
    worst_cell = np.zeros(len(mesh.points), dtype=np.intp)
    worst_cell[mesh.tets[order]] = order[:, None]
    found = {}
    for name in mesh.names[1:]:
        cells = worst_cell[mesh.on(name)]
        if len(cells):
            cell = cells[np.argmin(quality[cells])]
            x, y, z = mesh.points[mesh.tets[cell]].mean(axis=0)
            found[name] = Worst(float(quality[cell]), (float(x), float(y), float(z)))
    return found


def _quality_failures(summary: QualitySummary, parameters: MeshParameters) -> list[str]:
    failures = []
    if summary.inverted:
        failures.append(f"{summary.inverted} cells are inverted")
    if summary.min < parameters.accept_min:
        failures.append(f"smallest mean ratio {summary.min:.3f} is below {parameters.accept_min:g}")
    if summary.mean < parameters.accept_mean:
        failures.append(f"average mean ratio {summary.mean:.3f} is below {parameters.accept_mean:g}")
    if summary.below_0_4 >= parameters.accept_below:
        failures.append(f"{summary.below_0_4:.3%} of the cells are below mean ratio 0.4")
    return failures


def _place(index: int, model: CadModel) -> str:
    """Name the CAD edge that a message goes on to judge."""
    if index < 0:
        return ""
    patches = sorted({model.faces[i].patch for i in model.edges[index].faces})
    return f"the CAD edge {index} of {' and '.join(patches)} "

"""How exactly boundary nodes lie on what they belong to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.attachment import Attachment
from sdm_deflect.meshing.mesh import FloatArray

# Largest allowed distance in metres.
EXACT = 1e-7
FREE_FORM = 1e-5


@dataclass(frozen=True, slots=True)
class Exactness:
    """Largest distances (metres) of boundary nodes, freshly projected, from the CAD.

    Parameters
    ----------
    exact, edge, free_form
        From planes and cylinders, from CAD edges, from all other faces.
    matched_vertices
        How many CAD vertices have a node on them.
    """

    exact: float
    edge: float
    free_form: float
    matched_vertices: int

    def failures(self) -> list[str]:
        """One sentence for each limit that is exceeded."""
        limits = (
            ("planes and cylinders", self.exact, EXACT),
            ("CAD edges", self.edge, EXACT),
            ("free-form faces", self.free_form, FREE_FORM),
        )
        return [f"boundary nodes are up to {value:.1e} m off {what}" for what, value, limit in limits if value > limit]


def exactness(points: FloatArray, attachment: Attachment, model: CadModel) -> Exactness:
    """Measure all boundary nodes of points (N, 3)."""
    exact, edge, free_form = 0.0, 0.0, 0.0
    for index, face in enumerate(model.faces):
        nodes = points[attachment.incidence[attachment.incidence[:, 1] == index, 0]]
        away = _largest(face.project(nodes) - nodes)
        if face.free_form:
            free_form = max(free_form, away)
        else:
            exact = max(exact, away)
    for index in np.unique(attachment.edge[attachment.edge >= 0]):
        nodes = points[attachment.nodes[attachment.edge == index]]
        edge = max(edge, _largest(model.edges[index].project(nodes)[0] - nodes))
    on_vertex = attachment.vertex >= 0
    apart = points[attachment.nodes[on_vertex]] - model.vertices[attachment.vertex[on_vertex]]
    matched = int(np.count_nonzero(np.linalg.norm(apart, axis=1) <= EXACT))
    return Exactness(exact, edge, free_form, matched)


def _largest(vectors: FloatArray) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))

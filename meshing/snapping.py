"""Boundary nodes onto the exact CAD."""

from __future__ import annotations

import numpy as np

from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.attachment import Attachment
from sdm_deflect.meshing.mesh import FloatArray


def snapped(points: FloatArray, attachment: Attachment, model: CadModel) -> FloatArray:
    """Points (N, 3) with each attached node moved to the nearest point of its CAD vertex, edge or face."""
    moved = points.copy()
    on_vertex = attachment.vertex >= 0
    moved[attachment.nodes[on_vertex]] = model.vertices[attachment.vertex[on_vertex]]
    for index in np.unique(attachment.edge[attachment.edge >= 0]):
        nodes = attachment.nodes[attachment.edge == index]
        moved[nodes] = model.edges[index].project(points[nodes])[0]
    for index in np.unique(attachment.face[attachment.face >= 0]):
        nodes = attachment.nodes[attachment.face == index]
        moved[nodes] = model.faces[index].project(points[nodes])
    return moved

"""Plane meshes made by hand: a plate of triangles or quads, with a slit whose lower lip is a flap."""

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh


def plate(count: int = 24, shape: str = "quad", z: float = 0.0) -> Mesh:
    """A square of side 2 around a square hole of side 0.5 in its middle; patches ``hole``, ``bottom`` and ``rest``."""
    x = np.linspace(-1.0, 1.0, count + 1)
    points = np.array([(a, b, z) for b in x for a in x])
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(count), np.arange(count)))
    first = j * (count + 1) + i
    quads = np.column_stack([first, first + 1, first + count + 2, first + count + 1])
    middles = points[quads].mean(axis=1)
    quads = quads[np.abs(middles[:, :2]).max(axis=1) > 0.25]
    nodes, rows = np.unique(quads, return_inverse=True)
    points, quads = points[nodes], rows.reshape(-1, 4)
    lines = np.concatenate([quads[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))])
    _, kept, times = np.unique(np.sort(lines, axis=1), axis=0, return_index=True, return_counts=True)
    lines = lines[np.sort(kept[times == 1])]
    middle = points[lines].mean(axis=1)
    far = np.abs(middle[:, :2]).max(axis=1)
    parts = {"hole": far < 0.5, "bottom": (middle[:, 1] < -0.99), "rest": (far > 0.5) & (middle[:, 1] >= -0.99)}
    patches = tuple(Patch(name, (Cells("line", lines[own]),)) for name, own in parts.items())
    if shape == "triangle":
        quads = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(points, (Cells(shape, quads),), patches, name="plate")

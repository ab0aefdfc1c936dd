"""Small meshes of several cell types, made by hand."""

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh, Patch, Zone

POINTS = np.array(
    [
        *[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        *[[2, 0, 0], [2, 1, 0], [2, 0, 1], [2, 1, 1], [0, 0.5, 1.5], [1, 0.5, 1.5]],
    ],
    dtype=np.float64,
)
"""A hexahedron (0 to 7), a box beside it of a pyramid and four tetrahedra (8 to 11), a roof of a wedge (12, 13)."""
CELLS = {
    "hexahedron": [[0, 1, 2, 3, 4, 5, 6, 7]],
    "pyramid": [[1, 2, 6, 5, 8]],
    "tetra": [[6, 2, 11, 8], [11, 2, 9, 8], [10, 5, 11, 8], [11, 5, 6, 8]],
    "wedge": [[4, 12, 7, 5, 13, 6]],
}
PATCHES = {
    "floor": {"quad": [[0, 3, 2, 1]], "triangle": [[1, 2, 8], [2, 9, 8]]},
    "inlet": {"quad": [[0, 4, 7, 3]], "triangle": [[4, 12, 7]]},
    "outlet": {"triangle": [[8, 9, 11], [8, 11, 10]]},
    "left wall": {"quad": [[0, 1, 5, 4]], "triangle": [[1, 8, 5], [8, 10, 5]]},
    "right wall": {"quad": [[3, 7, 6, 2]], "triangle": [[2, 6, 11], [2, 11, 9]]},
    "roof": {"quad": [[4, 5, 13, 12], [7, 12, 13, 6]], "triangle": [[5, 6, 13], [5, 10, 11], [5, 11, 6]]},
}


def hybrid(zones: int = 1) -> Mesh:
    """A hexahedron, a pyramid, four tetrahedra and a wedge with shared faces, in six patches.

    Every cell has a positive volume by VTK's order of nodes, every boundary face is on one patch and its normal
    points out of the flow. Coordinates are irrational, so that a round trip of all 17 digits is a test. With
    several zones, copies stand side by side, each with points of its own; patches after the first copy are named
    ``"floor 2"`` and so on.
    """
    wobble = np.sin(np.arange(POINTS.size).reshape(POINTS.shape)) * np.pi / 100.0
    points = [POINTS + wobble + [0.0, 3.0 * i, 0.0] for i in range(zones)]
    cells = tuple(_cells(CELLS, 14 * i) for i in range(zones))
    patches = tuple(
        Patch(name if i == 0 else f"{name} {i + 1}", _cells(faces, 14 * i))
        for i in range(zones)
        for name, faces in PATCHES.items()
    )
    parts = tuple(Zone(f"block {i + 1}", 14 * i, 14 * (i + 1)) for i in range(zones)) if zones > 1 else ()
    return Mesh(np.vstack(points), tuple(block for zone in cells for block in zone), patches, parts)


def _cells(blocks: dict[str, list[list[int]]], first: int) -> tuple[Cells, ...]:
    return tuple(Cells(shape, np.array(nodes, dtype=np.intp) + first) for shape, nodes in blocks.items())

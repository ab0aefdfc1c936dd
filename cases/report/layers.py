"""Parts of a picture, taken from a mesh."""

from collections.abc import Iterable

import numpy as np

from sdm_deflect.cases.motion import BoolArray, FloatArray, IndexArray
from sdm_deflect.cases.report.colours import MAGENTA, patch_colour, quality_rgb
from sdm_deflect.cases.report.scene import Colour, Layer, dots, plain
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.quality import mean_ratio

TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
BOX_EDGES = np.array([[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit])
"""Edges of a hexahedron whose corner i has the binary code zyx."""
EDGE: Colour = (40, 40, 40)


def patches(mesh: TetMesh, names: Iterable[str], colour: Colour | None = None, **looks: object) -> tuple[Layer, ...]:
    """Return the surface meshes of patches, in one colour or in those of their components."""
    return tuple(
        plain(mesh.points, mesh.triangles_of(name), colour or patch_colour(name), **looks) for name in names
    )


def shell(tets: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return the triangles (F, 3) that bound a set of tetrahedra (M, 4), and the row (F,) of each one's cell."""
    faces = tets[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    return faces[outer], outer // 4


def cells_by_quality(mesh: TetMesh, chosen: BoolArray, **looks: object) -> Layer:
    """Return the outside of the chosen (M,) cells, coloured by their mean ratio."""
    tets = mesh.tets[chosen]
    triangles, cell = shell(tets)
    rgb = quality_rgb(mean_ratio(mesh.points, tets)[cell])
    return Layer(mesh.points, triangles, rgb, **{"edge": EDGE, "ambient": 0.85, **looks})  # type: ignore[arg-type]


def centroids(mesh: TetMesh) -> FloatArray:
    """Return the centroids (M, 3) of the cells."""
    return np.asarray(mesh.points[mesh.tets].mean(axis=1))


def box(corners: FloatArray, width: float = 3.0) -> Layer:
    """Return the edges of a hexahedron (8, 3)."""
    return plain(corners, BOX_EDGES, MAGENTA, width=width)


def sites(points: FloatArray, colour: Colour, size: float = 4.0) -> Layer:
    """Return data sites (P, 3) as dots."""
    return dots(points, colour, size)

"""Meshes of hexahedra made by hand."""

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh


def grid(low, high, counts):
    """Points (N, 3) of a grid, and the hexahedra between them."""
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape([n + 1 for n in counts])
    nx, ny, nz = counts
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = np.stack([index[i : i + nx, j : j + ny, k : k + nz] for i, j, k in corners], axis=-1)
    return points, cells.reshape(-1, 8)


FACES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
SIDES = {"x-": (0, 0), "x+": (0, 1), "y-": (1, 0), "y+": (1, 1), "z-": (2, 0), "z+": (2, 1)}


def block_with_body(n=8):
    """The cube (-2, 2)**3 around a body, the cube (-.5, .5)**3: patches ``body`` and the sides ``x-`` to ``z+``."""
    points, cells = grid([-2, -2, -2], [2, 2, 2], [n, n, n])
    middle = points[cells].mean(axis=1)
    cells = cells[(np.abs(middle) > 0.5).any(axis=1)]
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = points[used], cells.reshape(-1, 8)
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[first[count == 1]]
    centre = points[faces].mean(axis=1)
    patches = [Patch("body", (Cells("quad", faces[(np.abs(centre) < 1.0).all(axis=1)]),))]
    for name, (axis, upper) in SIDES.items():
        on = np.abs(centre[:, axis] - (2.0 if upper else -2.0)) < 1e-9
        patches.append(Patch(name, (Cells("quad", faces[on]),)))
    return Mesh(points, (Cells("hexahedron", cells),), tuple(patches))


def joined(one, other, names=("near", "far")):
    """Two meshes as zones of one; patches of the second get an apostrophe."""
    n = len(one.points)

    def moved(faces):
        return tuple(Cells(f.shape, f.nodes + n) for f in faces)

    patches = (*one.patches, *(Patch(p.name + "'", moved(p.faces)) for p in other.patches))
    zones = (Zone(names[0], 0, n), Zone(names[1], n, n + len(other.points)))
    return Mesh(np.vstack([one.points, other.points]), (*one.cells, *moved(other.cells)), patches, zones)


def annulus_with_fin():
    """A quarter annulus, radii 1 to 3, with a fin on the inner cylinder: ``body``; ``round`` (r = 1); ``rest``."""
    points, cells = grid([1.0, 0.2, -1.0], [3.0, 1.4, 1.0], [8, 12, 10])
    r, phi, z = points.T
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    middle = np.column_stack([r, phi, z])[cells].mean(axis=1)
    inside = (middle[:, 0] < 1.5) & (np.abs(middle[:, 1] - 0.8) < 0.1) & (np.abs(middle[:, 2]) < 0.4)
    used, cells = np.unique(cells[~inside], return_inverse=True)
    points, cells = points[used], cells.reshape(-1, 8)
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[first[count == 1]]
    radius = np.linalg.norm(points[:, :2], axis=1)[faces]
    angle, height = np.arctan2(points[:, 1], points[:, 0])[faces], points[:, 2][faces]
    on_round = (np.abs(radius - 1.0) < 1e-9).all(axis=1)
    outer = np.zeros(len(faces), dtype=bool)
    for values, low, high in ((radius, None, 3.0), (angle, 0.2, 1.4), (height, -1.0, 1.0)):
        for end in (low, high):
            if end is not None:
                outer |= (np.abs(values - end) < 1e-9).all(axis=1)
    body = ~on_round & ~outer
    parts = {"body": body, "round": on_round, "rest": outer}
    patches = tuple(Patch(name, (Cells("quad", faces[own]),)) for name, own in parts.items())
    return Mesh(points, (Cells("hexahedron", cells),), patches)


def two_bodies():
    """Two thin plates, ``left`` and ``right``, in a channel with the sides ``wall``."""
    points, cells = grid([-4, -1.5, -2], [4, 1.5, 2], [32, 12, 20])
    x, y, z = np.abs(points[cells].mean(axis=1)).T
    body = (np.abs(x - 1.25) < 0.5) & (y < 0.5) & (z < 0.2)
    used, cells = np.unique(cells[~body], return_inverse=True)
    points, cells = points[used], cells.reshape(-1, 8)
    faces = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[first[count == 1]]
    centre = points[faces].mean(axis=1)
    inner = (np.abs(centre) < [3.0, 1.0, 1.0]).all(axis=1)
    parts = {"left": inner & (centre[:, 0] < 0), "right": inner & (centre[:, 0] > 0), "wall": ~inner}
    patches = tuple(Patch(name, (Cells("quad", faces[own]),)) for name, own in parts.items())
    return Mesh(points, (Cells("hexahedron", cells),), patches)

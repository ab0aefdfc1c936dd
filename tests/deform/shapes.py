"""The block around a body in cells of each shape."""

from itertools import permutations

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.faces import FACE_SHAPES, FACES
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import SIDES, block_with_body
from tests.meshing.formats.examples import polyhedral
from tests.meshing.repair.meshes import CORNER

HALVES = [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]
SHAPES = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")


def body_in(shape, n=8):
    """``block_with_body`` in cells of one shape; the polyhedra have faces of six corners."""
    block = block_with_body(n)
    (hexahedra,) = (cells.nodes for cells in block.cells)
    if shape == "polyhedron":
        return bricks(block)
    if shape == "hexahedron":
        return block
    if shape == "pyramid":
        tips = len(block.points) + np.arange(len(hexahedra))[:, None]
        sides = [hexahedra[:, list(face)[::-1]] for face in FACES["hexahedron"]]
        points = np.vstack([block.points, block.points[hexahedra].mean(axis=1)])
        return named(points, Cells(shape, np.vstack([np.hstack([side, tips]) for side in sides])))
    if shape == "wedge":
        parts = [hexahedra[:, half][:, [0, 2, 1, 3, 5, 4]] for half in HALVES]
        return named(block.points, Cells(shape, np.vstack(parts)))
    steps = [np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(p)]], axis=0) for p in permutations(range(3))]
    tets = np.vstack([hexahedra[:, [CORNER[tuple(at)] for at in path.tolist()]] for path in steps])
    a, b, c, d = (block.points[tets[:, k]] for k in range(4))
    left = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    tets[left] = tets[left][:, [0, 2, 1, 3]]
    return named(block.points, Cells(shape, tets))


def named(points, cells):
    """A mesh whose boundary is divided into ``body`` and the sides ``x-`` to ``z+`` by the places of its faces."""
    faces = {}
    for face in FACES[cells.shape]:
        faces.setdefault(FACE_SHAPES[len(face)], []).append(cells.nodes[:, list(face)])
    blocks = {name: [] for name in ("body", *SIDES)}
    for shape, rows in faces.items():
        every = np.vstack(rows)
        _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
        outer = every[first[count == 1]]
        centre = points[outer].mean(axis=1)
        marks = {"body": (np.abs(centre) < 1.0).all(axis=1)}
        marks |= {name: np.abs(centre[:, axis] - (4 * upper - 2)) < 1e-9 for name, (axis, upper) in SIDES.items()}
        for name, mark in marks.items():
            blocks[name] += [Cells(shape, outer[mark])] if mark.any() else []
    return Mesh(points, (cells,), tuple(Patch(name, tuple(parts)) for name, parts in blocks.items()))


def bricks(block):
    """Hexahedra joined in pairs along x, shifted by one from row to row: most of their faces along z are hexagons."""
    mesh = polyhedral(block)
    (cells,) = mesh.cells
    step = np.unique(np.round(block.points[:, 0], 9))
    place = np.searchsorted(step, block.points[block.cells[0].nodes].min(axis=1) + 1e-6) - 1
    place[:, 0] = (place[:, 0] + place[:, 1] % 2) // 2
    _, brick = np.unique(place, axis=0, return_inverse=True)
    brick = _apart(brick.ravel(), cells)
    rows = np.split(cells.faces.nodes, cells.faces.offsets[1:-1])
    label = np.full(len(rows), -1)
    for i, patch in enumerate(block.patches):
        mine = {frozenset(row) for faces in patch.faces for row in faces.nodes.tolist()}
        label[[frozenset(row.tolist()) in mine for row in rows]] = i
    groups = {}
    for i, row in enumerate(rows):
        own, other = brick[cells.owner[i]], brick[cells.neighbour[i]] if i < len(cells.neighbour) else -1
        if own != other:
            swap = -1 < other < own
            key = (min(own, other) if other >= 0 else own, max(own, other) if other >= 0 else -1, label[i])
            flat = int(np.argmin(np.ptp(block.points[row], axis=0)))
            groups.setdefault((*key, flat), []).append(row[::-1].tolist() if swap else row.tolist())
    faces = [(key, face) for key, parts in groups.items() for face in _joined(parts)]
    inner = [one for one in faces if one[0][1] >= 0]
    ordered = [*inner, *(one for i in range(len(block.patches)) for one in faces if one[0][1] < 0 and one[0][2] == i)]
    polygons = Polygons(
        np.array([node for _, face in ordered for node in face]), np.cumsum([0, *(len(face) for _, face in ordered)])
    )
    owner, neighbour = np.array([key[0] for key, _ in ordered]), np.array([key[1] for key, _ in inner])
    marks = np.array([key[2] for key, _ in ordered])
    patches = []
    for i, patch in enumerate(block.patches):
        own = np.flatnonzero((marks == i) & (np.arange(len(ordered)) >= len(inner)))
        patches.append(Patch(patch.name, (polygons.rows(own[0], own[-1] + 1),)))
    used, nodes = np.unique(polygons.nodes, return_inverse=True)
    back = np.zeros(len(block.points), dtype=np.intp)
    back[used] = np.arange(len(used))
    patches = [Patch(p.name, tuple(Polygons(back[f.nodes], f.offsets) for f in p.faces)) for p in patches]
    whole = Polyhedra(Polygons(nodes.ravel(), polygons.offsets), owner, neighbour)
    return Mesh(block.points[used], (whole,), tuple(patches))


def _apart(brick, cells):
    """Pairs that the body divides are two cells."""
    pairs = {tuple(sorted(pair)) for pair in zip(cells.owner[: len(cells.neighbour)], cells.neighbour, strict=True)}
    found = brick.copy()
    for one in range(brick.max() + 1):
        own = np.flatnonzero(brick == one)
        if len(own) == 2 and tuple(own) not in pairs:
            found[own[1]] = found.max() + 1
    return found


def _joined(parts):
    """Faces between the same two cells, as one where two of them share an edge."""
    if len(parts) != 2:
        return parts
    one, other = parts
    ends = {(b, a) for a, b in zip(other, other[1:] + other[:1], strict=True)}
    common = [(a, b) for a, b in zip(one, one[1:] + one[:1], strict=True) if (a, b) in ends]
    if len(common) != 1:
        return parts
    (a, b), i = common[0], one.index(common[0][1])
    j = other.index(common[0][0])
    assert one[i - 1] == a
    assert other[j - 1] == b
    return [[*one[i:], *one[:i], *other[j + 1 :], *other[: j - 1]][: len(one) + len(other) - 2]]

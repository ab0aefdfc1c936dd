"""A half wing with a flap in a hybrid mesh: hexahedra and prisms in layers, pyramids and tetrahedra farther out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

TIP, END, RADIUS = 1.0, 1.8, 3.0
RINGS, CUT = 10, 2
FLAP = ("flap_upper", "flap_lower", "flap_base")
HEXAHEDRON = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
# Faces of each cell in VTK's order of nodes, normals out of the cell.
FACES = {
    "hexahedron": HEXAHEDRON.tolist(),
    "wedge": [[0, 1, 2], [3, 5, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]],
    "pyramid": [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
    "tetra": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
}


@dataclass(frozen=True, slots=True, eq=False)
class Wing:
    """The mesh and what a test wants to know of it.

    Parameters
    ----------
    mesh
        Chord 1, thickness 0.12, span 1 from y = 0; patches ``wing_upper``, ``wing_lower``, ``wing_base`` (the blunt
        trailing edge), ``wing_tip``, `FLAP`, ``symmetry`` (y = 0) and ``far_field``; normals out of the flow.
    hinge
        (2, 3) ends of the hinge line, inside the wing.
    columns
        (K, L + 1) nodes from each wall node outwards, through all layers; column 0 is on the wall.
    first_height
        Distance of ``columns[:, 1]`` from ``columns[:, 0]``.
    """

    mesh: Mesh
    hinge: FloatArray
    columns: IntArray
    first_height: float


def wing(
    flap: tuple[float, float] = (0.3, 0.7),
    hinge: float = 0.7,
    first_height: float = 1e-3,
    layers: int = 8,
    cells: int = 7,
) -> Wing:
    """Return a wing whose flap spans y = flap[0] to flap[1] behind x = hinge.

    Every cross section is an O-grid: layers that grow by 1.3, then rings of hexahedra out to a cylinder. Below the
    wing they are cut into prisms; the outermost `CUT` rings into pyramids, where they meet a quadrilateral, and
    tetrahedra. Beyond the tip the section itself is filled. `cells` is the number of cells along the flap's chord;
    7 gives 40,000 cells in all, 3 about 12,000.
    """
    section = _section(hinge, cells)
    span = _span(flap, cells)
    points = _points(section, span, first_height, layers)
    grid = np.arange(points[..., 0].size).reshape(points.shape[:3])
    blocks, corners = _volume(grid, span, points.reshape(-1, 3))
    wall = grid[0][:, span <= TIP + 1e-9].ravel()
    mesh = Mesh(corners, blocks, _patches(corners, blocks, wall, flap, hinge))
    ends = np.array([[hinge, flap[0], 0.0], [hinge, flap[1], 0.0]])
    columns = grid[: layers + 1][:, :, span <= TIP + 1e-9].reshape(layers + 1, -1).T
    return Wing(mesh, ends, columns, first_height)


def _section(hinge: float, cells: int) -> FloatArray:
    """Points (2 C - 1, 2) from the upper trailing edge over the nose to the lower trailing edge."""
    behind = np.linspace(1.0, hinge, cells + 1)
    ahead = hinge * (1.0 - np.cos(np.linspace(np.pi / 2.0, 0.0, 2 * cells + 1)))[1:]
    x = np.concatenate([behind, ahead])
    powers = np.stack([np.sqrt(x), x, x**2, x**3, x**4])
    z = 0.6 * np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1015]) @ powers + 0.006 * x
    return np.concatenate([np.column_stack([x, z]), np.column_stack([x, -z])[-2::-1]])


def _span(flap: tuple[float, float], cells: int) -> FloatArray:
    stops = np.unique([0.0, *flap, TIP])
    pieces = [np.linspace(a, b, round(2 * cells * (b - a)) + 2)[:-1] for a, b in pairwise(stops)]
    return np.concatenate([*pieces, TIP + (END - TIP) * np.linspace(0.0, 1.0, cells) ** 1.5])


def _points(section: FloatArray, span: FloatArray, first: float, layers: int) -> FloatArray:
    """Points (ring, station round the section, station along the span, 3)."""
    edge = np.roll(section, -1, axis=0) - section
    normal = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.linalg.norm(edge, axis=1)[:, None]
    normal = normal + np.roll(normal, 1, axis=0)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = first * np.concatenate([[0.0], np.cumsum(1.3 ** np.arange(layers))])
    near = section + height[:, None, None] * normal
    half = (len(section) + 1) / 2
    angle = np.pi * (np.arange(len(section)) + 0.5) / (half - 0.5)
    outer = np.column_stack([0.5 + RADIUS * np.cos(angle), RADIUS * np.sin(angle)])
    growth = (RADIUS / (2.0 * height[-1] - height[-2])) ** (1.0 / RINGS)
    fraction = (growth ** np.arange(1, RINGS + 1) - 1.0) / (growth**RINGS - 1.0)
    far = near[-1] + fraction[:, None, None] * (outer - near[-1])
    plane = np.concatenate([near, far])[:, :, None, :]
    y = np.broadcast_to(span[None, None, :], (*plane.shape[:2], len(span)))
    return np.stack([np.broadcast_to(plane[..., 0], y.shape), y, np.broadcast_to(plane[..., 1], y.shape)], axis=-1)


def _volume(grid: IntArray, span: FloatArray, points: FloatArray) -> tuple[tuple[Cells, ...], FloatArray]:
    """Cells of each shape, and the points with the centres of the cells that were cut."""
    stations = grid.shape[1]
    ahead = np.roll(grid, -1, axis=1)
    base = np.stack([grid[:, :, :-1], grid[:, :, 1:], ahead[:, :, 1:], ahead[:, :, :-1]], axis=-1)
    boxes = np.concatenate([base[:-1], base[1:]], axis=-1)
    below = np.zeros(boxes.shape[1:3], dtype=bool)
    below[stations // 2 : -1] = span[1:] <= TIP + 1e-9
    bricks, prisms = _beyond_tip(grid, span)
    outer, where = boxes[-CUT:].reshape(-1, 8), np.broadcast_to(below, (CUT, *below.shape)).copy()
    where[1:] = True  # the faces of the second ring towards the first are cut, as below the wing
    pyramids, tets = _cut(outer, where.ravel(), len(points))
    cells = (
        Cells("hexahedron", np.concatenate([boxes[:-CUT, ~below].reshape(-1, 8), bricks])),
        Cells("wedge", np.concatenate([_halves(boxes[:-CUT, below].reshape(-1, 8)), prisms])),
        Cells("pyramid", pyramids),
        Cells("tetra", tets),
    )
    return cells, np.concatenate([points, points[outer].mean(axis=1)])


def _diagonal(quads: IntArray) -> IntArray:
    """Cut quadrilaterals (K, 4) through their smallest node into triangles (K, 2, 3) of the same normal."""
    turn = (np.argmin(quads, axis=1)[:, None] + np.arange(4)) % 4
    a, b, c, d = np.take_along_axis(quads, turn, axis=1).T
    return np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=1)


def _halves(boxes: IntArray) -> IntArray:
    """Two prisms (2 K, 6) of each hexahedron; their triangles are on its first and last four nodes."""
    inner, outer = _diagonal(boxes[:, :4]), _diagonal(boxes[:, 4:])
    return np.concatenate([inner, outer], axis=-1)[..., [0, 2, 1, 3, 5, 4]].reshape(-1, 6)


def _beyond_tip(grid: IntArray, span: FloatArray) -> tuple[IntArray, IntArray]:
    """Hexahedra and prisms that go on where the wing ends, between its upper and lower surface."""
    ring = grid[0][:, span >= TIP - 1e-9]
    nose = len(ring) // 2
    upper, lower = ring[:nose], ring[:nose:-1]
    face = np.stack([upper[:-1], upper[1:], lower[1:], lower[:-1]], axis=-1)
    bricks = np.concatenate([face[:, :-1], face[:, 1:]], axis=-1)[..., [3, 2, 1, 0, 7, 6, 5, 4]]
    tip = np.stack([upper[-1], ring[nose], lower[-1]], axis=-1)
    prisms = np.concatenate([tip[:-1], tip[1:]], axis=-1)
    return bricks.reshape(-1, 8), prisms


def _cut(boxes: IntArray, cut_inside: IntArray, first: int) -> tuple[IntArray, IntArray]:
    """Pyramids and tetrahedra from the centre of each hexahedron to its faces.

    `cut_inside` tells which have triangles on their first face; all other faces are cut. Centres are the nodes
    from `first` on.
    """
    centre = first + np.arange(len(boxes))
    inward = boxes[:, HEXAHEDRON[:, ::-1]]
    whole = np.zeros(inward.shape[:2], dtype=bool)
    whole[~cut_inside, 0] = True
    apex = np.broadcast_to(centre[:, None], whole.shape)
    triangles = _diagonal(inward[~whole]).reshape(-1, 3)
    tets = np.column_stack([triangles, np.repeat(apex[~whole], 2)])
    return np.column_stack([inward[whole], apex[whole]]), tets


def boundary_faces(cells: tuple[Cells, ...]) -> dict[str, IntArray]:
    """Triangles (K, 3) and quadrilaterals (K, 4) of one cell only, normals out of it."""
    found = {}
    for shape, corners in (("triangle", 3), ("quad", 4)):
        faces = [block.nodes[:, face] for block in cells for face in FACES[block.shape] if len(face) == corners]
        if not faces:
            continue
        rows = np.concatenate(faces)
        _, first, count = np.unique(np.sort(rows, axis=1), axis=0, return_index=True, return_counts=True)
        found[shape] = rows[first[count == 1]]
    return found


def _patches(
    points: FloatArray, cells: tuple[Cells, ...], wall: IntArray, flap: tuple[float, float], hinge: float
) -> tuple[Patch, ...]:
    faces = boundary_faces(cells)
    labels = {shape: _labels(points, rows, wall, flap, hinge) for shape, rows in faces.items()}
    names = ("wing_upper", "wing_lower", "wing_base", "wing_tip", *FLAP, "symmetry", "far_field")
    return tuple(
        Patch(name, tuple(Cells(s, rows[labels[s] == name]) for s, rows in faces.items() if (labels[s] == name).any()))
        for name in names
    )


def _labels(points: FloatArray, rows: IntArray, wall: IntArray, flap: tuple[float, float], hinge: float) -> np.ndarray:
    x, y, z = points[rows].mean(axis=1).T
    part = np.where((flap[0] < y) & (y < flap[1]) & (x > hinge), "flap", "wing")
    side = np.where(x > 1.0 - 1e-9, "base", np.where(z > 0.0, "upper", "lower"))
    on_wall = np.isin(rows, wall).all(axis=1)
    on_wall_name = np.where(np.abs(y - TIP) < 1e-9, "wing_tip", np.char.add(np.char.add(part, "_"), side))
    elsewhere = np.where(np.abs(y) < 1e-9, "symmetry", "far_field")
    return np.where(on_wall, on_wall_name, elsewhere)

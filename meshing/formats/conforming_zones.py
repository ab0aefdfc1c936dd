"""Zones that fit together point by point, joined to one mesh with one point at each place.

Structured grids have collapsed hexahedra and quads at singular lines and points: around an axis, at a wing tip, at a
sharp edge. These become the wedges, pyramids, tetrahedra and triangles that they are.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import permutations, product
from typing import TypeVar

import numpy as np

from sdm_deflect.base.arrays import BoolArray, IntArray, distinct
from sdm_deflect.meshing.mesh.cells import Cells, Constraint, Faces, Patch, Polygons, Polyhedra, Volume, Zone
from sdm_deflect.meshing.mesh.faces import cell_face_keys, face_keys, node_keys
from sdm_deflect.meshing.mesh.mesh import Mesh

from .shapes import chosen, places
from .zones import common_constraints, renumber

Block = TypeVar("Block", Cells | Polygons, Cells | Polyhedra)
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
EDGES = {
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
# A shape, pairs of corners of a hexahedron that are one point in it, and those that are its corners in VTK's order.
FORMS = (
    ("wedge", ((0, 1), (4, 5)), (0, 3, 2, 4, 7, 6)),
    ("pyramid", ((4, 5), (4, 6), (4, 7)), (0, 1, 2, 3, 4)),
    ("tetra", ((2, 3), (4, 5), (4, 6), (4, 7)), (0, 1, 2, 4)),
)


def _turns() -> IntArray:
    """Return the 24 orders of a hexahedron's corners by rotations."""
    turns = []
    for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.zeros((3, 3), dtype=np.intp)
        turn[range(3), axes] = signs
        if np.linalg.det(turn) > 0:
            moved = (2 * CORNERS - 1) @ turn
            turns.append([int(np.argmin(np.abs(2 * CORNERS - 1 - corner).sum(axis=1))) for corner in moved])
    return np.array(turns, dtype=np.intp)


TURNS = _turns()


def true_shapes(block: Cells) -> Iterator[Cells]:
    """Yield hexahedra or quads as blocks of their true shapes; cells with distinct corners come first.

    Hexahedra with seven distinct corners stay as they are; quads with two or one are left out.
    """
    if block.shape not in ("hexahedron", "quad"):
        yield block
        return
    if not any(np.any(block.nodes[:, a] == block.nodes[:, b]) for a, b in EDGES[block.shape]):
        yield block
        return
    distinct = 1 + np.count_nonzero(np.diff(np.sort(block.nodes, axis=1), axis=1), axis=1)
    for part in _quads(block.nodes, distinct) if block.shape == "quad" else _hexahedra(block.nodes, distinct):
        if len(part):
            yield part


def simple(blocks: Iterable[Block]) -> Iterator[Block | Cells]:
    """Yield blocks of cells or faces; those with repeated corners get their true shapes."""
    for block in blocks:
        yield from true_shapes(block) if isinstance(block, Cells) else (block,)


def _quads(nodes: IntArray, distinct: IntArray) -> Iterator[Cells]:
    yield Cells("quad", nodes[distinct == 4])
    rows = nodes[distinct == 3]
    again = np.argmax(rows == np.roll(rows, 1, axis=1), axis=1)  # the corner that is the one before it
    yield Cells("triangle", rows[np.arange(len(rows))[:, None], (again[:, None] + np.arange(3)) % 4])


def _hexahedra(nodes: IntArray, distinct: IntArray) -> Iterator[Cells]:
    known = np.zeros(len(nodes), dtype=np.bool_)
    shapes = []
    for shape, merged, corners in FORMS:
        shaped = np.full((len(nodes), len(corners)), -1)
        for turn in TURNS:
            turned = nodes[:, turn]
            fit = (distinct == len(corners)) & np.all([turned[:, a] == turned[:, b] for a, b in merged], axis=0)
            shaped[fit] = turned[fit][:, list(corners)]
        fitting = shaped[:, 0] >= 0
        known |= fitting
        shapes.append(Cells(shape, shaped[fitting]))
    yield Cells("hexahedron", nodes[~known])
    yield from shapes


@dataclass(frozen=True, slots=True, eq=False)
class ZoneMesh:
    """A zone by itself.

    Parameters
    ----------
    name : the zone's.
    mesh : its points, counted from 0, cells and patches.
    families : names of patches that mean the same in all zones.
    block : whether the zone is structured, so that cells and faces may be collapsed.
    """

    name: str
    mesh: Mesh
    families: frozenset[str] = frozenset()
    block: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Zones put together.

    Parameters
    ----------
    mesh : the joined mesh; zones that touch are one zone, with the zones of the file as its blocks.
    index : (F,) point of the mesh for each point of the file, zone after zone.
    first : (N,) first point of the file at each point of the mesh.
    """

    mesh: Mesh
    index: IntArray = field(repr=False)
    first: IntArray = field(repr=False)


def fit_zones(parts: Sequence[ZoneMesh], touching: Iterable[tuple[int, int]], same: Sequence[IntArray]) -> Fitted:
    """Join zones to one mesh; zones that touch stand together, at the place of their first.

    Collapsed cells and faces of blocks get their true shapes. A patch keeps its name if no other zone has a patch of
    that name, or if it is a family in all touching zones that have it. Otherwise it is ``"zone/patch"``. Faces that lie
    between two cells are taken from patches.

    Parameters
    ----------
    touching : Pairs of zones, as rows of `parts`.
    same : Rows (K, 2) of points that are one, counted through all zones.
    """
    if len(parts) == 1 and not parts[0].block and not same:
        (single,) = parts
        every = np.arange(len(single.mesh.points))
        return Fitted(replace(single.mesh, zones=(Zone(single.name, 0, len(every)),)), every, every)
    starts = np.cumsum([0, *(len(part.mesh.points) for part in parts)])
    groups = _groups(len(parts), touching)
    order = np.concatenate([np.arange(starts[i], starts[i + 1]) for group in groups for i in group])
    index, first = _weld(order, same)
    points = np.concatenate([part.mesh.points for part in parts])[first]
    twice = np.bincount(index, minlength=len(first)) > 1
    zones: list[Zone] = []
    cells: list[Volume] = []
    patches: list[Patch] = []
    begin = 0
    common = _common(groups, parts)
    for group in groups:
        touching_parts = [parts[i] for i in group]
        numbers = [index[starts[i] : starts[i + 1]] for i in group]
        zones.append(_zone(touching_parts, numbers, begin))
        cells += _cells(touching_parts, numbers)
        patches += _patches(touching_parts, numbers, common)
        begin = zones[-1].stop
    mesh = Mesh(points, tuple(cells), tuple(patches), tuple(zones))
    return Fitted(_without_inner(mesh, twice) if twice.any() else mesh, index, first)


def _groups(count: int, touching: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return groups of zones that touch, directly or through others, in the order of their first zones."""
    pairs = np.array(list(touching), dtype=np.intp).reshape(-1, 2)
    label = _components(count, pairs)
    return [np.flatnonzero(label == value).tolist() for value in dict.fromkeys(label.tolist())]


def _weld(order: IntArray, same: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    """Return `Fitted.index` and `Fitted.first` for the file's points, numbered in the given order (F,)."""
    count, place = len(order), np.empty_like(order)
    place[order] = np.arange(count)
    if not same:
        return place, order
    label = _components(count, place[np.concatenate(same)])
    least = np.full(count, count)
    np.minimum.at(least, label, np.arange(count))
    of = least[label]
    kept = of == np.arange(count)
    return (np.cumsum(kept) - 1)[of][place], order[kept]


def _components(count: int, pairs: IntArray) -> IntArray:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    graph = coo_array((np.ones(len(pairs), dtype=np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _common(groups: Sequence[Sequence[int]], parts: Sequence[ZoneMesh]) -> set[str]:
    """Return the names of patches that occur in zones that do not touch."""
    names = [{patch.name for i in group for patch in parts[i].mesh.patches} for group in groups]
    count = Counter(name for zone_names in names for name in zone_names)
    return {name for name, groups_with in count.items() if groups_with > 1}


def _zone(parts: Sequence[ZoneMesh], numbers: Sequence[IntArray], begin: int) -> Zone:
    end = max(begin, *(int(number.max(initial=-1)) + 1 for number in numbers))
    return Zone(parts[0].name, begin, end, tuple(part.name for part in parts) if len(parts) > 1 else ())


def _cells(parts: Sequence[ZoneMesh], numbers: Sequence[IntArray]) -> tuple[Volume, ...]:
    blocks = [renumber(block, number) for part, number in zip(parts, numbers, strict=True) for block in part.mesh.cells]
    if len(parts) == 1 and not parts[0].block:
        return tuple(blocks)
    simple = [some for block in blocks if isinstance(block, Cells) for some in true_shapes(block)]
    return (*_by_shape(simple), *(block for block in blocks if isinstance(block, Polyhedra)))


def _one(blocks: Sequence[Cells]) -> Cells:
    return blocks[0] if len(blocks) == 1 else Cells(blocks[0].shape, np.concatenate([block.nodes for block in blocks]))


def _patches(parts: Sequence[ZoneMesh], numbers: Sequence[IntArray], common: Set[str]) -> list[Patch]:
    """Return the patches of touching zones; families are joined, other `common` names get the zone's name in front."""
    apart = _separate_names(parts)
    by_patch: dict[str, list[Faces]] = {}
    kinds: list[tuple[str, Constraint]] = []
    for part, index in zip(parts, numbers, strict=True):
        for patch in part.mesh.patches:
            name = f"{part.name}/{patch.name}" if patch.name in apart else patch.name
            name = f"{parts[0].name}/{name}" if name in common else name
            kinds.append((name, patch.constraint))
            by_patch.setdefault(name, []).extend(_without_collapsed(patch, index))
    constraints = common_constraints(kinds)
    if len(parts) == 1 and not parts[0].block:
        return [Patch(name, tuple(patch_faces), constraint=constraints[name]) for name, patch_faces in by_patch.items()]
    patches = [
        Patch(name, _sorted_faces(patch_faces), constraint=constraints[name]) for name, patch_faces in by_patch.items()
    ]
    return [patch for patch in patches if patch.faces]


def _without_collapsed(patch: Patch, index: IntArray) -> Iterator[Faces]:
    """Yield the faces with their new points; a face with repeated points gets a simpler shape."""
    for faces in (renumber(faces, index) for faces in patch.faces):
        yield from true_shapes(faces) if isinstance(faces, Cells) else (faces,)


def _separate_names(parts: Sequence[ZoneMesh]) -> set[str]:
    """Return the names that several zones use for patches but that are not a family in all of them."""
    having = Counter(name for part in parts for name in part.mesh.names)
    families = Counter(name for part in parts for name in part.families.intersection(part.mesh.names))
    return {name for name, count in having.items() if count > max(1, families[name])}


def _sorted_faces(faces: Sequence[Faces]) -> tuple[Faces, ...]:
    """Return faces of each shape as one block, then polygons."""
    simple = _by_shape([block for block in faces if isinstance(block, Cells)])
    return (*simple, *(block for block in faces if isinstance(block, Polygons)))


def _by_shape(blocks: Sequence[Cells]) -> tuple[Cells, ...]:
    shapes = dict.fromkeys(block.shape for block in blocks)
    return tuple(_one([block for block in blocks if block.shape == shape]) for shape in shapes)


def _without_inner(mesh: Mesh, twice: BoolArray) -> Mesh:
    """Remove from the patches the faces between two cells; all corners of these are in several zones (``twice``)."""
    keys = node_keys(len(mesh.points))
    patch_faces = [face_keys(faces, keys) for patch in mesh.patches for faces in patch.faces]
    given = distinct(np.concatenate([keys[:0], *patch_faces]))
    count = np.zeros(len(given), dtype=np.intp)
    for part in cell_face_keys(mesh.cells, keys, twice):
        rows, there = places(part, given)
        np.add.at(count, rows[there], 1)
    patches, each = [], iter(patch_faces)
    for patch in mesh.patches:
        kept = [chosen(faces, np.flatnonzero(count[np.searchsorted(given, next(each))] < 2)) for faces in patch.faces]
        if any(len(faces) for faces in kept):
            patches.append(replace(patch, faces=tuple(faces for faces in kept if len(faces))))
    return replace(mesh, patches=tuple(patches))

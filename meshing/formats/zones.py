"""Zones joined to one mesh and cut out of it, and a file's periodic pairs of nodes as pairs of patches."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.cells import Cells, Constraint, Patch, Periodic, Polygons, Polyhedra, Zone, take_faces
from sdm_deflect.meshing.mesh.images import fit_motion, tolerance
from sdm_deflect.meshing.mesh.mesh import Mesh

from .shapes import Faces, chosen

Block = TypeVar("Block", bound=Cells | Polygons | Polyhedra)
# A pair's name in messages, and its nodes (K, 2): each with its image.
Listed = tuple[str, IntArray]
# Returns the coordinates (K, 3) of nodes (K,).
Places = Callable[[IntArray], FloatArray]


def join_zones(names: Sequence[str], parts: Sequence[Mesh]) -> Mesh:
    """Join zones, one after another, to one mesh.

    A patch keeps its name if no other zone has a patch of that name; else it is ``"zone/patch"``.
    """
    starts = np.cumsum([0, *(len(part.points) for part in parts)]).tolist()
    zones = tuple(Zone(name, start, stop) for name, start, stop in zip(names, starts, starts[1:], strict=False))
    if len(parts) == 1:
        return replace(parts[0], zones=zones)
    count = Counter(patch.name for part in parts for patch in part.patches)
    patches = [
        _shifted_patch(patch, zone, count[patch.name] > 1)
        for zone, part in zip(zones, parts, strict=True)
        for patch in part.patches
    ]
    cells = [_shifted_cells(block, zone.start) for zone, part in zip(zones, parts, strict=True) for block in part.cells]
    return Mesh(np.concatenate([part.points for part in parts]), tuple(cells), tuple(patches), zones)


def _shifted_patch(patch: Patch, zone: Zone, common: bool) -> Patch:
    name = f"{zone.name}/{patch.name}" if common else patch.name
    faces = tuple(_shift(faces, zone.start) for faces in patch.faces)
    return Patch(name, faces, constraint=patch.constraint)


def part(mesh: Mesh, zone: Zone) -> Mesh:
    """Return the mesh of one zone, with nodes counted from 0; ``"zone/patch"`` is ``"patch"`` again.

    ValueError if a cell or a boundary face joins two zones.
    """
    if (zone.start, zone.stop) == (0, len(mesh.points)):
        return replace(mesh, patches=tuple(_without_zone(patch, zone) for patch in mesh.patches))
    cells = [block for block in (_cells_inside(block, zone) for block in mesh.cells) if len(block)]
    patches = [patch for patch in (_patch_inside(patch, zone) for patch in mesh.patches) if patch.faces]
    pairs = [pair for pair in mesh.periodic if ((pair.nodes >= zone.start) & (pair.nodes < zone.stop)).all()]
    zone_pairs = [replace(pair, nodes=pair.nodes - zone.start, patches=_own(pair.patches, zone)) for pair in pairs]
    return Mesh(mesh.points[zone.start : zone.stop], tuple(cells), tuple(patches), periodic=tuple(zone_pairs))


def _patch_inside(patch: Patch, zone: Zone) -> Patch:
    """Return the part of a patch within a zone; it may have no faces."""
    faces = [_inside(block, zone, f"faces of patch {patch.name}") for block in patch.faces]
    return _without_zone(Patch(patch.name, tuple(filter(len, faces)), constraint=patch.constraint), zone)


def common_constraints(named: Iterable[tuple[str, Constraint]]) -> dict[str, Constraint]:
    """Return the constraint of each patch by name, if all its parts have the same."""
    constraints: dict[str, Constraint] = {}
    for name, constraint in named:
        constraints[name] = constraint if constraints.get(name, constraint) == constraint else ""
    return constraints


def _without_zone(patch: Patch, zone: Zone) -> Patch:
    return replace(patch, name=patch.name.removeprefix(f"{zone.name}/"))


def _own(names: tuple[str, str], zone: Zone) -> tuple[str, str]:
    return names[0].removeprefix(f"{zone.name}/"), names[1].removeprefix(f"{zone.name}/")


def _shift(block: Faces, by: int) -> Faces:
    return replace(block, nodes=block.nodes + by) if by else block


def _shifted_cells(block: Cells | Polyhedra, by: int) -> Cells | Polyhedra:
    return replace(block, faces=_shift(block.faces, by)) if isinstance(block, Polyhedra) else _shift(block, by)


def _cells_inside(block: Cells | Polyhedra, zone: Zone) -> Cells | Polyhedra:
    if isinstance(block, Cells):
        return _inside(block, zone, f"{block.shape} cells")
    inside = _within(block.faces, zone)
    if inside.any() and not inside.all():
        raise ValueError(f"polyhedra of zone {zone.name} and of other zones must be blocks of their own")
    if inside.all():
        return _shifted_cells(block, -zone.start)
    empty = np.empty(0, dtype=np.intp)
    return Polyhedra(take_faces(block.faces, empty), empty, empty)


def _inside(block: Faces, zone: Zone, what: str) -> Faces:
    within = _within(block, zone)
    if isinstance(block, Polygons):
        starts = block.offsets[:-1]
        some, whole = (np.asarray(of.reduceat(within, starts)) for of in (np.logical_or, np.logical_and))
    else:
        some, whole = (np.asarray(of.reduce(within, axis=1)) for of in (np.logical_or, np.logical_and))
    if torn := np.count_nonzero(some & ~whole):
        raise ValueError(f"{torn} {what} join zone {zone.name} to another zone")
    return _shift(block if whole.all() else chosen(block, np.flatnonzero(whole)), -zone.start)


def renumber(block: Block, index: IntArray) -> Block:
    """Return cells or faces with each node replaced by its entry in `index` (N,)."""
    if isinstance(block, Polyhedra):
        return replace(block, faces=replace(block.faces, nodes=index[block.faces.nodes]))
    return replace(block, nodes=index[block.nodes])


def _within(faces: Cells | Polygons, zone: Zone) -> BoolArray:
    return (faces.nodes >= zone.start) & (faces.nodes < zone.stop)


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """The periodic pairs of a file.

    Attributes
    ----------
    periodic : the pairs.
    patches : the patches, and then patches of nodes alone for pairs whose nodes are on no patch.
    notes : a sentence for each pair that cannot be used.
    """

    periodic: tuple[Periodic, ...]
    patches: tuple[Patch, ...] = field(repr=False)
    notes: tuple[str, ...] = ()


def with_pairs(mesh: Mesh, listed: Iterable[Listed], notes: tuple[str, ...] = ()) -> Mesh:
    """Return the mesh with the pairs that its file lists; `notes` are sentences on pairs that cannot be used."""
    pairs = pairs_of(mesh.patches, listed, lambda nodes: mesh.points[nodes])
    notes = (*mesh.notes, *notes, *pairs.notes)
    return replace(mesh, patches=pairs.patches, periodic=pairs.periodic, notes=notes)


def pairs_to_write(mesh: Mesh) -> list[Periodic]:
    """Return the pairs with nodes, without those of a case one cell thick: other formats can hold these alone."""
    return [pair for pair in mesh.periodic if len(pair.nodes) and not pair.thin]


def unwritten(pairs: Iterable[Periodic]) -> tuple[str, ...]:
    """Return a sentence for each pair that a file does not hold."""
    return tuple(f"{' and '.join(pair.patches)} are periodic, which the file does not say" for pair in pairs)


def pairs_of(patches: Sequence[Patch], listed: Iterable[Listed], places: Places) -> Pairs:
    """Return a pair, named by its first patch, for each two patches and each motion between them.

    Parameters
    ----------
    patches : those of the mesh.
    listed : pairs in the file; one may be listed in several parts, and again in the other direction.
    places : coordinates (N, 3) of the nodes.
    """
    every, notes, pairs = list(patches), [], list[Periodic]()
    for name, nodes in listed:
        try:
            new = _fit(name, ("", ""), nodes, places)
            first, second = (_holder(every, f"{name}~{i}", side) for i, side in enumerate(new.nodes.T, 1))
            every += [patch for patch in dict.fromkeys((first, second)) if patch not in every]
            _enter(pairs, replace(new, patches=(first.name, second.name)), places)
        except InputError as error:
            notes.append(f"{error}; the pair is left out")
    return Pairs(tuple(pairs), tuple(every), tuple(notes))


def _fit(name: str, patches: tuple[str, str], nodes: IntArray, places: Places) -> Periodic:
    """Return a pair with the motion that fits its nodes, listed once each."""
    rows = np.unique(nodes, axis=0)
    numbers = union(rows)
    return replace(fit_motion(places(numbers), name, patches, np.searchsorted(numbers, rows)), nodes=rows)


def _holder(patches: Sequence[Patch], name: str, nodes: IntArray) -> Patch:
    """Return the smallest patch that has all these nodes; without one, a new patch of nodes alone."""
    holding = [patch for patch in patches if len(patch.nodes) and _has(patch.nodes, nodes)]
    if holding:
        return min(holding, key=lambda patch: len(patch.nodes))
    names = {patch.name for patch in patches}
    while name in names:
        name += "~"
    return Patch(name, (), nodes)


def _has(known: IntArray, nodes: IntArray) -> bool:
    for some in (nodes[:1], nodes):  # most patches have not even the first
        at = np.minimum(np.searchsorted(known, some), len(known) - 1)
        if not np.array_equal(known[at], some):
            return False
    return True


def _enter(pairs: list[Periodic], new: Periodic, places: Places) -> None:
    """Add a pair to a list, or its nodes to the pair of the same patches and motion."""
    for i, old in enumerate(pairs):
        for nodes in (new.nodes, new.nodes[:, ::-1]) if set(old.patches) == set(new.patches) else ():
            here, there = places(nodes[:, 0]), places(nodes[:, 1])
            allowed = tolerance(np.concatenate([here, there]), np.arange(2 * len(here)))
            if np.abs(old.image(here) - there).max() <= allowed:
                pairs[i] = _fit(old.name, old.patches, np.concatenate([old.nodes, nodes]), places)
                return
    same = sum(pair.patches[0] == new.patches[0] for pair in pairs)
    pairs.append(replace(new, name=f"{new.patches[0]}~{same + 1}" if same else new.patches[0]))

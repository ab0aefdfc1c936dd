"""Zones apart, each with points counted from 0, and together in one mesh."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, IntArray
from sdm_deflect.deform.mesh.cells import Cells, Constraint, Patch, Polygons, Polyhedra, Zone, taken
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.formats.shapes import Faces, chosen

Block = TypeVar("Block", bound=Cells | Polygons | Polyhedra)


def joined(names: Sequence[str], parts: Sequence[Mesh]) -> Mesh:
    """Put zones one after another into one mesh.

    A patch keeps its name where no other zone has a patch of that name, and is called ``"zone/patch"`` otherwise.
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
    faces = tuple(_shifted(faces, zone.start) for faces in patch.faces)
    return Patch(name, faces, constraint=patch.constraint)


def part(mesh: Mesh, zone: Zone) -> Mesh:
    """Return one zone's points, cells and patches (``"zone/patch"`` is ``"patch"`` again), nodes counted from 0.

    ValueError if a cell or a boundary face joins two zones.
    """
    if (zone.start, zone.stop) == (0, len(mesh.points)):
        return replace(mesh, patches=tuple(_unprefixed(patch, zone) for patch in mesh.patches))
    cells = [block for block in (_cells_inside(block, zone) for block in mesh.cells) if len(block)]
    patches = [patch for patch in (_patch_inside(patch, zone) for patch in mesh.patches) if patch.faces]
    pairs = [pair for pair in mesh.periodic if ((pair.nodes >= zone.start) & (pair.nodes < zone.stop)).all()]
    own = [replace(pair, nodes=pair.nodes - zone.start, patches=_own(pair.patches, zone)) for pair in pairs]
    return Mesh(mesh.points[zone.start : zone.stop], tuple(cells), tuple(patches), periodic=tuple(own))


def _patch_inside(patch: Patch, zone: Zone) -> Patch:
    """Return what of a patch is in a zone: its faces there, if any."""
    faces = [_inside(block, zone, f"faces of patch {patch.name}") for block in patch.faces]
    return _unprefixed(Patch(patch.name, tuple(filter(len, faces)), constraint=patch.constraint), zone)


def agreed(named: Iterable[tuple[str, Constraint]]) -> dict[str, Constraint]:
    """Return the constraint of each patch that has several parts: that of all of them, or none."""
    found: dict[str, Constraint] = {}
    for name, own in named:
        found[name] = own if found.get(name, own) == own else ""
    return found


def _unprefixed(patch: Patch, zone: Zone) -> Patch:
    return replace(patch, name=patch.name.removeprefix(f"{zone.name}/"))


def _own(names: tuple[str, str], zone: Zone) -> tuple[str, str]:
    return names[0].removeprefix(f"{zone.name}/"), names[1].removeprefix(f"{zone.name}/")


def _shifted(block: Faces, by: int) -> Faces:
    return replace(block, nodes=block.nodes + by) if by else block


def _shifted_cells(block: Cells | Polyhedra, by: int) -> Cells | Polyhedra:
    return replace(block, faces=_shifted(block.faces, by)) if isinstance(block, Polyhedra) else _shifted(block, by)


def _cells_inside(block: Cells | Polyhedra, zone: Zone) -> Cells | Polyhedra:
    if isinstance(block, Cells):
        return _inside(block, zone, f"{block.shape} cells")
    own = _within(block.faces, zone)
    if own.any() and not own.all():
        raise ValueError(f"polyhedra of zone {zone.name} and of other zones must be blocks of their own")
    if own.all():
        return _shifted_cells(block, -zone.start)
    empty = np.empty(0, dtype=np.intp)
    return Polyhedra(taken(block.faces, empty), empty, empty)


def _inside(block: Faces, zone: Zone, what: str) -> Faces:
    own = _within(block, zone)
    if isinstance(block, Polygons):
        starts = block.offsets[:-1]
        some, whole = (np.asarray(of.reduceat(own, starts)) for of in (np.logical_or, np.logical_and))
    else:
        some, whole = (np.asarray(of.reduce(own, axis=1)) for of in (np.logical_or, np.logical_and))
    if torn := np.count_nonzero(some & ~whole):
        raise ValueError(f"{torn} {what} join zone {zone.name} to another zone")
    return _shifted(block if whole.all() else chosen(block, np.flatnonzero(whole)), -zone.start)


def renumbered(block: Block, index: IntArray) -> Block:
    """Return cells or faces with `index` (N,) of each node in its place."""
    if isinstance(block, Polyhedra):
        return replace(block, faces=replace(block.faces, nodes=index[block.faces.nodes]))
    return replace(block, nodes=index[block.nodes])


def _within(faces: Cells | Polygons, zone: Zone) -> BoolArray:
    return (faces.nodes >= zone.start) & (faces.nodes < zone.stop)

"""Parts of a decomposed OpenFOAM mesh put together: by the lists that decomposePar writes, or by processor patches.

The lists of a part say what its points, faces, cells and patches are in the whole (OpenFOAM, ``decomposePar``):
``pointProcAddressing`` and ``cellProcAddressing`` count from 0; ``faceProcAddressing`` counts from 1 and is negative
where the part has the face the other way round; ``boundaryProcAddressing`` is -1 for patches between parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.mesh.mesh import Mesh, Patch, Polygons, Polyhedra
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam_files import FoamPatch
from sdm_deflect.meshing.formats.openfoam_pairs import constraint_of, pairs_of
from sdm_deflect.meshing.formats.shapes import polygons

BETWEEN, CYCLIC = "processor", "processorCyclic"
"""Types of patches between parts; the faces of the second are on the cyclic patch that ``referPatch`` names."""
APART = 1e-5
"""Fraction of the largest coordinate by which a point may lie elsewhere in another part: text of six digits."""
FIT = "the parts are not of one mesh, or were changed after decomposePar"


@dataclass(frozen=True, slots=True, eq=False)
class ProcessorMesh:
    """The mesh of one part.

    Parameters
    ----------
    name : Such as ``processor0``, for messages.
    points : (N, 3) coordinates.
    cells : Its cells; on the boundary are the faces of its patches and those between parts.
    patches : Patches, those between parts as well.
    """

    name: str
    points: FloatArray = field(repr=False)
    cells: Polyhedra
    patches: Sequence[FoamPatch] = field(repr=False)

    def between(self, kind: str = BETWEEN) -> dict[int, FoamPatch]:
        """Patches between this part and others, by the number of the other."""
        found: dict[int, FoamPatch] = {}
        for patch in self.patches:
            if patch.type != kind:
                continue
            other = int(patch.entries.get("neighbProcNo", "-1"))
            if found.setdefault(other, patch) is not patch:
                raise MeshFileError(f"{self.name} has two patches towards processor{other}; there should be one")
        return found

    def check(self, number: int, count: int) -> None:
        """Refuse, with a MeshFileError, nodes and faces out of range, and patches between parts that are not there."""
        nodes = self.cells.faces.nodes
        if len(nodes) and not 0 <= nodes.min() <= nodes.max() < len(self.points):
            raise MeshFileError(
                f"faces have the nodes {nodes.min()} to {nodes.max()}, but there are {len(self.points)} points"
            )
        for patch in self.patches:
            inner, end, faces = len(self.cells.neighbour), patch.start + patch.count, len(self.cells.faces)
            if not (0 <= patch.start <= end <= faces and (inner <= patch.start or not patch.count)):
                raise MeshFileError(
                    f"patch {patch.name} has the faces {patch.start} to {end - 1}, "
                    f"but those on the boundary are {inner} to {faces - 1}"
                )
            if patch.type in (BETWEEN, CYCLIC):
                mine, other = (int(patch.entries.get(key, "-1")) for key in ("myProcNo", "neighbProcNo"))
                if mine != number:
                    raise MeshFileError(f"patch {patch.name} is one of processor{mine}; {FIT}")
                if not 0 <= other < count:
                    raise MeshFileError(f"patch {patch.name} borders on processor{other}, which is not there")


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """What a part is in the whole.

    Parameters
    ----------
    points : (N,) index of each point.
    faces : (F,) index of each face, plus 1; negative if the whole has the face the other way round.
    cells : (C,) index of each cell.
    """

    points: IntArray = field(repr=False)
    faces: IntArray = field(repr=False)
    cells: IntArray = field(repr=False)


def placed_by_patches(parts: Sequence[ProcessorMesh], names: Sequence[str]) -> list[Place]:
    """Number points, faces and cells of parts that were never a whole: one part after another, inner faces first.

    Face i of the patch from part p to part q is face i of that from q to p, from the same first node on, backwards;
    their nodes are the same points.
    """
    points = _starts([len(part.points) for part in parts])
    faces = _starts([len(part.cells.faces) for part in parts])
    cells = _starts([len(part.cells) for part in parts])
    group = _groups(parts, names)
    partner = np.full(faces[-1], -1, dtype=np.intp)
    ends: list[tuple[IntArray, IntArray]] = [(np.empty(0, np.intp), np.empty(0, np.intp))]
    for p, part in enumerate(parts):
        for q, patch in part.between().items():
            back = _back(parts, p, q, patch.count)
            if p < q:
                mine = part.cells.faces.rows(patch.start, patch.start + patch.count)
                other = parts[q].cells.faces.rows(back.start, back.start + back.count)
                if not np.array_equal(mine.offsets, other.offsets):
                    raise MeshFileError(f"{part.name} and {parts[q].name} have other faces between them; {FIT}")
                ends.append((points[p] + mine.nodes, points[q] + turned_back(other, np.ones(len(other), bool)).nodes))
                partner[faces[q] + back.start + np.arange(back.count)] = faces[p] + patch.start + np.arange(patch.count)
    number = _joined(int(points[-1]), *(np.concatenate(side) for side in zip(*ends, strict=True)))
    first = np.flatnonzero(partner < 0)
    signed = np.empty(faces[-1], dtype=np.intp)
    signed[first[np.argsort(group[first], kind="stable")]] = 1 + np.arange(len(first))
    signed[partner >= 0] = -signed[partner[partner >= 0]]
    return [
        Place(
            number[points[p] : points[p + 1]],
            signed[faces[p] : faces[p + 1]],
            np.arange(cells[p], cells[p + 1], dtype=np.intp),
        )
        for p in range(len(parts))
    ]


def _back(parts: Sequence[ProcessorMesh], p: int, q: int, count: int) -> FoamPatch:
    """Return the patch of part q towards part p, which should have so many faces."""
    back = parts[q].between().get(p)
    if back is None or back.count != count:
        found = back.count if back else 0
        raise MeshFileError(f"{parts[p].name} has {count} faces towards {parts[q].name}, which has {found} back; {FIT}")
    return back


def _groups(parts: Sequence[ProcessorMesh], names: Sequence[str]) -> IntArray:
    """Return what each face of the parts is in the whole: 0 for an inner one, 1 + i for one of patch i."""
    groups = []
    for part in parts:
        groups.append(np.zeros(len(part.cells.faces), dtype=np.intp))
        for patch in part.patches:
            name = whole_name(patch)
            if name is not None:
                groups[-1][patch.start : patch.start + patch.count] = 1 + names.index(name)
    return np.concatenate(groups)


def _starts(counts: Sequence[int]) -> IntArray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)


def _joined(count: int, one: IntArray, other: IntArray) -> IntArray:
    """Number (count,) of each of so many points when those of each pair are one, in the order of the first of them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    graph = coo_array((np.ones(len(one), dtype=np.bool_), (one, other)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    number: IntArray = rank[label.ravel()]
    return number


def whole_name(patch: FoamPatch) -> str | None:
    """Return the patch of the whole that the faces of a part's patch are on; None between two parts."""
    if patch.type == CYCLIC:
        return patch.entries.get("referPatch", patch.name)
    return None if patch.type == BETWEEN else patch.name


def patch_names(parts: Sequence[ProcessorMesh], ranks: Sequence[IntArray] = ()) -> tuple[str, ...]:
    """Return the names of the patches of the whole: by their indices `ranks` in it, else in the order of the parts.

    MeshFileError if the parts have different patches.
    """
    own = [[patch for patch in part.patches if patch.type not in (BETWEEN, CYCLIC)] for part in parts]
    known = {patch.name: i for patches in own for i, patch in enumerate(patches)}
    for part, rank in zip(parts, ranks, strict=bool(len(ranks))):
        pairs = zip(part.patches, rank.tolist(), strict=True)
        known |= {patch.name: i for patch, i in pairs if patch.type not in (BETWEEN, CYCLIC)}
    names = tuple(sorted(known, key=known.__getitem__))
    for part in parts:
        if lost := set(filter(None, map(whole_name, part.patches))).difference(names):
            raise MeshFileError(f"{part.name}: {', '.join(sorted(lost))} is no patch of any part; {FIT}")
    return names


def whole_points(points: Sequence[FloatArray], places: Sequence[IntArray]) -> FloatArray:
    """Return the points (N, 3) of the whole; MeshFileError if one is missing, or lies elsewhere in another part."""
    index, given = np.concatenate(places), np.concatenate(points)
    count = _count(index, "points")
    found = np.empty((count, 3))
    found[index[::-1]] = given[::-1]  # that of the first part remains
    with np.errstate(invalid="ignore"):  # coordinates that are not finite are refused with the mesh
        apart = np.abs(found[index] - given).max(axis=1, initial=0.0)
    if far := np.count_nonzero(apart > APART * np.abs(given).max(initial=0.0)):
        raise MeshFileError(f"{far} points that parts share lie up to {apart.max():.3g} apart; {FIT}")
    return found


def whole(parts: Sequence[ProcessorMesh], places: Sequence[Place], names: Sequence[str]) -> Mesh:
    """Return the mesh, with patches of these names, that the parts are parts of; MeshFileError if they do not fit."""
    points = whole_points([part.points for part in parts], [place.points for place in places])
    signed = np.concatenate([place.faces for place in places])
    _count(np.concatenate([place.cells for place in places]), "cells", once=True)
    face, backward = np.abs(signed) - 1, signed < 0
    nodes = np.concatenate([place.points[part.cells.faces.nodes] for part, place in zip(parts, places, strict=True)])
    sizes = np.concatenate([np.diff(part.cells.faces.offsets) for part in parts])
    faces = _each_once(turned_back(polygons(nodes, sizes), backward), face)
    owner, neighbour = _sides(parts, places, face, backward)
    inner = int(np.count_nonzero(neighbour >= 0))
    patch = _patch_of(parts, face, names, len(faces))
    if np.any(neighbour[:inner] < 0) or np.any(patch[:inner] >= 0) or np.any(patch[inner:] < 0):
        wrong = np.count_nonzero((neighbour >= 0) == (patch >= 0))
        raise MeshFileError(f"{wrong} faces are inside the whole and on a patch, or neither, or out of order; {FIT}")
    return _named(Mesh(points, (Polyhedra(faces, owner, neighbour[:inner]),), ()), parts, faces, patch, names)


def _named(mesh: Mesh, parts: Sequence[ProcessorMesh], faces: Polygons, patch: IntArray, names: Sequence[str]) -> Mesh:
    """Return the mesh with its patches and pairs; `patch` is each face's, -1 for inner ones."""
    order = np.argsort(patch, kind="stable")
    ends = np.searchsorted(patch[order], np.arange(len(names) + 1))
    known = {patch.name: patch for part in parts for patch in part.patches if patch.type not in (BETWEEN, CYCLIC)}
    foam = [known[name] for name in names]
    patches = tuple(
        Patch(name, (taken(faces, order[ends[i] : ends[i + 1]]),), constraint=constraint_of(foam[i]))
        for i, name in enumerate(names)
    )
    periodic = pairs_of(foam, patches, lambda nodes: mesh.points[nodes])
    return replace(mesh, patches=patches, periodic=periodic)


def _count(index: IntArray, what: str, once: bool = False) -> int:
    """How many there are in the whole: 0 to the largest index, each in one part at least."""
    if len(index) and not 0 <= index.min() <= index.max() < len(index):
        raise MeshFileError(f"the parts' {what} are {index.min()} to {index.max()} of the whole, too many; {FIT}")
    found = np.bincount(index)
    if missing := np.count_nonzero(found == 0):
        unused = ", or no cell has them (then delete the files *ProcAddressing)" if what == "points" else ""
        raise MeshFileError(f"{missing} {what} of the whole are in no part; a part is missing{unused}, or {FIT}")
    if once and found.max(initial=0) > 1:
        raise MeshFileError(f"{np.count_nonzero(found > 1)} {what} of the whole are in several parts; {FIT}")
    return len(found)


def _each_once(given: Polygons, face: IntArray) -> Polygons:
    """The faces of the whole from those of all parts; MeshFileError if two parts differ in one."""
    count = _count(face, "faces")
    order = np.argsort(face, kind="stable")
    again = np.flatnonzero(face[order][1:] == face[order][:-1])
    first = np.searchsorted(face[order], np.arange(count))
    one, other = taken(given, order[again]), taken(given, order[again + 1])
    if not (np.array_equal(one.offsets, other.offsets) and np.array_equal(one.nodes, other.nodes)):
        raise MeshFileError(f"faces between parts have other points in one than in the other; {FIT}")
    return taken(given, order[first])


def _sides(
    parts: Sequence[ProcessorMesh], places: Sequence[Place], face: IntArray, backward: BoolArray
) -> tuple[IntArray, IntArray]:
    """Owner and neighbour, or -1, of each face of the whole."""
    back = np.concatenate([place.cells[part.cells.owner] for part, place in zip(parts, places, strict=True)])
    front = np.full(len(back), -1, dtype=np.intp)
    starts = _starts([len(part.cells.faces) for part in parts])
    for start, part, place in zip(starts[:-1], parts, places, strict=True):
        front[start : start + len(part.cells.neighbour)] = place.cells[part.cells.neighbour]
    back, front = np.where(backward, front, back), np.where(backward, back, front)
    for side in (back, front):
        if np.any(np.bincount(face[side >= 0]) > 1):
            raise MeshFileError(f"a face is on the same side of two cells; {FIT}")
    sides = np.full((2, int(face.max(initial=-1)) + 1), -1, dtype=np.intp)
    for row, side in zip(sides, (back, front), strict=True):
        row[face[side >= 0]] = side[side >= 0]
    owner, neighbour = sides
    alone = owner < 0
    return np.where(alone, neighbour, owner), np.where(alone, -1, neighbour)


def _patch_of(parts: Sequence[ProcessorMesh], face: IntArray, names: Sequence[str], count: int) -> IntArray:
    """Index of the patch of each face of the whole; -1 for those on none."""
    known = {name: i for i, name in enumerate(names)}
    found = np.full(count, -1, dtype=np.intp)
    starts = _starts([len(part.cells.faces) for part in parts])
    for start, part in zip(starts[:-1].tolist(), parts, strict=True):
        for patch in part.patches:
            name = whole_name(patch)
            if name is not None:
                found[face[start + patch.start : start + patch.start + patch.count]] = known[name]
    return found


def turned_back(faces: Polygons, backward: BoolArray) -> Polygons:
    """Return all faces, those marked in `backward` (F,) backwards from the same first node, as OpenFOAM turns them."""
    nodes, begin = faces.nodes.copy(), faces.offsets[:-1][backward]
    sizes = np.diff(faces.offsets)[backward]
    first, size = np.repeat(begin, sizes), np.repeat(sizes, sizes)
    within = np.arange(len(first)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    nodes[first + within] = faces.nodes[first + -within % size]
    return Polygons(nodes, faces.offsets)

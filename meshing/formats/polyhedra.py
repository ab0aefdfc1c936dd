"""Conversion of standard cells to polyhedra in OpenFOAM's order, and of polyhedra to standard cells."""

from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import Cells, Polygons, Polyhedra, take_faces
from sdm_deflect.meshing.mesh.faces import FACES, Keys, face_keys, node_keys, patch_keys
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.standard import parts_of

from .shapes import polygons, turn_faces

# Patch of the boundary faces that are on no patch.
LOOSE = "unnamed"
# Faces of a cell in space.
FEWEST = 4


@dataclass(frozen=True, slots=True, eq=False)
class Bounded:
    """Polyhedra whose boundary faces are sorted by patch.

    Parameters
    ----------
    cells : Polyhedra; faces between two cells come first, by lower and then higher cell, then those of each patch.
    patches : Name, first face and number of faces of each patch.
    lost : A sentence for each thing that could not be kept.
    """

    cells: Polyhedra = field(repr=False)
    patches: tuple[tuple[str, int, int], ...]
    lost: tuple[str, ...]


def polyhedral_cells(mesh: Mesh) -> Bounded:
    """Return the cells of a mesh as polyhedra, in the same order.

    MeshFileError if three cells or more share a face, if a patch's face belongs to no cell, or for standard cells
    beside polyhedra.
    """
    keys = node_keys(len(mesh.points))
    faces, owner, neighbour = _face_pairs(mesh, keys)
    inner = np.flatnonzero(neighbour >= 0)
    inner = inner[np.lexsort((neighbour[inner], owner[inner]))]
    outer = np.flatnonzero(neighbour < 0)
    patch, lost = _patch_of(mesh, face_keys(take_faces(faces, outer), keys), keys)
    order = np.lexsort((owner[outer], patch))
    names = [p.name for p in mesh.patches]
    counts = np.bincount(patch, minlength=len(names) + 1)
    if counts[-1]:
        lost.append(f"{counts[-1]} boundary faces are on no patch; they are in the patch {LOOSE}")
        names.append(LOOSE)
    starts = len(inner) + np.concatenate([[0], np.cumsum(counts)])
    rows = np.concatenate([inner, outer[order]])
    cells = Polyhedra(take_faces(faces, rows), owner[rows], neighbour[inner])
    ranges = tuple((name, int(starts[i]), int(counts[i])) for i, name in enumerate(names))
    return Bounded(cells, ranges, tuple(lost))


def _face_pairs(mesh: Mesh, keys: Keys) -> tuple[Polygons, IntArray, IntArray]:
    """Return each face once, its owner (the lower cell; the normal points out of it), and its neighbour or -1."""
    if len(mesh.cells) == 1 and isinstance(cells := mesh.cells[0], Polyhedra):
        neighbour = np.full(len(cells.faces), -1, dtype=np.intp)
        neighbour[: len(cells.neighbour)] = cells.neighbour
        swap = (neighbour >= 0) & (neighbour < cells.owner)
        owner, other = np.where(swap, neighbour, cells.owner), np.where(swap, cells.owner, neighbour)
        return turn_faces(cells.faces, swap), owner, other
    return _match(*_faces_of_cells(mesh), keys)


def _match(faces: Polygons, cell: IntArray, keys: Keys) -> tuple[Polygons, IntArray, IntArray]:
    """Return the same as `_face_pairs` from the faces of all cells and their cells (K,); equal keys are one face."""
    key = face_keys(faces, keys)
    order = np.lexsort((cell, key))
    same = key[order][1:] == key[order][:-1]
    if thrice := np.count_nonzero(same[1:] & same[:-1]):
        raise MeshFileError(f"{thrice} faces are of three cells or more")
    neighbour = np.full(len(cell), -1, dtype=np.intp)
    neighbour[order[:-1][same]] = cell[order[1:][same]]
    second = np.zeros(len(cell), dtype=np.bool_)
    second[order[1:][same]] = True
    kept = np.flatnonzero(~second)
    return take_faces(faces, kept), cell[kept], neighbour[kept]


def polyhedra(faces: Polygons, cell: IntArray, points: int) -> Polyhedra:
    """Return cells from all their outward faces and the cell (K,) of each; MeshFileError if three share a face."""
    once, owner, neighbour = _match(faces, cell, node_keys(points))
    order = np.argsort(neighbour < 0, kind="stable")
    return Polyhedra(take_faces(once, order), owner[order], neighbour[neighbour >= 0])


def _faces_of_cells(mesh: Mesh) -> tuple[Polygons, IntArray]:
    nodes, sizes, cell, first = [], [], [], 0
    for block in mesh.cells:
        if isinstance(block, Polyhedra):
            raise MeshFileError(f"{len(block)} polyhedra are mixed with other cells")
        for face in FACES[block.shape]:
            nodes.append(block.nodes[:, list(face)].ravel())
            sizes.append(np.full(len(block), len(face), dtype=np.intp))
            cell.append(np.arange(first, first + len(block)))
        first += len(block)
    if not first:
        raise MeshFileError("there are no volume cells")
    return polygons(np.concatenate(nodes), np.concatenate(sizes)), np.concatenate(cell)


def _patch_of(mesh: Mesh, key: Keys, keys: Keys) -> tuple[IntArray, list[str]]:
    """Return the index (B,) of the patch of each boundary face; the number of patches for faces on none."""
    patch_of = np.full(len(key), len(mesh.patches), dtype=np.intp)
    order = np.argsort(key)
    lost = []
    for i, patch in enumerate(mesh.patches):
        keys_of = patch_keys(patch, keys)
        place = order[np.minimum(np.searchsorted(key, keys_of, sorter=order), len(key) - 1)]
        there = key[place] == keys_of
        taken_before = there & (patch_of[place] < len(mesh.patches))
        patch_of[place[there & ~taken_before]] = i
        if not there.all():
            lost.append(f"{np.count_nonzero(~there)} faces of patch {patch.name} are not on the boundary; left out")
        if taken_before.any():
            lost.append(f"{np.count_nonzero(taken_before)} faces of patch {patch.name} are on another patch; left out")
    return patch_of, lost


def check_cells(cells: Polyhedra, least: int = FEWEST) -> None:
    """Raise MeshFileError for cells with fewer than `least` faces, which damaged labels leave behind."""
    sides = np.concatenate([cells.owner, cells.neighbour])
    check_labels(int(sides.min(initial=0)), int(sides.max(initial=-1)), len(cells.owner), len(cells.neighbour))
    check_sides(int(np.count_nonzero(np.bincount(sides) < least)), len(cells), least)


def check_labels(low: int, high: int, owners: int, neighbours: int) -> None:
    """Raise MeshFileError if the least or the largest cell is impossible for these numbers of owners and neighbours."""
    if low < 0 or not 0 <= high < owners + neighbours:
        raise MeshFileError(f"owner and neighbour name cells that {owners} faces cannot bound")


def check_sides(few: int, cells: int, least: int = FEWEST) -> None:
    """Raise MeshFileError if a cell has fewer faces than `least`."""
    if few:
        number = {3: "three", 4: "four"}[least]
        raise MeshFileError(f"{few} of {cells} cells have fewer than {number} faces; the file is damaged")


def faces_by_cell(block: Polyhedra) -> tuple[Polygons, IntArray]:
    """Return the faces of each cell, with normals outwards, and their cells; inner faces occur twice."""
    cell = np.concatenate([block.owner, block.neighbour])
    row = np.concatenate([np.arange(len(block.owner)), np.arange(len(block.neighbour))])
    order = np.argsort(cell, kind="stable")
    return turn_faces(take_faces(block.faces, row[order]), order >= len(block.owner)), cell[order]


def standard_cells(mesh: Mesh) -> tuple[Cells, ...]:
    """Return the cells of a mesh with each block of polyhedra replaced by a block of each shape.

    The order within a shape is that of the polyhedra. MeshFileError if a polyhedron is no standard cell.
    """
    blocks = (_shapes(block) if isinstance(block, Polyhedra) else [block] for block in mesh.cells)
    return tuple(chain.from_iterable(blocks))


def _shapes(block: Polyhedra) -> list[Cells]:
    shapes, known = [], 0
    for shape, cells, rows, _ in parts_of(block):
        if isinstance(cells, Cells):
            shapes.append(Cells(shape, np.ascontiguousarray(cells.nodes[rows])))
            known += len(rows)
    if known < len(block):
        raise MeshFileError(
            f"{len(block) - known} of {len(block)} polyhedra are no tetrahedra, pyramids, prisms or hexahedra, "
            "and the format holds no others"
        )
    return shapes

"""Cells and faces by shape: order of nodes, faces of cells, faces with any number of corners."""

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.base.errors import MeshFileError, short_list
from sdm_deflect.meshing.mesh.cells import MIRRORED, PLANE, Cells, Patch, Polygons, take_faces
from sdm_deflect.meshing.mesh.faces import cell_face_keys, node_keys, patch_keys
from sdm_deflect.meshing.mesh.mesh import Mesh

# Corners whose edges from corner 0 are right-handed in a cell that is not inverted.
AXES = {"tetra": (1, 2, 3), "pyramid": (1, 3, 4), "wedge": (2, 1, 3), "hexahedron": (1, 3, 4)}
# Number of cells, equally spaced, that decide whether a block is left-handed.
SAMPLE = 1 << 12
Faces = TypeVar("Faces", bound=Cells | Polygons)
FullMesh = TypeVar("FullMesh", np.intp, np.uint64)


def polygons(nodes: IntArray, sizes: IntArray) -> Polygons:
    """Return faces with `sizes` (F,) corners each; their nodes follow one another in `nodes` (K,)."""
    return Polygons(nodes, np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp))


def turn_faces(faces: Polygons, backward: BoolArray) -> Polygons:
    """Return all faces, those marked in `backward` (F,) with their nodes in reverse order."""
    return _gather(faces, np.arange(len(faces)), backward)


def simple_faces(patch: Patch) -> Iterator[Cells]:
    """Yield the triangles and the quads of a patch; MeshFileError if a face has more than four corners."""
    for faces in patch.faces:
        if isinstance(faces, Cells):
            yield faces
            continue
        sizes = np.diff(faces.offsets)
        if more := np.count_nonzero(sizes > 4):
            raise MeshFileError(f"patch {patch.name}: {more} faces have more than four corners, which the format lacks")
        for shape, corners in (("triangle", 3), ("quad", 4)):
            first = faces.offsets[:-1][sizes == corners]
            if len(first):
                yield Cells(shape, faces.nodes[first[:, None] + np.arange(corners)])


def _gather(faces: Polygons, rows: IntArray, backward: BoolArray) -> Polygons:
    sizes = np.diff(faces.offsets)[rows]
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp)
    within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], sizes)
    flipped = np.repeat(backward, sizes)
    within[flipped] = (np.repeat(sizes, sizes) - 1 - within)[flipped]
    return Polygons(faces.nodes[np.repeat(faces.offsets[rows], sizes) + within], offsets)


def orient(points: FloatArray, cells: Cells) -> Cells:
    """Return volume cells of one shape in VTK's order, whether the file has them right- or left-handed.

    Programs that write "VTK's order" differ in the handedness of wedges, some in that of all cells, and solvers correct
    it while they read. A block is reversed as a whole if most of its cells are left-handed, so single inverted cells
    stay inverted. Plane cells are reversed one by one to run counter-clockwise, as in solvers.
    """
    if cells.shape in PLANE:
        corners = points[cells.nodes][:, :, :2]
        with np.errstate(all="ignore"):  # `Mesh` refuses coordinates that are not finite
            across, along = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
            clockwise = across[:, 0] * along[:, 1] < across[:, 1] * along[:, 0]
        return replace(cells, nodes=np.where(clockwise[:, None], cells.nodes[:, ::-1], cells.nodes))
    step = max(1, len(cells) // SAMPLE)
    sample = cells.nodes[::step]
    if not left_handed(points[sample[:, [0, *AXES[cells.shape]]]]):
        return cells
    return replace(cells, nodes=mirror_nodes(cells.shape, cells.nodes))


def left_handed(corners: FloatArray) -> bool:
    """Return whether most cells with four corners (M, 4, 3) are left-handed."""
    with np.errstate(all="ignore"):  # `Mesh` refuses coordinates that are not finite
        a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
        hands = np.einsum("ij,ij->i", np.cross(a, b), c)
    return 2 * int(np.count_nonzero(hands < 0.0)) > len(corners)


def mirror_nodes(shape: str, nodes: IntArray) -> IntArray:
    """Return nodes (M, k) of volume cells in the order of their mirror images."""
    return np.take(nodes, MIRRORED[shape], axis=1)


def places(wanted: NDArray[FullMesh], known: NDArray[FullMesh]) -> tuple[IntArray, BoolArray]:
    """Return the index of each number in `known` (N,), and whether it is there; if not, the index is arbitrary."""
    if not len(known):
        return np.zeros(wanted.shape, dtype=np.intp), np.zeros(wanted.shape, dtype=np.bool_)
    order = np.argsort(known, kind="stable")
    index = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    return index, known[index] == wanted


def chosen(faces: Faces, rows: IntArray) -> Faces:
    """Return the faces or cells `rows` (R,), in that order."""
    if isinstance(faces, Polygons):
        some = take_faces(faces, rows)
        return replace(faces, nodes=some.nodes, offsets=some.offsets)
    return replace(faces, nodes=faces.nodes[rows])


def all_of(marked: BoolArray, faces: Cells | Polygons) -> BoolArray:
    """Return which faces (F,) have only marked nodes (N,)."""
    on = marked[faces.nodes]
    if isinstance(faces, Cells):
        return np.asarray(on.all(axis=1))
    return np.asarray(np.logical_and.reduceat(on, faces.offsets[:-1]))


def loose_faces(mesh: Mesh) -> dict[str, int]:
    """Count, by patch, the faces that are of no cell (patches without such faces are left out).

    Only cells with a face's number of nodes on the boundary are examined, in parts: the memory is that of the boundary.
    """
    keys = node_keys(len(mesh.points))
    mine = {patch.name: patch_keys(patch, keys) for patch in mesh.patches}
    given = distinct(np.concatenate([np.empty(0, np.uint64), *mine.values()]))
    seen = np.zeros(len(given), dtype=np.bool_)
    on_patch = np.zeros(len(mesh.points), dtype=np.bool_)
    on_patch[mesh.on(*(patch.name for patch in mesh.patches))] = True
    for part in cell_face_keys(mesh.cells, keys, on_patch) if len(given) else ():
        place = np.minimum(np.searchsorted(given, part), len(given) - 1)
        seen[place[given[place] == part]] = True
        if seen.all():
            return {}
    missing = given[~seen]
    counts = {name: int(np.count_nonzero(np.isin(patch_faces, missing))) for name, patch_faces in mine.items()}
    return {name: count for name, count in counts.items() if count}


def refuse_plane(mesh: Mesh, format_name: str) -> None:
    """Raise MeshFileError for a plane mesh in a format that cannot hold it."""
    if mesh.plane:
        raise MeshFileError(f"{format_name} holds no two-dimensional meshes; su2, cgns, gmsh and vtu do")


def check_faces(mesh: Mesh) -> None:
    """Raise MeshFileError if boundary faces belong to no cell; it names the patches and counts these faces."""
    if not sum(len(block) for block in mesh.cells):
        raise MeshFileError("there are no volume cells")
    if loose := loose_faces(mesh):
        counts = (f"{count} of {len(mesh.patch(name))} faces of patch {name}" for name, count in loose.items())
        raise MeshFileError(f"{short_list(counts)} are of no cell")

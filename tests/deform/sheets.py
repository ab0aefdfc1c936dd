"""Faces inside the flow as patches: sheets between cells, and slits with nodes on both sides."""

from dataclasses import replace

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.faces import FACE_SHAPES, FACES
from sdm_deflect.meshing.mesh.mesh import Mesh


def inner_faces(mesh: Mesh, inside) -> Cells:
    """The faces between two cells whose centres (F, 3) are `inside`."""
    (block,) = mesh.cells
    faces = np.concatenate([block.nodes[:, list(face)] for face in FACES[block.shape]])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[np.sort(first[count == 2])]
    return Cells(FACE_SHAPES[faces.shape[1]], faces[inside(mesh.points[faces].mean(axis=1))])


def with_sheet(mesh: Mesh, inside, name: str = "wake") -> Mesh:
    """The mesh with these faces as a patch."""
    return replace(mesh, patches=(*mesh.patches, Patch(name, (inner_faces(mesh, inside),))))


def with_slit(mesh: Mesh, inside, above, names: tuple[str, ...] = ("front", "back")) -> Mesh:
    """The mesh cut along these faces: cells `above` (C, 3) get nodes of their own, but at the rim of the cut.

    Both sides are patches; of one name they are one patch.
    """
    sheet, (block,) = inner_faces(mesh, inside), mesh.cells
    edges = np.concatenate([np.sort(sheet.nodes[:, [i, i - 1]], axis=1) for i in range(sheet.nodes.shape[1])])
    if sheet.shape == "line":
        ends, count = np.unique(sheet.nodes, return_counts=True)
        rim = ends[count == 1]
    else:
        edges, count = np.unique(edges, axis=0, return_counts=True)
        rim = np.unique(edges[count == 1])
    walls = mesh.on(*mesh.names)
    cut = np.setdiff1d(np.unique(sheet.nodes), np.setdiff1d(rim, walls))
    number = np.arange(len(mesh.points))
    number[cut] = len(mesh.points) + np.arange(len(cut))
    on_top = above(mesh.points[block.nodes].mean(axis=1))
    nodes = np.where(on_top[:, None], number[block.nodes], block.nodes)
    points = np.vstack([mesh.points, mesh.points[cut]])
    sides = {names[0]: [sheet.nodes], names[-1]: [number[sheet.nodes]]}
    if len(names) == 1:
        sides = {names[0]: [sheet.nodes, number[sheet.nodes]]}
    patches = [Patch(name, tuple(Cells(sheet.shape, part) for part in parts)) for name, parts in sides.items()]
    whole = Mesh(points, (Cells(block.shape, nodes),), (*mesh.patches, *patches), name="slit")
    return on_own_side(whole, mesh, number)


def on_own_side(whole: Mesh, mesh: Mesh, number) -> Mesh:
    """Give faces of the old patches at the cut the nodes of the cell behind them."""
    (block,) = whole.cells
    faces = np.concatenate([block.nodes[:, list(face)] for face in FACES[block.shape]])
    known = {tuple(sorted(face)) for face in faces.tolist()}
    patches = []
    for patch in whole.patches:
        if patch.name not in mesh.names:
            patches.append(patch)
            continue
        (own,) = patch.faces
        there = np.array([tuple(sorted(face)) in known for face in own.nodes.tolist()])
        patches.append(Patch(patch.name, (Cells(own.shape, np.where(there[:, None], own.nodes, number[own.nodes])),)))
    return replace(whole, patches=tuple(patches))

"""A block of hexahedra of any size with a flap in its floor, written piece by piece as CGNS or as a case of OpenFOAM.

``python -m benchmarks.large_block 464 block.cgns`` writes 1e8 nodes (5.6 GB); 216 nodes along an edge are 1e7. A name
without suffix, such as ``block``, makes a case in binary (1e7 cells: 1.1 GB). The unit
cube's floor has the patch `flap`, a tenth of its edge wide, and `wall` around it; all other sides are `far`. Beside it
``block.npz`` has the displacements of a flap that turns by 15 degrees about its front edge (`sdm deflect --table`).
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing.formats.cgns_hdf5 import create, create_sized
from sdm_deflect.meshing.formats.cgns_nodes import AXES
from sdm_deflect.meshing.formats.cgns_write import write_root
from sdm_deflect.meshing.formats.openfoam import boundary_text, header
from sdm_deflect.meshing.formats.openfoam_files import MESH, FoamPatch
from sdm_deflect.meshing.mesh.faces import FACES

# Where the flap begins and ends along x and y.
LOW, HIGH = 0.45, 0.55
# Width of the flap's edges, in which its displacement falls to nothing.
SIDE = 0.025
DEGREES = 15.0
KIND = np.int32


def write_block(path: Path, count: int) -> None:
    """Write a block of `count` nodes along each edge."""
    cells = (count - 1) ** 3
    with h5py.File(path, "w", track_order=True) as file:
        write_root(file)
        base = create(file, "Base", "CGNSBase_t", np.array([3, 3], dtype=np.int32))
        zone = create(base, "Block", "Zone_t", np.array([[count**3], [cells], [0]], dtype=KIND))
        create(zone, "ZoneType", "ZoneType_t", "Unstructured")
        grid = create(zone, "GridCoordinates", "GridCoordinates_t")
        for column, axis in enumerate(AXES):
            stored = create_sized(grid, axis, count**3, np.float64)
            for layer in range(count):
                stored[layer * count**2 : (layer + 1) * count**2] = points(count, layer)[:, column]
        conditions = create(zone, "ZoneBC", "ZoneBC_t")
        stored = _section(zone, "cells", 17, 1, cells, 8)
        for layer in range(count - 1):
            size = 8 * (count - 1) ** 2
            stored[layer * size : (layer + 1) * size] = hexahedra(count, layer).ravel() + 1
        first = cells + 1
        for name, faces in sides(count):
            _section(zone, name, 7, first, len(faces), 4)[:] = faces.ravel() + 1
            condition = create(conditions, name, "BC_t", "BCWall")
            create(condition, "PointRange", "IndexRange_t", np.array([[first], [first + len(faces) - 1]], dtype=KIND))
            create(condition, "GridLocation", "GridLocation_t", "FaceCenter")
            first += len(faces)
    write_table(path, count)


def write_case(path: Path, count: int) -> None:
    """Write the same as an OpenFOAM case, faces between cells by lower cell, then by higher."""
    folder, cells = path / MESH, count - 1
    folder.mkdir(parents=True)
    (path / "case.foam").touch()
    outer = dict(sides(count))
    inner = 3 * cells**2 * (cells - 1)
    total = inner + sum(map(len, outer.values()))
    patches, first = [], inner
    for name, faces in outer.items():
        patches.append(FoamPatch(name, "wall", len(faces), first))
        first += len(faces)
    (folder / "boundary").write_text(header("polyBoundaryMesh", "boundary") + boundary_text(patches), encoding="utf-8")
    with _list(folder / "points", "vectorField", count**3) as file:
        for layer in range(count):
            points(count, layer).tofile(file)
    with (
        _list(folder / "faces", "faceCompactList", total + 1) as faces_file,
        _list(folder / "owner", "labelList", total) as owner_file,
        _list(folder / "neighbour", "labelList", inner) as neighbour_file,
    ):
        for start in range(0, total + 1, 1 << 20):
            np.arange(4 * start, 4 * min(start + (1 << 20), total + 1), 4, dtype=KIND).tofile(faces_file)
        faces_file.write(b")\n%d\n(" % (4 * total))
        for layer in range(cells):
            nodes, owner, neighbour = between(count, layer)
            nodes.astype(KIND).tofile(faces_file)
            owner.astype(KIND).tofile(owner_file)
            neighbour.astype(KIND).tofile(neighbour_file)
        for faces in outer.values():
            faces.astype(KIND).tofile(faces_file)
            _cell_behind(count, faces).astype(KIND).tofile(owner_file)
    write_table(path, count)


def between(count: int, layer: int) -> tuple[IntArray, IntArray, IntArray]:
    """Return the nodes (F, 4) of faces between cells of a layer and higher ones, and the cells on either side (F,)."""
    nodes, cells = hexahedra(count, layer), count - 1
    own = layer * cells**2 + np.arange(cells**2)
    column, row = own % cells, own // cells % cells
    there = np.column_stack([column < cells - 1, row < cells - 1, np.full(cells**2, layer < cells - 1)])
    corners = [FACES["hexahedron"][side] for side in (1, 3, 5)]
    faces = np.stack([nodes[:, list(side)] for side in corners], axis=1)
    other = own[:, None] + [1, cells, cells**2]
    return faces[there], np.repeat(own, there.sum(axis=1)), other[there]


def _cell_behind(count: int, faces: IntArray) -> IntArray:
    """Return the cell (F,) of faces of the boundary."""
    low = faces.min(axis=1)
    place = (np.minimum(low // count**axis % count, count - 2) for axis in range(3))
    return np.asarray(sum(own * (count - 1) ** axis for axis, own in enumerate(place)))


@contextmanager
def _list(path: Path, kind: str, rows: int) -> Iterator[BinaryIO]:
    """Give a file of OpenFOAM in which the rows of a list are to be written."""
    with path.open("wb") as file:
        file.write(header(kind, path.name, form="binary").encode() + b"%d\n(" % rows)
        yield file
        file.write(b")\n")


def points(count: int, layer: int) -> FloatArray:
    """Return the points (count^2, 3) of one layer; x runs fastest."""
    at = np.arange(count) / (count - 1)
    y, x = np.meshgrid(at, at, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(count**2, at[layer])])


def hexahedra(count: int, layer: int) -> IntArray:
    """Return the nodes ((count - 1)^2, 8) of the cells above one layer."""
    floor = _squares(count) + layer * count**2
    return np.concatenate([floor, floor + count**2], axis=1)


def sides(count: int) -> Iterator[tuple[str, IntArray]]:
    """Yield the patches and their faces (F, 4)."""
    floor, j = _squares(count)[:, ::-1], np.arange(count - 1)
    middle = (np.stack(np.meshgrid(j, j, indexing="ij"), axis=-1).reshape(-1, 2) + 0.5) / (count - 1)
    on_flap = ((middle > LOW) & (middle < HIGH)).all(axis=1)
    yield "flap", floor[on_flap]
    yield "wall", floor[~on_flap]
    top = _squares(count) + (count - 1) * count**2
    x, y, z = 1, count, count**2
    along = np.add.outer(j * z, j * y).ravel()[:, None]
    across = np.add.outer(j * z, j * x).ravel()[:, None]
    far, corners = (count - 1) * np.array([x, y]), [np.array(own) for own in ([0, z, y + z, y], [0, x, x + z, z])]
    left, front = along + corners[0], across + corners[1]
    yield "far", np.concatenate([top, left, left[:, ::-1] + far[0], front, front[:, ::-1] + far[1]])


def write_table(path: Path, count: int) -> None:
    """Write the displacements of a block's flap."""
    flap, vectors = table(count, DEGREES)
    np.savez(path.with_suffix(".npz"), points=flap, vectors=vectors)


def table(count: int, degrees: float) -> tuple[FloatArray, FloatArray]:
    """Return the flap's nodes (K, 3) and their displacements (K, 3): turned about their front edge, held at all."""
    _, faces = next(sides(count))
    flap = points(count, 0)[np.unique(faces)]
    low, high = flap.min(axis=0), flap.max(axis=0)
    angle, arm, edge = np.radians(degrees), flap[:, 0] - low[0], np.minimum(flap - low, high - flap)[:, :2]
    share = np.clip(edge / SIDE, 0.0, 1.0).prod(axis=1)
    share = share * share * (3.0 - 2.0 * share)
    turned = np.column_stack([arm * (np.cos(angle) - 1.0), np.zeros(len(flap)), arm * np.sin(angle)])
    return flap, share[:, None] * turned


def _squares(count: int) -> IntArray:
    """Nodes ((count - 1)^2, 4) of the squares of the lowest layer, seen from above."""
    j = np.arange(count - 1)
    return np.add.outer(j * count, j).ravel()[:, None] + [0, 1, count + 1, count]


def _section(zone: h5py.Group, name: str, kind: int, first: int, cells: int, width: int) -> h5py.Dataset:
    section = create(zone, name, "Elements_t", np.array([kind, 0], dtype=np.int32))
    create(section, "ElementRange", "IndexRange_t", np.array([first, first + cells - 1], dtype=KIND))
    return create_sized(section, "ElementConnectivity", width * cells, KIND)


if __name__ == "__main__":
    out, edge = Path(sys.argv[2]), int(sys.argv[1])
    (write_block if out.suffix else write_case)(out, edge)

"""A block of hexahedra of any size with a flap in its floor, written as CGNS piece by piece.

``python -m benchmarks.large_block 464 block.cgns`` writes 1e8 nodes (5.6 GB); 216 nodes along an edge are 1e7. The unit
cube's floor has the patch `flap`, a tenth of its edge wide, and `wall` around it; all other sides are `far`. Beside it
``block.npz`` has the displacements of a flap that turns by 15 degrees about its front edge (`sdm deflect --table`).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

from sdm_deflect.meshing.formats.cgns_nodes import AXES, create, create_sized
from sdm_deflect.meshing.formats.cgns_write import write_root
from sdm_deflect.meshing.mesh import FloatArray, IntArray

LOW, HIGH = 0.45, 0.55
"""Where the flap begins and ends along x and y."""
SIDE = 0.025
"""Width of the flap's edges, in which its displacement falls to nothing."""
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
    flap, vectors = table(count, DEGREES)
    np.savez(path.with_suffix(".npz"), points=flap, vectors=vectors)


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
    write_block(Path(sys.argv[2]), int(sys.argv[1]))

"""Structured meshes in blocks, and CGNS files of them as mesh generators write them."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, field, replace
from itertools import product

import h5py
import numpy as np

from sdm_deflect.meshing.formats.cgns_hdf5 import create
from sdm_deflect.meshing.formats.cgns_nodes import AXES
from sdm_deflect.meshing.formats.cgns_write import write_root
from tests.meshing.formats.alike import replace_data
from tests.meshing.formats.wing import _points, _section, _span

HINGE = 0.7
FLAP = (0.3, 0.7)


@dataclass(frozen=True, eq=False)
class Block:
    """Points (ni, nj, nk, 3) or (ni, nj, 2), and the numbers (ni, nj, nk) of their places, the same in all blocks.

    `conditions` are (name, family or none, kind, first and last index from 1 along each axis, location); those on faces
    are normal to the third axis.
    """

    name: str
    points: np.ndarray
    places: np.ndarray
    conditions: list[tuple] = field(default_factory=list)

    def transposed(self, *order: int) -> Block:
        """The same block with its axes in another order; a negative one (counted from -1) runs backward."""
        axes = [axis if axis >= 0 else -1 - axis for axis in order]
        dimension = len(axes)
        flips = [k for k, axis in enumerate(order) if axis < 0]
        points = np.flip(self.points.transpose(*axes, dimension), flips)
        places = np.flip(self.places.transpose(*axes), flips)
        conditions = []
        for name, family, kind, begin, end, where in self.conditions:
            low, high = [begin[a] for a in axes], [end[a] for a in axes]
            for k in flips:
                across = where is not None and where.endswith("FaceCenter") and axes[k] != 2
                last = places.shape[k] - across
                low[k], high[k] = last + 1 - high[k], last + 1 - low[k]
            if where in ("IFaceCenter", "JFaceCenter", "KFaceCenter"):
                where = "IJK"[axes.index("IJK".index(where[0]))] + where[1:]
            conditions.append((name, family, kind, low, high, where))
        return replace(self, points=points, places=places, conditions=conditions)

    def flat(self) -> Block:
        """The plane block at the third axis' beginning, without conditions."""
        return replace(self, points=self.points[:, :, 0, :2], places=self.places[:, :, 0], conditions=[])


def sides(places: np.ndarray) -> list[tuple[int, int, np.ndarray]]:
    """Axis, index and places of each side of a block."""
    return [(a, at, np.take(places, at, axis=a)) for a in range(places.ndim) for at in (0, places.shape[a] - 1)]


def interfaces(blocks: list[Block]) -> list[tuple]:
    """(block, other block, begin, end, donor's begin, donor's end, transform) wherever whole sides are one, from 1."""
    found = []
    for a, b in product(range(len(blocks)), repeat=2):
        for (i, at, own), (j, to, other) in product(sides(blocks[a].places), sides(blocks[b].places)):
            if (a, i, at) != (b, j, to) and own.size == other.size and set(own.ravel()) == set(other.ravel()):
                found.append((a, b, *_match(blocks[a].places, i, at, blocks[b].places, j, to)))
    return found


def _match(own, axis, at, other, to_axis, to):
    size = own.shape
    begin = [at if d == axis else 0 for d in range(own.ndim)]
    end = [at if d == axis else size[d] - 1 for d in range(own.ndim)]

    def found(index):
        return np.argwhere((other == own[tuple(index)]) & (np.indices(other.shape)[to_axis] == to))[0]

    turn = [0] * own.ndim
    for d in range(own.ndim):
        if d == axis:  # from inside out here is from outside in there
            turn[d] = (to_axis + 1) * (1 if (at == 0) != (to == 0) else -1)
            continue
        step = list(begin)
        step[d] += 1
        way = found(step) - found(begin)
        turn[d] = int((np.flatnonzero(way)[0] + 1) * way.sum())
    return [i + 1 for i in begin], [i + 1 for i in end], found(begin) + 1, found(end) + 1, turn


def write_blocks(path, blocks: list[Block], kind=np.float64, family_nodes=True, connect=True, dimension=3) -> None:
    """Write a CGNS file in HDF5."""
    with h5py.File(path, "w", track_order=True) as file:
        write_root(file)
        base = create(file, "Base#1", "CGNSBase_t", np.array([dimension, dimension], dtype=np.int32))
        for block in blocks:
            size = np.array(block.places.shape)
            zone = create(base, block.name, "Zone_t", np.stack([size, size - 1, 0 * size]).astype(np.int32))
            create(zone, "ZoneType", "ZoneType_t", "Structured")
            grid = create(zone, "GridCoordinates", "GridCoordinates_t")
            for axis, values in zip(AXES[:dimension], np.moveaxis(block.points, -1, 0), strict=True):
                create(grid, axis, "DataArray_t", np.ascontiguousarray(values.T, dtype=kind))
            conditions = create(zone, "ZoneBC", "ZoneBC_t")
            for name, family, bc, begin, end, where in block.conditions:
                node = create(conditions, name, "BC_t", bc)
                create(node, "PointRange", "IndexRange_t", np.array([begin, end], dtype=np.int32))
                if where:
                    create(node, "GridLocation", "GridLocation_t", where)
                if family:
                    create(node, "FamilyName", "FamilyName_t", family)
        for i, (a, b, begin, end, donor, last, turn) in enumerate(interfaces(blocks) if connect else ()):
            zone = base[blocks[a].name]
            group = (
                zone["ZoneGridConnectivity"]
                if "ZoneGridConnectivity" in zone
                else create(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t")
            )
            node = create(group, f"SF{i}", "GridConnectivity1to1_t", blocks[b].name)
            create(node, "Transform", '"int[IndexDimension]"', np.array(turn, dtype=np.int32))
            create(node, "PointRange", "IndexRange_t", np.array([begin, end], dtype=np.int32))
            create(node, "PointRangeDonor", "IndexRange_t", np.array([donor, last], dtype=np.int32))
        families = dict.fromkeys(own[1] for block in blocks for own in block.conditions if own[1])
        for family in families if family_nodes else ():
            create(create(base, family, "Family_t"), "FamilyBC", "FamilyBC_t", "BCWall")


def in_a_layer(path, axis, third):
    """Give plane blocks three axes, with one point along `axis`, and the same number in the coordinate `third`."""
    with h5py.File(path, "r+") as file:
        base = file["Base#1"]
        base[" data"][...] = [3, 3]
        for zone in (node for node in base.values() if "GridCoordinates" in node):
            size = np.insert(zone[" data"][()], axis, [1, 0, 0], axis=1)
            replace_data(zone, size.astype(np.int32))
            grid = zone["GridCoordinates"]
            for node in grid.values():
                replace_data(node, node[" data"][()].reshape(size[0, ::-1]))
            given = iter([node[" data"][()] for node in grid.values()])
            for name in AXES:
                values = np.full(size[0, ::-1], 2.5) if name == third else next(given)
                if name in grid:
                    replace_data(grid[name], values)
                else:
                    create(grid, name, "DataArray_t", values)
            for node in (*zone["ZoneBC"].values(), *zone.get("ZoneGridConnectivity", {}).values()):
                for name in {"PointRange", "PointRangeDonor"} & set(node):
                    replace_data(node[name], np.insert(node[name][" data"][()], axis, 1, axis=1).astype(np.int32))
                if "Transform" in node:
                    turn = [way + np.sign(way) * (abs(way) > axis) for way in node["Transform"][" data"][()]]
                    replace_data(node["Transform"], np.insert(turn, axis, axis + 1).astype(np.int32))


def wing_blocks(cells: int = 4, layers: int = 6) -> list[Block]:
    """A wing between two planes in an O-grid of nine blocks, the axes of which differ; its flap spans `FLAP`.

    Round the section there are the upper side, the lower side and the blunt base; along the span three pieces.
    """
    section, span = _section(HINGE, cells), _span(FLAP, cells)
    points = _points(section, span, 1e-3, layers).transpose(1, 2, 0, 3)
    closed = np.concatenate([points, points[:1]])
    numbers = np.arange(points[..., 0].size).reshape(points.shape[:3])
    numbers = np.concatenate([numbers, numbers[:1]])
    nose = len(section) // 2
    rounds = {"upper": (0, nose), "lower": (nose, len(section) - 1), "base": (len(section) - 1, len(section))}
    cuts = [0, *(int(np.argmin(np.abs(span - y))) for y in FLAP), len(span) - 1]
    found = []
    for side, (a, b) in rounds.items():
        for k in range(3):
            part = np.s_[a : b + 1, cuts[k] : cuts[k + 1] + 1]
            found.append(_block(f"{side}-{k}", closed[part], numbers[part], cells, k))
    turns = [(0, 1, 2), (0, 1, -3), (1, 0, 2), (2, 0, 1), (-1, 1, 2), (2, 1, 0), (1, 2, 0), (0, 2, 1), (-2, -1, -3)]
    return [block.transposed(*turn) for block, turn in zip(found, turns, strict=True)]


def _block(named: str, points: np.ndarray, places: np.ndarray, cells: int, piece: int) -> Block:
    side = named.split("-")[0]
    ni, nj, nk = places.shape
    conditions = []
    behind = {"upper": (1, cells + 1), "lower": (ni - cells, ni), "base": (1, ni)}[side]
    if piece == 1:
        conditions.append((f"flap-{side}", "flap", "BCWallViscous", (behind[0], 1, 1), (behind[1], nj, 1), None))
        if side == "upper":
            conditions.append(("wing-front", "wing", "BCWall", (behind[1], 1, 1), (ni - 1, nj - 1, 1), "KFaceCenter"))
        if side == "lower":
            conditions.append(("wing-front", "wing", "BCWall", (1, 1, 1), (behind[0], nj, 1), "Vertex"))
    else:
        conditions.append(("wing-part", "wing", "FamilySpecified", (1, 1, 1), (ni - 1, nj - 1, 1), "FaceCenter"))
    conditions.append(("outer", "far", "BCFarfield", (1, 1, nk), (ni, nj, nk), None))
    if piece != 1:
        name, at = ("root", 1) if piece == 0 else ("end", nj)
        conditions.append((name, name, "BCSymmetryPlane", (1, at, 1), (ni, at, nk), None))
    return Block(named, points, places, conditions)


def cube(name: str = "block", n=(4, 3, 5), at=(0.0, 0.0, 0.0), places: int = 0, conditions=()) -> Block:
    """A block of unit cells from a corner on, whose places are numbered on from one."""
    grid = np.stack(np.meshgrid(*(np.arange(k, dtype=float) for k in n), indexing="ij"), axis=-1) + at
    return Block(name, grid + 0.01 * np.sin(grid * 3.0), places + np.arange(np.prod(n)).reshape(n), list(conditions))


def two_blocks(gap: float = 0.0) -> list[Block]:
    """Two blocks side by side along x, which share a side."""
    left, right = cube("left"), cube("right", places=1000, at=(3.0 + gap, 0.0, 0.0))
    right.places[0] = left.places[-1]
    right.points[0] += left.points[-1] - right.points[0] + [gap, 0.0, 0.0]
    return [left, right]


def stored(path):
    """Coordinates (K, 3) of each zone, in the file's order."""
    with h5py.File(path) as file:
        zones = [node for node in file["Base#1"].values() if "GridCoordinates" in node]
        return {
            zone.name: np.stack([zone["GridCoordinates"][axis][" data"][()].ravel() for axis in AXES], axis=1)
            for zone in zones
        }


def complaints(path):
    done = subprocess.run(["cgnscheck", "-v", path], capture_output=True, text=True, check=True)
    assert "checking complete" in done.stdout
    known = ("WARNING:dataclass not given", "WARNING:use [IJK]FaceCenter with Structured grids")
    lines = [line for line in done.stdout.splitlines() if line.startswith(("ERROR", "WARNING"))]
    return [line for line in lines if line not in known]

"""PLOT3D grids (.p3d, .xyz, .x, .g, .ufmt): blocks of hexahedra, text and binary."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import prod
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.mesh import Cells, Mesh, Patch
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.cgns_blocks import AXES, Plane, Size, cells, faces
from sdm_deflect.meshing.formats.cgns_interfaces import NEAR
from sdm_deflect.meshing.formats.fitted import Fitted, Part, fitted
from sdm_deflect.meshing.formats.format import about, check_points, only_rewritten
from sdm_deflect.meshing.formats.plot3d_file import Plot3dFile
from sdm_deflect.meshing.formats.plot3d_map import ONE_TO_ONE, PATCHED, SINGULAR, UNPROCESSED, Entry, Range, map_of
from sdm_deflect.meshing.formats.shapes import oriented
from sdm_deflect.meshing.mesh import FloatArray, IntArray

Pair = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Plot3d:
    """Blocks of hexahedra, left- or right-handed; those that meet point by point are one zone.

    How a file is stored follows from its counts and its length. Two faces of cells whose corners are at the very same
    places are one face, unless the map says that they are boundaries; so are faces that the map pairs, ``ONE_TO_ONE``,
    if they are near enough. Patches are named by the map (`map_of`): faces of one name are one patch. All others are
    ``block1/imin``, ``block1/imax`` and so on. IBLANK is no part of the mesh; a rewritten file keeps it.
    """

    name: str = "plot3d"
    suffixes: tuple[str, ...] = (".p3d", ".xyz", ".x", ".g", ".ufmt")

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`; a damaged map is a MeshFileError, too."""
        with about(path), path.open("rb") as file:
            found = Plot3dFile.opened(file, partial(progress, f"reading {path.name}"))
            return put_together(found.points(), found.layout.sizes, map_of(path, found.layout.sizes)).mesh

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; points of several blocks that are one get the same numbers.

        Of coordinates in text, each that changed is written with as many digits as it needs, with an exponent where it
        had one. Single precision stays single.
        """
        report = partial(progress, f"writing {out.name}")
        with fresh(out, source) as beside, about(source), source.open("rb") as file, beside.open("wb") as copy:
            found = Plot3dFile.opened(file, report)
            old = found.points()
            whole = put_together(old, found.layout.sizes, map_of(source, found.layout.sizes))
            check_points(points, len(whole.first))
            changed = (points != old[whole.first])[whole.index]
            found.copy_moved(points[whole.index], changed, copy)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """Refuse it with a MeshFileError: a mesh from elsewhere has no blocks."""
        raise only_rewritten(out)


def put_together(points: FloatArray, sizes: Sequence[Size], said: Sequence[Entry]) -> Fitted:
    """Return the mesh of blocks with these points (F, 3), one after another, of these sizes.

    ValueError for coordinates that are not finite.
    """
    starts = np.cumsum([0, *map(prod, sizes)]).tolist()
    parts, loose = [], []
    for i, size in enumerate(sizes):
        part, rest = _block(i, size, points[starts[i] : starts[i + 1]], said)
        parts.append(part)
        loose.append(np.concatenate([np.empty((0, 4), np.intp), *(own.nodes + starts[i] for own in rest)]))
    touching, same = _meeting(points, loose)
    for own in said:
        if own.kind in (ONE_TO_ONE, PATCHED):
            ends = tuple(end.block for end in own.ranges)
            rows = _paired(points, own.ranges, sizes, starts) if own.kind == ONE_TO_ONE else None
            if rows is not None:
                same.append(rows)
            if rows is not None or own.kind == PATCHED:
                touching.append((ends[0], ends[1]))
    return fitted(parts, touching, same)


def _block(number: int, size: Size, points: FloatArray, said: Sequence[Entry]) -> tuple[Part, list[Cells]]:
    """A block by itself, and its outer faces that may be of another block, too."""
    own = cells(size)
    turned = oriented(points, own)
    free = {
        (axis, at): np.ones(prod(size[d] - 1 for d in range(3) if d != axis), dtype=np.bool_)
        for axis in range(3)
        for at in (0, size[axis] - 1)
    }
    named: dict[str, list[Cells]] = {}
    for entry in said:
        if entry.kind in (ONE_TO_ONE, PATCHED, UNPROCESSED) or entry.ranges[0].block != number:
            continue
        plane = entry.ranges[0].plane(size)
        mask = free[plane.axis, plane.at]
        rows = plane.rows[mask[plane.rows]]
        mask[rows] = False
        if entry.kind not in SINGULAR and len(rows):
            named.setdefault(entry.name, []).append(faces(size, Plane(plane.axis, plane.at, rows), turned is not own))
    name, rest = f"block{number + 1}", {}
    for (axis, at), mask in free.items():
        if len(rows := np.flatnonzero(mask)):
            side = f"{name}/{AXES[axis]}{'max' if at else 'min'}"
            rest[side] = faces(size, Plane(axis, at, rows), turned is not own)
    patches = [Patch(key, tuple(blocks)) for key, blocks in named.items()]
    patches += [Patch(side, (block,)) for side, block in rest.items()]
    return Part(name, Mesh(points, (turned,), tuple(patches)), frozenset(named)), list(rest.values())


def _meeting(points: FloatArray, loose: Sequence[IntArray]) -> tuple[list[Pair], list[IntArray]]:
    """Pairs of blocks that have a face in common, and rows (K, 2) of points that are one.

    `loose` are the faces (M, 4) of each block; two are one if their corners are at the very same places.
    """
    every, block = np.concatenate(loose), np.repeat(np.arange(len(loose)), [len(own) for own in loose])
    if not len(every):
        return [], []
    nodes = np.unique(every)
    _, place = np.unique(points[nodes] + 0.0, axis=0, return_inverse=True)  # -0 is 0
    corners = np.sort(place.ravel()[np.searchsorted(nodes, every)], axis=1)
    solid = np.count_nonzero(np.diff(corners, axis=1), axis=1) >= 2  # three different corners
    _, label, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    rows = np.flatnonzero(solid & (count[label.ravel()] == 2))
    rows = rows[np.argsort(label.ravel()[rows], kind="stable")]
    pairs = np.unique(block[rows].reshape(-1, 2), axis=0)
    shared = np.unique(every[rows])
    at = place.ravel()[np.searchsorted(nodes, shared)]
    order = np.argsort(at, kind="stable")
    again = np.flatnonzero(np.diff(at[order]) == 0)
    return [(int(a), int(b)) for a, b in pairs], [np.stack([shared[order][again], shared[order][again + 1]], axis=1)]


def _paired(points: FloatArray, ends: Sequence[Range], sizes: Sequence[Size], starts: Sequence[int]) -> IntArray | None:
    """Rows (K, 2) of points of two faces that are one; None if they lie elsewhere: the interface is periodic."""
    here, there = (end.points(sizes[end.block]) + starts[end.block] for end in ends)
    gap, nearest = cKDTree(points[there]).query(points[here])
    distance = np.linalg.norm(points[here], axis=1)
    if len(here) != len(there) or np.any(gap > NEAR * np.maximum(distance, np.median(distance))):
        return None
    return np.stack([here, there[nearest]], axis=1)

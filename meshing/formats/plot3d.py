"""PLOT3D grids: blocks of hexahedra, or of quadrilaterals in a plane; text and binary."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Cells, Mesh, Patch
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.cgns_blocks import AXES, BlockFace, Size, cells, collapsed, faces
from sdm_deflect.meshing.formats.cgns_interfaces import NEAR, meeting
from sdm_deflect.meshing.formats.fitted import Fitted, ZoneMesh, fitted
from sdm_deflect.meshing.formats.format import about, check_points, fewest_bits
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.numbers import copy_text
from sdm_deflect.meshing.formats.plot3d_file import Plot3dFile, kind_of, styled
from sdm_deflect.meshing.formats.plot3d_map import (
    ONE_TO_ONE,
    PATCHED,
    UNPROCESSED,
    WITHOUT,
    IndexRange,
    MapEntry,
    map_of,
    maps,
)
from sdm_deflect.meshing.formats.rewriting import rewritten
from sdm_deflect.meshing.formats.shapes import oriented

NO_PAIRS = np.empty((0, 2), dtype=np.intp)


@registered("plot3d", ".p3d", ".p3dfmt", ".p2d", ".p2dfmt", ".xyz", ".x", ".g", ".ufmt", written=False)
class Plot3d(Format):
    """Blocks of hexahedra, or of quadrilaterals in a plane, left- or right-handed; those that meet are one zone.

    How a file is stored follows from its counts and its length. Two faces of cells whose corners are at the very same
    places are one face, unless the map says that they are boundaries; so are faces that the map pairs, ``ONE_TO_ONE``,
    if they are near enough. Faces that only touch, ``PATCHED``, are on no patch. Patches are named by the map
    (`map_of`): faces of one name are one patch. All others are ``block1/imin``, ``block1/imax`` and so on. IBLANK is no
    part of the mesh; a rewritten file keeps it.
    """

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`; a damaged map is a MeshFileError, too."""
        return _read(path, path, progress)

    def read_copy(self, path: Path, source: Path) -> Mesh:
        """See `Format.read_copy`; the map is that of the source."""
        return _read(path, source)

    def files(self, path: Path) -> Iterable[Path]:
        """See `Format.files`."""
        return path, *maps(path)

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        with about(source or out), (source or out).open("rb") as file:
            return fewest_bits(kind_of(file))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; points of several blocks that are one get the same numbers.

        Of coordinates in text, each that changed is written with as many digits as it needs, with an exponent where it
        had one. Single precision stays single.
        """
        report = partial(progress, f"writing {out.name}")
        with about(source), source.open("rb") as file:
            stored = Plot3dFile.opened(file, report)
            old = stored.points()
            joined = put_together(old, stored.sizes, map_of(source, stored.sizes))
            check_points(points, len(joined.first))
            new, changed = points[joined.index], (points != old[joined.first])[joined.index]
            changes = None if stored.values is not None else tuple(stored.changes(source, new, changed))
        if changes is not None:
            rewritten(source, changes, out, progress)
            return
        with fresh(out, source) as beside, about(source), source.open("rb") as file, beside.open("wb") as copy:
            copy_text(file, replace(stored, file=file).placed(), stored.moved(new, changed), copy, styled)


def _read(path: Path, mapped: Path, progress: Progress = silent) -> Mesh:
    """Return the mesh of a grid with the map beside a grid `mapped`."""
    with about(path), path.open("rb") as file:
        found = Plot3dFile.opened(file, partial(progress, f"reading {path.name}"))
        return put_together(found.points(), found.sizes, map_of(mapped, found.sizes)).mesh


def put_together(points: FloatArray, sizes: Sequence[Size], said: Sequence[MapEntry]) -> Fitted:
    """Return the mesh of blocks with these points (F, 3), one after another, of these sizes.

    ValueError for coordinates that are not finite.
    """
    starts = np.cumsum([0, *map(prod, sizes)])
    parts, free, same = [], [], []
    for i, size in enumerate(sizes):
        own = points[starts[i] : starts[i + 1]]
        part, rest = _block(i, size, own, said)
        parts.append(part)
        free += [faces.nodes + starts[i] for faces in rest]
        same.append(collapsed(own, size) + starts[i])
    found = meeting(points, np.concatenate(free)) if free else np.empty((0, 2), np.intp)
    same.append(found)
    touching = np.unique(np.searchsorted(starts, found, side="right") - 1, axis=0).tolist()
    for entry in said:
        if entry.kind in (ONE_TO_ONE, PATCHED) and entry.ranges[0].axis < len(sizes[0]):
            rows = _paired(points, entry.ranges, sizes, starts) if entry.kind == ONE_TO_ONE else NO_PAIRS
            if rows is not None:
                same.append(rows)
                touching.append([end.block for end in entry.ranges])
    return fitted(parts, touching, list(filter(len, same)))


def _block(number: int, size: Size, points: FloatArray, said: Sequence[MapEntry]) -> tuple[ZoneMesh, list[Cells]]:
    """A block by itself, and its outer faces that may be of another block, too."""
    own = cells(size)
    turned = oriented(points, own)
    left_handed = bool(2 * np.count_nonzero(turned.nodes[:, 1] != own.nodes[:, 1]) > len(own))
    free = _sides(size)
    named: dict[str, list[Cells]] = {}
    for entry, plane in _bounded(said, number, size):
        mask = free[plane.axis, plane.at]
        rows = plane.rows[mask[plane.rows]]
        mask[rows] = False
        if entry.kind not in WITHOUT and len(rows):
            named.setdefault(entry.name, []).append(faces(size, BlockFace(plane.axis, plane.at, rows), left_handed))
    rest = {
        f"block{number + 1}/{AXES[axis]}{'max' if at else 'min'}": faces(size, BlockFace(axis, at, rows), left_handed)
        for (axis, at), mask in free.items()
        if len(rows := np.flatnonzero(mask))
    }
    patches = [Patch(name, tuple(blocks)) for name, blocks in named.items()]
    patches += [Patch(name, (block,)) for name, block in rest.items()]
    part = ZoneMesh(f"block{number + 1}", Mesh(points, (turned,), tuple(patches)), frozenset(named), block=True)
    return part, list(rest.values())


def _sides(size: Size) -> dict[tuple[int, int], BoolArray]:
    """Return by axis and number of points on it a mask (F,) of the faces on each side of a block; all are marked."""
    return {
        (axis, at): np.ones(prod(n - 1 for d, n in enumerate(size) if d != axis), dtype=np.bool_)
        for axis in range(len(size))
        for at in (0, size[axis] - 1)
    }


def _bounded(said: Sequence[MapEntry], number: int, size: Size) -> Iterator[tuple[MapEntry, BlockFace]]:
    """Yield what is said of sides of a block that are no interfaces, each with the faces that it is said of."""
    for entry in said:
        if entry.kind not in (ONE_TO_ONE, UNPROCESSED):
            for end in entry.ranges:
                if end.block == number and end.axis < len(size):
                    yield entry, end.plane(size)


def _paired(points: FloatArray, ends: Sequence[IndexRange], sizes: Sequence[Size], starts: IntArray) -> IntArray | None:
    """Rows (K, 2) of points of two faces that are one; None if they lie elsewhere: the interface is periodic."""
    here, there = (end.points(sizes[end.block]) + starts[end.block] for end in ends)
    gap, nearest = cKDTree(points[there]).query(points[here])
    distance = np.linalg.norm(points[here], axis=1)
    if len(here) != len(there) or np.any(gap > NEAR * np.maximum(distance, np.median(distance))):
        return None
    return np.stack([here, there[nearest]], axis=1)

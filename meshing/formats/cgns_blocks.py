"""Blocks of a CGNS file: structured zones, their cells and the faces that conditions and interfaces name.

A block has size[d] points along axis d; points are stored with the first axis fastest. Its faces lie in planes of the
grid, on which one index is constant. A block with one point along one of three axes is plane; the other axes are
`wide`. SIDS, sections 6.3 (Zone_t), 8.2 (GridConnectivity1to1_t) and 9.3 (BC_t).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import Cells, Constraint, Patch

from .cgns_boundary import Border, Fault, as_faults, check_range, constraint, location, named_conditions, place_of
from .cgns_nodes import check_taken, child, integers
from .zones import common_constraints

Size = tuple[int, ...]
Indices = Sequence[int] | IntArray
AXES = "ijk"
# The axis normal to the faces, by the location that a condition names.
LOCATIONS = {"IFaceCenter": 0, "JFaceCenter": 1, "KFaceCenter": 2}
# Cells and faces by the number of axes.
SHAPES = {2: ("quad", "line"), 3: ("hexahedron", "quad")}
# Corners of a cell from its first one, in VTK's order; those of a face are the same with one axis less.
CORNERS = {
    2: ((0, 0), (1, 0), (1, 1), (0, 1)),
    3: ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
}
# Masks of the outer faces that are on no patch yet, by axis and plane number.
Sides = dict[tuple[int, int], BoolArray]


@dataclass(frozen=True, slots=True, eq=False)
class BlockFace:
    """Faces `rows` (R,) of the plane whose index along `axis` is `at`; of the other axes the first is fastest."""

    axis: int
    at: int
    rows: IntArray = field(repr=False)


def size_of(zone: Any, dimensions: int) -> Size:
    """Return the number of points along each axis; MeshFileError if the block has no cells or its sizes are damaged."""
    sizes = integers(zone).tolist()
    if len(sizes) != 3 * dimensions or min(sizes[:dimensions]) < 0:
        raise MeshFileError(f"its size {sizes} does not fit {dimensions} axes; the file is damaged")
    size = tuple(sizes[:dimensions])
    if 0 in size or len(wide(size)) < 2:
        raise no_cells(size)
    return size


def no_cells(size: Size) -> MeshFileError:
    """Return the error of a block with too few points along an axis."""
    return MeshFileError(f"its {_times(size)} points hold no cells: 2 are needed along each axis")


def wide(size: Size) -> list[int]:
    """Return the axes along which a block has two points or more."""
    return [axis for axis, n in enumerate(size) if n != 1]


def cells(size: Size) -> Cells:
    """Return all cells of a block, the first axis fastest."""
    first = _numbers([np.arange(max(n - 1, 1)) for n in size], size)
    return Cells(SHAPES[len(wide(size))][0], first[:, None] + _steps(size, wide(size)))


def faces(size: Size, plane: BlockFace, left_handed: bool) -> Cells:
    """Return the faces of a plane; on the outside of a block their normals point out of it."""
    others = _others(size, plane.axis)
    places = np.unravel_index(plane.rows, _faces_along(size, plane.axis), order="F")
    step = strides(size)
    first = plane.at * step[plane.axis] + sum(at * step[axis] for at, axis in zip(places, others, strict=True))
    nodes = np.asarray(first, dtype=np.intp)[:, None] + _steps(size, others)
    forward = (plane.at > 0) ^ (wide(size).index(plane.axis) == 1) ^ left_handed
    return Cells(SHAPES[len(others) + 1][1], nodes if forward else nodes[:, ::-1])


def block_border(base: Any, zone: Any, size: Size, left_handed: bool) -> tuple[Border, list[Patch]]:
    """Return the patches of a block, and the faces on no patch by side (``"imin"``).

    A condition belongs to the patch of its family's name where it names a family, else to one of its own name. A face
    that several conditions have is of the first.
    """
    free: Sides = {}
    for axis in wide(size):
        for at in (0, size[axis] - 1):
            free[axis, at] = np.ones(prod(_faces_along(size, axis)), dtype=np.bool_)
    by_patch: dict[str, list[Cells]] = {}
    faults: list[Fault] = []
    families, numbers, constraints = set(), 0, list[tuple[str, Constraint]]()
    for name, node, patch, of_family in named_conditions(base, zone, faults, always=True):
        families |= {patch} if of_family else set()
        constraints.append((patch, constraint(base, node)))
        with as_faults(faults, name, patch, of_family):
            for plane in list(_planes(node, size)):
                numbers += len(plane.rows)
                check_taken(zone, 64 * numbers, "what its boundary conditions name")
                rows = _take_free(plane, free)
                if len(rows):
                    by_patch.setdefault(patch, []).append(
                        faces(size, BlockFace(plane.axis, plane.at, rows), left_handed)
                    )
    rest = [
        Patch(f"{AXES[axis]}{'max' if at else 'min'}", (faces(size, BlockFace(axis, at, rows), left_handed),))
        for (axis, at), mask in free.items()
        if len(rows := np.flatnonzero(mask))
    ]
    kinds = common_constraints(constraints)
    patches = [Patch(name, tuple(patch_faces), constraint=kinds[name]) for name, patch_faces in by_patch.items()]
    return Border(patches, frozenset(families), faults), rest


def equal_neighbours(points: FloatArray, size: Size) -> IntArray:
    """Return pairs (K, 2) of neighbouring points on a side of the block that are at the same place."""
    grid = np.arange(len(points)).reshape(size, order="F")
    pairs = [np.empty((0, 2), dtype=np.intp)]
    for axis in wide(size):
        for side in (np.take(grid, [0], axis), np.take(grid, [-1], axis)):
            for along in range(side.ndim):
                ahead = np.moveaxis(side, along, 0)
                behind, before = ahead[:-1].ravel(), ahead[1:].ravel()
                same = (points[behind] == points[before]).all(axis=1)
                pairs.append(np.stack([behind[same], before[same]], axis=1))
    return np.concatenate(pairs)


def points_in(begin: Indices, end: Indices, size: Size) -> IntArray:
    """Return the numbers (K,) of the points from `begin` to `end` (counted from 0), the first axis fastest."""
    return _numbers([_count(a, b) for a, b in zip(begin, end, strict=True)], size)


def donors_of(
    begin: Sequence[int], end: Sequence[int], donor: Sequence[int], turn: Sequence[int], size: Size
) -> IntArray:
    """Return the numbers (K,) of the points in another block of `size` that points `begin` to `end` lie on.

    Point `begin` lies on point `donor` of that block; axis a runs along its axis abs(turn[a]) - 1, backward if that is
    negative. MeshFileError if they are not all in that block.
    """
    at: list[Any] = list(donor)
    shape = [abs(b - a) + 1 for a, b in zip(begin, end, strict=True)]
    for axis, (a, b, way) in enumerate(zip(begin, end, turn, strict=True)):
        along = (_count(a, b) - a) * (1 if way > 0 else -1)
        at[abs(way) - 1] = at[abs(way) - 1] + along.reshape([-1 if d == axis else 1 for d in range(len(shape))])
    for values, n in zip(at, size, strict=True):
        if np.min(values) < 0 or np.max(values) >= n:
            raise MeshFileError(f"it lies on points beyond the {_times(size)} of the other block")
    numbers = sum(values * stride for values, stride in zip(at, strides(size), strict=True))
    return np.asarray(np.broadcast_to(numbers, shape), dtype=np.intp).ravel(order="F")


def faces_at(begin: Indices, end: Indices, where: str, size: Size) -> IntArray:
    """Return the points (K,), some repeated, of the faces (``FaceCenter``, ...) from `begin` to `end`."""
    planes = _plane_of_range(begin, end, where, size)
    return np.concatenate([np.empty(0, dtype=np.intp), *(faces(size, plane, False).nodes.ravel() for plane in planes)])


def check_face(begin: Indices, end: Indices, size: Size) -> None:
    """Refuse (MeshFileError) a range of points that is on no face of a block."""
    if not any(begin[axis] == end[axis] for axis in wide(size)):
        raise MeshFileError("its range is no face of the block")


def bounds(node: Any, place: str, size: Size) -> tuple[list[int], list[int]]:
    """Return the first and the last indices of a range, counted from 0; MeshFileError if they are not in the block."""
    values = integers(child(node, place))
    if len(values) != 2 * len(size):
        raise MeshFileError(f"its {place} has {len(values)} numbers, expected {2 * len(size)}")
    begin, end = values[: len(size)].tolist(), values[len(size) :].tolist()
    check_range(begin, end, size)
    if min(*begin, *end) < 1 or any(max(a, b) > n for a, b, n in zip(begin, end, size, strict=True)):
        raise MeshFileError(
            f"it is on the points ({', '.join(map(str, begin))}) to ({', '.join(map(str, end))}) of a block of "
            f"{_times(size)}"
        )
    return [a - 1 for a in begin], [b - 1 for b in end]


def _planes(node: Any, size: Size) -> Iterator[BlockFace]:
    place, where = place_of(node), location(node)
    if place.startswith("Element"):
        raise MeshFileError("it does not say where it is on the block")
    if where == "EdgeCenter" and len(wide(size)) > 2:
        return
    if place == "PointRange":
        yield from _plane_of_range(*bounds(node, place, size), where, size)
        return
    values = integers(child(node, place)) - 1
    if len(values) % len(size):
        raise MeshFileError(f"its {place} has {len(values)} numbers, no multiple of {len(size)}")
    at = values.reshape(-1, len(size))
    if len(at) and (at.min() < 0 or np.any(at >= size)):
        raise MeshFileError(f"it is on points beyond the {_times(size)} of the block")
    yield from _planes_of_points(at, size) if where == "Vertex" else _planes_of_faces(at, where, size)


def _plane_of_range(
    begin: Sequence[int] | IntArray, end: Sequence[int] | IntArray, where: str, size: Size
) -> Iterator[BlockFace]:
    """Yield the faces of a range; an edge, a point, or a whole plane block has none."""
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    plane = _face_axis(low, high, where, size)
    if plane is None:  # by points, or faces told by the points around them
        flat = [d for d in wide(size) if low[d] == high[d]]
        if not flat and len(wide(size)) == len(size):
            raise MeshFileError("its range is no face of the block")
        if len(flat) != 1:  # an edge or a point; or a plane block itself
            return
        axis, at, high = flat[0], int(low[flat[0]]), high - 1
    else:
        axis, at = plane
    rows = _numbers([np.arange(low[d], high[d] + 1) for d in _others(size, axis)], _faces_along(size, axis))
    yield BlockFace(axis, at, rows)


def _face_axis(low: IntArray, high: IntArray, where: str, size: Size) -> tuple[int, int] | None:
    """Return axis and index of the plane of a range of faces or boundary cells; None for a range of points."""
    if where == "Vertex":
        return None
    axes = [axis for axis in wide(size) if LOCATIONS.get(where, axis) == axis]
    fit = [plane for axis in axes if (plane := _across(axis, low, high, where, size))]
    return min(fit)[1:] if fit else None


def _across(axis: int, low: IntArray, high: IntArray, where: str, size: Size) -> tuple[bool, int, int] | None:
    """Return whether a range covers only a part of its plane, with the plane's axis and index; None without a plane."""
    last = size[axis] - (2 if where == "CellCenter" else 1)
    others = _others(size, axis)
    outer = low[axis] in (0, last) or where in LOCATIONS
    if low[axis] != high[axis] or not outer or any(high[d] > size[d] - 2 for d in others):
        return None
    whole = all(low[d] == 0 and high[d] == size[d] - 2 for d in others)
    return not whole, axis, size[axis] - 1 if low[axis] == last > 0 else int(low[axis])


def _planes_of_points(at: IntArray, size: Size) -> Iterator[BlockFace]:
    """Yield the faces on the outside of a block all of whose corners are among points (K, axes)."""
    numbers = np.unique(at @ strides(size))
    at = np.stack(np.unravel_index(numbers, size, order="F"), axis=1)
    for axis in wide(size):
        others = _others(size, axis)
        along = _faces_along(size, axis)
        for number in (0, size[axis] - 1):
            first = (at[:, axis] == number) & (at[:, others] < along).all(axis=1)
            corners = numbers[first, None] + _steps(size, others)
            whole = at[first][np.isin(corners, numbers).all(axis=1)]
            yield BlockFace(axis, number, whole[:, others] @ strides(along))


def _planes_of_faces(at: IntArray, where: str, size: Size) -> Iterator[BlockFace]:
    """Yield the faces at indices (K, axes), which are constant along the named axis, or else along one of them."""
    low, high = at.min(axis=0, initial=max(size)), at.max(axis=0, initial=0)
    plane = _face_axis(low, high, where, size) if len(at) else None
    if plane is None:
        raise MeshFileError("its list of faces is on no side of the block; give it by ranges, one for each side")
    axis, number = plane
    yield BlockFace(axis, number, np.unique(at[:, _others(size, axis)] @ strides(_faces_along(size, axis))))


def _take_free(plane: BlockFace, free: Sides) -> IntArray:
    """Return the faces of a plane that are on no patch yet, and mark them as taken; inner faces are always free."""
    mask = free.get((plane.axis, plane.at))
    if mask is None:
        return plane.rows
    rows = plane.rows[mask[plane.rows]]
    mask[rows] = False
    return rows


def _count(begin: int, end: int) -> IntArray:
    return np.arange(begin, end + 1) if end >= begin else np.arange(begin, end - 1, -1)


def _faces_along(size: Size, axis: int) -> Size:
    """Return the number of faces in a plane along each of its two axes."""
    return tuple(size[d] - 1 for d in _others(size, axis))


def _others(size: Size, axis: int) -> list[int]:
    return [d for d in wide(size) if d != axis]


def strides(size: Size) -> IntArray:
    """Return by how much the numbers of neighbouring points along each axis differ."""
    return np.concatenate([[1], np.cumprod(size[:-1])]).astype(np.intp)


def _steps(size: Size, axes: Sequence[int]) -> IntArray:
    """Return the offsets of the corners of a cell, or of a face along these axes, from its first corner."""
    corners = CORNERS[len(axes)] if len(axes) > 1 else ((0,), (1,))
    return np.array(corners, dtype=np.intp) @ strides(size)[list(axes)]


def _numbers(along: Sequence[IntArray], size: Size) -> IntArray:
    """Return the numbers of all points whose indices are among those along each axis, the first axis fastest."""
    total: IntArray = np.zeros(1, dtype=np.intp)
    for indices, stride in zip(along, strides(size), strict=True):
        total = (total[None, :] + stride * indices[:, None]).ravel()
    return total


def _times(size: Sequence[int]) -> str:
    return " x ".join(map(str, size))

"""Content of the page's turnable picture: JSON, and arrays of coordinates in single precision."""

import json
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from gzip import compress
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct, union
from sdm_deflect.cases.run.metrics import Json
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.surface.motions import Fixed, Powers, Turn
from sdm_deflect.deform.volume.controls import ControlRange
from sdm_deflect.meshing.formats.polyhedra import faces_by_cell
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polyhedra, Volume
from sdm_deflect.meshing.mesh.crossing import IntersectingFaces
from sdm_deflect.meshing.mesh.edges import area_vectors, edges_of, polygons_of, sharp_edges
from sdm_deflect.meshing.mesh.faces import FACES
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_of
from sdm_deflect.meshing.mesh.standard import parts_of

from . import colours
from .data import Box, MovedSurface, ReportData, diagonal, measure_in_words
from .slices import BOX_EDGES, triangles_of

# Largest number of cells in the page, the worst of all boxes, in space and in a plane: a browser draws them. With many
# surfaces, whose fields take most of the page, there are fewer.
MOST_CELLS, MOST_OF_MANY, MOST_PLANE = 6_500, 4_000, 25_000
# Largest number of triangles of a patch; outside of the boxes larger ones are thinned to about that.
MOST_TRIANGLES = 4_000
# Largest number of sites, or of centres, of one kind in the page.
MOST_DOTS = 3_000
# Margin around the scene, as a share of its largest extent: without it, what touches the end of an axis is clipped.
EDGE = 0.02
# Drawn height of the hexahedron around a plane mesh, as a share of its own.
FLAT = 1e-3
# Share of the largest displacement that the tip of a surface has at least, at which its label stands. The tip of a
# swept tail moves less than the ends of its root.
FAR = 0.35
# Number of amounts at which a page stores a track's functions; it interpolates between them.
SAMPLES = 501
# Edges at which faces turn by more degrees stay as they are in thinned patches.
CREASE = 20.0
# Corners of the triangles on the outside of each shape.
TABLES = {
    shape: [k for face in faces for i in range(1, len(face) - 1) for k in (face[0], face[i], face[i + 1])]
    for shape, faces in FACES.items()
} | {"triangle": [0, 1, 2], "quad": [0, 1, 2, 0, 2, 3]}
# Names of the arrays, and lists of arrays, in a scene.
ARRAYS = frozenset((
    "points", "points_low", "at", "fields", "fields_low", "rest", "rest_low", "unrepaired", "faces", "edges", "cell",
    "rows", "qualities", "segments",
))  # fmt: skip
# Arrays that a page does not get: nodes of the mesh.
KEPT = frozenset(("nodes",))
# Shares of the coordinates: smaller differences from what the page computes are left out, of patches and of cells.
SEEN, EXACT = 2.0**-24, 1e-13
# From this number of surfaces on, fields have no remainders, unless single precision would be coarser than this share
# of the shortest edge: five surfaces would fill 1.8 MB with them.
MANY, THIN = 3, 1e-4
# Where single precision is coarser than this share of the surfaces' size, patches store remainders, too.
COARSE = 5e-7


@dataclass(frozen=True, eq=False)
class Turning:
    """The fields that turn the mesh of a page, and the amounts of the run.

    Attributes
    ----------
    motion : the motion of all nodes; without surfaces if there is no plan.
    own : amounts of the run.
    poses : amounts of all surfaces at which the mesh was measured, surface by surface.
    """

    motion: MeshMotion = field(repr=False)
    own: tuple[float, ...]
    poses: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of(cls, data: ReportData) -> "Turning":
        """Return the fields of a run's plan, if there is one."""
        motion = data.motion
        if motion is None:
            return cls(MeshMotion((), data.mesh.points, (), ()), ())
        amounts, poses = {surface.control: surface.amount for surface in data.surfaces}, []
        for i in range(len(motion.controls)):
            for row in motion.measured[i]:
                poses.append(tuple(row.amount if i == j else other for j, other in enumerate(motion.amounts)))
        return cls(
            motion if motion.plan else motion.on(data.mesh.points),
            tuple(amounts[control.name] for control in motion.controls),
            tuple(poses),
        )

    def page_fields(
        self, nodes: IntArray, points: FloatArray, exact: bool, fine: bool
    ) -> tuple[list[Json], FloatArray]:
        """Return the fields of nodes (K,) at points (K, 3), and the places that the page computes from them.

        With `exact` points have a second, low part, and with `fine` fields have one.
        """
        out, computed, place = [], np.sum(_split(points, exact), axis=0), np.full(len(self.motion.start), -1)
        surfaces = zip(self.motion.controls, self.own, self.motion.rows, self.motion.fields, strict=True)
        for i, (control, amount, rows, fields) in enumerate(surfaces):
            place[:] = -1
            place[rows] = np.arange(len(rows))
            at = np.flatnonzero(place[nodes] >= 0)
            at = at[fields[:, place[nodes[at]]].any(axis=(0, 2))]
            parts = [_split(field[place[nodes[at]]], fine) for field in fields]
            for value, part in zip(control.functions.values(amount), parts, strict=True):
                computed[at] += value * np.sum(part, axis=0)
            names = zip(("fields", "fields_low"), zip(*parts, strict=True), strict=False)
            numbers = {name: [single(field) for field in values] for name, values in names}
            out += [{"surface": i, "at": integers(at), **numbers}] if len(at) else []
        return out, np.asarray(computed)

    def states(self, data: ReportData) -> Iterator[FloatArray]:
        """Yield the mesh (N, 3) before, after, before the repair, and at each pose."""
        yield from (data.mesh.points, data.points, data.points if data.interpolated is None else data.interpolated)
        yield from map(self.motion.at, self.poses)


def turnable(data: ReportData, most_cells: int = 0, most_triangles: int = MOST_TRIANGLES) -> Json:
    """Return patches, hexahedra, sites, centres and cells of a run, with the fields that turn them."""
    turning = Turning.of(data)
    in_space = MOST_CELLS if len(data.surfaces) < MANY else MOST_OF_MANY
    most_cells = most_cells or (MOST_PLANE if data.mesh.plane else in_space)
    parts = list(patches(data, most_triangles, turning))
    return {
        "patches": parts,
        "labels": list(labels(data, parts)),
        "boxes": [{"segments": single(_corners_shown(data, box)[BOX_EDGES])} for box in data.boxes],
        "crossed": {"segments": single(_crossed(data))},
        "dots": list(dots(data)),
        "cells": cells(data, most_cells, turning),
        "turn": surfaces(data, turning) if turning.own else None,
        "views": list(views(data)),
        "colours": {
            "shades": colours.shades(colours.QUALITY),
            "range": [colours.QUALITIES.vmin, colours.QUALITIES.vmax],
            "displacement": colours.shades(colours.DISPLACEMENT),
            "change": colours.shades(colours.CHANGE),
            "changes": [colours.CHANGES.vmin, colours.CHANGES.vmax],
            "lost": colours.LOST,
        },
        "measure": measure_in_words(data.boxes),
        "grade": data.grade if data.checks else "",
        "source": data.repeat,
        "hinges": [hinge._asdict() for hinge in data.hinges],
        "beside": data.beside,
        "plane": data.mesh.plane,
        "unit": data.length.shown,
        "factor": data.length.factor,
        "middle": data.length.factor * float(data.middle[1]),
    }


def _crossed(data: ReportData) -> FloatArray:
    """Return the edges (E, 2, 3) of faces that newly go through others; none where the check passed."""
    if all(check.passed for check in data.checks if check.name == "surfaces_crossed"):
        return np.empty((0, 2, 3))
    return np.asarray(data.points[IntersectingFaces.of(data.mesh, data.points).edges])


def labels(data: ReportData, parts: list[Json]) -> Iterator[Json]:
    """Yield the name of each surface, its amount in words, and the patch and row of the node at its tip.

    Where nothing moves, all patches have labels, small ones first: the page leaves out those that would cover others.
    """
    nodes = {part["own"]: np.frombuffer(b64decode(part["nodes"]), "<u4") for part in parts}
    for surface in data.surfaces:
        node = _tip(data, surface)
        name = next((name for name in surface.patches if name in nodes and node in nodes[name]), None)
        if name:
            place = {"own": name, "row": int(np.searchsorted(nodes[name], node))}
            yield {"name": surface.name, "control": surface.control, "amount": surface.amount_text, **place}
    shown = [] if data.surfaces else [part["own"] for part in parts if not part["hidden"]]
    for name in sorted(shown, key=lambda name: diagonal(data.mesh.points[nodes[name]])):
        places = data.mesh.points[nodes[name]]
        row = int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))
        yield {"name": name, "control": "", "amount": "", "own": name, "row": row}


def _tip(data: ReportData, surface: MovedSurface) -> int:
    """Return the node of a surface that is farthest from the middle, among those that move far."""
    places, ends = data.mesh.points[surface.nodes], data.points[surface.nodes]
    travel = np.linalg.norm(ends - places, axis=1)
    away = np.linalg.norm(places - data.middle, axis=1)
    return int(surface.nodes[np.argmax(np.where(travel >= FAR * travel.max(), away, -np.inf))])


def patches(data: ReportData, most: int, turning: Turning) -> Iterator[Json]:
    """Yield the surface meshes; faces point out of the body, for the lighting."""
    inside = union(*(box.nodes for box in data.boxes))
    moving = [name for surface in data.surfaces for name in surface.patches]
    following = [name for surface in data.surfaces for name in surface.panel]
    for patch in data.mesh.patches:
        if patch.name not in (*data.drawn, *data.hidden) or not patch.faces:
            continue
        whole = triangles_of(patch.faces)
        shown = thin_patch(data.mesh, patch, inside, most) if len(whole) > most else whole
        thin = len(shown) < len(whole)
        yield {
            "name": f"{patch.name} (thinned)" if thin else patch.name,
            "own": patch.name,
            "hidden": patch.name in data.hidden,
            "surface": patch.name in moving,
            "panel": patch.name in following,
            **_part(data, turning, shown[:, ::-1], None if thin else _edges(patch)),
        }


def _edges(patch: Patch) -> IntArray | None:
    """Return the edges (E, 2) of faces with more than three corners."""
    if all(isinstance(block, Cells) and block.shape == "triangle" for block in patch.faces):
        return None
    return np.unique(np.sort(edges_of(polygons_of(patch.faces))[0], axis=1), axis=0)


def thin_patch(mesh: Mesh, patch: Patch, keep: IntArray, most: int = MOST_TRIANGLES) -> IntArray:
    """Return about `most` triangles (F, 3) of a patch: the nodes in a box of a lattice are merged to one.

    Nodes in `keep` (K,), on creases, and shared with other patches stay.
    """
    triangles, faces = triangles_of(patch.faces), polygons_of(patch.faces)
    a, b, c = mesh.points[triangles].transpose(1, 0, 2)
    size = np.sqrt(1.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / most)
    nodes = distinct(triangles)
    place = mesh.points[nodes] / size
    nodes = nodes[np.argsort(np.linalg.norm(place % 1.0 - 0.5, axis=1), kind="stable")]
    stays = np.zeros(len(mesh.points), dtype=bool)
    stays[keep] = True
    stays[mesh.on(*(name for name in mesh.names if name != patch.name))] = True
    stays[sharp_edges(mesh.points, faces, CREASE).ravel()] = True
    kept_alone = np.where(stays[nodes], nodes, -1)
    key = np.column_stack([np.floor(mesh.points[nodes] / size).astype(np.intp), _side(mesh, patch)[nodes], kept_alone])
    _, first, box_of = np.unique(key, axis=0, return_index=True, return_inverse=True)
    merged = np.arange(len(mesh.points))
    merged[nodes] = nodes[first[box_of.ravel()]]
    corners = merged[triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    once = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]
    return np.asarray(corners[np.sort(once)])


def _side(mesh: Mesh, patch: Patch) -> IntArray:
    """Return the side, of six, that each node (N,) of a patch faces, so that both sides of a thin body stay apart."""
    faces, normal = polygons_of(patch.faces), np.zeros_like(mesh.points)
    edges, face = edges_of(faces)
    np.add.at(normal, edges[:, 0], area_vectors(mesh.points, faces)[face])
    axis = np.abs(normal).argmax(axis=1)
    return np.asarray(2 * axis + (normal[np.arange(len(normal)), axis] > 0.0))


def dots(data: ReportData) -> Iterator[Json]:
    """Yield data sites of all surfaces, and the centres of each direction."""
    if not data.boxes:
        return
    sites = [data.mesh.points[box.sites] for box in data.boxes]
    yield _dots("sites", "sites on the surface", sites, colours.WORSE)
    yield _dots("sites", "sites of zero displacement", [box.zero for box in data.boxes], colours.NAVY)
    for direction, colour in zip("xyz", colours.XYZ, strict=True):
        centres = [box.fits.centres[direction] for box in data.boxes if direction in box.fits.centres]
        if centres:
            yield _dots("centres", f"centres for {direction}", centres, colour)


def surfaces(data: ReportData, turning: Turning) -> Json:
    """Return the surfaces that can be turned, the figures of each, and the command that moves the mesh."""
    motion, out = data.motion, []
    for control, amount, table in zip(
        turning.motion.controls, turning.own, motion.figures() if motion else (), strict=True
    ):
        functions = _functions(control)
        tolerance = next(b.tolerance for b in data.boxes if any({*s.patches} & {*control.patches} for s in b.surfaces))
        out.append({**table, "functions": functions, "own": amount, "tolerance": tolerance})
    return {"surfaces": out, "stands": motion.amounts if motion else (), "command": data.moves}


def _functions(control: ControlRange) -> Json:
    """Return a surface's functions for the page: kind and numbers, or samples over the range."""
    kind = type(control.functions).__name__
    if isinstance(control.functions, Turn | Powers | Fixed):
        return asdict(control.functions) | {"kind": kind}
    amounts = np.linspace(control.low, control.high, SAMPLES)
    values = [control.functions.values(at).tolist() for at in amounts]
    return {"kind": "Samples", "low": control.low, "high": control.high, "values": values}


def cells(data: ReportData, most: int, turning: Turning) -> Json:
    """Return the worst cells that touch a hexahedron, by their least quality at any amount, and the number of all."""
    blocks = list(_touching(data, turning))
    worst = np.concatenate([np.empty(0), *(quality.min(axis=0) for *_, quality in blocks)])
    limit = np.partition(worst, most - 1)[most - 1] if len(worst) > most else np.inf
    groups, starts = [], np.cumsum([0, *(len(rows) for _, rows, *_ in blocks)])
    for start, (block, rows, sign, qualities) in zip(starts, blocks, strict=False):
        kept = np.flatnonzero(qualities.min(axis=0) <= limit)
        for shape, typed, block_rows, at in parts_of(block, rows[kept]):
            corners, nodes = _corners(typed, block_rows)
            known = (
                {} if isinstance(typed, Cells) else {"qualities": [single(quality[kept[at]]) for quality in qualities]}
            )
            group = {"shape": shape, "sign": sign, **corners, **known, "rows": integers(start + kept[at])}
            groups.append({**group, **_part(data, turning, nodes, exact=True)})
    return {"all": len(worst), "shown": int(np.count_nonzero(worst <= limit)), "groups": groups}


def _touching(data: ReportData, turning: Turning) -> Iterator[tuple[Volume, IntArray, float, FloatArray]]:
    """Yield each block with the rows (R,) that touch a hexahedron, its orientation, and their quality (S, R).

    There are S states: before, after, before the repair, and where the mesh was measured.
    """
    blocks = list(data.mesh.cells if data.boxes else ())
    rows = [union(*(box.affected.rows[i] for box in data.boxes)) for i in range(len(blocks))]
    signs = data.boxes[0].affected.orientation if blocks else ()
    measured: list[list[FloatArray]] = [[] for _ in blocks]
    for points in turning.states(data):
        for values, *part in zip(measured, blocks, rows, signs, strict=True):
            values.append(quality_of(points, *part))  # type: ignore[arg-type]
    yield from zip(blocks, rows, signs, map(np.array, measured), strict=True)


def _corners(block: Cells | Polyhedra, rows: IntArray) -> tuple[Json, IntArray]:
    """Return how triangles are made of cells, and the cells' nodes (C, k); polyhedra are given as triangles."""
    if isinstance(block, Cells):
        return {"table": TABLES[block.shape], "cell": None}, block.nodes[rows]
    place = np.full(len(block), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    faces, cell = faces_by_cell(block)
    cell_of = np.repeat(place[cell], np.maximum(np.diff(faces.offsets) - 2, 0))
    first = np.repeat(faces.offsets[:-1], np.maximum(np.diff(faces.offsets) - 2, 0))
    step = np.arange(len(first)) - np.searchsorted(first, first) + 1
    triangles = np.column_stack([faces.nodes[first], faces.nodes[first + step], faces.nodes[first + step + 1]])
    kept = cell_of >= 0
    return {"table": [0, 1, 2], "cell": integers(cell_of[kept])}, triangles[kept]


def views(data: ReportData) -> Iterator[Json]:
    """Yield names and extents (low, high) of the views: all surfaces, each surface, then everything.

    The camera looks at the view's patches; extents are those of the boxes, in which planes may cut.
    """
    every = [_corners_shown(data, box) for box in data.boxes]
    if data.surfaces:
        named = [name for surface in data.surfaces for name in surface.patches]
        yield _view(data, "surfaces", np.vstack(every)) | {"patches": named, "box": None}
    for i, box in enumerate(data.boxes):
        for surface in box.surfaces if len(data.surfaces) > 1 else ():
            yield _view(data, surface.name, every[i]) | {"patches": list(surface.patches), "box": i}
    drawn = np.vstack([data.mesh.points[data.mesh.on(*data.drawn)], *every])
    yield _view(data, "everything", drawn) | {"patches": [] if data.boxes else list(data.drawn), "box": None}


def _corners_shown(data: ReportData, box: Box) -> FloatArray:
    """Return the corners (8, 3) of a hexahedron; those around a plane mesh come close to its plane."""
    corners = box.hexahedron.corners.copy()
    if data.mesh.plane:
        corners[:, 2] = data.mesh.points[0, 2] + FLAT * (corners[:, 2] - data.mesh.points[0, 2])
    return corners


def single(values: FloatArray) -> str:
    """Return numbers in base64 of little-endian single precision."""
    return b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def integers(values: IntArray) -> str:
    """Return indices in base64 of little-endian 32 bits."""
    return b64encode(values.astype("<u4").tobytes()).decode("ascii")


def pack(scene: Json) -> tuple[str, str]:
    """Return a scene as two compressed texts in base64: the JSON with references to arrays, and the arrays.

    A reference has the begin of an array and its length. The first bytes of all numbers of an array come first, then
    the second bytes, and so on: similar bytes compress better.
    """
    parts: list[bytes] = []

    def placed(value: Any) -> Any:
        if isinstance(value, Mapping):
            rows = value.items()
            return {name: (place if name in ARRAYS else placed)(entry) for name, entry in rows if name not in KEPT}
        return [placed(entry) for entry in value] if isinstance(value, list) else value

    def place(value: Any) -> Any:
        if not isinstance(value, str):
            return [place(entry) for entry in value] if value else value
        numbers = np.frombuffer(b64decode(value), dtype=np.uint8).reshape(-1, 4)
        start = sum(map(len, parts))
        parts.append(numbers.T.tobytes())
        return [start, len(numbers)]

    content = json.dumps(placed(scene)).encode()
    return encode(content), encode(b"".join(parts))


def encode(content: bytes) -> str:
    """Return bytes compressed, in base64."""
    return b64encode(compress(content, 9, mtime=0)).decode("ascii")


def _part(
    data: ReportData, turning: Turning, faces: IntArray, edges: IntArray | None = None, *, exact: bool = False
) -> Json:
    """Return cells or triangles (F, k) with their nodes and the fields that move these.

    `rest` is the displacement of the run's mesh from the fields' mesh, `unrepaired` that from the mesh without repair.
    Numbers of `exact` parts have a second, low part, which cells of thin layers need.
    """
    nodes, local = np.unique(faces, return_inverse=True)
    local = local.reshape(faces.shape)
    before, after = data.mesh.points[nodes], data.points[nodes]
    largest = float(np.abs(before).max(initial=0.0))
    exact = exact or SEEN * largest > COARSE * data.surface_size > 0.0
    edge = np.linalg.norm(before[local] - before[np.roll(local, 1, axis=1)], axis=2)
    shortest = float(edge[edge > 0.0].min(initial=np.inf))
    fine = exact and (len(turning.own) < MANY or SEEN * data.surface_size > THIN * shortest)
    modes, computed = turning.page_fields(nodes, before, exact, fine)
    between = after if data.interpolated is None else data.interpolated[nodes]
    small = (EXACT if exact else SEEN) * largest
    rest, mended = _without_small(after - computed, small), _without_small(between - after, small)
    return {
        "nodes": integers(nodes),
        **_single("points", before, exact),
        "modes": modes,
        **(_single("rest", rest, exact) if rest.any() else {}),
        **({"unrepaired": single(mended)} if mended.any() else {}),
        "goes": not np.array_equal(before, after),
        "faces": integers(local),
        "corners": faces.shape[1],
        "edges": None if edges is None else integers(np.searchsorted(nodes, edges)),
    }


def _single(name: str, values: FloatArray, exact: bool) -> Json:
    """Return numbers in single precision by name; if they are to be `exact`, also the remainders."""
    parts = _split(values, exact)
    return {f"{name}{tail}": single(part) for tail, part in zip(("", "_low"), parts, strict=False)}


def _split(values: FloatArray, exact: bool) -> list[FloatArray]:
    """Return numbers in single precision; if they are to be `exact`, also the remainders."""
    high = values.astype("<f4").astype(np.float64)
    return [high, (values - high).astype("<f4").astype(np.float64)] if exact else [high]


def _without_small(values: FloatArray, small: float) -> FloatArray:
    """Return values (M, 3) with small rows set to zero."""
    return np.where(np.abs(values).max(axis=1, keepdims=True) > small, values, 0.0)


def _dots(group: str, name: str, points: list[FloatArray], colour: str) -> Json:
    every = np.vstack(points)
    step = -(-len(every) // MOST_DOTS)
    label = name if step <= 1 else f"{name}, 1 in {step} drawn"
    return {"group": group, "name": label, "points": single(every[:: max(step, 1)]), "count": len(every),
            "colour": colour}  # fmt: skip


def _view(data: ReportData, name: str, points: FloatArray) -> Json:
    margin = EDGE * float(np.ptp(points, axis=0).max())
    low, high = data.length.factor * (points.min(axis=0) - margin), data.length.factor * (points.max(axis=0) + margin)
    return {"name": name, "low": low.tolist(), "high": high.tolist()}

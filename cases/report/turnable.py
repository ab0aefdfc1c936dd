"""What the page's turnable picture shows, as JSON: coordinates are base64 of single precision numbers."""

from base64 import b64encode
from collections.abc import Iterator

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from sdm_deflect.cases.metrics import Json
from sdm_deflect.cases.report.data import ReportData
from sdm_deflect.cases.report.scene3d import (
    BLUE,
    BOX_EDGES,
    FAR_FIELD,
    ORANGE,
    QUALITY_MAP,
    QUALITY_RANGE,
    Colour,
    hexadecimal,
    patch_colour,
)
from sdm_deflect.cases.sdm.job import BLOCK
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Plan
from sdm_deflect.meshing.mesh import TetMesh

MOST_CELLS = 40_000
"""So many of the worst cells of all hexahedra are in the page: a browser has to draw them."""
MOST_TRIANGLES = 6_000
"""Patches of more are thinned to about so many away from the hexahedra."""
MOST_DOTS = 10_000
"""So many sites or centres of a kind are in the page at most."""
MARGIN = 0.2
"""Around the hexahedron of a view, by its largest extent."""
SHADES = 9


def turnable(data: ReportData) -> Json:
    """Return patches, hexahedra, sites, centres and cells of a run, before and after."""
    return {
        "patches": list(patches(data)),
        "boxes": [box(plan) for plan in data.plans],
        "dots": list(dots(data)),
        "cells": cells(data),
        "views": list(views(data)),
        "colours": {"range": [QUALITY_RANGE.vmin, QUALITY_RANGE.vmax], "shades": shades()},
    }


def patches(data: ReportData) -> Iterator[Json]:
    """Yield the surface meshes; the far field is left out, a block's outer faces are hidden at first.

    Triangles point out of the body, as lighting wants them. The name of a thinned patch says that it is.
    """
    inside = np.concatenate([plan.region.inside for plan in data.plans])
    for name in data.mesh.names[1:]:
        if name != FAR_FIELD:
            colour = hexadecimal(patch_colour(name))
            whole = data.mesh.triangles_of(name)
            shown = thinned(data.mesh, whole, inside) if len(whole) > MOST_TRIANGLES else whole
            label = name if len(shown) == len(whole) else f"{name} (thinned)"
            yield {"name": label, "colour": colour, "hidden": name == BLOCK, **_both(data, shown[:, ::-1])}


def thinned(mesh: TetMesh, triangles: IntArray, keep: IntArray) -> IntArray:
    """Return fewer of the triangles (F, 3) of a patch: nodes in one box of a lattice become the one in its middle.

    The nodes `keep` (K,) stay, and all on edges of CAD faces: creases, and what the patch shares with others.
    """
    a, b, c = mesh.points[triangles].transpose(1, 0, 2)
    size = np.sqrt(1.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / MOST_TRIANGLES)
    nodes = np.unique(triangles)
    place = mesh.points[nodes] / size
    nodes = nodes[np.argsort(np.linalg.norm(place % 1.0 - 0.5, axis=1), kind="stable")]
    face, stays = _faces(mesh)
    stays[keep] = True
    own = np.where(stays[nodes], nodes, -1)
    key = np.column_stack([np.floor(mesh.points[nodes] / size).astype(np.intp), face[nodes], own])
    _, first, box_of = np.unique(key, axis=0, return_index=True, return_inverse=True)
    merged = np.arange(len(mesh.points))
    merged[nodes] = nodes[first[box_of.ravel()]]
    corners = merged[triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    once = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]
    return np.asarray(corners[np.sort(once)])


def box(plan: Plan) -> Json:
    """Return the edges of a hexahedron as pairs of points."""
    return {"name": plan.surface, "segments": single(plan.region.hexahedron.corners[BOX_EDGES])}


def dots(data: ReportData) -> Iterator[Json]:
    """Yield data sites of all surfaces, and the centres of each direction."""
    sites = [data.mesh.points[plan.sites.moving] for plan in data.plans]
    zero = [part.points for plan in data.plans for part in plan.sites.zero]
    yield _dots("sites", "sites on the surface", sites, ORANGE)
    yield _dots("sites", "sites of zero displacement", zero, BLUE)
    for direction, colour in zip("xyz", (BLUE, ORANGE, (30, 30, 30)), strict=True):
        own = [centres[direction] for centres in data.centres.values()]
        yield _dots("centres", f"centres for {direction}", own, colour)


def cells(data: ReportData) -> Json:
    """Return the worst cells that touch a hexahedron, by their quality before or after, and how many there are."""
    near = np.flatnonzero(np.any([data.touching(plan) for plan in data.plans], axis=0))
    quality = np.array([mean_ratio(mesh.points, mesh.tets[near]) for mesh in (data.mesh, data.deflected)])
    kept = np.sort(np.argsort(quality.min(axis=0), kind="stable")[:MOST_CELLS])
    return {
        "all": len(near),
        "before": single(quality[0, kept]),
        "after": single(quality[1, kept]),
        **_both(data, data.mesh.tets[near[kept]]),
    }


def views(data: ReportData) -> Iterator[Json]:
    """Yield names and boxes (low, high) of what can be looked at: each control surface, then everything."""
    for plan in data.plans:
        corners = plan.region.hexahedron.corners
        yield _view(plan.surface, corners, MARGIN * float(np.ptp(corners, axis=0).max()))
    names = [name for name in data.mesh.names[1:] if name != FAR_FIELD]
    yield _view("everything", data.mesh.points[data.mesh.on(*names)], 0.0)


def shades() -> list[list[object]]:
    """Return the colour map of the quality as plotly takes it."""
    return [[float(s), to_hex(colormaps[QUALITY_MAP](s))] for s in np.linspace(0.0, 1.0, SHADES)]


def single(values: FloatArray) -> str:
    """Return numbers in base64 of little-endian single precision."""
    return b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def _both(data: ReportData, faces: IntArray) -> Json:
    """Return cells or triangles (F, k) with their own nodes before and after (None where none of them moves)."""
    nodes, local = np.unique(faces, return_inverse=True)
    before, after = (_at(mesh, nodes) for mesh in (data.mesh, data.deflected))
    return {
        "points": single(before),
        "moved": None if np.array_equal(before, after) else single(after),
        "faces": b64encode(local.astype("<u4").tobytes()).decode("ascii"),
    }


def _faces(mesh: TetMesh) -> tuple[IntArray, BoolArray]:
    """Return a CAD face of each node (N,), and whether it is on others, too (N,)."""
    label, face = mesh.face * len(mesh.names) + mesh.patch, np.full(len(mesh.points), -1)
    face[mesh.triangles] = label[:, None]
    several = np.zeros(len(mesh.points), dtype=bool)
    several[mesh.triangles[face[mesh.triangles] != label[:, None]]] = True
    return face, several


def _at(mesh: TetMesh, nodes: IntArray) -> FloatArray:
    return np.asarray(mesh.points[nodes])


def _dots(group: str, name: str, points: list[FloatArray], colour: Colour) -> Json:
    every = np.vstack(points)
    step = -(-len(every) // MOST_DOTS)
    label = name if step <= 1 else f"{name}, 1 in {step} drawn"
    return {"group": group, "name": label, "points": single(every[:: max(step, 1)]), "count": len(every),
            "colour": hexadecimal(colour)}  # fmt: skip


def _view(name: str, points: FloatArray, margin: float) -> Json:
    return {"name": name, "low": (points.min(axis=0) - margin).tolist(), "high": (points.max(axis=0) + margin).tolist()}

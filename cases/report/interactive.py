"""What the page's turnable picture shows, as JSON: coordinates are base64 of single precision numbers."""

from base64 import b64encode
from collections.abc import Iterator

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from cases.metrics import Json
from cases.motion import FloatArray, IndexArray
from cases.report.aircraft import FAR_FIELD
from cases.report.colours import BLUE, ORANGE, QUALITY_MAP, QUALITY_RANGE, hexadecimal, patch_colour
from cases.report.layers import BOX_EDGES
from cases.report.scene import Colour
from cases.report.story import Story
from cases.turn import Turn
from cases.zero_sites import BLOCK
from meshing.mesh import TetMesh
from meshing.quality import mean_ratio

MOST_CELLS = 60_000
"""So many of the worst cells of all hexahedra are in the page: a browser has to draw them."""
MARGIN = 0.2
"""Around the hexahedron of a view, by its largest extent."""
SHADES = 9


def turnable(story: Story) -> Json:
    """Return patches, hexahedra, sites, centres and cells of a run, before and after."""
    return {
        "patches": list(patches(story)),
        "boxes": [box(turn) for turn in story.turns],
        "dots": list(dots(story)),
        "cells": cells(story),
        "views": list(views(story)),
        "colours": {"range": [QUALITY_RANGE.vmin, QUALITY_RANGE.vmax], "shades": shades()},
    }


def patches(story: Story) -> Iterator[Json]:
    """Yield the surface meshes; the far field is left out, a block's outer faces are hidden at first.

    Triangles point out of the body, as lighting wants them.
    """
    for name in story.mesh.names[1:]:
        if name != FAR_FIELD:
            colour = hexadecimal(patch_colour(name))
            parts = _both(story, story.mesh.triangles_of(name)[:, ::-1])
            yield {"name": name, "colour": colour, "hidden": name == BLOCK, **parts}


def box(turn: Turn) -> Json:
    """Return the edges of a hexahedron as pairs of points."""
    return {"name": turn.surface, "segments": single(turn.region.hexahedron.corners[BOX_EDGES])}


def dots(story: Story) -> Iterator[Json]:
    """Yield data sites of all surfaces, and the centres of each direction."""
    sites = [story.mesh.points[turn.motion.nodes] for turn in story.turns]
    zero = [part.points for turn in story.turns for part in turn.region.zero]
    yield _dots("sites", "sites on the surface", sites, ORANGE)
    yield _dots("sites", "sites of zero displacement", zero, BLUE)
    for direction, colour in zip("xyz", (BLUE, ORANGE, (30, 30, 30)), strict=True):
        own = [centres[direction] for centres in story.centres.values()]
        yield _dots("centres", f"centres for {direction}", own, colour)


def cells(story: Story) -> Json:
    """Return the worst cells that touch a hexahedron, by their quality before or after, and how many there are."""
    near = np.flatnonzero(np.any([story.touching(turn) for turn in story.turns], axis=0))
    quality = np.array([mean_ratio(mesh.points, mesh.tets[near]) for mesh in (story.mesh, story.deflected)])
    kept = np.sort(np.argsort(quality.min(axis=0), kind="stable")[:MOST_CELLS])
    return {
        "all": len(near),
        "before": single(quality[0, kept]),
        "after": single(quality[1, kept]),
        **_both(story, story.mesh.tets[near[kept]]),
    }


def views(story: Story) -> Iterator[Json]:
    """Yield names and boxes (low, high) of what can be looked at: each control surface, then everything."""
    for turn in story.turns:
        corners = turn.region.hexahedron.corners
        yield _view(turn.surface, corners, MARGIN * float(np.ptp(corners, axis=0).max()))
    names = [name for name in story.mesh.names[1:] if name != FAR_FIELD]
    yield _view("everything", story.mesh.points[story.mesh.on(*names)], 0.0)


def shades() -> list[list[object]]:
    """Return the colour map of the quality as plotly takes it."""
    return [[float(s), to_hex(colormaps[QUALITY_MAP](s))] for s in np.linspace(0.0, 1.0, SHADES)]


def single(values: FloatArray) -> str:
    """Return numbers in base64 of little-endian single precision."""
    return b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def _both(story: Story, faces: IndexArray) -> Json:
    """Return cells or triangles (F, k) with their own nodes before and after (None where none of them moves)."""
    nodes, local = np.unique(faces, return_inverse=True)
    before, after = (_at(mesh, nodes) for mesh in (story.mesh, story.deflected))
    return {
        "points": single(before),
        "moved": None if np.array_equal(before, after) else single(after),
        "faces": b64encode(local.astype("<u4").tobytes()).decode("ascii"),
    }


def _at(mesh: TetMesh, nodes: IndexArray) -> FloatArray:
    return np.asarray(mesh.points[nodes])


def _dots(group: str, name: str, points: list[FloatArray], colour: Colour) -> Json:
    return {"group": group, "name": name, "points": single(np.vstack(points)), "count": sum(map(len, points)),
            "colour": hexadecimal(colour)}  # fmt: skip


def _view(name: str, points: FloatArray, margin: float) -> Json:
    return {"name": name, "low": (points.min(axis=0) - margin).tolist(), "high": (points.max(axis=0) + margin).tolist()}

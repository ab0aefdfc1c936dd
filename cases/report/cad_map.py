"""The distance of the moved surface's nodes from the deflected CAD, as a map of both sides of the surface."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sdm_deflect.cases.report.data import ReportData
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.volume.deflection import Plan

MAP = "viridis"
LEAST, TOP = 1e-17, 1e2
"""Distances (m) below are drawn here; the colours span at least so many times that."""
MEASURED = ("surface_to_cad", "root_on_cylinder")


def cad_distances(data: ReportData, plan: Plan) -> FloatArray:
    """Distance (N,) of each mesh node from the deflected CAD, nan where none was measured."""
    distance = np.full(len(data.mesh.points), np.nan)
    for check in data.checks:
        name, _, surface = check.name.partition(":")
        own = surface in ("", plan.surface)
        if name in MEASURED and own and check.nodes is not None and check.distances is not None:
            distance[check.nodes] = np.fmax(distance[check.nodes], check.distances)
    return distance


def cad_map(data: ReportData, plan: Plan) -> tuple[Figure, str]:
    """Draw the map of a control surface and say what is seen."""
    distance, limit = cad_distances(data, plan), data.case.limits.surface_to_cad
    triangles = data.deflected.triangles_of(plan.surface)
    points = data.deflected.points
    seen, up, sides = views(points, triangles)
    norm = LogNorm(LEAST, max(TOP * LEAST, float(np.nanmax(distance, initial=LEAST))))
    flat = 1e3 * points[:, seen]
    width, height = np.ptp(flat[np.unique(triangles)], axis=0)
    rows = 2 if width > 1.5 * height else 1
    figure = Figure(figsize=(9.6, 2.2 + 9.0 * height / width) if rows == 2 else (9.6, 4.8), layout="constrained")
    axes = figure.subplots(rows, 3 - rows, sharex=True, sharey=True, squeeze=False).ravel()
    for one, side, name in zip(axes, (up, ~up), sides, strict=True):
        _side(one, flat, triangles[side], np.maximum(distance, LEAST), norm)
        one.set(ylabel=f"{'xyz'[seen[1]]}, mm", aspect="equal")
        one.set_title(f"{plan.surface}, {name}", fontsize="medium")
    for one in axes[rows - 1 :]:
        one.set_xlabel(f"{'xyz'[seen[0]]}, mm")
    figure.colorbar(ScalarMappable(norm, MAP), ax=list(axes), label=f"distance from CAD, m (limit {limit:g})")
    known = distance[~np.isnan(distance)]
    blended = np.isnan(distance[triangles]).any()
    largest, median = (float(of(known)) if len(known) else 0.0 for of in (np.max, np.median))
    return figure, (
        f"Distance of {len(known)} moved nodes of {plan.surface} from the deflected CAD, on both sides: at most "
        f"{largest:.1e} m, median {median:.1e} m; the limit is {limit:g} m. "
        + ("Hatched triangles belong to a strip that is blended and not compared." if blended else "")
    )


def views(points: FloatArray, triangles: IntArray) -> tuple[list[int], BoolArray, tuple[str, str]]:
    """Which two axes to draw, the longer first; which triangles (F,) face the first of two viewers; the sides' names.

    Triangles point into the body.
    """
    corners = points[triangles]
    normal = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = int(np.abs(normal).sum(axis=0).argmax())
    names = {0: ("rear side", "front side"), 1: ("starboard side", "port side"), 2: ("upper side", "lower side")}
    across = sorted((i for i in range(3) if i != axis), key=lambda i: -np.ptp(corners[..., i]))
    return across, normal[:, axis] > 0.0, names[axis]


def _side(axes: Axes, flat: FloatArray, triangles: IntArray, distance: FloatArray, norm: LogNorm) -> None:
    """Draw triangles (F, 3) with nodes at `flat` (N, 2); those with a node without a distance are hatched."""
    nodes, triangles = np.unique(triangles, return_inverse=True)
    flat, distance = flat[nodes], distance[nodes]
    known = ~np.isnan(distance[triangles]).any(axis=1)
    x, y = flat.T
    if known.any():
        shown = Triangulation(x, y, triangles[known])
        axes.tripcolor(shown, np.nan_to_num(distance), norm=norm, cmap=MAP, shading="gouraud")
        drawn = np.unique(triangles[known])
        axes.scatter(x[drawn], y[drawn], c=distance[drawn], norm=norm, cmap=MAP, s=6, edgecolors="0.15", linewidths=0.4)
    axes.triplot(Triangulation(x, y, triangles), color="0.35", lw=0.3)
    blended = PolyCollection(list(flat[triangles[~known]]), facecolor="0.93", edgecolor="0.6", hatch="////", lw=0.2)
    axes.add_collection(blended)

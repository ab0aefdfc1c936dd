"""Figures 6 and 8: the tail on its fuselage panel, its hexahedron, and the mesh around it."""

import numpy as np

from sdm_deflect.cases.motion import BoolArray, FloatArray, IndexArray
from sdm_deflect.cases.report.aircraft import walls
from sdm_deflect.cases.report.colours import BLUE, GREY, ORANGE
from sdm_deflect.cases.report.compose import Picture
from sdm_deflect.cases.report.layers import box, cells_by_quality, centroids, patches, sites
from sdm_deflect.cases.report.scene import View, framed, plain
from sdm_deflect.cases.run import Run
from sdm_deflect.cases.tail import panel_of
from sdm_deflect.geometry.datum import ends
from sdm_deflect.meshing.mesh import TetMesh

PIXELS = (900, 640)
CUT = 0.35
"""Where the mesh is cut for figure 8: share of the span from root to tip."""


def confinement(run: Run) -> Picture:
    """Figure 6: surface meshes of tail and panel, the hexahedron and the zero sites on its faces."""
    region, mesh = run.deflections[0].turn.region, run.mesh
    surface = region.surface
    shown = patches(mesh, (surface, panel_of(surface)), edge=(60, 60, 60), width=0.7)
    rest = patches(mesh, (name for name in walls(mesh) if name not in run.deflections[0].turn.motion.patches), GREY,
                   opacity=0.25)  # fmt: skip
    dots = tuple(sites(part.points, BLUE, 10.0) for part in region.zero)
    corners = region.hexahedron.corners
    view = framed((*rest, *shown, *dots, box(corners)), corners, (0.7, -1.0, 0.6), PIXELS)
    return Picture(
        (view,), (f"{len(region.zero[0])} sites at zero, {len(run.deflections[0].turn.motion.nodes)} on the surface",),
        "Surface mesh of the left tail and of the fuselage panel on which it turns; the hexahedron in magenta and the "
        "data sites of zero displacement on its faces as blue dots.", columns=1,
    )  # fmt: skip


def around(run: Run) -> Picture:
    """Figure 8: cells around the tail by quality, and the panel's surface mesh, before and after."""
    pair = ((run.mesh, "undeflected"), (run.deflected, f"{run.case.angle:+g} deg"))
    return Picture(
        (*(section(run, mesh) for mesh, _ in pair), *(panel(run, mesh) for mesh, _ in pair)),
        (*(f"cells around the tail, {text}" for _, text in pair), *(f"fuselage panel, {text}" for _, text in pair)),
        "Top: cells cut across the span of the tail, coloured by mean ratio, before and after the deflection, with the "
        "tail in grey. Bottom: surface meshes of the fuselage panels; only the one beside the tail follows it.",
        quality=True,
    )


def section(run: Run, mesh: TetMesh) -> View:
    """Look from the tip at the cells inboard of a cut across the tail."""
    span, region = ends(run.case.fighter, run.deflections[0].turn.surface), run.deflections[0].turn.region
    middle = (1.0 - CUT) * span[0].mean(axis=0) + CUT * span[1].mean(axis=0)
    grey = patches(mesh, (region.surface,), GREY)
    cells = cells_by_quality(mesh, cut(run, middle), width=0.8)
    return View((*grey, cells, box(region.hexahedron.corners, 2.0)), middle, (0.12, -1.0, 0.3), 0.16, PIXELS)


def cut(run: Run, middle: FloatArray) -> BoolArray:
    """True for cells (M,) that touch the hexahedron and lie inboard of the cut; chosen before the deflection."""
    region, centre = run.deflections[0].turn.region, centroids(run.mesh)
    return np.asarray(run.mesh.touching(region.inside) & (np.abs(centre[:, 1]) < abs(middle[1])))


def panel(run: Run, mesh: TetMesh) -> View:
    """Look from behind at the fuselage panels with their surface meshes; all else is shaded."""
    surface = run.deflections[0].turn.surface
    meshed = [name for name in walls(mesh) if name.startswith("fuselage_")]
    shaded = [name for name in walls(mesh) if name not in meshed and not name.startswith("wing")]
    layers = (
        *patches(mesh, shaded, GREY),
        *patches(mesh, meshed, (225, 225, 225), edge=(60, 60, 60), width=0.8),
        plain(run.mesh.points, border(run.mesh, surface), ORANGE, width=5.0),
    )
    focus = mesh.points[mesh.on(panel_of(surface))].mean(axis=0)
    return View(layers, focus, (0.55, -1.0, 0.5), 0.2, PIXELS)


def border(mesh: TetMesh, surface: str) -> IndexArray:
    """Return the edges (E, 2) at which the panel of a tail meets patches other than the tail."""
    triangles = mesh.triangles_of(panel_of(surface))
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    outer = distinct[count == 1]
    return np.asarray(outer[~np.isin(outer, mesh.on(surface)).all(axis=1)])

"""The paper's figures of the aircraft: patches and blocks (1), quality (3, 4, 7), the gap (5), the tail (6, 8)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.cases.aircraft.job import BLOCK, panel_of
from sdm_deflect.cases.aircraft.metrics import Run
from sdm_deflect.cases.report.figures import bars
from sdm_deflect.deform.box.hexahedron import FACES, Hexahedron
from sdm_deflect.geometry.confinement import block_corners, gap_faces
from sdm_deflect.geometry.datum import ends, ribs
from sdm_deflect.meshing.generate.attachment import cell_faces, edges_of
from sdm_deflect.meshing.mesh.labelled import tets_of, touching, triangles_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio
from studies import rendering
from studies.colours import BLUE, BOX, COMPONENTS, GREY, NAVY, ORANGE, Direction
from studies.rendering import SCALES, Layer, Picture, View, components_of

BINS = np.linspace(0.0, 1.0, 51)
# Width and height in pixels of each view.
WHOLE, GAP, TAIL = (900, 620), (900, 700), (900, 640)
# Extent of the portion outboard of the aileron's end, and above and below it, by the distance to the block's face.
OUTBOARD, ALONG = 4.0, 4.5
# One in so many sites of zero displacement is drawn.
THINNED = 3
# Where the mesh is cut for figure 8: share of the span from root to tip.
CUT = 0.35


def blocks(aircraft: Run, chimera: Run) -> Picture:
    """Draw the aircraft as meshed, and the aileron's block in the aircraft's.

    Raises ValueError if the second run has no Chimera block.
    """
    if chimera.background is None:
        raise ValueError(f"case {chimera.case.name} has no Chimera block")
    mesh, names = aircraft.mesh, components_of(walls(aircraft.mesh))
    surface = rendering.patches(mesh, walls(mesh), edge=(70, 70, 70), width=0.6)
    whole = rendering.framed(surface, mesh.points[mesh.on(*walls(mesh))], (-1.0, -1.1, 0.9), WHOLE)
    legend = {name: COMPONENTS[name] for name in [*names, BLOCK]}
    return Picture(
        (whole, overlapping(chimera, chimera.background)),
        ("full model, one block", "Chimera block of the aileron in the aircraft's block"),
        "Left: surface mesh of the aircraft, coloured by component. Right: the Chimera block around the left aileron, "
        "transparent with grey edges, in the surrounding aircraft.",
        legend={("block's outer faces" if name == BLOCK else name): colour for name, colour in legend.items()},
    )


def walls(mesh: Mesh) -> list[str]:
    """Return the patches of the aircraft itself."""
    return [name for name in mesh.names if name not in ("far_field", BLOCK)]


def shell(tets: IntArray) -> tuple[IntArray, IntArray]:
    """Return the triangles (F, 3) that bound a set of tetrahedra (M, 4), and the row (F,) of each one's cell."""
    faces = cell_faces(tets)
    outer = faces.second < 0
    return faces.nodes[outer], faces.first[outer]


def cells_by(scale: str, values: FloatArray, mesh: Mesh, chosen: BoolArray, **looks: Any) -> Layer:
    """Return the outside of the chosen (M,) cells, coloured by values (M,) of all on one of `SCALES`."""
    triangles, cell = shell(tets_of(mesh)[chosen])
    rgb = SCALES[scale].rgb(values[chosen][cell])
    return Layer(mesh.points, triangles, rgb, **{"edge": (40, 40, 40), "ambient": 0.85, **looks})


def overlapping(run: Run, background: Mesh) -> View:
    """Look at the block around the aileron from behind, port and above."""
    corners = block_corners(run.case.fighter, run.case.block, run.deflection.boxes[0].plan.surface)
    around = rendering.patches(background, walls(background), edge=(120, 120, 120), width=0.4)
    own = rendering.patches(run.mesh, walls(run.mesh), edge=(60, 60, 60), width=0.6)
    outside = rendering.plain(run.mesh.points, triangles_of(run.mesh, BLOCK), BOX, opacity=0.12)
    return rendering.framed((*around, *own, outside, rendering.box(corners)), corners, (0.9, -1.0, 0.9), WHOLE)


def gaps(runs: Sequence[Run]) -> Picture:
    """Draw the gap of each run as deflected, seen from behind."""
    return Picture(
        tuple(gap(run) for run in runs),
        tuple(f"{run.case.angle:+g} deg" for run in runs),
        "Cells around the end of the deflected aileron, cut near its trailing edge and seen from behind; the straight "
        "face on the right is the Chimera block's, on which nodes slide. Colours show the mean ratio; the aileron is "
        "blue, the box has grey edges.",
        columns=len(runs),
        scale="quality",
    )


def gap(run: Run) -> View:
    """Look at the gap from behind and a little from above and inboard."""
    plan, mesh = run.deflection.boxes[0].plan, run.deflected
    own, face, end = stations(run)
    width = abs(face - own)
    others = [name for name in walls(mesh) if name != plan.surface]
    grey = (*rendering.patches(mesh, others, GREY), *rendering.patches(mesh, [plan.surface], BLUE))
    cells = cells_by("quality", mean_ratio(mesh.points, tets_of(mesh)), mesh, in_gap(run), width=1.2)
    focus = np.array([end[1, 0], own - np.sign(face - own) * width, 2.0 * width])
    return View(
        (*grey, cells, rendering.box(plan.region.hexahedron.corners)), focus, (1.0, 0.25, 0.35), 14.0 * width, GAP
    )


def stations(run: Run) -> tuple[float, float, FloatArray]:
    """Return y of the aileron's end and of the block's face in the gap, and the aileron's section (3, 3) there."""
    surface, fighter = run.deflection.boxes[0].plan.surface, run.case.fighter
    section = ends(fighter, surface)[0][2:5]
    return float(ribs(fighter, surface)[0]), float(gap_faces(fighter, run.case.block, surface)[0]), section


def in_gap(run: Run) -> BoolArray:
    """True for cells (M,) ahead of the trailing edge, from the block's face to some gaps outboard.

    They are chosen by where they were before the deflection, so that every angle shows the same cells.
    """
    own, face, section = stations(run)
    x, y, z = run.mesh.points[tets_of(run.mesh)].mean(axis=1).T
    width, outboard = abs(face - own), np.sign(own - face) * (y - own)
    ahead = (x > section[0, 0]) & (x < section[1, 0] - 0.25 * np.ptp(section[:, 0]))
    return np.asarray(ahead & (outboard < OUTBOARD * width) & (np.abs(z) < ALONG * width))


def confinement(run: Run) -> Picture:
    """Figure 6: surface meshes of tail and panel, the hexahedron and the zero sites on its faces."""
    plan, mesh = run.deflection.boxes[0].plan, run.mesh
    surface = plan.surface
    shown = rendering.patches(mesh, (surface, panel_of(surface)), edge=(60, 60, 60), width=0.7)
    others = [name for name in walls(mesh) if name not in run.deflection.boxes[0].plan.patches]
    rest = rendering.patches(mesh, others, GREY, opacity=0.25)
    corners, direction = plan.region.hexahedron.corners, (0.7, -1.0, 0.6)
    zero = rendering.dots(far_sites(plan.sites.zero[0].points, plan.region.hexahedron, direction)[::THINNED], NAVY, 3.0)
    view = rendering.framed((*rest, *shown, zero, rendering.box(corners)), corners, direction, TAIL)
    return Picture(
        (view,),
        (f"{len(plan.sites.zero[0]):,} sites at zero; shown is one in {THINNED} of those on the far faces",),
        "Surface mesh of the left tail and of the fuselage panel on which it turns; the hexahedron in grey and data "
        f"sites of zero displacement as dark dots: one in {THINNED} of those on the three far faces.",
        columns=1,
    )


def far_sites(points: FloatArray, box: Hexahedron, direction: Direction) -> FloatArray:
    """Return the sites (Z, 3) on the faces of a box that are turned away from a viewer in a direction."""
    off, far = [], []
    for name in FACES:
        first, second, third, _ = box.face(name)
        normal = np.cross(second - first, third - first)
        normal *= np.sign(normal @ (first - box.corners.mean(axis=0))) / np.linalg.norm(normal)
        off.append(np.abs((points - first) @ normal))
        far.append(float(normal @ np.array(direction)) < 0.0)
    return np.asarray(points[np.array(far)[np.argmin(off, axis=0)]])


def around(run: Run) -> Picture:
    """Figure 8: cells around the tail, and the panel's surface mesh, before and after."""
    pair = ((run.mesh, "undeflected"), (run.deflected, f"{run.case.angle:+g} deg"))
    return Picture(
        (*(section(run, mesh) for mesh, _ in pair), *(panel(run, mesh) for mesh, _ in pair)),
        (*(f"cells around the tail, {text}" for _, text in pair), *(f"fuselage panel, {text}" for _, text in pair)),
        "Top: cells cut across the span of the tail, before and after the deflection, coloured by the mean ratio that "
        "they lost, with the tail in blue. Bottom: surface meshes of the fuselage panels; only the one beside the tail "
        "follows it.",
        scale="lost",
    )


def section(run: Run, mesh: Mesh) -> View:
    """Look from the tip at the cells inboard of a cut across the tail."""
    span, region = ends(run.case.fighter, run.deflection.boxes[0].plan.surface), run.deflection.boxes[0].plan.region
    middle = (1.0 - CUT) * span[0].mean(axis=0) + CUT * span[1].mean(axis=0)
    grey = rendering.patches(mesh, (run.deflection.boxes[0].plan.surface,), BLUE)
    y = run.mesh.points[tets_of(run.mesh), 1].mean(axis=1)
    chosen = touching(run.mesh, region.inside) & (np.abs(y) < abs(middle[1]))  # by where they were before
    lost = mean_ratio(run.mesh.points, tets_of(mesh)) - mean_ratio(mesh.points, tets_of(mesh))
    cells = cells_by("lost", lost, mesh, chosen, width=0.8)
    return View((*grey, cells, rendering.box(region.hexahedron.corners, 2.0)), middle, (0.12, -1.0, 0.3), 0.16, TAIL)


def panel(run: Run, mesh: Mesh) -> View:
    """Look from behind at the fuselage panels with their surface meshes; all else is shaded."""
    surface = run.deflection.boxes[0].plan.surface
    meshed = [name for name in walls(mesh) if name.startswith("fuselage_")]
    shaded = [name for name in walls(mesh) if name not in meshed and not name.startswith("wing")]
    layers = (
        *rendering.patches(mesh, [name for name in shaded if name != surface], GREY),
        *rendering.patches(mesh, [surface], BLUE),
        *rendering.patches(mesh, meshed, (225, 225, 225), edge=(60, 60, 60), width=0.8),
        rendering.plain(run.mesh.points, border(run.mesh, surface), ORANGE, width=5.0),
    )
    focus = mesh.points[mesh.on(panel_of(surface))].mean(axis=0)
    return View(layers, focus, (0.55, -1.0, 0.5), 0.2, TAIL)


def border(mesh: Mesh, surface: str) -> IntArray:
    """Return the edges (E, 2) at which the panel of a tail meets patches other than the tail."""
    edges, index = edges_of(triangles_of(mesh, panel_of(surface)))
    outer = edges[np.bincount(index.ravel()) == 1]
    return np.asarray(outer[~np.isin(outer, mesh.on(surface)).all(axis=1)])


def histograms(runs: Sequence[Run], titles: Sequence[str]) -> tuple[Figure, str]:
    """Draw one pair of histograms of all cells of the mesh for each run (3, 4, 7), and say what is seen."""
    figure = Figure(figsize=(4.6 * len(runs), 3.6), layout="constrained")
    axes = figure.subplots(1, len(runs), sharey=True, squeeze=False)[0]
    texts = [pair(run, one, title) for run, one, title in zip(runs, axes, titles, strict=True)]
    axes[0].set_ylabel("cells (log above 1)")
    axes[0].legend(loc="upper left", fontsize="small")
    return figure, "Histograms of the mean ratio before and after the deflection. " + " ".join(texts)


def pair(run: Run, axes: Axes, title: str) -> str:
    """Draw the histograms of one run: of the whole mesh as in the paper, and of the cells that touch the hexahedron."""
    before, after = (mean_ratio(mesh.points, tets_of(mesh)) for mesh in (run.mesh, run.deflected))
    near = touching(run.mesh, run.deflection.boxes[0].plan.region.inside)
    bars(axes, after, BINS, "deflected", color="#bcd5f0", fill=True)
    bars(axes, before, BINS, "undeflected", color="black", lw=1.4)
    bars(axes, after[near], BINS, "deflected, at the hexahedron", color="#1a73c9", lw=1.8)
    bars(axes, before[near], BINS, "undeflected, at the hexahedron", color="black", lw=1.2, ls=":")
    axes.set(xlabel="mean ratio", yscale="symlog", xlim=(0.0, 1.0), ylim=(0.0, None))
    axes.set_title(f"{title}\nsmallest {before.min():.3f} before, {after.min():.3f} after", fontsize="medium")
    axes.grid(alpha=0.3)
    return f"{title}: smallest {before.min():.3f} before and {after.min():.3f} after."

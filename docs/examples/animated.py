"""Draw the README's animated picture: all control surfaces of the aircraft, and the mesh around the flap of an airfoil.

python docs/examples/airfoils.py FOLDER
python docs/examples/animated.py FOLDER deflecting.gif

Every frame shows meshes deflected to its angle: the aircraft of the case `all` at its small scale, and the
``naca0012.su2`` that airfoils.py has written into FOLDER.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from PIL import Image

import sdm_deflect as sdm
from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.cases.aircraft.job import plan_of
from sdm_deflect.cases.aircraft.pipeline import mesh_of_case
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.cases.report.colours import CELLS, EDGE, LOSS, LOST, MOVES, STAYS
from sdm_deflect.cases.run.progress import Stopwatch
from sdm_deflect.deform.volume.deflection import deflect
from sdm_deflect.meshing.formats.adapters import to_pyvista

# Largest angles, degrees.
AIRCRAFT, AIRFOIL = 15.0, 25.0
PERIOD, COLOURS, MILLISECONDS = 28, 96, 80
# Where the aircraft is seen from and at, and half the height (m) of what is seen: from the nose to the tails.
EYE, FOCUS, SCALE = (1.76, -1.35, 0.80), (0.545, -0.01, 0.01), 0.345
# Loss of quality at which a cell has the darkest colour.
DARK = 0.4
# Degrees between faces, above which an edge is sharp.
SHARP = 30.0
BAR = {
    "title": "quality lost by a cell", "n_labels": 2, "fmt": "%.2f", "color": "black", "position_x": 0.05,
    "position_y": 0.03, "width": 0.40, "height": 0.10, "title_font_size": 15, "label_font_size": 14,
}  # fmt: skip

PLACES = (12, 24), (12, 350)
LABEL: dict[str, Any] = {"font_size": 11, "color": "black"}


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What one frame shows: its share of the largest angles, the aircraft's cells and faces, the airfoil's.

    `lost` (M,) is the quality that each cell of the airfoil has lost.
    """

    share: float
    aircraft: Any = field(repr=False)
    airfoil: Any = field(repr=False)
    lost: FloatArray = field(repr=False)


def shares(period: int = PERIOD) -> list[float]:
    """Return the different shares of the largest angle in a period of an oscillation, ascending."""
    return np.unique(np.sin(2.0 * np.pi * np.arange(period) / period).round(9) + 0.0).tolist()


def aircraft(parts: Sequence[float]) -> Iterator[Any]:
    """Yield the aircraft with all control surfaces at each share of their angle; they reuse the first one's centres."""
    case = replace(case_named("all"), angle=AIRCRAFT)
    mesh = mesh_of_case(case, Stopwatch())[0]
    plan = plan_of(case, mesh, [AIRCRAFT * part for part in parts])
    known = deflect(plan)
    orientation = plan.affected.orientation
    for pose in plan.poses:
        displacement = deflect(plan, pose, earlier=known).points - mesh.points
        yield to_pyvista(mesh.with_points(mesh.points + displacement), displacement, orientation)


def airfoil(mesh: Path, parts: Sequence[float]) -> list[Any]:
    """Return the airfoil with its flap at each share of the angle, trailing edge down where positive."""
    angles = [-AIRFOIL * part for part in parts]
    return [one.to_pyvista() for one in sdm.sweep(mesh, "flap", [0.75, 0.0], angles, motion="blended", fixed="wing")]


def faces_of(grid: Any, far: str = "far_field") -> tuple[Any, Any]:
    """Return the faces of the aircraft that never move, and those of patches that do."""
    names = [str(name) for name in grid.field_data["patch_names"]]
    patch = grid.cell_data["patch"]
    turns = np.array([name.startswith(("aileron", "tail", "rudder")) for name in names])[patch]
    still = (patch > 0) & (patch != names.index(far)) & ~turns
    return grid.extract_cells(still), grid.extract_cells(turns)


def smooth(faces: Any) -> Any:
    """Return faces with normals for smooth shading, except across sharp edges."""
    surface = faces.extract_surface(algorithm="dataset_surface")
    return surface.compute_normals(split_vertices=True, feature_angle=SHARP, cell_normals=False)


def drawn(frame: Frame) -> Image.Image:
    """Draw one frame: on the left the aircraft, on the right the cells around the flap by their quality."""
    plotter = pv.Plotter(off_screen=True, shape=(1, 2), border=False, window_size=[960, 400])
    plotter.background_color = "white"
    still, turned = faces_of(frame.aircraft)
    plotter.add_mesh(smooth(still), color=STAYS, ambient=0.35, smooth_shading=True)
    plotter.add_mesh(smooth(turned), color=MOVES, ambient=0.30, smooth_shading=True)
    edges = turned.extract_surface(algorithm="dataset_surface").extract_feature_edges(SHARP)
    plotter.add_mesh(edges, color=EDGE, line_width=1.0)
    plotter.camera_position = [EYE, FOCUS, (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = SCALE
    plotter.add_text(f"{AIRCRAFT * frame.share:+5.1f}°", position=PLACES[0], **LABEL)
    plotter.subplot(0, 1)
    cells = frame.airfoil.extract_cells(frame.airfoil.cell_data["patch"] == 0)
    worse = np.where(frame.lost > LOST, frame.lost, np.nan)
    actor = plotter.add_mesh(
        cells, scalars=worse, cmap=LOSS, clim=(LOST, DARK), nan_color="white", show_edges=True, edge_color=CELLS,
        line_width=0.5, lighting=False, show_scalar_bar=False,
    )  # fmt: skip
    plotter.camera_position = [(0.865, 0.0, 1.0), (0.865, 0.0, 0.0), (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.16
    plotter.add_text(f"{AIRFOIL * frame.share:+5.1f}°", position=PLACES[1], **LABEL)
    plotter.add_scalar_bar(mapper=actor.mapper, **BAR)
    image = Image.fromarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    return image


def frames(mesh: Path, parts: Sequence[float]) -> Iterator[Image.Image]:
    """Yield a picture for each share of the largest angles."""
    before = quality_of_cells(airfoil(mesh, [0.0])[0])
    for part, grid, plane in zip(parts, aircraft(parts), airfoil(mesh, parts), strict=True):
        yield drawn(Frame(part, grid, plane, before - quality_of_cells(plane)))


def quality_of_cells(grid: Any) -> FloatArray:
    """Return the quality (M,) of the cells of a plane mesh, without its lines."""
    return np.asarray(grid.cell_data["quality"][grid.cell_data["patch"] == 0])


def main(folder: Path, picture: Path, period: int = PERIOD) -> None:
    """Write the animated picture of a period, which ends where it begins."""
    parts = shares(period)
    images = dict(zip(parts, frames(folder / "naca0012.su2", parts), strict=True))
    order = [images[min(parts, key=lambda part: abs(part - np.sin(a)))] for a in 2 * np.pi * np.arange(period) / period]
    palette = order[0].quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
    first, *rest = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in order)
    first.save(picture, save_all=True, append_images=rest, duration=MILLISECONDS, loop=0, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

"""A picture of a finished run, made from its .vtu files with PyVista.

python docs/examples/picture_of_run.py runs/rudder rudder.png
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.image import imsave

BLUE, GREY, BOX = "#1a73c9", "#ccd1d7", "#6b7580"
EDGES = [[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit]
MOVED = 1e-6


def surfaces(file: Path) -> tuple[Any, list[str]]:
    """Return the boundary triangles of a mesh file, and the names of its patches."""
    grid = pv.read(file)
    triangles = grid.extract_cells(grid.cell_data["patch"] > 0).extract_surface(algorithm="dataset_surface")
    return triangles, bytes(grid.field_data["patch_names"]).decode().split("\0")[:-1]


def moved_patches(triangles: Any, names: list[str]) -> list[str]:
    """Return the names of the patches with a node that moved."""
    far = np.linalg.norm(triangles.point_data["displacement"], axis=1) > MOVED
    cells = far[triangles.regular_faces].all(axis=1)
    return [names[i] for i in np.unique(triangles.cell_data["patch"][cells])]


def hexahedra(file: Path) -> list[Any]:
    """Return the edges of every hexahedron of the run."""
    with np.load(file, allow_pickle=False) as stored:
        boxes = [stored[name] for name in stored.files if name.startswith("hexahedron")]
    lines = np.array([[2, *edge] for edge in EDGES])
    return [pv.PolyData(corners, lines=lines) for corners in boxes]


def draw(folder: Path, picture: Path, direction: tuple[float, float, float] = (1.0, -1.3, 0.8)) -> list[str]:
    """Draw what moved in blue and the hexahedra as grey lines; return the names of the patches that moved."""
    triangles, names = surfaces(folder / "deflected.vtu")
    moved = moved_patches(triangles, names)
    patch = triangles.cell_data["patch"]
    moves, far = np.isin(patch, [names.index(name) for name in moved]), patch == names.index("far_field")
    plotter = pv.Plotter(off_screen=True, window_size=[900, 620])
    plotter.background_color = "white"
    plotter.add_mesh(triangles.extract_cells(~moves & ~far), color=GREY, ambient=0.3)
    plotter.add_mesh(triangles.extract_cells(moves), color=BLUE, ambient=0.25, show_edges=True, edge_color="#444444")
    boxes = hexahedra(folder / "interpolant.npz")
    for lines in boxes:
        plotter.add_mesh(lines, color=BOX, line_width=2)
    corners = np.vstack([lines.points for lines in boxes])
    plotter.camera_position = [corners.mean(axis=0) + np.array(direction), corners.mean(axis=0), (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.36 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    imsave(picture, cropped(plotter.screenshot(None, return_img=True)))
    plotter.close()
    return moved


def cropped(image: Any, margin: int = 8) -> Any:
    """Return an image (H, W, 3) without its white border."""
    inked = (image < 255).any(axis=2)
    (top, bottom), (left, right) = (np.flatnonzero(inked.any(axis=axis))[[0, -1]] for axis in (1, 0))
    rows, columns = (slice(max(0, a - margin), b + margin) for a, b in ((top, bottom), (left, right)))
    return np.ascontiguousarray(image[rows, columns])


if __name__ == "__main__":
    print(", ".join(draw(Path(sys.argv[1]), Path(sys.argv[2]))))

"""The process that draws: `python -m sdm_deflect.cases.report.render`, started by `sdm_deflect.cases.report.offscreen`.

A system without an OpenGL library ends it with a segmentation fault, which no exception handler catches; in a
process of its own that is a message.
"""

from typing import Any

import numpy as np

from sdm_deflect.cases.report.scene import Layer, View, decoded
from sdm_deflect.meshing.child import Arrays, serve


def draw(question: Arrays) -> Arrays:
    """Return one image (H, W, 3) for each view, by number."""
    return {str(i): image(view) for i, view in enumerate(decoded(question))}


def image(view: View) -> Any:
    """Draw one view."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=list(view.pixels), lighting="light kit")
    plotter.set_background("white")
    for layer in view.layers:
        add(plotter, layer)
    towards = np.array(view.towards) / np.linalg.norm(view.towards)
    plotter.camera.position = view.focus + 10.0 * view.height * towards
    plotter.camera.focal_point = view.focus
    plotter.camera.up = view.up
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * view.height
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return pixels


def add(plotter: Any, layer: Layer) -> None:
    """Add one layer to a picture."""
    import pyvista

    kind = {1: "verts", 2: "lines", 3: "faces"}[layer.cells.shape[1]]
    sized = np.column_stack([np.full(len(layer.cells), layer.cells.shape[1]), layer.cells])
    data = pyvista.PolyData(layer.points, **{kind: sized.ravel()})
    data.cell_data["rgb"] = np.broadcast_to(layer.rgb, (len(layer.cells), 3)).astype(np.uint8)
    plotter.add_mesh(
        data, scalars="rgb", rgb=True, opacity=layer.opacity, lighting=kind == "faces",
        show_edges=layer.edge is not None, edge_color=layer.edge, line_width=layer.width, point_size=layer.width,
        render_points_as_spheres=kind == "verts", ambient=layer.ambient, diffuse=1.0 - layer.ambient,
    )  # fmt: skip


if __name__ == "__main__":
    serve(draw)

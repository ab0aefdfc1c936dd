"""Pictures drawn in another process: without an OpenGL library it ends with a segmentation fault, this one does not."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pickle import dumps, loads
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.scene3d import Layer, View, legible
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.files.child import Arrays, serve, started

Image = NDArray[np.uint8]

MODULE = "sdm_deflect.cases.report.offscreen"
SECONDS = 300.0
LOG_PREFIX = re.compile(r"\x1b\[[0-9;]*m|\d{4}-\d\d-\d\d [^|]*\| ")
"""Colours and the place in VTK's source that its last words begin with."""
NEEDS = "rendering needs OpenGL libraries (on Debian: apt-get install libgl1 libegl1 libopengl0)"


class RenderError(RuntimeError):
    """A picture could not be drawn."""


@contextmanager
def rendering(views: tuple[View, ...], module: str = MODULE) -> Iterator[Callable[[], tuple[Image, ...]]]:
    """Begin to draw; the callable waits for the images (H, W, 3), or raises RenderError that says what is needed."""
    question = np.frombuffer(dumps([legible(view) for view in views]), dtype=np.uint8)
    with started(module, {"views": question}) as pending:

        def wait() -> tuple[Image, ...]:
            try:
                answer = pending.answer(SECONDS)
            except MeshingError as error:
                raise RenderError(f"{LOG_PREFIX.sub('', str(error))}; {NEEDS}") from None
            return tuple(answer[str(i)].astype(np.uint8) for i in range(len(views)))

        yield wait


def rendered(views: tuple[View, ...]) -> tuple[Image, ...]:
    """Return the images (H, W, 3) of views; RenderError if the drawing process fails."""
    with rendering(views) as images:
        return images()


def draw(question: Arrays) -> Arrays:
    """Return one image (H, W, 3) for each view, by number."""
    return {str(i): image(view) for i, view in enumerate(loads(question["views"].tobytes()))}


def image(view: View) -> Any:
    """Draw one view."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=list(view.pixels), lighting="light kit")
    plotter.set_background("white")
    for layer in view.layers:
        add(plotter, layer)
    towards = np.array(view.towards) / np.linalg.norm(view.towards)
    plotter.camera_position = [view.focus + 10.0 * view.height * towards, view.focus, view.up]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * view.height
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")
    try:
        return plotter.screenshot(return_img=True)
    finally:
        plotter.close()


def add(plotter: Any, layer: Layer) -> None:
    """Add one layer to a picture."""
    import pyvista

    kind = {1: "verts", 2: "lines"}.get(layer.cells.shape[1], "faces")
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

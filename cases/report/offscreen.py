"""Pictures drawn in another process, so that a missing graphics library is a message and not the end.

The process is `python -m sdm_deflect.cases.report.offscreen`: a system without an OpenGL library ends it with a
segmentation fault, which no exception handler catches.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.scene3d import Layer, View, decoded, encoded, legible
from sdm_deflect.meshing.child import Arrays, serve, started
from sdm_deflect.meshing.errors import MeshingError

Image = NDArray[np.uint8]

SECONDS = 300.0
LOG_PREFIX = re.compile(r"\x1b\[[0-9;]*m|\d{4}-\d\d-\d\d [^|]*\| ")
"""Colours and the place in VTK's source that its last words begin with."""
NEEDS = "rendering needs OpenGL libraries (on Debian: apt-get install libgl1 libegl1 libopengl0)"


class RenderError(RuntimeError):
    """A picture could not be drawn."""


@contextmanager
def rendering(
    views: tuple[View, ...], module: str = "sdm_deflect.cases.report.offscreen"
) -> Iterator[Callable[[], tuple[Image, ...]]]:
    """Begin to draw views; the callable waits for the images (H, W, 3).

    Raises RenderError from the callable, if the drawing process fails; says what that most likely needs.
    """
    with started(module, encoded(tuple(map(legible, views)))) as pending:

        def wait() -> tuple[Image, ...]:
            try:
                answer = pending.answer(SECONDS)
            except MeshingError as error:
                raise RenderError(f"{LOG_PREFIX.sub('', str(error))}; {NEEDS}") from None
            return tuple(answer[str(i)].astype(np.uint8) for i in range(len(views)))

        yield wait


def rendered(views: tuple[View, ...], module: str = "sdm_deflect.cases.report.offscreen") -> tuple[Image, ...]:
    """Return the images (H, W, 3) of views.

    Raises RenderError if the drawing process fails.
    """
    with rendering(views, module) as images:
        return images()


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

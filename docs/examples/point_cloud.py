"""Deflect a flap in a cloud of points: no mesh, no CAD.

The flap is a plate behind its hinge line x = z = 0. Every other point is moved by what the interpolant says.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sdm_deflect as sd
from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.deform.box.hexahedron import box
from sdm_deflect.meshing.mesh.axis import Axis

CHORD, SPAN = 0.10, 0.30
HINGE = Axis(np.zeros(3), np.array([0.0, 1.0, 0.0]))
REGION = box(np.array([0.0, -0.05, -0.08]), np.array([0.18, SPAN + 0.05, 0.08]))
TOLERANCE = 1e-5
GREY = "0.6"


def flap(step: float = 0.01) -> FloatArray:
    """Return points (N, 3) on the flap, `step` metres apart."""
    x, y = np.meshgrid(np.arange(0.0, CHORD + 1e-9, step), np.arange(0.0, SPAN + 1e-9, step))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def deflected(points: FloatArray, degrees: float) -> FloatArray:
    """Return points (N, 3) of the cloud after the flap has turned; outside the region they keep their bits."""
    surface = flap()
    cloud = np.vstack([surface, points]), {"flap": np.arange(len(surface))}
    hinge = [[0.0, 0.0, 0.0], [0.0, SPAN, 0.0]]
    result = sd.deflect(cloud, "flap", hinge, degrees, box=REGION, tolerance=TOLERANCE)
    return result.points[len(surface) :]


def draw() -> Figure:
    """Draw a section at mid span: lines of points before and after."""
    x, z = np.meshgrid(np.linspace(-0.06, 0.24, 51), np.linspace(-0.12, 0.12, 49))
    before = np.column_stack([x.ravel(), np.full(x.size, SPAN / 2), z.ravel()])
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    for axes, angle in zip(figure.subplots(1, 2, sharey=True), (0.0, 20.0), strict=True):
        after = deflected(before, angle)
        _lines(axes, 1e3 * after.reshape(*x.shape, 3))
        axes.set(title=f"flap at {angle:g} deg", xlabel="x, mm", aspect="equal")
        plate = 1e3 * HINGE.rotated(np.array([[0.0, 0.0, 0.0], [CHORD, 0.0, 0.0]]), angle)
        axes.plot(plate[:, 0], plate[:, 2], color="black", lw=3)
        corners = 1e3 * REGION.face("y-")[[0, 1, 2, 3, 0]]
        axes.plot(corners[:, 0], corners[:, 2], color="#6b7580", lw=2)
    figure.axes[0].set_ylabel("z, mm")
    return figure


def _lines(axes: Axes, nodes: FloatArray) -> None:
    for grid in (nodes, nodes.transpose(1, 0, 2)):
        axes.plot(grid[..., 0].T, grid[..., 2].T, color=GREY, lw=0.6)


if __name__ == "__main__":
    draw().savefig("point_cloud.png", dpi=100)

"""A tail turns on a cylinder: its root is lengthened onto the fuselage, and the panel follows on the cylinder."""

import numpy as np
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites, join
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.surface.appendix_a import slide_panel
from sdm_deflect.meshing.mesh.axis import Axis, Cylinder

FUSELAGE = Cylinder(Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])), 0.067)
PIVOT = Axis(np.array([0.080, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
APEX = np.array([0.090, 0.300, 0.0])
ANGLE = 12.0
BLUE, RED = "#1a73c9", "#d1350f"


def root(n: int = 21) -> FloatArray:
    """Return the root line (2 n, 3): upper and lower side of a wedge, where they meet the cylinder."""
    x = np.concatenate([np.linspace(0.02, 0.14, n), np.linspace(0.14, 0.02, n + 2)[1:-1]])
    half = 0.006 * (1.0 - np.abs(x - 0.08) / 0.06)
    z = np.where(np.arange(len(x)) < n, half, -half)
    return np.column_stack([x, np.sqrt(FUSELAGE.radius**2 - z**2), z])


def extended(line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the turned root line, and where its rays to the turned apex meet the cylinder."""
    turned = PIVOT.rotated(line, ANGLE)
    tip = PIVOT.rotated(APEX[None], ANGLE)
    return turned, FUSELAGE.projected_along(turned, tip - turned)


def panel(n: int = 33, m: int = 25) -> FloatArray:
    """Return nodes (n * m, 3) of the panel of the fuselage, 45 degrees to both sides of the tail."""
    x, angle = np.meshgrid(np.linspace(-0.02, 0.18, n), np.radians(np.linspace(-45.0, 45.0, m)))
    r = FUSELAGE.radius
    return np.column_stack([x.ravel(), (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


def border(nodes: FloatArray, n: int = 33, m: int = 25) -> FloatArray:
    """Return the nodes of the panel's border."""
    grid = nodes.reshape(m, n, 3)
    return np.vstack([grid[0], grid[-1], grid[1:-1, 0], grid[1:-1, -1]])


def followed(nodes: FloatArray) -> FloatArray:
    """Return the nodes of the panel after the root line has moved on it."""
    line = root()
    return nodes + slide_panel(nodes, FUSELAGE, line, extended(line)[1] - line, border(nodes))


def bulging(nodes: FloatArray) -> FloatArray:
    """Return the same without the projection back onto the cylinder."""
    line = root()
    sites = join([DataSites(line, extended(line)[1] - line), fixed_sites(border(nodes))])
    return nodes + fit(ThinPlateSpline(), sites.points, sites.values)(nodes)


def draw() -> Figure:
    """Draw the root from ahead, and the unrolled panel."""
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.35))
    line = root()
    turned, onto = extended(line)
    arc = np.radians(np.linspace(-20.0, 20.0, 101))
    left.plot(67.0 * np.cos(arc), 67.0 * np.sin(arc), color="black", label="fuselage")
    for points, style, name in ((line, "0.6", "root line"), (turned, RED, "turned"), (onto, BLUE, "lengthened")):
        left.plot(1e3 * points[:, 1], 1e3 * points[:, 2], "o", color=style, ms=4, label=name)
    left.set(xlabel="y, mm", ylabel="z, mm", title="seen from ahead (y stretched)", xlim=(62.0, 68.0))
    left.legend(fontsize="small", loc="center left")
    nodes = panel()
    for points, colour, width in ((nodes, "0.8", 0.6), (followed(nodes), BLUE, 0.8)):
        for grid in (unrolled(points).reshape(25, 33, 2), unrolled(points).reshape(25, 33, 2).transpose(1, 0, 2)):
            right.plot(grid[..., 0].T, grid[..., 1].T, color=colour, lw=width)
    for points, colour in ((line, "0.4"), (onto, RED)):
        right.plot(*unrolled(np.vstack([points, points[:1]])).T, color=colour, lw=2)
    off = 1e3 * np.abs(FUSELAGE.distance(bulging(nodes))).max()
    right.set(xlabel="x, mm", ylabel="along the arc, mm", title=f"unrolled panel; bulge before projection {off:.2f} mm")
    return figure


def unrolled(points: FloatArray) -> FloatArray:
    """Return axial and circumferential place (N, 2) in millimetres."""
    return 1e3 * np.column_stack([points[:, 0], FUSELAGE.radius * np.arctan2(points[:, 2], points[:, 1])])


if __name__ == "__main__":
    draw().savefig("tail_root.png", dpi=100)

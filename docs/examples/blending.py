"""How the surface mesh follows: multiquadric blending of an aileron between hinge, rib and trailing edge.

The wedge's hinge edges stay, its trailing edge turns. At the rib y = 0 it is joined to the wing and stays, too.
"""

import numpy as np
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.cases.report.colours import DISPLACEMENT, XYZ
from sdm_deflect.deform.rbf.interpolant import fit
from sdm_deflect.deform.rbf.kernels import Kernel, Multiquadric, ThinPlateSpline
from sdm_deflect.deform.surface.appendix_a import blend, blend_strip
from sdm_deflect.meshing.mesh.axis import Axis

CHORD, SPAN, HALF, STRIP, ANGLE = 0.020, 0.120, 0.003, 0.020, -12.0
KERNELS: dict[str, Kernel] = {
    "thin plate spline": ThinPlateSpline(),
    "multiquadric, $\\varepsilon$ = 3 /m": Multiquadric(3.0),
    "multiquadric, $\\varepsilon$ = $10^4$ /m": Multiquadric(1e4),
}


def upper_side(n: int = 13, m: int = 61) -> FloatArray:
    """Return nodes (n * m, 3) of the wedge's upper side: hinge edge at x = 0, trailing edge at x = CHORD."""
    x, y = np.meshgrid(np.linspace(0.0, CHORD, n), np.linspace(0.0, SPAN, m))
    return np.column_stack([x.ravel(), y.ravel(), (HALF * (1.0 - x / CHORD)).ravel()])


def line(x: float, z: float, n: int = 61) -> FloatArray:
    """Return points (n, 3) along the span."""
    return np.column_stack([np.full(n, x), np.linspace(0.0, SPAN, n), np.full(n, z)])


def chordwise(nodes: FloatArray) -> FloatArray:
    """Blend between hinge edges and turned trailing edge: the whole wedge stays planar."""
    edge = line(CHORD, 0.0)
    turned = Axis(np.zeros(3), np.array([0.0, 1.0, 0.0])).displacement(edge, ANGLE)
    return blend(nodes, np.vstack([line(0.0, HALF), line(0.0, -HALF)]), edge, turned)


def at_once(nodes: FloatArray) -> FloatArray:
    """Blend between hinge edges, rib and trailing edge with one interpolant: it bends everything."""
    edge = line(CHORD, 0.0)
    turned = Axis(np.zeros(3), np.array([0.0, 1.0, 0.0])).displacement(edge, ANGLE)
    beyond = edge[:, 1] >= STRIP
    return blend(nodes, held(nodes), edge[beyond], turned[beyond])


def in_strip(nodes: FloatArray) -> FloatArray:
    """Blend chordwise, and in a strip beside the rib spanwise: beyond the strip the wedge stays planar."""
    return blend_strip(nodes, nodes[:, 1] < STRIP, chordwise(nodes), held(nodes))


def held(nodes: FloatArray) -> FloatArray:
    """Return the points that stay: hinge edges and rib."""
    rib = nodes[(nodes[:, 1] == 0.0) & (nodes[:, 0] > 0.0)]
    return np.vstack([line(0.0, HALF), line(0.0, -HALF), rib])


def bulge(nodes: FloatArray, moved: FloatArray) -> FloatArray:
    """Return how far (N,) the displaced nodes are from the plane through those beyond the strip."""
    after = nodes + moved
    plane = after[nodes[:, 1] >= STRIP]
    normal = np.linalg.svd(plane - plane.mean(axis=0), full_matrices=False)[2][2]
    return np.abs((after - plane.mean(axis=0)) @ normal)


def draw() -> Figure:
    """Draw a line through few sites for each kernel, and the distance from the plane for three ways to blend."""
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    left, *plans = figure.subplots(1, 4, width_ratios=(2.6, 1, 1, 1))
    x, values = np.array([0.0, 0.2, 0.45, 0.7, 1.0]), np.array([0.0, 0.0, 1.0, 0.3, 0.3])
    fine = np.linspace(0.0, 1.0, 401)
    for (name, kernel), style, colour in zip(KERNELS.items(), ("--", "-.", "-"), XYZ, strict=True):
        s = fit(kernel, np.column_stack([x, 0.0 * x, 0.0 * x]), values[:, None])
        left.plot(fine, s(np.column_stack([fine, 0.0 * fine, 0.0 * fine]))[:, 0], style, color=colour, label=name)
    left.plot(x, values, "ko", label="sites")
    left.set(xlabel="x, m", ylabel="displacement, m", title="one line of sites")
    left.legend(fontsize="small", loc="upper right")
    nodes = upper_side()
    for axes, (title, way) in zip(plans, WAYS.items(), strict=True):
        microns = np.maximum(1e6 * bulge(nodes, way(nodes)), 1e-3).reshape(61, 13)
        x, y = 1e3 * nodes[:13, 0], 1e3 * nodes[::13, 1]
        shades = axes.pcolormesh(x, y, np.log10(microns), cmap=DISPLACEMENT, vmin=-3, vmax=3, shading="gouraud")
        axes.set(title=title, xlabel="x, mm")
    plans[0].set_ylabel("y, mm")
    bar = figure.colorbar(shades, ax=plans, label="distance from the plane, µm", ticks=[-3, -2, -1, 0, 1, 2, 3])
    bar.ax.set_yticklabels(["≤ 0.001", "0.01", "0.1", "1", "10", "100", "1000"])
    return figure


WAYS = {"chordwise": chordwise, "at once": at_once, "in a strip": in_strip}

if __name__ == "__main__":
    draw().savefig("blending.png", dpi=100)

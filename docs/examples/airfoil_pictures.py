"""Draw the deflected airfoils of the guide, from the meshes that airfoils.py has written into FOLDER.

python airfoil_pictures.py FOLDER PICTURE
"""

import sys
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

import sdm_deflect as sdm
from sdm_deflect import Result
from sdm_deflect.cases.report.colours import CELLS, INK, QUALITY
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.meshing.mesh.quality import quality_of

SHADES = Normalize(0.4, 1.0)
# What is seen of each mesh: x from and to, y from and to.
WINDOWS = {"naca0012": (0.6, 1.1, -0.16, 0.14), "three_elements": (0.62, 1.12, -0.26, 0.04)}


def deflected(folder: Path) -> dict[str, Result]:
    """Return both airfoils with their flaps down."""
    naca, three = (str(folder / f"{name}.su2") for name in WINDOWS)
    return {
        "naca0012": sdm.deflect(naca, "flap", hinge=[0.75, 0.0], angle=-20, fixed="wing", motion="blended"),
        "three_elements": sdm.deflect(three, "wall#2", hinge=[0.79, -0.055], angle=-10, fixed="wall"),
    }


def shown(axes: Axes, result: Result, points, title: str) -> None:
    """Draw cells by quality, walls, and the outline of the box."""
    for block in result.plan.mesh.cells:
        cells = PolyCollection(points[block.nodes][:, :, :2], cmap=QUALITY, norm=SHADES, edgecolors=CELLS, lw=0.3)
        cells.set_array(quality_of(points, block))
        axes.add_collection(cells)
    for patch in result.plan.mesh.patches:
        for lines in patch.faces:
            axes.add_collection(LineCollection(points[lines.nodes][:, :, :2], colors=INK, lw=1.4))
    axes.set_title(title, fontsize="medium")


def draw(folder: Path) -> Figure:
    """Return the figure: each airfoil before and after."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    rows = figure.subplots(2, 2)
    for pair, (name, result) in zip(rows, deflected(folder).items(), strict=True):
        before = result.points - result.displacement
        for axes, points, state in zip(
            pair, (before, result.points), ("undeflected", f"{result.angle:+g}°"), strict=True
        ):
            shown(axes, result, points, f"{name}, {state}")
            x0, x1, y0, y1 = WINDOWS[name]
            axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xlabel="x", ylabel="y")
    figure.colorbar(ScalarMappable(SHADES, QUALITY), ax=rows, label="mean ratio, scaled Jacobian", extend="min")
    return figure


if __name__ == "__main__":
    write_png(draw(Path(sys.argv[1])), Path(sys.argv[2]))

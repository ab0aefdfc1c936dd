"""Plane slices through the mesh around a control surface, coloured by quality: no graphics library is needed."""

from dataclasses import dataclass

import numpy as np
import pyvista
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from sdm_deflect.cases.report.data import ReportData
from sdm_deflect.cases.report.scene3d import QUALITY_MAP, QUALITY_RANGE
from sdm_deflect.deform.mesh import FloatArray
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Plan
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.meshing.mesh import TetMesh

AXES = "xyz"
AROUND = 0.06
"""Margin around the hexahedron, by its size."""
ALONG = 0.7
"""Where the chord at the root is cut: behind the hinge line of a wedge."""
ROOT = 0.15
"""Share of the span that counts as the root."""
BAR = (0.89, 0.2, 0.025, 0.6)
"""Where the bar of colours stands in the figure: left, bottom, width, height."""
CLOSE = 0.03
"""Half the width and height (m) of what is seen of the root."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane x, y or z = const, where it lies (m), what it shows, and the box (2, 3) of which it is drawn."""

    axis: int
    station: float
    what: str
    window: FloatArray

    @property
    def across(self) -> tuple[int, int]:
        """The axes to the right and upwards in a picture of the plane."""
        return ((1, 2), (0, 2), (0, 1))[self.axis]

    def point(self) -> FloatArray:
        """A point (3,) of the plane."""
        return np.asarray(np.eye(3)[self.axis] * self.station)

    def __str__(self) -> str:
        return f"{self.what}, {AXES[self.axis]} = {1e3 * self.station:.1f} mm"


def planes(data: ReportData, plan: Plan) -> tuple[Plane, Plane]:
    """The two planes of a control surface: a chord at half span; across the chord, close to the root or gap."""
    points, corners = data.mesh.points[data.mesh.on(plan.surface)], plan.region.hexahedron.corners
    span = int(np.ptp(points, axis=0)[1:].argmax()) + 1
    outwards = np.abs(points[:, span])
    inner = points[outwards <= outwards.min() + ROOT * np.ptp(outwards)]
    middle = inner.mean(axis=0)
    middle[span] = points[outwards.argmin(), span] + 0.4 * CLOSE * np.sign(points[:, span].mean())
    x = (1.0 - ALONG) * inner[:, 0].min() + ALONG * inner[:, 0].max()
    margin = AROUND * np.ptp(corners, axis=0).max()
    around = np.array([corners.min(axis=0) - margin, corners.max(axis=0) + margin])
    half = float(points[:, span].min() + points[:, span].max()) / 2
    end = "the inner end and its gap" if hinged(plan.surface) else "the root"
    return (
        Plane(span, half, "section at half span", around),
        Plane(0, float(x), f"section through {end}", np.array([middle - CLOSE, middle + CLOSE])),
    )


def slices(data: ReportData, plan: Plan) -> tuple[Figure, str]:
    """Draw both planes of a control surface before and after the deflection, and say what is seen."""
    chosen = planes(data, plan)
    figure = Figure(figsize=(9.6, 9.0))
    figure.subplots_adjust(left=0.08, right=0.85, bottom=0.06, top=0.91, wspace=0.22, hspace=0.25)
    axes, texts = figure.subplots(2, 2), []
    for row, plane in zip(axes, chosen, strict=True):
        smallest = [
            draw(one, mesh, plan, plane, state)
            for one, mesh, state in zip(
                row, (data.mesh, data.deflected), ("undeflected", f"{plan.angle:+g} deg"), strict=True
            )
        ]
        before, after = smallest
        texts.append(f"{str(plane).capitalize()}: smallest of its cells {before:.3f} before, {after:.3f} after.")
    shades = ScalarMappable(QUALITY_RANGE, QUALITY_MAP)
    figure.colorbar(shades, cax=figure.add_axes(BAR), label="mean ratio of a cell", extend="min")
    figure.suptitle(plan.surface, fontsize="medium")
    return figure, (
        f"Plane slices through the cells around {plan.surface}, coloured by mean ratio, before (left) and after "
        "(right); walls are black, the hexahedron is dashed. " + " ".join(texts)
    )


def draw(axes: Axes, mesh: TetMesh, plan: Plan, plane: Plane, state: str) -> float:
    """Draw one slice; return the smallest quality of a cell in it."""
    polygons, quality = cut_cells(mesh, plane)
    drawn = PolyCollection(
        polygons, array=quality, cmap=QUALITY_MAP, norm=QUALITY_RANGE, edgecolors="0.15", linewidths=0.25
    )
    axes.add_collection(drawn)
    axes.add_collection(LineCollection(list(cut_walls(mesh, plane)), colors="black", linewidths=1.6))
    section = 1e3 * plan.region.hexahedron.section(plane.point(), np.eye(3)[plane.axis])[:, plane.across]
    axes.plot(*np.vstack([section, section[:1]]).T, color="#cc00cc", lw=1.3, ls="--")
    right, up = plane.across
    axes.set(
        xlim=1e3 * plane.window[:, right], ylim=1e3 * plane.window[:, up],
        xlabel=f"{AXES[right]}, mm", ylabel=f"{AXES[up]}, mm", aspect="equal",
    )  # fmt: skip
    axes.set_title(f"{plane.what}\n{state}", fontsize="small")
    return float(quality.min(initial=1.0))


def cut_cells(mesh: TetMesh, plane: Plane) -> tuple[list[FloatArray], FloatArray]:
    """Polygons (k, 2) in mm in which the plane cuts the cells of its window, and the quality (P,) of those cells."""
    corners, shown = mesh.points[mesh.tets], list(plane.across)
    low, high = corners.min(axis=1)[:, shown], corners.max(axis=1)[:, shown]
    near = np.all((high > plane.window[0, shown]) & (low < plane.window[1, shown]), axis=1)
    heights = corners[..., plane.axis] - plane.station
    cells = mesh.tets[near & (heights.min(axis=1) < 0.0) & (heights.max(axis=1) > 0.0)]
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, mesh.points)
    grid.cell_data["quality"] = mean_ratio(mesh.points, cells)
    cut = grid.slice(normal=np.eye(3)[plane.axis], origin=plane.point(), generate_triangles=False)
    flat = 1e3 * np.asarray(cut.points, dtype=np.float64)[:, plane.across]
    polygons = [flat[face] for face in cut.irregular_faces]
    return polygons, np.asarray(cut.cell_data["quality"], dtype=np.float64)


def cut_walls(mesh: TetMesh, plane: Plane) -> FloatArray:
    """Segments (S, 2, 2) in mm in which the plane cuts the boundary."""
    sized = np.column_stack([np.full(len(mesh.triangles), 3), mesh.triangles])
    cut = pyvista.PolyData(mesh.points, sized.ravel()).slice(normal=np.eye(3)[plane.axis], origin=plane.point())
    flat = 1e3 * np.asarray(cut.points, dtype=np.float64)[:, plane.across]
    return np.asarray(flat[np.asarray(cut.lines).reshape(-1, 3)[:, 1:]])

"""The figures of the study: pressure on the surface of both meshes, coefficients over the angle, how they settle."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.cases.report.colours import BETTER, MOVES, STAYS, WORSE
from sdm_deflect.meshing.formats.openfoam_files import MESH, faces, labels, open_foam, parse, vectors
from studies.flow.fields import iterations_done, read_field
from studies.flow.forces import Forces, coefficients
from studies.flow.members import DEFLECTED, FRESH, FRESH_DEFLECTED, REPAIRED, UNDEFLECTED, FlowStudy, Member
from studies.flow.openfoam import WHOLE
from studies.flow.results import Increment, Results
from studies.flow.trend import slopes_of

COLOURS = {DEFLECTED: MOVES, REPAIRED: BETTER, FRESH_DEFLECTED: STAYS, FRESH: WORSE}
LABELS = {
    DEFLECTED: "deflected",
    REPAIRED: "deflected and repaired",
    FRESH_DEFLECTED: "other meshes, deflected",
    FRESH: "new mesh",
}
PRESSURES = Normalize(-0.6, 0.6)
# How far around the control surface is shown, by its largest extent.
BESIDE = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Pressure coefficients (T,) on the boundary's triangles (T, 3) of points (N, 3); which (T,) are the surface's."""

    points: FloatArray = field(repr=False)
    triangles: IntArray = field(repr=False)
    pressure: FloatArray = field(repr=False)
    own: FloatArray = field(repr=False)

    @classmethod
    def of(cls, study: FlowStudy, case: Path) -> "Skin":
        """Read the walls of a member, with the pressure of the cell at each."""
        folder, stream = case / MESH, study.stream
        points = vectors(open_foam(folder, "points")).values
        polygons, owner = faces(open_foam(folder, "faces")), labels(open_foam(folder, "owner"))
        count = int(max(owner.max(), labels(open_foam(folder, "neighbour")).max())) + 1
        pressure = read_field(case / str(iterations_done(case)) / "p", count)
        walls = [one for one in parse(open_foam(folder, "boundary").text()) if one.type == "wall"]
        rows = np.concatenate([np.arange(one.start, one.start + one.count) for one in walls])
        own = np.concatenate([np.full(one.count, one.name == study.surface) for one in walls])
        corners = polygons.offsets[rows][:, None] + np.arange(3)
        cp = (pressure[owner[rows]] - stream.pressure) / stream.dynamic_pressure
        return cls(points, polygons.nodes[corners], cp, own)


def pressures(study: FlowStudy, shown: Sequence[tuple[str, Path]]) -> Figure:
    """Draw the pressure coefficient on both sides of the surface and around it, a row for each member."""
    figure = Figure(figsize=(9.0, 3.1 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), 2, squeeze=False)
    for row, (title, case) in zip(axes, shown, strict=True):
        skin = Skin.of(study, case)
        for one, side, name in zip(row, (1.0, -1.0), ("upper side", "lower side"), strict=True):
            _draw(one, skin, side, vertical=study.surface == "rudder")
            one.set_title(f"{title}: {name}", fontsize="medium")
    figure.colorbar(axes[0, 0].collections[0], ax=axes.ravel().tolist(), label="pressure coefficient", shrink=0.8)
    return figure


def _draw(axes: Axes, skin: Skin, side: float, vertical: bool) -> None:
    """Draw the triangles that face one side, seen from there; of a fin its starboard and its port side."""
    across, up = (2, 1) if vertical else (1, 2)
    corners = skin.points[skin.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = side * -normals[:, up] > 0.3 * np.linalg.norm(normals, axis=1)  # normals point out of the flow
    extent = corners[skin.own == 1].reshape(-1, 3)
    low, high = extent.min(axis=0), extent.max(axis=0)
    margin = BESIDE * (high - low).max()
    order = np.argsort(side * corners[:, :, up].mean(axis=1))
    seen = order[facing[order]]
    plane = Triangulation(skin.points[:, across], -skin.points[:, 0], skin.triangles[seen])
    axes.tripcolor(plane, facecolors=skin.pressure[seen], norm=PRESSURES, cmap="RdBu_r", edgecolors="none")
    axes.set_xlim(low[across] - 0.3 * margin, high[across] + 0.3 * margin)
    axes.set_ylim(-high[0] - 0.3 * margin, -low[0] + margin)
    axes.set_aspect("equal")
    axes.set(xlabel=f"{'xyz'[across]}, m", ylabel="-x, m")


def curves(results: Results) -> Figure:
    """Draw the increments of the coefficients that the surface is there to change, over the angle."""
    slopes = slopes_of(results)
    names = list(dict.fromkeys(one.name for one in results.increments if one.judged))
    figure = Figure(figsize=(9.0, 3.2 * -(-len(names) // 2)), layout="constrained")
    for axes, name in zip(figure.subplots(-(-len(names) // 2), 2, squeeze=False).ravel(), names, strict=False):
        own = results.of(name)
        _points(axes, own)
        if name in slopes:
            slope = slopes[name]
            ends = np.array([min(0.0, *(one.angle for one in own)), max(0.0, *(one.angle for one in own))])
            axes.plot(ends, slope.rate * ends, "-", color="0.5", lw=1, zorder=0)
            axes.set_title(f"{name}: {slope.rate:.3g} per degree", fontsize="medium")
        axes.set(xlabel="deflection, deg", ylabel=f"increment of {name}")
        axes.grid(alpha=0.3)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize="small")
    return figure


def _points(axes: Axes, own: Sequence[Increment]) -> None:
    pairs = {
        DEFLECTED: [(one.angle, one.deflected) for one in own if one.deflected is not None],
        REPAIRED: [(one.angle, one.repaired) for one in own if one.repaired is not None],
        FRESH_DEFLECTED: [(one.angle, value) for one in own for value in one.others],
        FRESH: [(one.angle, value) for one in own for value in one.fresh],
    }
    styles = {DEFLECTED: "o", REPAIRED: "s", FRESH_DEFLECTED: "+", FRESH: "x"}
    for kind, points in pairs.items():
        if points:
            angle, value = zip(*points, strict=True)
            axes.plot(angle, value, styles[kind], color=COLOURS[kind], label=LABELS[kind], fillstyle="none")
    axes.margins(x=0.15)  # a first angle is off the frame


def settling(study: FlowStudy, members: Sequence[Member], cases: Path) -> Figure:
    """Draw lift and rolling moment of all members over the iterations."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("CL", "Cl"), strict=True):
        for member in sorted(members, key=lambda one: one.kind != FRESH):  # those to be judged on top
            forces = Forces.read(cases / member.name, WHOLE)
            late = forces.iteration > forces.iteration[-1] // 10
            series = coefficients(forces, study.setup(True))[name]
            colour = COLOURS.get(member.kind, "0.5")
            axes.plot(forces.iteration[late], series[late], color=colour, lw=0.8)
        axes.set(xlabel="iteration", ylabel=name)
        axes.grid(alpha=0.3)
    kinds = [kind for kind in (UNDEFLECTED, *COLOURS) if any(one.kind == kind for one in members)]
    handles = [axes.plot([], [], color=COLOURS.get(kind, "0.5"))[0] for kind in kinds]
    names = [LABELS.get(kind, kind) for kind in kinds]
    figure.legend(handles, names, loc="outside upper center", ncols=5, fontsize="small")
    return figure

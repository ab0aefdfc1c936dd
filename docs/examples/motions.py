"""Pictures of the motions: a flap that turns, on a track, beside a slot, and mirrored; a device; a beam's sections."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.deform.surface.appendix_a import blend
from sdm_deflect.deform.surface.slots import Slot
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.surface.tracks import Track, TrackLaw
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh

GREY, BLUE, RED = "0.55", "#1a73c9", "#d1350f"
OUT_OF_PLANE = np.array([0.0, 0.0, 1.0])


def section(first: float = 0.0, last: float = 1.0, thickness: float = 0.12, n: int = 60) -> FloatArray:
    """Return a NACA section (K, 3) between two shares of its chord, from the rear over the top."""
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n)))
    x = last + (first - last) * share
    y = 5.0 * thickness * (0.2969 * x**0.5 - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    lower = slice(n - 1 if first else n - 2, 0 if last == 1.0 else None, -1)  # no point twice
    both = np.vstack([np.column_stack([x, y]), np.column_stack([x, -y])[lower]])
    return np.column_stack([both, np.zeros(len(both))])


def placed(points: FloatArray, chord: float, degrees: float, at: tuple[float, float]) -> FloatArray:
    """Return a section (K, 3) scaled, turned about its nose, and moved."""
    turned = Axis(np.zeros(3), OUT_OF_PLANE).rotated(chord * points, degrees)
    return turned + np.array([*at, 0.0])


MAIN = section(last=0.97)
FLAP = placed(section(thickness=0.14), 0.3, -18.0, (0.955, -0.045))


def outlined(axes: Axes, points: FloatArray, colour: str, label: str = "") -> None:
    """Draw a closed outline."""
    axes.fill(
        *points[:, :2].T,
        facecolor="0.9" if colour == "black" else "none",
        edgecolor=colour,
        lw=1.4,
        label=label or None,
    )


def plain(axes: Axes, title: str, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Show a part of the plane in true proportions."""
    axes.set(title=title, xlim=x, ylim=y, aspect="equal", xticks=[], yticks=[])


def turned() -> Figure:
    """Draw a rigid flap with a slot, and a blended one whose skins stay joined to the wing."""
    figure = Figure(figsize=(9.6, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    hinge = Axis(np.array([0.99, -0.05, 0.0]), OUT_OF_PLANE)
    for axes in (left, right):
        outlined(axes, MAIN if axes is left else section(last=0.75), "black")
    outlined(left, FLAP, GREY, "before")
    outlined(left, hinge.rotated(FLAP, -15.0), BLUE, "15 degrees down")
    tail = section(first=0.75)
    nodes, sealed = tail[np.argsort(tail[:, 0])], Axis(np.array([0.75, 0.0, 0.0]), OUT_OF_PLANE)
    edge = nodes[-1:]
    moved = tail + blend(tail, nodes[:2], edge, sealed.displacement(edge, -15.0))
    outlined(right, tail, GREY, "before")
    outlined(right, moved, BLUE, "15 degrees down")
    left.plot(*hinge.point[:2], "o", color=RED, label="hinge")
    right.plot(*sealed.point[:2], "o", color=RED, label="hinge")
    plain(left, "rigid: all of it turns", (0.6, 1.3), (-0.25, 0.12))
    plain(right, "blended: its border stays, its trailing edge turns", (0.5, 1.05), (-0.15, 0.12))
    left.legend(fontsize="small", loc="lower left")
    return figure


def track() -> Figure:
    """Draw a flap at the rows of a track, and between them."""
    figure = Figure(figsize=(9.6, 3.0), layout="constrained")
    axes = figure.subplots()
    outlined(axes, MAIN, "black")
    rows = np.zeros((4, 8))
    rows[1:, :4] = [[0.3, -3.0, 0.03, 0.0], [0.7, -10.0, 0.08, -0.015], [1.0, -25.0, 0.1, -0.04]]
    rows[:, 5:] = rows[:, 2:5]
    law = TrackLaw(Track(Axis(np.array([0.99, -0.03, 0.0]), OUT_OF_PLANE), rows), FLAP)
    for amount in np.linspace(0.0, 1.0, 11):
        given = np.isclose(rows[:, 0], amount).any()
        outlined(axes, FLAP + law.displacement(float(amount)), BLUE if given else "0.8")
    plain(axes, "track: places that are given (blue), and between them", (0.6, 1.45), (-0.3, 0.12))
    return figure


def slot() -> Figure:
    """Draw gap and overlap at a trailing edge that is blunt."""
    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    axes = figure.subplots()
    main, flap = MAIN, placed(section(thickness=0.14), 0.3, -25.0, (0.955, -0.022))
    loops = (np.arange(len(main)), len(main) + np.arange(len(flap)))
    lines = (Cells("line", np.column_stack([loop, np.roll(loop, -1)])) for loop in loops)
    patches = tuple(Patch(name, (own,)) for name, own in zip(("main", "flap"), lines, strict=True))
    mesh = Mesh(np.vstack([main, flap]), (Cells("triangle", np.array([[0, 1, 2]])),), patches)
    own = Slot.of(mesh, "main", "flap")
    edge, foot = own.edge, own.edge - own.setting.gap * own.setting.normal
    nose = flap[np.argmin(flap[:, 0])]
    for points in (main, flap):
        outlined(axes, points, "black")
    axes.annotate(
        "", foot, edge, arrowprops={"arrowstyle": "<->", "color": BLUE, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )
    axes.text(foot[0] + 0.003, foot[1] + 0.004, "gap", color=BLUE)
    low = float(nose[1]) - 0.03
    for x, y in ((float(nose[0]), float(nose[1])), (float(edge[0]), float(edge[1]))):
        axes.plot([x, x], [y, low], color=RED, lw=0.8, ls=":")
    ends = [(float(nose[0]), low), (float(edge[0]), low)]
    axes.annotate("", *ends, arrowprops={"arrowstyle": "<->", "color": RED, "lw": 1.6, "shrinkA": 0, "shrinkB": 0})
    axes.text(float(nose[0]), low - 0.006, "overlap, along x", color=RED)
    axes.plot(*edge, "ko", ms=4)
    axes.annotate(
        "lower corner of the trailing edge", edge, (edge[0] + 0.012, edge[1] + 0.012), arrowprops={"arrowstyle": "-"}
    )
    plain(axes, "", (0.88, 1.06), (-0.065, 0.03))
    return figure


def mirror() -> Figure:
    """Draw a wing from above with flaps on both sides: equal angles, and opposite ones."""
    figure = Figure(figsize=(9.6, 2.8), layout="constrained")
    wing = np.array([[0.0, 0.0], [0.35, 1.0], [0.75, 1.0], [0.9, 0.0]])
    flap = np.array([[0.72, 0.3], [0.66, 0.8], [0.775, 0.8], [0.855, 0.3]])
    for axes, sign in zip(figure.subplots(1, 2), (1, -1), strict=True):
        for side, own in ((1.0, 1), (-1.0, sign)):
            axes.fill(side * wing[:, 1], -wing[:, 0], facecolor="0.93", edgecolor="black")
            axes.fill(side * flap[:, 1], -flap[:, 0], facecolor=BLUE if own > 0 else RED, alpha=0.6)
            axes.text(side * 0.55, -0.99, "down" if own > 0 else "up", ha="center", color=BLUE if own > 0 else RED)
        axes.axvline(0.0, color="black", lw=0.8, ls="--")
        axes.text(0.01, -0.1, "y = 0", fontsize="small")
        plain(axes, f"sign {sign:+d}", (-1.1, 1.1), (-1.08, 0.05))
    return figure


def device() -> Figure:
    """Draw the flap that a device cuts from a wing, from above."""
    figure = Figure(figsize=(9.6, 2.8), layout="constrained")
    axes = figure.subplots()
    nose, tail = np.array([[0.0, 0.0], [0.35, 2.0]]), np.array([[0.9, 0.0], [0.8, 2.0]])
    axes.fill(*np.vstack([nose, tail[::-1]])[:, ::-1].T, facecolor="0.93", edgecolor="black")
    ends = np.array([0.45, 0.85])
    front, rear = (side[0] + ends[:, None] * (side[1] - side[0]) for side in (nose, tail))
    hinge = front + 0.75 * (rear - front)
    axes.fill(*np.vstack([hinge, rear[::-1]])[:, ::-1].T, facecolor=BLUE, alpha=0.6)
    axes.plot(hinge[:, 1], hinge[:, 0], color=RED, lw=2)
    for eta, point, name in zip(ends, front, ("ETA1", "ETA2"), strict=True):
        axes.plot([2.0 * eta, 2.0 * eta], [point[0], 1.0], color="black", lw=0.8, ls=":")
        axes.text(2.0 * eta, 1.06, f"{name} = {eta:g}", ha="center")
    axes.text(1.3, float(hinge[:, 0].mean()) - 0.04, "hinge at XSI = 0.75 of the local chord", ha="center", color=RED)
    plain(axes, "", (-0.1, 2.1), (1.12, -0.08))
    return figure


def beam() -> Figure:
    """Draw the sections of a half wing that follow a beam's points: without rotations, and with them."""
    figure = Figure(figsize=(9.6, 2.05), layout="constrained")
    stations, profile = np.linspace(0.0, 3.0, 9), section(thickness=0.15)[:, [0, 2, 1]]
    wing = np.concatenate([profile + np.array([0.0, y, 0.0]) for y in stations])
    points = np.column_stack([0.4 + 0.0 * stations, stations, 0.0 * stations])
    vectors, rotations = np.zeros((2, len(points), 3))
    vectors[:, 2] = 0.06 * stations**2
    rotations[:, 0], rotations[:, 1] = np.arctan(0.12 * stations), 0.17 * stations
    surface = Surface.of(Mesh(wing, (), (Patch("wing", (), np.arange(len(wing))),)), ("wing",))
    titles = ("displacements alone: sections move", "with rotations: sections move and turn")
    for axes, title, turns in zip(figure.subplots(1, 2), titles, (None, rotations), strict=True):
        moved = wing + Table(points, vectors, rotations=turns).law(surface).displacement(1.0)
        for given, colour, label in ((wing, GREY, "before"), (moved, BLUE, "after")):
            for one in np.split(given, len(stations)):
                outlined(axes, _oblique(one), colour, label)
                label = ""
        axes.plot(*_oblique(points + vectors)[:, :2].T, "o-", color=RED, ms=4, label="beam")
        plain(axes, title, (-0.1, 3.8), (-0.45, 0.95))
    axes.legend(fontsize="small", loc="upper left")
    return figure


def _oblique(points: FloatArray) -> FloatArray:
    """Return points (K, 3) of a half wing as seen from above its tip: y to the right, z up, x towards the reader."""
    x, y, z = points.T
    return np.column_stack([y + 0.6 * x, z - 0.2 * x, np.zeros(len(points))])


PICTURES = {"turned": turned, "track": track, "slot": slot, "mirror": mirror, "device": device, "beam": beam}

if __name__ == "__main__":
    for name, draw in PICTURES.items():
        draw().savefig(f"motion_{name}.png", dpi=100)

"""What blending costs: forces on a NACA 0012 with its quarter-chord flap deflected in the mesh, beside a rigid flap.

The wall of the deflected mesh is the polygon of a panel method with vortices whose strength is linear along each panel
(Katz and Plotkin, Low-Speed Aerodynamics, sections 10.3 and 11.4). Flow without viscosity or compressibility, at zero
angle of attack; the chord is 1.
"""

from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import sdm_deflect
from sdm_deflect.base.arrays import BoolArray, FloatArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.report.colours import PALETTE
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.cases.run.output import write_table

# Place of the hinge on the chord, and thickness of the NACA 0012, in chords.
HINGE, THICKNESS = 0.75, 0.12
# Degrees, trailing edge down: the profile is symmetric. Beyond, the skin of the rigid flap folds at its hinge.
ANGLES = (1.0, 5.0, 10.0)
# Panels on either side of the wing and of its flap; half or twice as many change the ratios by 0.002 at most.
PANELS = (120, 30)
# Radius of the mesh in chords, and its layers of quadrilaterals from the wall on, each thicker than the one before.
FAR, LAYERS, GROWTH = 5.0, 30, 1.25
# Lift and pitching moment of a thin aerofoil for each degree of its flap (Glauert, 1927).
THIN = np.arccos(1.0 - 2.0 * HINGE)
THEORY = np.radians(1.0) * np.array([2.0 * (np.pi - THIN + np.sin(THIN)), -0.5 * np.sin(THIN) * (1.0 - np.cos(THIN))])


@dataclass(frozen=True, slots=True)
class Forces:
    """Coefficients of lift, of pitching moment, and of the flap's hinge moment.

    The pitching moment is about the quarter chord, nose up. The hinge moment refers to the flap's chord; it turns the
    trailing edge down.
    """

    lift: float
    moment: float
    hinge_moment: float


@dataclass(frozen=True, slots=True)
class Flap:
    """A flap at an angle (degrees): its forces in the deflected mesh, and those of a rigid flap."""

    angle: float
    blended: Forces
    rigid: Forces

    @property
    def ratios(self) -> FloatArray:
        """Forces of the blended flap over those of the rigid one (3,)."""
        return np.asarray(np.divide(astuple(self.blended), astuple(self.rigid)))


def wall() -> FloatArray:
    """Return the corners (N + 1, 2) of the aerofoil, from the trailing edge along the lower side around to it."""
    forward = HINGE * (1.0 - np.cos(np.linspace(0.0, 0.5 * np.pi, PANELS[0] + 1)))
    aft = np.linspace(HINGE, 1.0, PANELS[1] + 1)
    x = np.append(forward, aft[1:])
    powers = x[:, None] ** np.array([0.5, 1.0, 2.0, 3.0, 4.0])
    y = 5.0 * THICKNESS * powers @ np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1036])
    y[-1] = 0.0
    return np.vstack([np.column_stack([x, -y])[::-1], np.column_stack([x, y])[1:]])


def mesh_around(corners: FloatArray) -> sdm_deflect.Mesh:
    """Return quadrilaterals between an aerofoil (N + 1, 2) and a circle, with the patches wing, flap and far."""
    n = len(corners) - 1
    angle = -2.0 * np.pi * np.arange(n) / n
    circle = np.array([0.5, 0.0]) + FAR * np.column_stack([np.cos(angle), np.sin(angle)])
    share = (GROWTH ** np.arange(LAYERS + 1) - 1.0) / (GROWTH**LAYERS - 1.0)
    points = corners[:-1] + share[:, None, None] * (circle - corners[:-1])
    rows = np.arange((LAYERS + 1) * n).reshape(LAYERS + 1, n)
    around = np.roll(rows, -1, axis=1)
    quads = np.stack([rows[:-1], rows[1:], around[1:], around[:-1]], axis=-1).reshape(-1, 4)
    lines, behind = np.stack([rows[0], around[0]], axis=-1), on_flap(corners)
    parts = {"wing": lines[~behind], "flap": lines[behind], "far": np.stack([rows[-1], around[-1]], axis=-1)}
    patches = tuple(sdm_deflect.Patch(name, (sdm_deflect.Cells("line", own),)) for name, own in parts.items())
    flat = np.pad(points.reshape(-1, 2), [(0, 0), (0, 1)])
    return sdm_deflect.Mesh(flat, (sdm_deflect.Cells("quad", quads),), patches, name="NACA 0012")


def on_flap(corners: FloatArray) -> BoolArray:
    """Return which panels (N,) of an undeflected aerofoil (N + 1, 2) are behind the hinge."""
    return np.asarray(0.5 * (corners[1:, 0] + corners[:-1, 0]) > HINGE)


def deflected(corners: FloatArray, degrees: float) -> FloatArray:
    """Return the corners (N + 1, 2) with the flap down: `sdm deflect --motion blended` moves the mesh around them."""
    result = sdm_deflect.deflect(mesh_around(corners), "flap", [HINGE, 0.0], -degrees, motion="blended", fixed="wing")
    if not result.passed:
        raise InputError(f"the mesh around the flap at {degrees:g} deg fails its checks: {result}")
    around = result.mesh.points[: len(corners) - 1, :2]
    return np.vstack([around, around[:1]])


def turned(corners: FloatArray, degrees: float) -> FloatArray:
    """Return the corners (N + 1, 2) with those behind the hinge turned rigidly about it; the skin is kinked there."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    moved, behind = corners.copy(), corners[:, 0] > HINGE + 1e-9
    moved[behind] = (corners[behind] - [HINGE, 0.0]) @ np.array([[c, -s], [s, c]]) + [HINGE, 0.0]
    return moved


def forces(corners: FloatArray, flap: BoolArray) -> Forces:
    """Return the forces on a polygon (N + 1, 2) in a stream along x; `flap` (N,) are its panels behind the hinge."""
    z = corners @ np.array([1.0, 1j])
    along, middle, pressure = np.diff(z), 0.5 * (z[1:] + z[:-1]), 1.0 - surface_speed(z) ** 2
    force = -1j * pressure * along  # complex: pushes against the outward normal
    arms = (np.conj(middle - at) * force for at in (0.25, HINGE))
    moment, about_hinge = (one.imag for one in arms)
    hinge_moment = float(-about_hinge[flap].sum()) / (1.0 - HINGE) ** 2
    return Forces(float(force.imag.sum()), float(-moment.sum()), hinge_moment)


def surface_speed(z: np.ndarray) -> FloatArray:
    """Return the speed (N,) along the panels of a polygon z (N + 1,) with flow on its left, in a unit stream along x.

    Kutta condition: the vortex strengths at the trailing edge cancel.
    """
    n, length, direction = len(z) - 1, np.abs(np.diff(z)), np.diff(z) / np.abs(np.diff(z))
    local = (0.5 * (z[1:] + z[:-1])[:, None] - z[:-1]) / direction
    logarithm = np.log((local - length) / local)
    logarithm[np.diag_indices(n)] = 1j * np.pi  # on the side of the flow
    rising = (local * logarithm + length) / length
    factor = -1j / (2.0 * np.pi) / direction
    velocity = np.zeros((n, n + 1), dtype=complex)  # conjugate, for a unit strength at each corner
    velocity[:, :-1] += factor * (logarithm - rising)
    velocity[:, 1:] += factor * rising
    normal = (velocity * (1j * direction)[:, None]).real
    matrix = np.vstack([normal, np.eye(n + 1)[0] + np.eye(n + 1)[n]])
    strengths = np.linalg.solve(matrix, np.append(-(1j * direction).real, 0.0))
    return np.asarray((velocity * direction[:, None]).real @ strengths + direction.real)


def measured() -> list[Flap]:
    """Return the flap at each angle."""
    corners = wall()
    flap = on_flap(corners)
    return [
        Flap(angle, forces(deflected(corners, angle), flap), forces(turned(corners, angle), flap)) for angle in ANGLES
    ]


def write_flap(folder: Path) -> str:
    """Write flap.csv and flap.png; return the figures in words."""
    found = measured()
    names = [one.name for one in fields(Forces)]
    rows = [[one.angle, *astuple(one.blended), *astuple(one.rigid), *one.ratios] for one in found]
    heads = [f"{kind}_{name}" for kind in ("blended", "rigid", "ratio") for name in names]
    write_table(folder / "flap.csv", [["angle_deg", *heads], *rows])
    write_png(drawn(), folder / "flap.png")
    lines = [
        f"{one.angle:+g} deg: blended over rigid: lift {one.ratios[0]:.3f}, moment {one.ratios[1]:.3f}, "
        f"hinge moment {one.ratios[2]:.3f}" for one in found
    ]  # fmt: skip
    slope = found[0].blended
    theory = f"a thin aerofoil: {THEORY[0]:.4f} and {THEORY[1]:.5f}"
    return "\n".join([*lines, f"per degree: lift {slope.lift:.4f}, moment {slope.moment:.5f}; {theory}"])


def drawn(angle: float = ANGLES[-1]) -> Figure:
    """Draw both flaps at an angle, and the pressure on them."""
    corners = wall()
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    shape, pressure = figure.subplots(1, 2)
    for own, label, looks in (
        (deflected(corners, angle), "blended", {"color": PALETTE["moves"]}),
        (turned(corners, angle), "rigid", {"color": PALETTE["worse"], "ls": "--"}),
    ):
        middle = 0.5 * (own[1:] + own[:-1])
        shape.plot(*own.T, label=label, **looks)
        pressure.plot(middle[:, 0], 1.0 - surface_speed(own @ np.array([1.0, 1j])) ** 2, label=label, **looks)
    shape.set(
        xlim=(0.68, 1.0), aspect="equal", xlabel="x, chords", ylabel="y, chords", title=f"flap down by {angle:g}°"
    )
    pressure.set(ylim=(1.1, -1.5), xlabel="x, chords", ylabel="pressure coefficient")
    for axes in (shape, pressure):
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    return figure

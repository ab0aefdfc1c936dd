"""Corners of the hexahedra that confine a deformation (paper, section 3) and of a Chimera block (section 5.2)."""

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np

from .datum import hinge_edges, parent_ribs, ribs, trailing_edge
from .parameters import MIRROR, Fighter, FloatArray
from .quantity import Checked, quantity

# Corner i has the binary code zyx. Mirroring swaps the corners that differ in y.
MIRRORED_CORNERS = [2, 3, 0, 1, 6, 7, 4, 5]

# Where the inward face of a tail's hexahedron lies, by the y of its panel's borders: inside the fuselage.
INWARD = 0.5


@dataclass(frozen=True, slots=True)
class Margins(Checked):
    """How far a confinement hexahedron reaches beyond its surface, in metres.

    A hinged surface's hexahedron begins `ahead` of its hinge line, 0 in the paper. A tail's begins at its panel's front
    border; at its outboard face, `aft` is measured from the rear border, `up` and `down` from the panel's upper and
    lower borders. A rudder's `up` is to starboard, its `down` to port.
    """

    aft: float = quantity(0.05, "m", 1e-4, 10.0, "beyond the trailing edge")
    outboard: float = quantity(0.05, "m", 1e-4, 10.0, "beyond the tip")
    up: float = quantity(0.05, "m", 1e-4, 10.0, "above the hinge line")
    down: float = quantity(0.05, "m", 1e-4, 10.0, "below the hinge line")
    ahead: float = quantity(0.0, "m", 0.0, 10.0, "ahead of the hinge line of a hinged surface")


@dataclass(frozen=True, slots=True)
class BlockParameters(Checked):
    """Extent of a Chimera block beyond its aileron, in metres, and where in the gap it ends."""

    ahead: float = quantity(0.04, "m", 1e-3, 10.0, "ahead of the hinge line, parallel to it")
    aft: float = quantity(0.08, "m", 1e-3, 10.0, "behind the trailing edge")
    outboard: float = quantity(0.08, "m", 1e-3, 10.0, "beyond the tip, where the aileron reaches it")
    up: float = quantity(0.08, "m", 1e-3, 10.0, "above the wing's plane")
    down: float = quantity(0.08, "m", 1e-3, 10.0, "below the wing's plane")
    gap_share: float = quantity(0.6, "", 0.3, 0.7, "distance of the end face from the aileron, by the gap")


def hexahedron_corners(fighter: Fighter, surface: str, margins: Margins) -> FloatArray:
    """Return corners (8, 3) of a convex hexahedron with planar faces around a control surface.

    Corner i lies aft where i & 1, to starboard where i & 2, above where i & 4. Inside are the surface and
    flow, with a tail also its fuselage panel, and no node of any other component.
    """
    if surface == "rudder":
        return _rudder(fighter, margins)
    if surface.startswith("tail"):
        return _on_side(surface, _tail(fighter, margins))
    return _around_aileron(fighter, surface, parent_ribs(fighter, surface), margins, margins.ahead)


def inward_face(surface: str) -> str:
    """Return the hexahedron's face towards the parent: in the plane of the inboard rib, or inside the fuselage."""
    if surface == "rudder":
        return "z-"
    return "y+" if surface.endswith("_left") else "y-"


def rib_faces(fighter: Fighter, surface: str) -> tuple[str, ...]:
    """Return the hexahedron's faces in the planes of the parent's ribs, inboard first; none for a tail."""
    opposite = {"z-": "z+", "y+": "y-", "y-": "y+"}
    inward = inward_face(surface)
    return (inward, opposite[inward])[: len(parent_ribs(fighter, surface))]


def _around_aileron(
    fighter: Fighter, surface: str, stations: FloatArray, reach: Margins | BlockParameters, ahead: float = 0.0
) -> FloatArray:
    """Return corners (8, 3): end faces at stations (k,), a vertical front face `ahead` of the hinge edges (metres)."""
    hinge = hinge_edges(fighter, "aileron_right")[0]
    y = np.append(np.abs(stations), fighter.wing.half_span + reach.outboard)[:2]
    x = np.array([along(hinge[:, 1], hinge[:, 0], y) - ahead, np.full(2, fighter.wing.x_te + reach.aft)])
    return _on_side(surface, _corners(x, y, np.array([[-reach.down] * 2, [reach.up] * 2])))


def _on_side(surface: str, starboard: FloatArray) -> FloatArray:
    return starboard if surface.endswith("_right") else (starboard * MIRROR)[MIRRORED_CORNERS]


def _tail(fighter: Fighter, margins: Margins) -> FloatArray:
    """Return corners (8, 3): front face in the plane of the panel's front border, upper and lower by its meridians.

    The rear face touches the panel's rear border where the fuselage is widest, and leans aft by `aft` at the outboard
    face. In the border's plane it would stand only ten millimetres behind a trailing edge that moves as far. Nodes of
    the panel behind the rear face stay.
    """
    f, tail = fighter.fuselage, fighter.tail
    border = f.radius * np.array([cos(radians(f.panel_angle)), sin(radians(f.panel_angle))])
    y = np.array([INWARD * border[0], tail.half_span + margins.outboard])
    reach = y[1] - border[0]
    upper = border[1] + margins.up * (y - border[0]) / reach
    lower = -border[1] - margins.down * (y - border[0]) / reach
    tip = trailing_edge(fighter, "tail_right")[1]
    room = along(y, upper, tip[1:2])[0] - tip[2], tip[2] - along(y, lower, tip[1:2])[0]
    for name, value in zip(("up", "down"), room, strict=True):
        if value <= 0.0:
            raise ValueError(f"margins.{name} leaves the tail's tip {-value:g} m outside its hexahedron")
    rear = f.panel_rear + margins.aft * (y - f.radius) / (y[1] - f.radius)
    x = np.array([[f.panel_front] * 2, rear])
    return _corners(x, y, np.array([lower, upper]))


def _rudder(fighter: Fighter, margins: Margins) -> FloatArray:
    """Return corners (8, 3): front face ahead of the hinge edges, lower face in the plane of the rudder's lower end."""
    hinge, trailing = hinge_edges(fighter, "rudder")[0], trailing_edge(fighter, "rudder")
    z = np.append(parent_ribs(fighter, "rudder"), fighter.fin.z_tip + margins.outboard)[:2]
    front = along(hinge[:, 2], hinge[:, 0], z) - margins.ahead
    aft = along(trailing[:, 2], trailing[:, 0], z) + margins.aft
    corners = [[x[k], y, z[k]] for k in (0, 1) for y in (-margins.down, margins.up) for x in (front, aft)]
    return np.array(corners)


def _corners(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Return corners (8, 3) from x[aft][outboard] (2, 2), y[outboard] (2,), z[above][outboard] (2, 2)."""
    return np.array([[x[a, o], y[o], z[k, o]] for k in (0, 1) for o in (0, 1) for a in (0, 1)])


def along(stations: FloatArray, values: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return values (k,) at stations (k,) on the straight line through two stations (2,) and values (2,)."""
    slope = (values[1] - values[0]) / (stations[1] - stations[0])
    return np.asarray(values[0] + slope * (wanted - stations[0]), dtype=np.float64)


def gap_faces(fighter: Fighter, parameters: BlockParameters, surface: str) -> FloatArray:
    """Return stations y (k,) of the block's faces that stand in a gap, perpendicular to y; inboard first.

    ValueError if the surface is no aileron or has no gap.
    """
    if not surface.startswith("aileron"):
        raise ValueError(f"a Chimera block surrounds an aileron, not {surface!r}")
    if fighter.aileron.gap == 0.0:
        raise ValueError("a Chimera block needs a gap to end in; aileron.gap is 0")
    ends, parent = ribs(fighter, surface), parent_ribs(fighter, surface)
    return np.asarray(ends + parameters.gap_share * (parent - ends), dtype=np.float64)


def block_corners(fighter: Fighter, parameters: BlockParameters, surface: str) -> FloatArray:
    """Return corners (8, 3) of the block, in the order of `hexahedron_corners`: bits aft, starboard, above."""
    stations = gap_faces(fighter, parameters, surface)
    return _around_aileron(fighter, surface, stations, parameters, parameters.ahead)

"""Components with plane faces as polyhedra (starboard side), without lofts and booleans on thin parts."""

from collections.abc import Sequence
from itertools import pairwise
from math import cos, hypot, radians, sin, tan

import numpy as np

from .parameters import (
    BURIED,
    FRONT_LOWER,
    FRONT_UPPER,
    HINGE_LOWER,
    HINGE_UPPER,
    LE,
    TE,
    Fighter,
    FloatArray,
    Fuselage,
    Pedestal,
    Strake,
    VentralFin,
    Wing,
    aileron_span,
    fin_section,
    rudder_span,
    wing_section,
)

# Planar polygons (n, 3), each a closed loop of corners.
Loops = tuple[FloatArray, ...]

# A section without its trailing-edge wedge, and the wedge alone.
BOX = [LE, FRONT_UPPER, HINGE_UPPER, HINGE_LOWER, FRONT_LOWER]
WEDGE = [HINGE_UPPER, TE, HINGE_LOWER]

# Where plates end inside the fuselage, by its radius.
STRAKE_ROOT = 0.45
VENTRAL_ROOT = 0.67


def prism(first: FloatArray, last: FloatArray) -> Loops:
    """Return faces between two rings of corners (n, 3) of equal length, with both ends closed."""
    following = np.roll(np.arange(len(first)), -1)
    strips = [np.array([first[i], first[j], last[j], last[i]]) for i, j in enumerate(following.tolist())]
    return (first[::-1], last, *strips)


def wing_polyhedra(fighter: Fighter, notch: float = 0.0) -> list[Loops]:
    """Return the wing without its aileron: the part inboard of the kink, the box outboard, the rest of the wedge.

    Between the ribs the box ends a `notch` (m) ahead of the hinge edges.
    """
    wing, span = fighter.wing, aileron_span(fighter)
    root, kink = (wing_section(wing, y) for y in (BURIED * fighter.fuselage.radius, wing.y_kink))
    rest = [(wing.y_kink, span.wing_rib), (span.outer_rib, wing.half_span)]
    wedges = [prism(*(wing_section(wing, y)[WEDGE] for y in ends)) for ends in rest if ends[0] < ends[1]]
    notched = (span.wing_rib, span.outer_rib)
    pieces = [*rest, notched] if notch else [(wing.y_kink, wing.half_span)]
    boxes = [_wing_box(wing, ends, notch if ends == notched else 0.0) for ends in pieces if ends[0] < ends[1]]
    return [prism(root, kink), *boxes, *wedges]


def _wing_box(wing: Wing, ends: tuple[float, float], notch: float) -> Loops:
    """Return the wing ahead of its hinge edges between two stations y; it ends a `notch` (m) ahead of them."""
    sections = [wing_section(wing, y) for y in ends]
    for section in sections:
        section[[HINGE_UPPER, HINGE_LOWER], 0] -= notch
    return prism(*(section[BOX] for section in sections))


def fin_polyhedra(fighter: Fighter) -> list[Loops]:
    """Return the fin without its rudder: the box, which ends inside the pedestal, and the rest of the wedge."""
    fin = fighter.fin
    lower, upper = rudder_span(fighter)
    buried = 0.75 * fighter.fuselage.radius
    foot, tip = fin_section(fin, buried), fin_section(fin, fin.z_tip)
    rest = ((buried, lower), (upper, fin.z_tip))
    wedges = [prism(*(fin_section(fin, z)[WEDGE] for z in ends)) for ends in rest if ends[0] < ends[1]]
    return [prism(foot[BOX], tip[BOX]), *wedges]


def strake_polyhedra(strake: Strake, fuselage: Fuselage) -> list[Loops]:
    """Return one polyhedron for each segment of the leading edge, cut along the bisecting lines of its corners.

    The bevels of neighbouring segments meet at a flat angle, so a face has to stand behind the crease.
    """
    outline, inner, root = _strake_plan(strake, fuselage)
    half = 0.5 * strake.thickness
    cuts = pairwise(zip(outline, inner, root, strict=True))
    return [_bevelled_piece(first, last, half) for first, last in cuts]


def _strake_plan(strake: Strake, fuselage: Fuselage) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners (n, 2) of leading edge and inner bevel line, and of the cuts through both at the root."""
    y = STRAKE_ROOT * fuselage.radius
    first, second, third = (strake.x_1, strake.y_1), (strake.x_2, strake.y_2), (strake.x_3, strake.y_3)
    start = (first[0] - (first[1] - y) / tan(radians(strake.root_angle)), y)
    slope = (third[1] - second[1]) / (third[0] - second[0])
    end = (strake.x_end, third[1] + slope * (strake.x_end - third[0]))
    outline = np.array([start, first, second, end])
    base, aft = np.array([[0.0, y], [1.0, y]]), np.array([[strake.x_end, 0.0], [strake.x_end, 1.0]])
    inner = inset(outline, strake.bevel, base, aft)
    cuts = [crossing(np.array([p, q]), base) for p, q in zip(outline[1:-1], inner[1:-1], strict=True)]
    return outline, inner, np.array([inner[0], *cuts, [strake.x_end, y]])


def _bevelled_piece(first: Sequence[FloatArray], last: Sequence[FloatArray], half: float) -> Loops:
    """Return a piece between two cuts, each given by its edge, inner and root point in plan, (2,) each."""
    (edge0, inner0, root0), (edge1, inner1, root1) = first, last
    across = (0.0, half, half, -half, -half)
    faces = [
        _at_heights((edge0, inner0, root0, root0, inner0), across),
        _at_heights((edge1, inner1, root1, root1, inner1), across),
        _at_heights((root0, root1, root1, root0), (half, half, -half, -half)),
    ]
    for z in (half, -half):
        faces.append(_at_heights((inner0, inner1, root1, root0), (z, z, z, z)))
        faces.append(_at_heights((edge0, edge1, inner1, inner0), (0.0, 0.0, z, z)))
    return tuple(faces)


def _at_heights(plan: Sequence[FloatArray], heights: Sequence[float]) -> FloatArray:
    """Return the loop (n, 3) over plan corners without repeated points; the first piece's root is on its bevel."""
    loop = np.column_stack([np.array(plan), np.array(heights)])
    return loop[np.any(loop != np.roll(loop, 1, axis=0), axis=1)]


def ventral_polyhedron(ventral: VentralFin, fuselage: Fuselage) -> Loops:
    """Return a plate whose three free edges are bevelled by parallel insets, so that every face is planar."""
    v, buried = ventral, VENTRAL_ROOT * fuselage.radius
    lean = (v.x_tip - v.x_root) / (v.r_tip - fuselage.radius)
    root = [v.x_root - lean * (fuselage.radius - buried), buried]
    outline = np.array([root, [v.x_tip, v.r_tip], [v.x_te, v.r_te], [v.x_te, buried]])
    base = np.array([[0.0, buried], [1.0, buried]])
    inner = inset(outline, v.bevel, base, base)
    half = 0.5 * v.thickness
    edge, right, left = (
        _canted(plan, offset, v.cant) for plan, offset in ((outline, 0.0), (inner, half), (inner, -half))
    )
    bevels = [np.array([edge[i], edge[i + 1], flat[i + 1], flat[i]]) for flat in (right, left) for i in range(3)]
    foot = np.array([edge[0], right[0], right[3], edge[3], left[3], left[0]])
    return (right, left, *bevels, foot)


def pedestal_polyhedron(pedestal: Pedestal, fuselage: Fuselage) -> Loops:
    """Return a block, pointed in plan; its top rises from the fuselage and then is flat."""
    p, low = pedestal, 0.75 * fuselage.radius
    slope = (p.z_top - fuselage.radius) / (p.x_ramp_end - p.x_foot)

    def corner(x: float, y: float, z: float) -> list[float]:
        return [x, y, min(z, p.z_top + slope * (min(x, p.x_ramp_end) - p.x_ramp_end))]

    def pair(x: float, z: float) -> tuple[list[float], list[float]]:
        return corner(x, p.half_width, z), corner(x, -p.half_width, z)

    apex0, apex1 = corner(p.x_apex, 0.0, low), corner(p.x_apex, 0.0, p.z_top)
    (s0, t0), (s1, t1) = pair(p.x_shoulder, low), pair(p.x_shoulder, p.z_top)
    (s2, t2), (s3, t3), (s4, t4) = pair(p.x_ramp_end, p.z_top), pair(p.x_aft, p.z_top), pair(p.x_aft, low)
    faces = [[apex0, s0, s4, t4, t0], [apex1, s1, s2, t2, t1], [s2, s3, t3, t2], [s3, s4, t4, t3]]
    faces += [[apex0, s0, s1, apex1], [apex0, t0, t1, apex1]]
    faces += [[s0, s4, s3, s2, s1], [t0, t4, t3, t2, t1]]
    return tuple(np.array(face) for face in faces)


def inset(outline: FloatArray, width: float, first: FloatArray, last: FloatArray) -> FloatArray:
    """Return corners (n, 2) of the parallel inset, to the right of an open outline (n, 2).

    The inset begins on the line `first` and ends on the line `last`, each given by two points (2, 2).
    """
    lines = [first]
    for a, b in pairwise(outline):
        right = np.array([b[1] - a[1], a[0] - b[0]]) / hypot(*(b - a))
        lines.append(np.array([a, b]) + width * right)
    return np.array([crossing(a, b) for a, b in pairwise([*lines, last])])


def crossing(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the point (2,) where two lines, each given by two points (2, 2), cross.

    The elimination is written out: a solver of LAPACK gives other last bits on processors with AVX-512, and one bit of
    a corner gives another mesh.
    """
    (u, v), (p, q), (x, y) = a[1] - a[0], b[0] - b[1], b[0] - a[0]
    if abs(v) > abs(u):
        (u, v), (p, q), (x, y) = (v, u), (q, p), (y, x)
    factor = v / u
    share = (x - p * ((y - factor * x) / (q - factor * p))) / u
    return np.asarray(a[0] + share * (a[1] - a[0]), dtype=np.float64)


def _canted(plan: FloatArray, offset: float, cant: float) -> FloatArray:
    """Return points (n, 3) from (x, r) in the plane through the axis `cant` degrees from straight down."""
    c, s = cos(radians(cant)), sin(radians(cant))
    x, r = plan.T
    return np.column_stack([x, r * s + offset * c, -r * c + offset * s])

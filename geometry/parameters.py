"""The parameters of the Standard Dynamics Model, with units and ranges, and geometry that follows from them alone.

Metres and degrees; x aft from the nose apex, y starboard, z up. The defaults follow the three-view of Chung
et al. (JoAAA 54(2), 2022), scaled to the paper's span. At the strake root and the aft end of the inlet that would give
needle faces, which a mesher cannot resolve; there the defaults give the closest shape without them.

Sections of wing, tail and fin are hexagons: double wedges of six points. With thickness and bevels in constant
proportion to the chord, every face between two of them is planar.

Also reference area, lengths and point of the aircraft, for coefficients of forces.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, radians, sin, tan
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from .quantity import Checked, quantity

FloatArray = NDArray[np.float64]

# Largest angle (deg) of a control surface: the kernel builds the deflected aircraft up to it, not at 90.
LARGEST_TURN = 85.0

# Positions of a section's points, once around from the leading edge.
LE, FRONT_UPPER, HINGE_UPPER, TE, HINGE_LOWER, FRONT_LOWER = range(6)

# The port side is the starboard side times this.
MIRROR = np.array([1.0, -1.0, 1.0])

# How far inside the fuselage a root lies, by its radius: deep enough for a tail turned by 30 degrees.
BURIED = 0.42

# Metres. Shorter edges cost the volume mesher its quality; narrower gaps hold no cell at all.
MIN_FEATURE = 0.003
MIN_GAP = 0.0005

# Metres. Stations closer than this are meant to be one.
SAME_STATION = 1e-4

# The paper's spanwise gap by half-span (section 5).
PAPER_GAP_RATIO = 0.014


@dataclass(frozen=True, slots=True)
class Fuselage(Checked):
    """Tangent ogive and cylinder; a cylinder panel next to each tail is a patch of its own."""

    length: float = quantity(0.943, "m", 0.1, 10.0, "nose apex to base")
    radius: float = quantity(0.067, "m", 0.01, 1.0, "radius of the cylinder")
    nose_length: float = quantity(0.390, "m", 0.02, 5.0, "length of the ogive")
    panel_front: float = quantity(0.755, "m", 0.05, 10.0, "x of the panels' front border")
    panel_rear: float = quantity(0.940, "m", 0.05, 10.0, "x of the panels' rear border")
    panel_angle: float = quantity(74.0, "deg", 20.0, 75.0, "polar half-angle of a panel from the horizontal")


@dataclass(frozen=True, slots=True)
class Canopy(Checked):
    """Ellipsoid half sunk into the fuselage."""

    x: float = quantity(0.3034, "m", 0.0, 10.0, "x of the centre")
    z: float = quantity(0.0450, "m", 0.0, 1.0, "z of the centre")
    semi_length: float = quantity(0.1098, "m", 0.01, 2.0, "semi-axis along x")
    semi_width: float = quantity(0.0230, "m", 0.005, 1.0, "semi-axis along y")
    semi_height: float = quantity(0.0390, "m", 0.005, 1.0, "semi-axis along z")


@dataclass(frozen=True, slots=True)
class Inlet(Checked):
    """Blocked inlet under the fuselage: ruled lofts between four stations with a rounded bottom."""

    x_1: float = quantity(0.328, "m", 0.0, 10.0, "x of the front station")
    half_width_1: float = quantity(0.0413, "m", 0.002, 1.0, "half-width at station 1")
    z_side_1: float = quantity(-0.0755, "m", -2.0, 0.0, "z where the side ends, station 1")
    z_bottom_1: float = quantity(-0.0885, "m", -2.0, 0.0, "lowest z at station 1")
    x_2: float = quantity(0.410, "m", 0.0, 10.0, "x of station 2")
    half_width_2: float = quantity(0.0395, "m", 0.002, 1.0, "half-width at station 2")
    z_side_2: float = quantity(-0.0745, "m", -2.0, 0.0, "z where the side ends, station 2")
    z_bottom_2: float = quantity(-0.0875, "m", -2.0, 0.0, "lowest z at station 2")
    x_3: float = quantity(0.660, "m", 0.0, 10.0, "x of station 3")
    half_width_3: float = quantity(0.0180, "m", 0.002, 1.0, "half-width at station 3")
    z_side_3: float = quantity(-0.0730, "m", -2.0, 0.0, "z where the side ends, station 3")
    z_bottom_3: float = quantity(-0.0775, "m", -2.0, 0.0, "lowest z at station 3")
    x_4: float = quantity(0.740, "m", 0.0, 10.0, "x of the aft station, inside the fuselage")
    half_width_4: float = quantity(0.0120, "m", 0.002, 1.0, "half-width at station 4")
    z_side_4: float = quantity(-0.0500, "m", -2.0, 0.0, "z where the side ends, station 4")
    z_bottom_4: float = quantity(-0.0515, "m", -2.0, 0.0, "lowest z at station 4")

    def stations(self) -> tuple[tuple[float, ...], ...]:
        """Stations from front to aft, each with x, half-width, z of the side and z of the bottom."""
        columns = ("x", "half_width", "z_side", "z_bottom")
        return tuple(tuple(getattr(self, f"{name}_{i}") for name in columns) for i in range(1, 5))


@dataclass(frozen=True, slots=True)
class Pedestal(Checked):
    """Dorsal pedestal under the fin: pointed in plan, with a ramp in front and a flat top."""

    x_apex: float = quantity(0.640, "m", 0.0, 10.0, "x of the plan's point, inside the fuselage")
    x_foot: float = quantity(0.659, "m", 0.0, 10.0, "x where the ramp leaves the top of the cylinder")
    x_shoulder: float = quantity(0.703, "m", 0.0, 10.0, "x where the plan reaches its full width")
    x_ramp_end: float = quantity(0.725, "m", 0.0, 10.0, "x where the ramp reaches the top")
    x_aft: float = quantity(0.892, "m", 0.0, 10.0, "x of the aft end")
    half_width: float = quantity(0.0112, "m", 0.003, 0.5, "half-width")
    z_top: float = quantity(0.0855, "m", 0.0, 2.0, "z of the flat top")


@dataclass(frozen=True, slots=True)
class Strake(Checked):
    """Flat plate with bevelled leading edge from the nose into the wing."""

    thickness: float = quantity(0.005, "m", 0.001, 0.1, "thickness")
    bevel: float = quantity(0.008, "m", 0.001, 0.1, "width of the bevel")
    root_angle: float = quantity(45.0, "deg", 20.0, 80.0, "angle at which the leading edge leaves the nose")
    x_1: float = quantity(0.2850, "m", 0.0, 10.0, "x of the leading edge's first corner")
    y_1: float = quantity(0.0737, "m", 0.0, 5.0, "y of the leading edge's first corner")
    x_2: float = quantity(0.3195, "m", 0.0, 10.0, "x of the second corner")
    y_2: float = quantity(0.0833, "m", 0.0, 5.0, "y of the second corner")
    x_3: float = quantity(0.4533, "m", 0.0, 10.0, "x of a third point, which gives the last direction")
    y_3: float = quantity(0.0995, "m", 0.0, 5.0, "y of that point")
    x_end: float = quantity(0.500, "m", 0.0, 10.0, "x where the strake ends, inside the wing")


@dataclass(frozen=True, slots=True)
class Wing(Checked):
    """Trapezoid of hexagonal section with unswept trailing edge; constant thickness inboard of the kink."""

    half_span: float = quantity(0.3048, "m", 0.05, 5.0, "y of the tip")
    root_chord: float = quantity(0.3311, "m", 0.02, 5.0, "chord at y = 0")
    tip_chord: float = quantity(0.0753, "m", 0.01, 5.0, "chord at the tip")
    x_te: float = quantity(0.6990, "m", 0.05, 10.0, "x of the trailing edge")
    thickness_ratio: float = quantity(0.040, "", 0.01, 0.2, "thickness by chord, outboard of the kink")
    bevel_ratio: float = quantity(0.0955, "", 0.02, 0.4, "width of either bevel by chord, outboard of the kink")
    y_kink: float = quantity(0.112, "m", 0.02, 5.0, "y inboard of which thickness and bevels are constant")


@dataclass(frozen=True, slots=True)
class Aileron(Checked):
    """The wing's trailing-edge bevel wedge between two span stations."""

    gap: float = quantity(0.0, "m", 0.0, 1.0, "spanwise gap between wing and aileron; 0: none")
    y_inboard: float = quantity(0.0, "m", 0.0, 5.0, "y of the inboard end; 0: one gap outboard of the wing's kink")
    y_outboard: float = quantity(0.0, "m", 0.0, 5.0, "y of the outboard end; 0: the wing tip")


@dataclass(frozen=True, slots=True)
class Tail(Checked):
    """All-moving horizontal tail of hexagonal section, its plane through the fuselage axis."""

    half_span: float = quantity(0.1778, "m", 0.03, 5.0, "y of the tip")
    root_chord: float = quantity(0.1352, "m", 0.01, 5.0, "chord at the fuselage's side")
    x_te: float = quantity(0.9225, "m", 0.05, 10.0, "x of the unswept trailing edge")
    le_sweep: float = quantity(40.0, "deg", 0.0, 70.0, "sweep of the leading edge")
    anhedral: float = quantity(10.0, "deg", -30.0, 30.0, "tip below root")
    thickness_ratio: float = quantity(0.050, "", 0.01, 0.2, "thickness by chord")
    bevel_ratio: float = quantity(0.12, "", 0.02, 0.4, "width of either bevel by chord")
    pivot: float = quantity(0.60, "", 0.0, 1.0, "axis of rotation by root chord, from the leading edge")


@dataclass(frozen=True, slots=True)
class VentralFin(Checked):
    """Flat plate with bevelled edges in a plane through the fuselage axis."""

    cant: float = quantity(25.0, "deg", 0.0, 60.0, "angle from the vertical")
    x_root: float = quantity(0.6559, "m", 0.0, 10.0, "x of the leading edge on the fuselage")
    x_tip: float = quantity(0.6821, "m", 0.0, 10.0, "x of the leading edge's tip")
    r_tip: float = quantity(0.1240, "m", 0.01, 5.0, "distance of that tip from the axis")
    x_te: float = quantity(0.7514, "m", 0.0, 10.0, "x of the trailing edge")
    r_te: float = quantity(0.1058, "m", 0.01, 5.0, "distance of the trailing edge's tip from the axis")
    thickness: float = quantity(0.0032, "m", 0.001, 0.1, "thickness")
    bevel: float = quantity(0.006, "m", 0.001, 0.1, "width of the bevels")


@dataclass(frozen=True, slots=True)
class Fin(Checked):
    """Trapezoidal fin of hexagonal section in the plane y = 0."""

    z_root: float = quantity(0.0855, "m", 0.0, 5.0, "z to which the root values refer")
    z_tip: float = quantity(0.2133, "m", 0.0, 5.0, "z of the tip")
    x_le: float = quantity(0.7340, "m", 0.0, 10.0, "x of the leading edge at the root")
    root_chord: float = quantity(0.1520, "m", 0.01, 5.0, "chord at the root")
    le_sweep: float = quantity(47.5, "deg", 0.0, 75.0, "sweep of the leading edge")
    te_sweep: float = quantity(28.2, "deg", -30.0, 75.0, "sweep of the trailing edge")
    thickness_ratio: float = quantity(0.040, "", 0.01, 0.2, "thickness by chord")
    bevel_ratio: float = quantity(0.10, "", 0.02, 0.4, "width of either bevel by chord")


@dataclass(frozen=True, slots=True)
class Rudder(Checked):
    """The fin's trailing-edge bevel wedge between two heights."""

    z_inboard: float = quantity(0.0955, "m", 0.0, 5.0, "z of the lower end, above the pedestal")
    z_outboard: float = quantity(0.0, "m", 0.0, 5.0, "z of the upper end; 0: the fin's tip")


@dataclass(frozen=True, slots=True)
class Fighter:
    """The whole aircraft; ValueError if its components do not fit each other."""

    fuselage: Fuselage = field(default_factory=Fuselage)
    canopy: Canopy = field(default_factory=Canopy)
    inlet: Inlet = field(default_factory=Inlet)
    pedestal: Pedestal = field(default_factory=Pedestal)
    strake: Strake = field(default_factory=Strake)
    wing: Wing = field(default_factory=Wing)
    aileron: Aileron = field(default_factory=Aileron)
    tail: Tail = field(default_factory=Tail)
    ventral: VentralFin = field(default_factory=VentralFin)
    fin: Fin = field(default_factory=Fin)
    rudder: Rudder = field(default_factory=Rudder)

    def __post_init__(self) -> None:
        for check in (_fuselage, _wing, _aileron, _tail, _fin, _rudder, _under_side):
            check(self)


def hexagon(leading: FloatArray, chord: float, bevel: float, half_thickness: float, up: FloatArray) -> FloatArray:
    """Return the section (6, 3) of a chord along x from `leading` (3,), thick along the unit vector `up` (3,)."""
    aft = np.array([0.0, bevel, chord - bevel, chord, chord - bevel, bevel])
    above = half_thickness * np.array([0.0, 1.0, 1.0, 0.0, -1.0, -1.0])
    return np.asarray(leading + np.outer(aft, [1.0, 0.0, 0.0]) + np.outer(above, up), dtype=np.float64)


def wing_section(wing: Wing, y: float) -> FloatArray:
    """Return the starboard wing's section (6, 3) at a span station."""
    chord = _wing_chord(wing, y)
    reference = _wing_chord(wing, max(y, wing.y_kink))
    leading = np.array([wing.x_te - chord, y, 0.0])
    half = 0.5 * wing.thickness_ratio * reference
    return hexagon(leading, chord, wing.bevel_ratio * reference, half, np.array([0.0, 0.0, 1.0]))


def _wing_chord(wing: Wing, y: float) -> float:
    return wing.root_chord + (wing.tip_chord - wing.root_chord) * y / wing.half_span


def tail_section(tail: Tail, fuselage: Fuselage, y: float) -> FloatArray:
    """Return the starboard tail's section (6, 3), perpendicular to the tail's plane, whose chord line is at `y`."""
    slope = radians(tail.anhedral)
    beside = fuselage.radius * cos(slope)
    chord = tail.root_chord - (y - beside) * tan(radians(tail.le_sweep))
    leading = np.array([tail.x_te - chord, y, -y * tan(slope)])
    up = np.array([0.0, sin(slope), cos(slope)])
    return hexagon(leading, chord, tail.bevel_ratio * chord, 0.5 * tail.thickness_ratio * chord, up)


def tail_pivot(tail: Tail, fuselage: Fuselage) -> FloatArray:
    """Return the point where the tail's axis of rotation, parallel to y, pierces the starboard root chord (3,)."""
    slope = radians(tail.anhedral)
    beside = fuselage.radius * cos(slope)
    x = tail.x_te - (1.0 - tail.pivot) * tail.root_chord
    return np.array([x, beside, -beside * tan(slope)])


def fin_section(fin: Fin, z: float) -> FloatArray:
    """Return the fin's section (6, 3) at a height; its upper points are on the starboard side."""
    above = z - fin.z_root
    sweep = tan(radians(fin.le_sweep))
    chord = fin.root_chord - above * (sweep - tan(radians(fin.te_sweep)))
    leading = np.array([fin.x_le + above * sweep, 0.0, z])
    up = np.array([0.0, 1.0, 0.0])
    return hexagon(leading, chord, fin.bevel_ratio * chord, 0.5 * fin.thickness_ratio * chord, up)


@dataclass(frozen=True, slots=True)
class AileronSpan:
    """Span stations (y >= 0, metres) of an aileron and of the wing's ribs that face it.

    Without a gap a rib and the aileron's end coincide; `outer_rib` is the tip if the aileron reaches it.
    """

    wing_rib: float
    inboard: float
    outboard: float
    outer_rib: float


def aileron_span(fighter: Fighter) -> AileronSpan:
    """Return the stations; a rib within a tenth of a millimetre of the wing's kink is moved to it."""
    wing, aileron = fighter.wing, fighter.aileron
    offset = aileron.gap or PAPER_GAP_RATIO * wing.half_span
    inboard = aileron.y_inboard or wing.y_kink + offset
    rib = _snap(inboard - aileron.gap, wing.y_kink)
    outboard = _snap(aileron.y_outboard or wing.half_span, wing.half_span)
    outer = outboard if outboard == wing.half_span else _snap(outboard + aileron.gap, wing.half_span)
    return AileronSpan(rib, inboard, outboard, outer)


def rudder_span(fighter: Fighter) -> tuple[float, float]:
    """Return heights z of the rudder's lower and upper end."""
    tip = fighter.fin.z_tip
    return fighter.rudder.z_inboard, _snap(fighter.rudder.z_outboard or tip, tip)


def _snap(station: float, target: float) -> float:
    return target if abs(station - target) < SAME_STATION else station


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


def _increasing(fighter: Fighter, *quantities: str | tuple[str, float]) -> None:
    """Raise ValueError unless values increase: parameters by their names, or pairs of a name and a value."""
    named = [(each, attrgetter(each)(fighter)) if isinstance(each, str) else each for each in quantities]
    for (name, value), (following, limit) in pairwise(named):
        _require(
            value + MIN_FEATURE <= limit,
            f"{name} = {value:g} m must lie at least {MIN_FEATURE:g} m below {following} = {limit:g} m",
        )


def _fuselage(fighter: Fighter) -> None:
    f, p = fighter.fuselage, fighter.pedestal
    _increasing(fighter, "fuselage.nose_length", "fuselage.panel_front", "fuselage.panel_rear", "fuselage.length")
    _increasing(fighter, "pedestal.x_apex", "pedestal.x_shoulder", "pedestal.x_aft")
    _increasing(fighter, "pedestal.x_foot", "pedestal.x_ramp_end")
    _increasing(fighter, "fuselage.radius", "pedestal.z_top")
    beside = f.radius * cos(radians(f.panel_angle))
    _require(
        p.half_width + MIN_FEATURE <= beside,
        f"pedestal.half_width = {p.half_width:g} m reaches the panels beside the tails, which begin at y = "
        f"{beside:.4g} m; reduce it or fuselage.panel_angle",
    )


def _wing(fighter: Fighter) -> None:
    _increasing(fighter, "wing.tip_chord", "wing.root_chord")
    _increasing(fighter, "fuselage.radius", "wing.y_kink", "wing.half_span")
    _increasing(fighter, "wing.x_te", "fuselage.panel_front")


def _aileron(fighter: Fighter) -> None:
    a, w, span = fighter.aileron, fighter.wing, aileron_span(fighter)
    ends = f"the aileron's ends y = {span.inboard:g} and {span.outboard:g} m"
    width = span.outboard - span.inboard
    _require(
        span.outboard <= w.half_span,
        f"aileron.y_outboard = {span.outboard:g} m is beyond the tip, wing.half_span = {w.half_span:g} m",
    )
    _require(
        a.gap < max(width, MIN_GAP),
        f"aileron.gap = {a.gap:g} m is wider than the aileron; {ends} leave {max(width, 0.0):g} m",
    )
    _require(width >= MIN_FEATURE, f"{ends} must be at least {MIN_FEATURE:g} m apart, the outboard one outside")
    _require(
        a.gap == 0.0 or a.gap >= MIN_GAP,
        f"aileron.gap = {a.gap:g} m is too narrow for any mesh; it must be 0 or at least {MIN_GAP:g} m",
    )
    _require_strip("inboard", span.wing_rib - w.y_kink, f"wing.y_kink = {w.y_kink:g} m")
    _require_strip("outboard", w.half_span - span.outer_rib, f"wing.half_span = {w.half_span:g} m")


def check_notch(fighter: Fighter, notch: float) -> None:
    """Raise ValueError unless a gap of `notch` metres fits ahead of the ailerons' hinge edges; 0 always does."""
    if not notch:
        return
    a, w = fighter.aileron, fighter.wing
    _require(a.gap > 0.0, f"notch = {notch:g} m frees the ailerons at their hinges alone; set aileron.gap too")
    _require(
        notch >= MIN_GAP, f"notch = {notch:g} m is too narrow for any mesh; it must be 0 or at least {MIN_GAP:g} m"
    )
    tip = wing_section(w, aileron_span(fighter).outer_rib)
    room = float(tip[HINGE_UPPER, 0] - tip[FRONT_UPPER, 0]) - MIN_FEATURE
    _require(notch <= room, f"notch = {notch:g} m reaches the wing's front bevel; at most {room:.4g} m fit")


def _require_strip(end: str, width: float, neighbour: str) -> None:
    _require(
        width == 0.0 or width >= MIN_FEATURE,
        f"aileron.y_{end} leaves a strip of wing {width:.4g} m wide up to {neighbour}; with aileron.gap it "
        f"must leave 0 or at least {MIN_FEATURE:g} m",
    )


def _tail(fighter: Fighter) -> None:
    t, f = fighter.tail, fighter.fuselage
    _increasing(fighter, "fuselage.radius", "tail.half_span")
    _increasing(fighter, "fuselage.panel_front", ("the tail root's leading edge", t.x_te - t.root_chord))
    _increasing(fighter, "tail.x_te", "fuselage.panel_rear")
    _require(
        abs(t.anhedral) + 10.0 <= f.panel_angle,
        f"tail.anhedral = {t.anhedral:g} deg puts the tail's root within 10 deg of the border of its "
        f"fuselage panel at fuselage.panel_angle = {f.panel_angle:g} deg",
    )
    _require_tip("tail", tail_section(t, f, t.half_span))


def _fin(fighter: Fighter) -> None:
    fin = fighter.fin
    _increasing(fighter, "fin.z_root", "fin.z_tip")
    _increasing(fighter, "pedestal.x_ramp_end", "fin.x_le")
    _increasing(fighter, ("the fin's trailing edge at its root", fin.x_le + fin.root_chord), "pedestal.x_aft")
    _require_tip("fin", fin_section(fin, fin.z_tip))
    half = 0.5 * fin.thickness_ratio * fin.root_chord
    _increasing(fighter, ("half the fin's root thickness", half), "pedestal.half_width")


def _require_tip(name: str, tip: FloatArray) -> None:
    chord = tip[TE, 0] - tip[LE, 0]
    _require(
        chord >= 0.01, f"{name}.le_sweep, its chord and its span leave a tip chord of {chord:g} m; it needs 0.01 m"
    )


def _rudder(fighter: Fighter) -> None:
    _, upper = rudder_span(fighter)
    _increasing(fighter, "pedestal.z_top", "rudder.z_inboard")
    _increasing(fighter, "rudder.z_inboard", ("rudder.z_outboard", upper))
    rest = fighter.fin.z_tip - upper
    _require(
        rest == 0.0 or rest >= MIN_FEATURE,
        f"rudder.z_outboard = {upper:g} m must be the fin's tip (0), or {MIN_FEATURE:g} m or more below "
        f"fin.z_tip = {fighter.fin.z_tip:g} m",
    )


def _under_side(fighter: Fighter) -> None:
    _increasing(fighter, "inlet.x_1", "inlet.x_2", "inlet.x_3", "inlet.x_4")
    _increasing(fighter, "ventral.x_root", "ventral.x_tip", "ventral.x_te")
    _increasing(fighter, "ventral.x_te", "fuselage.panel_front")
    _increasing(fighter, "inlet.x_4", "fuselage.panel_front")
    _increasing(fighter, "fuselage.radius", "ventral.r_te")


@dataclass(frozen=True, slots=True)
class ReferenceValues:
    """Area (m2), chord and span (m) to which coefficients refer, and the point (3,) of moments (m)."""

    area: float
    chord: float
    span: float
    point: tuple[float, float, float]


def reference_values(fighter: Fighter) -> ReferenceValues:
    """Return the reference values of the wing's trapezoid, continued to the plane of symmetry.

    The chord is the mean aerodynamic one, and moments are about its quarter point.
    """
    wing = fighter.wing
    taper = wing.tip_chord / wing.root_chord
    chord = 2.0 / 3.0 * wing.root_chord * (1.0 + taper + taper**2) / (1.0 + taper)
    area = wing.half_span * (wing.root_chord + wing.tip_chord)
    return ReferenceValues(area, chord, 2.0 * wing.half_span, (wing.x_te - 0.75 * chord, 0.0, 0.0))

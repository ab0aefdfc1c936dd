"""Every number of the Standard Dynamics Model as a parameter with unit and range.

Metres and degrees; x aft from the nose apex, y starboard, z up. The defaults follow the three-view of Chung
et al. (JoAAA 54(2), 2022) scaled to the paper's span, and where that leaves needle faces that a mesher cannot
resolve (strake root, aft end of the inlet), the closest shape without them.
"""

from dataclasses import dataclass, field

from sdm_deflect.geometry.consistency import check_consistency
from sdm_deflect.geometry.quantity import Checked, quantity

LARGEST_TURN = 85.0
"""Largest angle (deg) of a control surface: the kernel builds the deflected aircraft up to it, not at 90."""


@dataclass(frozen=True, slots=True)
class Fuselage(Checked):
    """Tangent ogive and cylinder; a cylinder panel next to each tail is a patch of its own."""

    length: float = quantity(0.943, "m", 0.1, 10.0, "nose apex to base")
    radius: float = quantity(0.067, "m", 0.01, 1.0, "radius of the cylinder")
    nose_length: float = quantity(0.390, "m", 0.02, 5.0, "length of the ogive")
    panel_front: float = quantity(0.755, "m", 0.05, 10.0, "x of the panels' front border")
    panel_rear: float = quantity(0.932, "m", 0.05, 10.0, "x of the panels' rear border")
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
        """(x, half-width, z of the side, z of the bottom) from front to aft."""
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
    """The whole aircraft; ValueError where its components do not fit each other."""

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
        check_consistency(self)

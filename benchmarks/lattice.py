"""The aileron's control derivatives by a vortex lattice: ``python -m benchmarks.lattice``.

Another theory beside the flow study: linear, of a wing without thickness or fuselage, whose flap is its camber. The
lattice is AeroSandbox's; compressibility by Goethert's rule: lengths along x are divided by beta = sqrt(1 - M^2), and
so are the coefficients at the same flap angle. Angles of the wing in degrees, coefficients with the signs of the study.

AeroSandbox (``pip install aerosandbox``) goes into an environment of its own; the script needs no more of this
project than its parameters of the aircraft.
"""

import argparse
from itertools import pairwise

import aerosandbox as asb
import numpy as np

from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter, reference_values
from studies.flow.reference import surface_reference

# Width (m) of the strip beside the closed rib over which a blended aileron rises; half of it is lost.
STRIP = 0.02
# Panels along the chord, of which the flap's hinge is an edge (19 of 21).
CHORDWISE = (21, 42, 63)


def derivatives(mach: float, chordwise: int, strip: float = STRIP, spanwise: int = 12) -> dict[str, float]:
    """Return CL, Cm, Cl and Ch per degree of the left aileron, trailing edge down."""
    fighter, beta = Fighter(), float(np.sqrt(1.0 - mach**2))
    wing, whole, own = fighter.wing, reference_values(fighter), surface_reference(fighter, "aileron_left")
    inboard = float(np.abs(hinge_line(fighter, "aileron_left")[:, 1]).min()) + 0.5 * strip
    flat = asb.Airfoil("plate", coordinates=asb.Airfoil("naca0001").repanel(200).coordinates)
    bent = flat.add_control_surface(deflection=1.0, hinge_point_x=1.0 - wing.bevel_ratio)

    def chord(y: float) -> float:
        return wing.root_chord + (wing.tip_chord - wing.root_chord) * abs(y) / wing.half_span

    def part(stations: tuple[float, ...], airfoil: asb.Airfoil) -> asb.Wing:
        return asb.Wing(
            symmetric=False,
            xsecs=[
                asb.WingXSec(xyz_le=[(wing.x_te - chord(y)) / beta, y, 0.0], chord=chord(y) / beta, airfoil=airfoil)
                for y in stations
            ],
        )

    tip = wing.half_span
    parts = [part((-tip, -inboard), bent), *(part(ends, flat) for ends in pairwise((-inboard, 0.0, inboard, tip)))]
    plane = asb.Airplane(
        xyz_ref=[whole.point[0] / beta, 0.0, 0.0],
        wings=parts,
        s_ref=whole.area / beta,
        c_ref=whole.chord / beta,
        b_ref=whole.span,
    )
    lattice = asb.VortexLatticeMethod(
        plane,
        asb.OperatingPoint(velocity=1.0),
        spanwise_resolution=spanwise,
        chordwise_resolution=chordwise,
        chordwise_spacing_function=np.linspace,
    )
    found = lattice.run()
    x, y, _ = np.array(lattice.vortex_centers).T
    hinge = (wing.x_te - wing.bevel_ratio * np.array([chord(one) for one in y])) / beta
    behind = (x > hinge) & (y < -inboard)
    moment = -((x - hinge) * np.array(lattice.forces_geometry)[:, 2])[behind].sum()
    pressure = lattice.op_point.dynamic_pressure()
    named = {name: float(found[name]) for name in ("CL", "Cm", "Cl")}
    named["Ch"] = float(moment / (pressure * own.area / beta * own.chord / beta))
    return {name: value / beta for name, value in named.items()}


def main() -> None:
    """Print a row for each fineness, and one without the strip."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mach", type=float, default=0.6)
    mach = parser.parse_args().mach
    for chordwise, strip in (*((count, STRIP) for count in CHORDWISE), (CHORDWISE[-1], 0.0)):
        row = derivatives(mach, chordwise, strip)
        words = "  ".join(f"{name} {value:+.5f}" for name, value in row.items())
        print(f"{chordwise} panels along the chord, strip {strip:g} m: {words}")


if __name__ == "__main__":
    main()

"""The CAD of a case, undeflected and deflected."""

from typing import Literal

from cases.case import Case
from geometry.aircraft import build
from geometry.deflected import Deflection
from geometry.model import CadModel

Mode = Literal["rigid", "blended"]


def undeflected_cad(case: Case) -> CadModel:
    """Build the aircraft as it is meshed."""
    return build(case.fighter)


def deflected_cad(case: Case, mode: Mode = "rigid") -> CadModel:
    """Build the aircraft with its surfaces turned by the angles of the case."""
    turned = {one.surface: Deflection(one.factor * case.angle, _mode(one.surface, mode)) for one in case.deflections}
    return build(case.fighter, turned)


def _mode(surface: str, mode: Mode) -> Mode:
    """Tails turn as a whole: only a hinged wedge can be blended."""
    return "rigid" if surface.startswith("tail") else mode

"""The CAD of a case, undeflected and deflected."""

from typing import Literal

from cases.case import Case
from cases.motion import hinged
from geometry import domain
from geometry.aircraft import build
from geometry.deflected import Deflection
from geometry.model import CadModel

Mode = Literal["rigid", "blended"]


def undeflected_cad(case: Case) -> CadModel:
    """Build what is meshed: the aircraft, or the Chimera block."""
    if case.domain == "block":
        return domain.chimera_block(case.fighter, case.block, case.deflections[0].surface)
    return build(case.fighter)


def background_cad(case: Case) -> CadModel:
    """Build the aircraft that surrounds the Chimera block of a case."""
    return domain.background(case.fighter, case.deflections[0].surface)


def deflected_cad(case: Case, mode: Mode = "rigid") -> CadModel:
    """Build the aircraft with its surfaces turned by the angles of the case; tails can only turn rigidly."""
    turned = {
        one.surface: Deflection(one.factor * case.angle, mode if hinged(one.surface) else "rigid")
        for one in case.deflections
    }
    return build(case.fighter, turned)

"""The CAD of a case, undeflected and deflected."""

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.reference import turned
from sdm_deflect.geometry.aircraft import background, build, chimera_block
from sdm_deflect.geometry.model import CadModel


def undeflected_cad(case: Case) -> CadModel:
    """Build what is meshed: the aircraft, or the Chimera block."""
    if case.domain == "block":
        return chimera_block(case.fighter, case.block, case.deflections[0].surface)
    return build(case.fighter)


def background_cad(case: Case) -> CadModel:
    """Build the aircraft that surrounds the Chimera block of a case."""
    return background(case.fighter, case.deflections[0].surface)


def deflected_cad(case: Case) -> CadModel:
    """Build the aircraft with its surfaces turned rigidly by the angles of the case."""
    return build(case.fighter, turned(case, "rigid"))

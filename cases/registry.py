"""The cases by name."""

from dataclasses import replace

from sdm_deflect.cases.aileron import AILERON
from sdm_deflect.cases.aileron_chimera import AILERON_CHIMERA
from sdm_deflect.cases.all import ALL
from sdm_deflect.cases.case import Case
from sdm_deflect.cases.rudder import RUDDER
from sdm_deflect.cases.tail import TAIL
from sdm_deflect.deform.errors import InputError, nearest
from sdm_deflect.meshing.generate.parameters import BACKGROUND_SCALES, BLOCK_SCALES, SCALES

CASES: dict[str, Case] = {case.name: case for case in (AILERON, AILERON_CHIMERA, TAIL, RUDDER, ALL)}

PAPER_SPACING = {"aileron-chimera": 8.0, "tail": 3.25}
"""Spacing of zero sites, over edges of the moving surface, that gives the paper's meshes its number of sites."""


def case_named(name: str, scale: str = "small") -> Case:
    """Return a case at a scale; InputError with the nearest name if there is none."""
    for what, given, known in (("case", name, CASES), ("scale", scale, SCALES)):
        if given not in known:
            raise InputError(f"unknown {what} {given!r}; {nearest(given, known, 'there are')}")
    case = CASES[name]
    sizes = BLOCK_SCALES if case.domain == "block" else SCALES
    case = replace(case, scale=scale, mesh=sizes[scale], background=BACKGROUND_SCALES[scale])
    if scale == "paper" and name in PAPER_SPACING:
        case = replace(case, confinement=replace(case.confinement, spacing_edges=PAPER_SPACING[name]))
    return case

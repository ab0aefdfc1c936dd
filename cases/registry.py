"""The cases by name."""

from dataclasses import replace
from difflib import get_close_matches

from cases.aileron import AILERON
from cases.aileron_chimera import AILERON_CHIMERA
from cases.all import ALL
from cases.case import Case
from cases.rudder import RUDDER
from cases.tail import TAIL
from meshing.parameters import SCALES

CASES: dict[str, Case] = {case.name: case for case in (AILERON, AILERON_CHIMERA, TAIL, RUDDER, ALL)}

EDGE_FACTORS = {"aileron-chimera": {"aileron": 0.55, "wing": 0.55, "chimera": 0.8, "gap_cells": 1.5}}
"""Edge lengths of a case's mesh by those of its scale."""


def case_named(name: str, scale: str = "small") -> Case:
    """Return a case at a scale; ValueError with the nearest name if there is none."""
    if name not in CASES:
        close = get_close_matches(name, list(CASES), n=1)
        hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(CASES)}"
        raise ValueError(f"unknown case {name!r}; {hint}")
    if scale not in SCALES:
        raise ValueError(f"unknown scale {scale!r}; there are {', '.join(SCALES)}")
    sizes, factors = SCALES[scale], EDGE_FACTORS.get(name, {})
    finer = replace(sizes, **{patch: factor * getattr(sizes, patch) for patch, factor in factors.items()})
    return replace(CASES[name], scale=scale, mesh=finer, background=sizes)

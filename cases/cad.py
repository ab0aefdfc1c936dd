"""The CAD of a case, undeflected and deflected."""

from typing import Literal

import numpy as np

from cases.case import Case
from cases.motion import FloatArray, hinged
from geometry import domain
from geometry.aircraft import build
from geometry.datum import ends, gap_faces
from geometry.deflected import Deflection
from geometry.model import CadModel

Mode = Literal["rigid", "blended"]
CELLS_TO_BLOCK_FACE = 2.5
"""Cells of the background between an aileron's end and the block's face in the gap: its fringe lies there."""


def undeflected_cad(case: Case) -> CadModel:
    """Build what is meshed: the aircraft, or the Chimera block."""
    if case.domain == "block":
        return domain.chimera_block(case.fighter, case.block, case.deflections[0].surface)
    return build(case.fighter)


def background_cad(case: Case) -> CadModel:
    """Build the aircraft that surrounds the Chimera block of a case."""
    return domain.background(case.fighter, case.deflections[0].surface)


def background_finer(case: Case) -> tuple[FloatArray, FloatArray]:
    """Points (S, 3) on the aileron's ends in the gaps and the background's edge lengths (S,) there, metres."""
    surface = case.deflections[0].surface
    faces = gap_faces(case.fighter, case.block, surface)
    sections = ends(case.fighter, surface)[: len(faces)]
    share = np.linspace(0.0, 1.0, 24)[:, None]
    points, lengths = [], []
    for section, station in zip(sections, faces, strict=True):
        corners = section[2:5]  # hinge above, trailing edge, hinge below
        loop = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        points.append(np.vstack([a + share * (b - a) for a, b in loop]))
        lengths.append(np.full(len(points[-1]), abs(station - section[3, 1]) / CELLS_TO_BLOCK_FACE))
    return np.vstack(points), np.concatenate(lengths)


def deflected_cad(case: Case, mode: Mode = "rigid") -> CadModel:
    """Build the aircraft with its surfaces turned by the angles of the case; tails can only turn rigidly."""
    turned = {
        one.surface: Deflection(one.factor * case.angle, mode if hinged(one.surface) else "rigid")
        for one in case.deflections
    }
    return build(case.fighter, turned)

"""The hole that a Chimera block's control surface cuts out of the background, and the cells that it wants there."""

import numpy as np

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.motion import FloatArray
from sdm_deflect.geometry.confinement import gap_faces
from sdm_deflect.geometry.datum import ends, ribs

ROOM = 0.6
"""Half height of the hole by the longest chord: an aileron turned by up to 36 deg stays inside."""
BEYOND = 0.15
"""How far the hole reaches beyond trailing edge and tip, by the longest chord."""
CELLS_TO_BLOCK_FACE = 2.5
"""Cells of the background between the hole and the block's face in a gap: the hole's fringe lies there."""


def hole(case: Case) -> tuple[FloatArray, FloatArray]:
    """Corners (3,) of the box cut out of the background; in a gap it ends with the aileron."""
    surface = case.deflections[0].surface
    wedges = ends(case.fighter, surface)[:, 2:5]  # hinge above, trailing edge, hinge below
    low, high = wedges.min(axis=(0, 1)), wedges.max(axis=(0, 1))
    chord = float(np.ptp(wedges[:, :, 0], axis=1).max())
    height = chord * max(ROOM, np.sin(np.radians(abs(case.angle))) + 0.1)
    low += np.array([0.0, -BEYOND * chord, -height])
    high += np.array([BEYOND * chord, BEYOND * chord, height])
    for station in ribs(case.fighter, surface):
        ((low, high)[int(abs(station - high[1]) < abs(station - low[1]))])[1] = station
    return low, high


def finer_background(case: Case) -> tuple[FloatArray, FloatArray]:
    """Points (S, 3) on the hole's ends in the gaps, and the background's edge lengths (S,) there, metres."""
    surface, (low, high) = case.deflections[0].surface, hole(case)
    points, lengths = [], []
    stations = gap_faces(case.fighter, case.block, surface)
    for end, face in zip(ribs(case.fighter, surface), stations, strict=True):
        length = abs(face - end) / CELLS_TO_BLOCK_FACE
        x, z = (np.linspace(low[i], high[i], 2 + int((high[i] - low[i]) / length)) for i in (0, 2))
        grid = np.stack(np.meshgrid(x, [0.5 * (end + face)], z, indexing="ij"), axis=-1).reshape(-1, 3)
        points.append(grid)
        lengths.append(np.full(len(grid), length))
    return np.vstack(points), np.concatenate(lengths)

"""Figure 5: the mesh in the gap between aileron and Chimera face, coloured by quality."""

from collections.abc import Sequence

import numpy as np

from sdm_deflect.cases.motion import BoolArray, FloatArray
from sdm_deflect.cases.report.aircraft import walls
from sdm_deflect.cases.report.colours import DARK
from sdm_deflect.cases.report.compose import Picture
from sdm_deflect.cases.report.layers import box, cells_by_quality, centroids, patches
from sdm_deflect.cases.report.scene import View
from sdm_deflect.cases.run import Run
from sdm_deflect.geometry.confinement import gap_faces
from sdm_deflect.geometry.datum import ends, ribs

PIXELS = (900, 700)
OUTBOARD, ALONG = 4.0, 4.5
"""Extent of the portion outboard of the aileron's end, and above and below it, by the distance to the block's face."""


def gaps(runs: Sequence[Run]) -> Picture:
    """Draw the gap of each run as deflected, seen from behind."""
    return Picture(
        tuple(gap(run) for run in runs),
        tuple(f"{run.case.angle:+g} deg" for run in runs),
        "Cells around the end of the deflected aileron, cut near its trailing edge and seen from behind; the straight "
        "face on the right is the Chimera block's, on which nodes slide. Colours show the mean ratio; aileron and wing "
        "are dark grey, the hexahedron has magenta edges.",
        columns=len(runs),
        quality=True,
    )


def gap(run: Run) -> View:
    """Look at the gap from behind and a little from above and inboard."""
    turn, mesh = run.deflections[0].turn, run.deflected
    own, face, end = stations(run)
    width = abs(face - own)
    grey = patches(mesh, walls(mesh), DARK)
    cells = cells_by_quality(mesh, in_gap(run), width=1.2)
    focus = np.array([end[1, 0], own - np.sign(face - own) * width, 2.0 * width])
    return View((*grey, cells, box(turn.region.hexahedron.corners)), focus, (1.0, 0.25, 0.35), 14.0 * width, PIXELS)


def stations(run: Run) -> tuple[float, float, FloatArray]:
    """Return y of the aileron's end and of the block's face in the gap, and the aileron's section (3, 3) there."""
    surface, fighter = run.deflections[0].turn.surface, run.case.fighter
    section = ends(fighter, surface)[0][2:5]
    return float(ribs(fighter, surface)[0]), float(gap_faces(fighter, run.case.block, surface)[0]), section


def in_gap(run: Run) -> BoolArray:
    """True for cells (M,) ahead of the trailing edge, from the block's face to some gaps outboard.

    They are chosen by where they were before the deflection, so that every angle shows the same cells.
    """
    own, face, section = stations(run)
    x, y, z = centroids(run.mesh).T
    width, outboard = abs(face - own), np.sign(own - face) * (y - own)
    ahead = (x > section[0, 0]) & (x < section[1, 0] - 0.25 * np.ptp(section[:, 0]))
    return np.asarray(ahead & (outboard < OUTBOARD * width) & (np.abs(z) < ALONG * width))

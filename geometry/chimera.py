"""Where a Chimera block around an aileron ends (paper, section 5.2), from the parameters alone."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.geometry.confinement import MIRRORED_CORNERS, along
from sdm_deflect.geometry.hinges import hinge_edges, parent_ribs, ribs
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.quantity import check_quantities, quantity
from sdm_deflect.geometry.sections import MIRROR, FloatArray


@dataclass(frozen=True, slots=True)
class BlockParameters:
    """Extent of a Chimera block beyond its aileron, in metres, and where in the gap it ends."""

    ahead: float = quantity(0.04, "m", 1e-3, 10.0, "ahead of the hinge line, parallel to it")
    aft: float = quantity(0.08, "m", 1e-3, 10.0, "behind the trailing edge")
    outboard: float = quantity(0.08, "m", 1e-3, 10.0, "beyond the tip, where the aileron reaches it")
    up: float = quantity(0.08, "m", 1e-3, 10.0, "above the wing's plane")
    down: float = quantity(0.08, "m", 1e-3, 10.0, "below the wing's plane")
    gap_share: float = quantity(0.6, "", 0.3, 0.7, "distance of the end face from the aileron, by the gap")

    def __post_init__(self) -> None:
        check_quantities(self, "block")


def gap_faces(fighter: Fighter, parameters: BlockParameters, surface: str) -> FloatArray:
    """Stations y (k,) of the block's faces that stand in a gap, perpendicular to y; inboard first.

    Raises
    ------
    ValueError
        Where the surface is no aileron or has no gap.
    """
    if not surface.startswith("aileron"):
        raise ValueError(f"a Chimera block surrounds an aileron, not {surface!r}")
    if fighter.aileron.gap == 0.0:
        raise ValueError("a Chimera block needs a gap to end in; aileron.gap is 0")
    own, parent = ribs(fighter, surface), parent_ribs(fighter, surface)
    return np.asarray(own + parameters.gap_share * (parent - own), dtype=np.float64)


def block_corners(fighter: Fighter, parameters: BlockParameters, surface: str) -> FloatArray:
    """Corners (8, 3) of the block, in the order of `hexahedron_corners`: bits aft, starboard, above."""
    stations = np.abs(gap_faces(fighter, parameters, surface))
    hinge = hinge_edges(fighter, "aileron_right")[0]
    tip = fighter.wing.half_span + parameters.outboard
    y = (stations[0], stations[1] if len(stations) == 2 else tip)
    front = along(hinge[:, 1], hinge[:, 0], np.array(y)) - parameters.ahead
    aft = fighter.wing.x_te + parameters.aft
    corners = [[x, y[o], z] for z in (-parameters.down, parameters.up) for o in (0, 1) for x in (front[o], aft)]
    starboard = np.array(corners)
    return starboard if surface.endswith("_right") else (starboard * MIRROR)[MIRRORED_CORNERS]

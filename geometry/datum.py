"""What a deformation needs to know of the geometry, as plain arrays from the parameters alone."""

from dataclasses import dataclass

import numpy as np

from sdm_deflect.geometry.chimera import BlockParameters, block_corners, gap_faces
from sdm_deflect.geometry.confinement import Margins, hexahedron_corners, inward_face, rib_faces
from sdm_deflect.geometry.hinges import (
    SURFACES,
    ends,
    hinge_edges,
    hinge_line,
    hinged,
    parent_ribs,
    ribs,
    trailing_edge,
)
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.rotation import rotated
from sdm_deflect.geometry.sections import FloatArray

__all__ = [
    "SURFACES",
    "BlockParameters",
    "Margins",
    "PanelBorder",
    "block_corners",
    "cylinder",
    "ends",
    "gap_faces",
    "hexahedron_corners",
    "hinge_edges",
    "hinge_line",
    "hinged",
    "inward_face",
    "panel_border",
    "parent_ribs",
    "rib_faces",
    "ribs",
    "rotated",
    "trailing_edge",
]


@dataclass(frozen=True, slots=True)
class PanelBorder:
    """Limits of a cylinder panel: x in metres, polar angles in degrees from starboard, positive upwards.

    On the port side the angles run through 180 degrees, from the upper border to the lower one.
    """

    front: float
    rear: float
    polar: tuple[float, float]


def cylinder(fighter: Fighter) -> tuple[FloatArray, FloatArray, float]:
    """A point (3,) on the axis, the axis' direction (3,) and the radius of the rear fuselage."""
    point = np.array([fighter.fuselage.nose_length, 0.0, 0.0])
    return point, np.array([1.0, 0.0, 0.0]), fighter.fuselage.radius


def panel_border(fighter: Fighter, side: str) -> PanelBorder:
    """The border of the fuselage panel on a side, "left" or "right"."""
    if side not in ("left", "right"):
        raise ValueError(f"side = {side!r} must be 'left' or 'right'")
    f, middle = fighter.fuselage, 180.0 if side == "left" else 0.0
    return PanelBorder(f.panel_front, f.panel_rear, (middle - f.panel_angle, middle + f.panel_angle))

"""Where the movable surfaces begin and end, resolved from the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sdm_deflect.geometry.parameters import Fighter

# Metres. Shorter edges cost the volume mesher its quality; narrower gaps hold no cell at all.
MIN_FEATURE = 0.003
MIN_GAP = 0.0005

# Metres. Stations closer than this are meant to be one.
SAME_STATION = 1e-4

# The paper's spanwise gap by half-span (section 5).
PAPER_GAP_RATIO = 0.014


@dataclass(frozen=True, slots=True)
class AileronSpan:
    """Span stations (y >= 0, metres) of an aileron and of the wing's ribs that face it.

    Without a gap a rib and the aileron's end coincide; `outer_rib` is the tip where the aileron reaches it.
    """

    wing_rib: float
    inboard: float
    outboard: float
    outer_rib: float


def aileron_span(fighter: Fighter) -> AileronSpan:
    """Resolve the stations; a rib within a tenth of a millimetre of the wing's kink is put on it."""
    wing, aileron = fighter.wing, fighter.aileron
    offset = aileron.gap or PAPER_GAP_RATIO * wing.half_span
    inboard = aileron.y_inboard or wing.y_kink + offset
    rib = _snapped(inboard - aileron.gap, wing.y_kink)
    outboard = _snapped(aileron.y_outboard or wing.half_span, wing.half_span)
    outer = outboard if outboard == wing.half_span else _snapped(outboard + aileron.gap, wing.half_span)
    return AileronSpan(rib, inboard, outboard, outer)


def rudder_span(fighter: Fighter) -> tuple[float, float]:
    """Heights z of the rudder's lower and upper end."""
    tip = fighter.fin.z_tip
    return fighter.rudder.z_inboard, _snapped(fighter.rudder.z_outboard or tip, tip)


def _snapped(station: float, target: float) -> float:
    return target if abs(station - target) < SAME_STATION else station

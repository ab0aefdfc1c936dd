"""Whether the components of an aircraft fit each other, from the parameters alone."""

from __future__ import annotations

from itertools import pairwise
from math import cos, radians
from operator import attrgetter
from typing import TYPE_CHECKING

from sdm_deflect.geometry.sections import (
    LE,
    MIN_FEATURE,
    MIN_GAP,
    TE,
    FloatArray,
    aileron_span,
    fin_section,
    rudder_span,
    tail_section,
)

if TYPE_CHECKING:
    from sdm_deflect.geometry.parameters import Fighter


def check_consistency(fighter: Fighter) -> None:
    """Raise ValueError with one sentence on the first two components that do not fit."""
    for check in (_fuselage, _wing, _aileron, _tail, _fin, _rudder, _under_side):
        check(fighter)


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


def _increasing(fighter: Fighter, *quantities: str | tuple[str, float]) -> None:
    """Require that values grow: parameters by their names, and pairs of what follows from them and its value."""
    named = [(each, attrgetter(each)(fighter)) if isinstance(each, str) else each for each in quantities]
    for (name, value), (following, limit) in pairwise(named):
        _require(
            value + MIN_FEATURE <= limit,
            f"{name} = {value:g} m must lie at least {MIN_FEATURE:g} m below {following} = {limit:g} m",
        )


def _fuselage(fighter: Fighter) -> None:
    f, p = fighter.fuselage, fighter.pedestal
    _increasing(fighter, "fuselage.nose_length", "fuselage.panel_front", "fuselage.panel_rear", "fuselage.length")
    _increasing(fighter, "pedestal.x_apex", "pedestal.x_shoulder", "pedestal.x_aft")
    _increasing(fighter, "pedestal.x_foot", "pedestal.x_ramp_end")
    _increasing(fighter, "fuselage.radius", "pedestal.z_top")
    beside = f.radius * cos(radians(f.panel_angle))
    _require(
        p.half_width + MIN_FEATURE <= beside,
        f"pedestal.half_width = {p.half_width:g} m reaches the panels beside the tails, which begin at y = "
        f"{beside:.4g} m; reduce it or fuselage.panel_angle",
    )


def _wing(fighter: Fighter) -> None:
    _increasing(fighter, "wing.tip_chord", "wing.root_chord")
    _increasing(fighter, "fuselage.radius", "wing.y_kink", "wing.half_span")
    _increasing(fighter, "wing.x_te", "fuselage.panel_front")


def _aileron(fighter: Fighter) -> None:
    a, w, span = fighter.aileron, fighter.wing, aileron_span(fighter)
    ends = f"the aileron's ends y = {span.inboard:g} and {span.outboard:g} m"
    width = span.outboard - span.inboard
    _require(
        span.outboard <= w.half_span,
        f"aileron.y_outboard = {span.outboard:g} m is beyond the tip, wing.half_span = {w.half_span:g} m",
    )
    _require(
        a.gap < max(width, MIN_GAP),
        f"aileron.gap = {a.gap:g} m is wider than the aileron; {ends} leave {max(width, 0.0):g} m",
    )
    _require(width >= MIN_FEATURE, f"{ends} must be at least {MIN_FEATURE:g} m apart, the outboard one outside")
    _require(
        a.gap == 0.0 or a.gap >= MIN_GAP,
        f"aileron.gap = {a.gap:g} m is too narrow for any mesh; it must be 0 or at least {MIN_GAP:g} m",
    )
    _require_strip("inboard", span.wing_rib - w.y_kink, f"wing.y_kink = {w.y_kink:g} m")
    _require_strip("outboard", w.half_span - span.outer_rib, f"wing.half_span = {w.half_span:g} m")


def _require_strip(end: str, width: float, neighbour: str) -> None:
    _require(
        width == 0.0 or width >= MIN_FEATURE,
        f"aileron.y_{end} leaves a strip of wing {width:.4g} m wide up to {neighbour}; with aileron.gap it "
        f"must leave 0 or at least {MIN_FEATURE:g} m",
    )


def _tail(fighter: Fighter) -> None:
    t, f = fighter.tail, fighter.fuselage
    _increasing(fighter, "fuselage.radius", "tail.half_span")
    _increasing(fighter, "fuselage.panel_front", ("the tail root's leading edge", t.x_te - t.root_chord))
    _increasing(fighter, "tail.x_te", "fuselage.panel_rear")
    _require(
        abs(t.anhedral) + 10.0 <= f.panel_angle,
        f"tail.anhedral = {t.anhedral:g} deg puts the tail's root within 10 deg of the border of its "
        f"fuselage panel at fuselage.panel_angle = {f.panel_angle:g} deg",
    )
    _require_tip("tail", tail_section(t, f, t.half_span))


def _fin(fighter: Fighter) -> None:
    fin = fighter.fin
    _increasing(fighter, "fin.z_root", "fin.z_tip")
    _increasing(fighter, "pedestal.x_ramp_end", "fin.x_le")
    _increasing(fighter, ("the fin's trailing edge at its root", fin.x_le + fin.root_chord), "pedestal.x_aft")
    _require_tip("fin", fin_section(fin, fin.z_tip))
    half = 0.5 * fin.thickness_ratio * fin.root_chord
    _increasing(fighter, ("half the fin's root thickness", half), "pedestal.half_width")


def _require_tip(name: str, tip: FloatArray) -> None:
    chord = tip[TE, 0] - tip[LE, 0]
    _require(
        chord >= 0.01, f"{name}.le_sweep, its chord and its span leave a tip chord of {chord:g} m; it needs 0.01 m"
    )


def _rudder(fighter: Fighter) -> None:
    _, upper = rudder_span(fighter)
    _increasing(fighter, "pedestal.z_top", "rudder.z_inboard")
    _increasing(fighter, "rudder.z_inboard", ("rudder.z_outboard", upper))
    rest = fighter.fin.z_tip - upper
    _require(
        rest == 0.0 or rest >= MIN_FEATURE,
        f"rudder.z_outboard = {upper:g} m must be the fin's tip (0), or {MIN_FEATURE:g} m or more below "
        f"fin.z_tip = {fighter.fin.z_tip:g} m",
    )


def _under_side(fighter: Fighter) -> None:
    _increasing(fighter, "inlet.x_1", "inlet.x_2", "inlet.x_3", "inlet.x_4")
    _increasing(fighter, "ventral.x_root", "ventral.x_tip", "ventral.x_te")
    _increasing(fighter, "ventral.x_te", "fuselage.panel_front")
    _increasing(fighter, "inlet.x_4", "fuselage.panel_front")
    _increasing(fighter, "fuselage.radius", "ventral.r_te")

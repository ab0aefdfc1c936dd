"""The rudder: the fin's trailing-edge wedge, treated as an aileron."""

from sdm_deflect.cases.case import Case, Deflection

RUDDER = Case(
    name="rudder",
    title="rudder, no gap, trailing edge to port",
    deflections=(Deflection("rudder"),),
    angle=15.0,
)

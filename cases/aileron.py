"""Case 5.1: the left aileron without a gap, blended chordwise and, beside the wing, spanwise."""

from sdm_deflect.cases.case import Case, Deflection

AILERON = Case(
    name="aileron",
    title="left aileron, no gap (section 5.1)",
    deflections=(Deflection("aileron_left"),),
    angle=-12.0,
)

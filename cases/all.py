"""Every control surface at once, each in a hexahedron of its own."""

from sdm_deflect.cases.case import Case, Deflection

ALL = Case(
    name="all",
    title="both ailerons (-/+), both tails and the rudder at once",
    deflections=(
        Deflection("aileron_left", -1.0),
        Deflection("aileron_right", 1.0),
        Deflection("tail_left", 1.0),
        Deflection("tail_right", 1.0),
        Deflection("rudder", 1.25),
    ),
    angle=12.0,
)

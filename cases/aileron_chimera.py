"""Case 5.2: the left aileron behind a spanwise gap, in a Chimera block of its own."""

from sdm_deflect.cases.case import AdaptationSettings, Case, Confinement, Deflection
from sdm_deflect.geometry.parameters import Aileron, Fighter

AILERON_CHIMERA = Case(
    name="aileron-chimera",
    title="left aileron with spanwise gap in a Chimera block (section 5.2)",
    deflections=(Deflection("aileron_left"),),
    domain="block",
    angle=-12.0,
    fighter=Fighter(aileron=Aileron(gap=0.014 * 0.3048)),
    confinement=Confinement(spacing_edges=1.2),
    adaptation=AdaptationSettings(initial_surface=20, initial_hexahedron=20, n_add=8),
)

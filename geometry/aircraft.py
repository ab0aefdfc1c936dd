"""The whole aircraft as one solid with named faces."""

from collections.abc import Mapping, Set

from sdm_deflect.geometry.assemble import assemble
from sdm_deflect.geometry.datum import SURFACES, ends, hinge_line, hinged
from sdm_deflect.geometry.deflected import Deflection, deflected_wedge, turned, wedge
from sdm_deflect.geometry.fuse import Cell, general_fuse
from sdm_deflect.geometry.fuselage import canopy_parts, fuselage_parts, inlet_parts
from sdm_deflect.geometry.layout import MIN_FEATURE
from sdm_deflect.geometry.lifting import fin_polyhedra, wing_polyhedra
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.parts import Part, both_sides, centred, solid
from sdm_deflect.geometry.plates import pedestal_polyhedron, strake_polyhedra, ventral_polyhedron
from sdm_deflect.geometry.polyhedron import Loops, prism
from sdm_deflect.geometry.preflight import preflight
from sdm_deflect.geometry.walls import partitions, skin, walls


def build(
    fighter: Fighter,
    deflections: Mapping[str, Deflection] | None = None,
    without: Set[str] = frozenset(),
) -> CadModel:
    """Fuse all components into one solid.

    Parameters
    ----------
    deflections : mapping
        Control surfaces that are deflected in the CAD, by name. A rigidly turned one leaves slots too fine for
        a mesher: a deflected model is a reference to measure against and is not checked for meshing.
    without : set of str
        Control surfaces that are left out: the background of a Chimera block, so that all of the block's
        outer faces lie in flow.

    Raises
    ------
    ValueError
        Where a name is not that of a control surface.
    CadError
        Where the kernel fails, or the undeflected aircraft could not be meshed.
    """
    moved = dict(deflections or {})
    for name in [*moved, *without]:
        if name not in SURFACES:
            raise ValueError(f"no control surface {name!r}; there are {', '.join(SURFACES)}")
    found = walls(general_fuse(aircraft_parts(fighter, moved, without)))
    model = assemble(skin(found, _solid, _own_patch), partitions(found, _solid), fluid_inside=False)
    if not moved:
        preflight(model, min(MIN_FEATURE, fighter.aileron.gap or MIN_FEATURE))
    return model


def aircraft_parts(
    fighter: Fighter, deflections: Mapping[str, Deflection], without: Set[str] = frozenset()
) -> list[Part]:
    """All components as overlapping parts; where two overlap, the volume is the earlier one's."""
    f = fighter
    surfaces = [Part(name, solid(_surface(f, name, deflections.get(name)))) for name in SURFACES if name not in without]
    return [
        *fuselage_parts(f.fuselage),
        *centred("pedestal", [pedestal_polyhedron(f.pedestal, f.fuselage)]),
        *both_sides("wing", wing_polyhedra(f)),
        *centred("fin", fin_polyhedra(f)),
        *surfaces,
        *both_sides("strake", strake_polyhedra(f.strake, f.fuselage)),
        *both_sides("ventral", [ventral_polyhedron(f.ventral, f.fuselage)]),
        *canopy_parts(f.canopy),
        *inlet_parts(f.inlet),
    ]


def _surface(fighter: Fighter, name: str, deflection: Deflection | None) -> Loops:
    inner, outer = ends(fighter, name)
    if deflection is None:
        return wedge(inner, outer) if hinged(name) else prism(inner, outer)
    axis = hinge_line(fighter, name)
    return (
        deflected_wedge(inner, outer, axis, deflection)
        if hinged(name)
        else turned(prism(inner, outer), axis, deflection)
    )


def _solid(_cell: Cell) -> bool:
    return True


def _own_patch(inner: Cell, _outer: Cell | None) -> str:
    return inner.patch

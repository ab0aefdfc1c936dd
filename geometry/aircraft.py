"""The whole aircraft as one solid with named faces."""

from collections.abc import Mapping

from geometry.assemble import assemble
from geometry.deflected import SURFACES, Deflection, deflected_wedge, hinge_axis, wedge
from geometry.fuse import Cell, general_fuse
from geometry.fuselage import canopy_parts, fuselage_parts, inlet_parts
from geometry.lifting import (
    aileron_ends,
    fin_polyhedra,
    rudder_ends,
    tail_ends,
    wing_polyhedra,
)
from geometry.model import CadModel
from geometry.parameters import Fighter
from geometry.parts import Part, both_sides, centred, one_side
from geometry.plates import pedestal_polyhedron, strake_polyhedra, ventral_polyhedron
from geometry.polyhedron import prism
from geometry.walls import partitions, skin, walls


def build(fighter: Fighter, deflections: Mapping[str, Deflection] | None = None) -> CadModel:
    parts = aircraft_parts(fighter, deflections or {})
    found = walls(general_fuse(parts))

    def inside(cell: Cell) -> bool:
        return True

    return assemble(skin(found, inside, lambda inner, _: inner.patch), partitions(found, inside), fluid_inside=False)


def aircraft_parts(fighter: Fighter, deflections: Mapping[str, Deflection]) -> list[Part]:
    f = fighter
    return [
        *fuselage_parts(f.fuselage),
        *centred("pedestal", [pedestal_polyhedron(f.pedestal, f.fuselage)]),
        *both_sides("wing", wing_polyhedra(f)),
        *both_sides("aileron", [wedge(*aileron_ends(f))]),
        *both_sides("tail", [prism(*tail_ends(f))]),
        *centred("fin", fin_polyhedra(f)),
        *centred("rudder", [wedge(*rudder_ends(f))]),
        *both_sides("strake", strake_polyhedra(f.strake, f.fuselage)),
        *both_sides("ventral", [ventral_polyhedron(f.ventral, f.fuselage)]),
        *canopy_parts(f.canopy),
        *inlet_parts(f.inlet),
    ]

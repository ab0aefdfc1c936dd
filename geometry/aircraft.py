"""The whole aircraft as one solid with named faces, and the two flow domains of the Chimera case."""

from collections.abc import Iterator, Mapping, Set
from contextlib import contextmanager
from dataclasses import fields
from types import ModuleType

import numpy as np
from OCP import Standard, StdFail

from .assemble import assemble, preflight
from .confinement import BlockParameters, block_corners
from .datum import SURFACES, ends, hinge_line, hinged, ribs
from .deflected import CadTurn, deflected_wedge, turned_surface, wedge
from .fuse import (
    NamedSolid,
    both_sides,
    canopy_parts,
    fuselage_parts,
    general_fuse,
    inlet_parts,
    one_side,
    partitions,
    skin,
    solid,
    walls,
)
from .model import CadModel
from .parameters import MIN_FEATURE, Fighter, FloatArray, check_notch
from .polyhedra import (
    Loops,
    fin_polyhedra,
    pedestal_polyhedron,
    prism,
    strake_polyhedra,
    ventral_polyhedron,
    wing_polyhedra,
)
from .quantity import CadError

CHIMERA = "chimera"

# The shortest edge that a block may have, by the gap: the wing's wall between the end face and the aileron.
SMALLEST_GAP_EDGE = 0.25


def build(
    fighter: Fighter,
    deflections: Mapping[str, CadTurn] | None = None,
    without: Set[str] = frozenset(),
    notch: float = 0.0,
) -> CadModel:
    """Fuse all components into one solid; ailerons with a notch ahead of their hinges are solids of their own.

    Parameters
    ----------
    deflections : mapping
        Control surfaces that are deflected in the CAD, by name. A rigid turn leaves slots too fine for a mesher, so
        a deflected model only serves as a reference and is not checked for meshing.
    without : set of str
        Control surfaces that are left out: the background of a Chimera block, so that all of the block's
        outer faces lie in flow.
    notch : float
        Chordwise gap (m) between the wing and both ailerons, ahead of their hinge edges; 0: none.

    Raises
    ------
    ValueError
        If a name is not that of a control surface, a tail is to be blended, or the notch is impossible.
    CadError
        If the kernel fails, or the undeflected aircraft could not be meshed.
    """
    moved = dict(deflections or {})
    _check_surfaces(moved, without)
    check_notch(fighter, notch)
    loose = sum(bool(notch) for name in SURFACES if "aileron" in name and name not in without)
    with _kernel_errors_named(fighter):
        faces = walls(general_fuse(aircraft_parts(fighter, moved, without, notch)))
        model = assemble(skin(faces), partitions(faces), fluid_inside=False, loose=loose)
        if not moved:
            preflight(model, min([MIN_FEATURE, *filter(None, (fighter.aileron.gap, notch))]))
    return model


def _check_surfaces(moved: Mapping[str, CadTurn], without: Set[str]) -> None:
    for name in [*moved, *without]:
        if name not in SURFACES:
            raise ValueError(f"no control surface {name!r}; there are {', '.join(SURFACES)}")
    if whole := [name for name, turn in moved.items() if turn.mode != "rigid" and not hinged(name)]:
        raise ValueError(f"{whole[0]} has no hinge edges to blend towards; its deflection.mode must be 'rigid'")


def aircraft_parts(
    fighter: Fighter, deflections: Mapping[str, CadTurn], without: Set[str], notch: float
) -> list[NamedSolid]:
    """Return all components as overlapping parts; a common volume belongs to the earlier part."""
    f, kept = fighter, [name for name in SURFACES if name not in without]
    return [
        *fuselage_parts(f.fuselage),
        *one_side("pedestal", [pedestal_polyhedron(f.pedestal, f.fuselage)]),
        *both_sides("wing", wing_polyhedra(f, notch)),
        *one_side("fin", fin_polyhedra(f)),
        *(NamedSolid(name, solid(loops)) for name in kept for loops in _surface(f, name, deflections.get(name), notch)),
        *both_sides("strake", strake_polyhedra(f.strake, f.fuselage)),
        *both_sides("ventral", [ventral_polyhedron(f.ventral, f.fuselage)]),
        *canopy_parts(f.canopy),
        *inlet_parts(f.inlet),
    ]


def _surface(fighter: Fighter, name: str, deflection: CadTurn | None, notch: float) -> list[Loops]:
    inner, outer = ends(fighter, name)
    whole, axis = wedge(inner, outer) if hinged(name) else prism(inner, outer), hinge_line(fighter, name)
    if deflection is None:
        return [whole]
    free = notch and "aileron" in name and deflection.mode == "rigid"
    if hinged(name) and not free:
        gap = fighter.aileron.gap if name != "rudder" else 0.0
        return deflected_wedge(inner, outer, axis, deflection, 0 if gap else len(ribs(fighter, name)))
    return [turned_surface(whole, axis, deflection.angle)]


def chimera_block(fighter: Fighter, parameters: BlockParameters, surface: str = "aileron_left") -> CadModel:
    """Return the flow inside a hexahedral block around an aileron and the part of the wing ahead of it.

    Its outer faces are planar and called "chimera"; those that face a rib of the wing are perpendicular to y and
    stand in the gap. The front cuts through the wing parallel to the hinge line.

    Raises
    ------
    ValueError
        Where there is no such aileron, or no gap.
    CadError
        Where the kernel fails or the block could not be meshed.
    """
    side = surface.removeprefix("aileron")
    corners = block_corners(fighter, parameters, surface)
    with _kernel_errors_named(fighter):
        parts = [
            *one_side(f"wing{side}", wing_polyhedra(fighter)),
            NamedSolid(surface, solid(wedge(*ends(fighter, surface)))),
            NamedSolid(CHIMERA, solid(_faces(corners))),
        ]
        faces = walls(general_fuse(parts))
        model = assemble(skin(faces, CHIMERA), partitions(faces, CHIMERA), fluid_inside=True)
        preflight(model, min_edge=SMALLEST_GAP_EDGE * fighter.aileron.gap)
    return model


def background(fighter: Fighter, surface: str = "aileron_left") -> CadModel:
    """Return the background of a Chimera block, the aircraft without the aileron.

    The block's outer faces take their flow from the background. Without the aileron in it, every outer face, and every
    place that the aileron leaves when it moves, lies in the background's flow.
    """
    return build(fighter, without={surface})


def _faces(corners: FloatArray) -> Loops:
    """Return the six faces (4, 3) of a hexahedron with corners (8, 3) in the order of `hexahedron_corners`."""
    quads = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    return tuple(corners[list(quad)] for quad in quads)


def _exceptions(module: ModuleType) -> tuple[type[Exception], ...]:
    return tuple(kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Exception))


# The kernel's exceptions have no common base; CadQuery and NumPy raise the last two for shapes without extent.
KERNEL: tuple[type[Exception], ...] = (*_exceptions(Standard), *_exceptions(StdFail), ValueError, ArithmeticError)


@contextmanager
def _kernel_errors_named(fighter: Fighter) -> Iterator[None]:
    """Turn errors of the kernel into CadErrors that name the parameters which differ from the defaults."""
    try:
        with np.errstate(all="raise", under="ignore"):
            yield
    except KERNEL as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CadError(f"the CAD kernel builds no aircraft with {_differences(fighter)} ({what})") from error


def _differences(fighter: Fighter) -> str:
    usual, changed = Fighter(), []
    for component in fields(Fighter):
        given, default = getattr(fighter, component.name), getattr(usual, component.name)
        changed += [
            f"{component.name}.{parameter.name} = {getattr(given, parameter.name):g}"
            for parameter in fields(given)
            if getattr(given, parameter.name) != getattr(default, parameter.name)
        ]
    return ", ".join(changed) or "the default parameters"

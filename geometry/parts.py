"""The parts that the aircraft is fused from: overlapping solids with the patches their skins become."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cadquery import Face, Shell, Solid, Vector, Wire

from sdm_deflect.geometry.polyhedron import FloatArray, Loops
from sdm_deflect.geometry.sections import MIRROR


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid and its patch name; where parts overlap, the earlier one in the list owns the volume."""

    patch: str
    solid: Solid


def solid(loops: Sequence[FloatArray]) -> Solid:
    """The solid inside planar polygons (n, 3) that close a volume, in any orientation."""
    faces = [Face.makeFromWires(Wire.makePolygon([Vector(*p) for p in loop], close=True)) for loop in loops]
    closed = Solid.makeSolid(Shell.makeShell(faces))
    return closed if closed.Volume() > 0.0 else Solid(closed.wrapped.Reversed())


def both_sides(name: str, polyhedra: Iterable[Loops]) -> list[Part]:
    """The starboard polyhedra as `name`_right, and their exact mirror images as `name`_left."""
    starboard = list(polyhedra)
    return one_side(f"{name}_right", starboard) + one_side(f"{name}_left", starboard)


def one_side(patch: str, starboard: Iterable[Loops]) -> list[Part]:
    """Polyhedra given for the starboard side, on the side that the patch name ends with."""
    factor = MIRROR if patch.endswith("_left") else MIRROR**2
    return [Part(patch, solid([loop * factor for loop in loops])) for loops in starboard]


def centred(name: str, polyhedra: Iterable[Loops]) -> list[Part]:
    """Polyhedra across the plane of symmetry."""
    return [Part(name, solid(loops)) for loops in polyhedra]

"""The parts that the aircraft is fused from: overlapping solids, each with the patch that its skin becomes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cadquery import Solid

from geometry.polyhedron import Loops, solid
from geometry.sections import MIRROR


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid and its patch name; where parts overlap, the earlier one in the list owns the volume."""

    patch: str
    solid: Solid


def both_sides(name: str, polyhedra: Iterable[Loops]) -> list[Part]:
    """The starboard polyhedra and their exact mirror images, as `name`_right and `name`_left."""
    starboard = list(polyhedra)
    return one_side(name, "right", starboard) + one_side(name, "left", starboard)


def one_side(name: str, side: str, starboard: Iterable[Loops]) -> list[Part]:
    """Polyhedra given for the starboard side, as the parts `name`_`side` on their own side."""
    factor = MIRROR if side == "left" else MIRROR**2
    return [Part(f"{name}_{side}", solid([loop * factor for loop in loops])) for loops in starboard]


def centred(name: str, polyhedra: Sequence[Loops]) -> list[Part]:
    """Polyhedra in the plane of symmetry."""
    return [Part(name, solid(loops)) for loops in polyhedra]

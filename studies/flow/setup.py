"""What a flow solver is to compute: the free stream, what each patch is, and the forces that it reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import cos, isfinite, radians, sin, sqrt
from typing import Literal

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.formats.openfoam import FLAT, count_sides, kind_of, touches_sides
from sdm_deflect.meshing.mesh.mesh import Mesh

# Ratio of specific heats, and the gas constant (J/kg/K), of air.
GAMMA, GAS = 1.4, 287.058
Kind = Literal["wall", "far", "symmetry"]


@dataclass(frozen=True, slots=True)
class FreeStream:
    """Air far from the body; x points aft, z up.

    Parameters
    ----------
    mach : Mach number, above 0 and at most 5.
    alpha : angle of attack, degrees, nose up.
    beta : sideslip, degrees, wind from starboard (y).
    pressure, temperature : static, Pa and K.

    Raises
    ------
    InputError
        For a value outside its range.
    """

    mach: float = 0.6
    alpha: float = 0.0
    beta: float = 0.0
    pressure: float = 1e5
    temperature: float = 288.15

    def __post_init__(self) -> None:
        ranges = {
            "mach": (0.01, 5.0),
            "alpha": (-45.0, 45.0),
            "beta": (-45.0, 45.0),
            "pressure": (1.0, 1e8),
            "temperature": (10.0, 5000.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not (isfinite(value) and low <= value <= high):
                raise InputError(f"{name} = {value:g} must be between {low:g} and {high:g}")

    @property
    def speed(self) -> float:
        """Speed (m/s)."""
        return self.mach * sqrt(GAMMA * GAS * self.temperature)

    @property
    def dynamic_pressure(self) -> float:
        """Pressure (Pa): half the density times the square of the speed."""
        return 0.5 * GAMMA * self.pressure * self.mach**2

    @property
    def directions(self) -> FloatArray:
        """Unit vectors (3, 3): of drag (along the wind), of side force, of lift (normal to the wind, and to y)."""
        a, b = radians(self.alpha), radians(self.beta)
        drag = np.array([cos(a) * cos(b), -sin(b), sin(a) * cos(b)])
        lift = np.array([-sin(a), 0.0, cos(a)])
        return np.array([drag, np.cross(lift, drag), lift])


@dataclass(frozen=True, slots=True)
class Hinge:
    """A moving surface whose moment about its axis is reported: patches, a point (m) and the direction of the axis."""

    name: str
    patches: tuple[str, ...]
    point: tuple[float, float, float]
    axis: tuple[float, float, float]

    @classmethod
    def through(cls, name: str, patches: Sequence[str], points: FloatArray) -> "Hinge":
        """Return the hinge on the line from the first to the second of two points (2, 3)."""
        first, second = np.asarray(points, dtype=np.float64)
        axis = (second - first) / np.linalg.norm(second - first)
        return cls(name, tuple(patches), tuple(first.tolist()), tuple(axis.tolist()))

    def renamed(self, names: Mapping[str, str]) -> "Hinge":
        """Return the same hinge where some patches have other names."""
        return replace(self, patches=tuple(names.get(name, name) for name in self.patches))


@dataclass(frozen=True, slots=True)
class Setup:
    """A flow to compute.

    Attributes
    ----------
    stream : the free stream.
    hinges : surfaces whose hinge moment is reported.
    point : moments of the whole are about it (m).
    area, length, span : reference area (m2), chord of the pitching moment and span of rolling and yawing moment (m).
    iterations : steps in all; the first `settling` of them are of first order.
    far : patches of the far field beside those that are found.
    kinds : what each patch is, if that is known; else `kinds_of` finds it.
    """

    stream: FreeStream = field(default_factory=FreeStream)
    hinges: tuple[Hinge, ...] = ()
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    area: float = 1.0
    length: float = 1.0
    span: float = 1.0
    iterations: int = 3000
    settling: int = 500
    far: tuple[str, ...] = ()
    kinds: Mapping[str, Kind] | None = None

    def kinds_on(self, mesh: Mesh) -> Mapping[str, Kind]:
        """Return what each patch of a mesh is; InputError as of `kinds_of`."""
        return self.kinds or kinds_of(mesh, self.far)


# Sides of the mesh's bounding box that a patch reaches which may be its far field.
ENCLOSING = 3


def kinds_of(mesh: Mesh, far: Sequence[str] = (), moving: Sequence[str] = ()) -> Mapping[str, Kind]:
    """Return what each patch is: its name says it; a far field must also reach the outside of the mesh.

    Where no name says far field, patches that reach at least three sides of the mesh's bounding box are it: those of
    them that are no plane, if there are any. A patch without a telling name that covers nothing but a side of that box
    is a plane of symmetry: an inviscid wall all the same, but its force is not the body's. Patches that are `moving`
    are walls.

    Raises InputError if there is no far field or no wall, or a name or wildcard in `far` stands for no patch.
    """
    given = mesh.expand(far, "far field")
    sides = {patch.name: count_sides(mesh.points, patch.nodes) for patch in mesh.patches}
    flat = {patch.name for patch in mesh.patches if on_one_side(mesh.points, patch.nodes)}
    kinds: dict[str, Kind] = {name: _kind_by_name(name, count > 0) for name, count in sides.items()}
    kinds |= dict.fromkeys(given, "far")
    if "far" not in kinds.values():
        around = {name for name in _walls(kinds) if sides[name] >= ENCLOSING}
        kinds |= dict.fromkeys(around - flat or around, "far")
    kinds |= dict.fromkeys(flat & _walls(kinds), "symmetry")
    kinds |= dict.fromkeys([name for name in moving if name not in given], "wall")
    _check_complete(mesh, kinds)
    return kinds


def _walls(kinds: Mapping[str, Kind]) -> set[str]:
    return {name for name, kind in kinds.items() if kind == "wall"}


def _check_complete(mesh: Mesh, kinds: Mapping[str, Kind]) -> None:
    """Refuse a mesh without a far field, or without a wall."""
    for kind, wrong in MISSING.items():
        if kind not in kinds.values():
            raise InputError(f"{mesh.name}: {wrong}; the patches are {', '.join(mesh.names)}")


def _kind_by_name(name: str, outside: bool) -> Kind:
    """Return what the name of a patch says, a wall if nothing."""
    types: dict[str, Kind] = {"symmetryPlane": "symmetry", "patch": "far"}
    return types.get(kind_of(name, planar=True, outside=outside), "wall")


MISSING: Mapping[Kind, str] = {
    "far": "no patch is a far field: no name says so, and none encloses the mesh; name it with --far-field",
    "wall": "no patch is a wall, so that there is no force to report",
}


def on_one_side(points: FloatArray, nodes: IntArray) -> bool:
    """Whether some nodes (K,) all lie on one and the same side of the box around all points (N, 3)."""
    if not len(nodes):
        return False
    flat = np.ptp(points[nodes], axis=0) <= FLAT * np.ptp(points, axis=0).max()
    return bool((touches_sides(points, nodes).any(axis=0) & flat).any())

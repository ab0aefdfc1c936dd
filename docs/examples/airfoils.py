"""Plane meshes by another mesher: Gmsh's triangles around airfoils, with layers of quadrilaterals on them.

    python airfoils.py [FOLDER]

writes ``naca0012.su2`` with the patches ``wing``, ``flap`` (behind x = 0.75) and ``far_field``, and
``three_elements.su2``, whose slat, main element and flap are one patch ``wall``. Chord 1 each.
"""

import sys
from itertools import pairwise
from pathlib import Path

import gmsh
import numpy as np

HINGE, FAR = 0.75, 10.0
LAYER, THICKNESS, GROWTH = 4e-4, 6e-3, 1.25
FACTORS = (0.2969, -0.1260, -0.3516, 0.2843, -0.1036)
POWERS = (0.5, 1.0, 2.0, 3.0, 4.0)
# Of each element its chord, thickness over chord, leading edge, and degrees by which it is turned nose up.
ELEMENTS = {
    "slat": (0.15, 0.16, (-0.130, -0.045), -36.0),
    "main": (0.80, 0.13, (0.0, 0.0), 2.0),
    "flap": (0.28, 0.14, (0.775, -0.050), 22.0),
}


def half_thickness(x: np.ndarray, thickness: float) -> np.ndarray:
    """NACA's symmetric section with a sharp trailing edge, at fractions of the chord."""
    return 5.0 * thickness * sum(factor * x**power for factor, power in zip(FACTORS, POWERS, strict=True))


def skins(ends: tuple[float, ...], thickness: float, place=lambda x, y: (x, y)) -> list[int]:
    """Return the curves around an airfoil, from the trailing edge over its upper side; cut at chordwise `ends`."""
    occ, corners = gmsh.model.occ, {}

    def point(x: float, side: float) -> int:
        y = side * half_thickness(np.array(x), thickness).item()
        return occ.addPoint(*place(x, y if 0.0 < x < 1.0 else 0.0), 0.0)

    for x in (0.0, *ends, 1.0):
        for side in (1.0, -1.0):
            corners[x, side] = corners.get((x, 1.0)) if x in (0.0, 1.0) and side < 0.0 else point(x, side)
    curves = []
    for side in (1.0, -1.0):
        stations = (0.0, *ends, 1.0)
        for first, last in pairwise(stations):
            inner = first + (last - first) * np.linspace(0.0, 1.0, 25)[1:-1] ** (2 if first == 0.0 else 1)
            nodes = [corners[first, side], *(point(x, side) for x in inner.tolist()), corners[last, side]]
            curves.append(occ.addSpline(nodes))
    half = len(curves) // 2
    return [*reversed(curves[:half]), *curves[half:]]


def meshed(loops: list[list[int]], patches: dict[str, list[int]], sharp: list[int], size: float) -> None:
    """Mesh the plane around closed loops of curves; `sharp` are points where the layers go around a trailing edge."""
    occ, fields = gmsh.model.occ, gmsh.model.mesh.field
    outer = occ.addCircle(0.5, 0.0, 0.0, FAR)
    plane = occ.addPlaneSurface([occ.addCurveLoop([outer]), *(occ.addCurveLoop(loop) for loop in loops)])
    occ.synchronize()
    for name, curves in {**patches, "far_field": [outer]}.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, [plane], name="fluid")
    walls = [curve for loop in loops for curve in loop]
    distance, growth, layers = fields.add("Distance"), fields.add("MathEval"), fields.add("BoundaryLayer")
    fields.setNumbers(distance, "CurvesList", walls)
    fields.setNumber(distance, "Sampling", 200)
    fields.setString(growth, "F", f"{size} + 0.15 * F{distance}")
    fields.setAsBackgroundMesh(growth)
    fields.setNumbers(layers, "CurvesList", walls)
    fields.setNumbers(layers, "FanPointsList", sharp)
    for option, value in (("Size", LAYER), ("Ratio", GROWTH), ("Thickness", THICKNESS), ("Quads", 1)):
        fields.setNumber(layers, option, value)
    fields.setAsBoundaryLayer(layers)
    for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.model.mesh.generate(2)


def ends_of(curves: list[int]) -> list[int]:
    """Return the point at which the first and the last of some curves meet."""
    gmsh.model.occ.synchronize()
    first, last = (
        {tag for _, tag in gmsh.model.getBoundary([(1, c)], oriented=False)} for c in (curves[0], curves[-1])
    )
    return sorted(first & last)


def naca_0012(size: float) -> None:
    """One airfoil, whose flap shares its skins' ends with the wing: there is no gap."""
    curves = skins((HINGE,), 0.12)
    meshed([curves], {"wing": curves[1:3], "flap": [curves[0], curves[3]]}, ends_of(curves), size)


def place(x0: float, y0: float, c: float, s: float, x: float, y: float) -> tuple[float, float]:
    """Put a point of an airfoil of chord 1 into the plane."""
    return x0 + c * x + s * y, y0 - s * x + c * y


def three_elements(size: float) -> None:
    """Slat, main element and flap, each reaching below the one before."""
    loops = []
    for chord, thickness, (x0, y0), degrees in ELEMENTS.values():
        c, s = chord * np.cos(np.radians(degrees)), chord * np.sin(np.radians(degrees))
        loops.append(
            skins((), thickness, lambda x, y, x0=x0, y0=y0, c=c, s=s: (x0 + c * x + s * y, y0 - s * x + c * y))
        )
    meshed(loops, {"wall": [c for loop in loops for c in loop]}, [p for loop in loops for p in ends_of(loop)], size)


def build(folder: Path, size: float = 0.012) -> None:
    """Write ``naca0012`` and ``three_elements`` as .su2 and .msh into `folder`, with faces of a `size` on the walls."""
    for made in (naca_0012, three_elements):
        gmsh.initialize(interruptible=False)
        try:
            gmsh.option.setNumber("General.Verbosity", 2)
            made(size)
            for suffix in ("su2", "msh"):
                gmsh.write(str(folder / f"{made.__name__.replace('naca_', 'naca')}.{suffix}"))
        finally:
            gmsh.finalize()


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "."))

"""A mesh by another mesher: Gmsh's own tetrahedra around a NACA 0012 half wing with a flap.

    python naca_wing.py [FOLDER]

writes ``naca.msh`` (Gmsh 4.1, binary) and ``naca.su2`` with the patches ``wing``, ``flap``, ``symmetry`` and
``far_field``. Chord 1, span 2 from the symmetry plane y = 0; the flap spans y = 0.6 to 1.4 behind x = 0.7, so its
hinge line runs from (0.7, 0.6, 0) to (0.7, 1.4, 0).
"""

import sys
from pathlib import Path

import gmsh
import numpy as np

HINGE, FLAP, SPAN, FAR = 0.7, (0.6, 1.4), 2.0, 8.0
THICKNESS = (0.2969, -0.1260, -0.3516, 0.2843, -0.1015)
POWERS = (0.5, 1.0, 2.0, 3.0, 4.0)


def half_thickness(x: np.ndarray) -> np.ndarray:
    """NACA 0012 with its blunt trailing edge, at fractions of the chord."""
    return 0.6 * sum(factor * x**power for factor, power in zip(THICKNESS, POWERS, strict=True))


def section() -> int:
    """Return the plane section at y = 0; its skins end at the hinge, so that the flap has faces of its own."""
    occ = gmsh.model.occ
    ahead = HINGE * np.linspace(0.0, 1.0, 25) ** 2
    behind = np.linspace(HINGE, 1.0, 9)
    curves = {}
    corners = {0.0: occ.addPoint(0.0, 0.0, 0.0)}
    for side in (1.0, -1.0):
        for x in (HINGE, 1.0):
            corners[side * x] = occ.addPoint(x, 0.0, side * half_thickness(np.array(x)).item())
        for name, x in (("ahead", ahead), ("behind", behind)):
            inner = [occ.addPoint(a, 0.0, b) for a, b in zip(x, side * half_thickness(x), strict=True)][1:-1]
            curves[name, side] = occ.addSpline([corners[side * x[0]], *inner, corners[side * x[-1]]])
    base = occ.addLine(corners[1.0], corners[-1.0])
    order = [curves["ahead", 1.0], curves["behind", 1.0], base, curves["behind", -1.0], curves["ahead", -1.0]]
    return occ.addPlaneSurface([occ.addCurveLoop(order)])


def fluid() -> None:
    """Cut the wing, in three pieces along the span, out of a box."""
    occ = gmsh.model.occ
    pieces, face = [], (2, section())
    for length in np.diff([0.0, *FLAP, SPAN]):
        made = occ.extrude([face], 0.0, length, 0.0)
        face = made[0]
        pieces.append(made[1])
    box = occ.addBox(-FAR, 0.0, -FAR, 2.0 * FAR, FAR, 2.0 * FAR)
    occ.cut([(3, box)], pieces)
    occ.synchronize()


def name_of(surface: int) -> str:
    """Return the patch of a surface, by its place."""
    x0, y0, z0, x1, y1, z1 = gmsh.model.getBoundingBox(2, surface)
    if max(abs(v) for v in (x0, x1, z0, z1, y1)) > FAR / 2.0:
        return "symmetry" if y1 < 1e-3 else "far_field"
    is_flap = x0 > HINGE - 1e-3 and y0 > FLAP[0] - 1e-3 and y1 < FLAP[1] + 1e-3
    return "flap" if is_flap else "wing"


def sizes(fineness: float) -> None:
    """Ask for small cells at the wing that grow away from it."""
    fields = gmsh.model.mesh.field
    wing = [tag for _, tag in gmsh.model.getEntities(2) if name_of(tag) in ("wing", "flap")]
    distance, growth = fields.add("Distance"), fields.add("MathEval")
    fields.setNumbers(distance, "SurfacesList", wing)
    fields.setNumber(distance, "Sampling", 40)
    fields.setString(growth, "F", f"{0.04 / fineness} + 0.3 * F{distance}")
    fields.setAsBackgroundMesh(growth)
    for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def define(fineness: float = 1.0) -> None:
    """Define the flow domain, its patches and the sizes of cells; twice the `fineness` halves those at the wing."""
    fluid()
    surfaces: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getEntities(2):
        surfaces.setdefault(name_of(tag), []).append(tag)
    for name, tags in surfaces.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="fluid")
    sizes(fineness)


def build(folder: Path, fineness: float = 1.0) -> None:
    """Write ``naca.msh`` and ``naca.su2`` into `folder`."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        define(fineness)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.optimize("Netgen")
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(folder / "naca.msh"))
        gmsh.write(str(folder / "naca.su2"))
    finally:
        gmsh.finalize()


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "."))

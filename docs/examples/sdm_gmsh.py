"""The SDM meshed by Gmsh, from the CAD that `sdm geometry --out sdm.step` writes.

    python sdm_gmsh.py [sdm.step [sdm.su2]]

Gmsh reads the faces in the order of the file, but not their names: these are taken from the file's text.
"""

import re
import sys
from pathlib import Path

import gmsh

# Edges at the aircraft in metres, how much longer they get in a metre, and half the side of the far field.
NEAR, GROWTH, FAR = 0.03, 0.35, 3.0


def flow(step: Path) -> dict[str, list[int]]:
    """Build the volume between the aircraft and a cube around it; return the surfaces of each patch."""
    occ = gmsh.model.occ
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    occ.importShapes(str(step))
    skin = [tag for _, tag in occ.getEntities(2)]
    names = re.findall(r"ADVANCED_FACE\('([^']*)'", step.read_text())
    cube = occ.addBox(-FAR, -FAR, -FAR, 2 * FAR, 2 * FAR, 2 * FAR)
    sides = [tag for _, tag in occ.getEntities(2) if tag not in skin]
    occ.remove([(3, tag) for _, tag in occ.getEntities(3)])
    occ.addVolume([occ.addSurfaceLoop(sides), occ.addSurfaceLoop(skin)], cube)
    occ.synchronize()
    patches = {"far_field": sides}
    for name, tag in zip(names, skin, strict=True):
        patches.setdefault(name, []).append(tag)
    return patches


def build(step: Path, out: Path, near: float = NEAR) -> None:
    """Mesh the flow around the CAD, with edges of length `near` at the aircraft."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        patches = flow(step)
        for name, tags in patches.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="flow")
        size = f"Min({near} + {GROWTH} * Max(0, Sqrt((x - 0.45)^2 + y^2 + z^2) - 0.6), 1)"
        field = gmsh.model.mesh.field.add("MathEval")
        gmsh.model.mesh.field.setString(field, "F", size)
        gmsh.model.mesh.field.setAsBackgroundMesh(field)
        for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(out))
    finally:
        gmsh.finalize()


if __name__ == "__main__":
    words = [*sys.argv[1:], *("sdm.step", "sdm.su2")[len(sys.argv) - 1 :]]
    build(Path(words[0]), Path(words[1]))

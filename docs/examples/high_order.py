"""Deflect a mesh of second order: `python high_order.py [FOLDER]` makes one in Gmsh, and turns its flap by 10 degrees.

Every node of a tetrahedron with ten nodes is a node of eight linear ones. So the mesh of these has all nodes, and each
node of a curved wall is a node of the surface that moves.
"""

import sys
import warnings
from pathlib import Path

import gmsh
import meshio
import numpy as np
from naca_wing import FLAP, HINGE, define

import sdm_deflect

ANGLE = 10.0
# Nodes of the linear cells within a curved one, as meshio numbers them: the corners, and the four parts of a triangle.
CORNERS = [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3]]
TRIANGLE = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
# The octahedron between the corners, cut along each of its diagonals.
OCTAHEDRON = [
    [[4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]],
    [[5, 7, 6, 4], [5, 7, 9, 6], [5, 7, 8, 9], [5, 7, 4, 8]],
    [[6, 8, 4, 5], [6, 8, 5, 9], [6, 8, 9, 7], [6, 8, 7, 4]],
]


def curved(path: Path, fineness: float = 1.0) -> None:
    """Write the half wing of `naca_wing.py` with cells of second order."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        define(fineness)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.model.mesh.optimize("HighOrder")
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def tetrahedra(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return eight linear tetrahedra (8 T, 4) for each curved one (T, 10), cut along the shortest diagonal."""
    ends = points[nodes[:, [4, 5, 6]]] - points[nodes[:, [9, 7, 8]]]
    shortest = np.linalg.norm(ends, axis=2).argmin(axis=1)
    corners = np.concatenate([np.broadcast_to(CORNERS, (len(nodes), 4, 4)), np.array(OCTAHEDRON)[shortest]], axis=1)
    return np.take_along_axis(nodes, corners.reshape(len(nodes), -1), axis=1).reshape(-1, 4)


def linear(mesh: meshio.Mesh) -> meshio.Mesh:
    """Return the linear mesh with all nodes of one of second order, and its physical groups."""
    cells, groups = [], []
    for block, group in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        solid = block.type == "tetra10"
        parts = tetrahedra(mesh.points, block.data) if solid else block.data[:, TRIANGLE].reshape(-1, 3)
        cells.append(("tetra" if solid else "triangle", parts))
        groups.append(np.repeat(group, len(parts) // len(block.data)))
    return meshio.Mesh(mesh.points, cells, cell_data={"gmsh:physical": groups}, field_data=mesh.field_data)


def on_patch(mesh: meshio.Mesh, name: str) -> np.ndarray:
    """Return the nodes of a patch, those within its edges as well."""
    groups = zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True)
    faces = [block.data[group == mesh.field_data[name][0]] for block, group in groups if block.type == "triangle6"]
    return np.unique(np.concatenate(faces))


def least_jacobian(path: Path) -> float:
    """Return the least scaled Jacobian of the curved tetrahedra of a file, as Gmsh has it; below 0 one is folded."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        gmsh.open(str(path))
        (tags,) = gmsh.model.mesh.getElements(3)[1]
        return float(min(gmsh.model.mesh.getElementQualities(tags, "minSJ")))
    finally:
        gmsh.finalize()


def main(folder: Path) -> None:
    """Write ``curved.msh`` and ``curved-deflected.msh``, and say how good the latter is."""
    before, after = folder / "curved.msh", folder / "curved-deflected.msh"
    curved(before)
    mesh = meshio.read(before)
    hinge = [[HINGE, FLAP[0], 0.0], [HINGE, FLAP[1], 0.0]]
    # no repair: it moves single nodes, and does not know which of them bend one cell
    settings = {"motion": "blended", "fixed": "wing", "slide": "symmetry:plane", "repair": "off"}
    plan = sdm_deflect.plan(linear(mesh), "flap", hinge, range=(-ANGLE, ANGLE), **settings)
    mesh.points = plan.on(mesh.points).at(ANGLE)
    mesh.write(after, file_format="gmsh22")
    failed = [check.name for check in plan.check(ANGLE) if not check.passed]
    least = [f"{least_jacobian(path):.3f}" for path in (before, after)]
    sys.stdout.write(
        f"{len(mesh.points):,} nodes; checks of the linear cells that failed: {', '.join(failed) or 'none'}\n"
        f"least scaled Jacobian of the curved cells: {' before, '.join(least)} after\n"
    )


if __name__ == "__main__":
    warnings.simplefilter("ignore", UserWarning)  # ends of a blended flap turn by less
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))

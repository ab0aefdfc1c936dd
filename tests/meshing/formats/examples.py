"""Small meshes of several cell types, made by hand."""

import numpy as np

from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polygons, Polyhedra, Zone
from sdm_deflect.meshing.mesh.faces import FACES
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.extras import Library

gmsh = Library("gmsh")
pv = Library("pyvista")

# A hexahedron (0 to 7), a box beside it of a pyramid and four tetrahedra (8 to 11), a roof of a wedge (12, 13).
POINTS = np.array(
    [
        *[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        *[[2, 0, 0], [2, 1, 0], [2, 0, 1], [2, 1, 1], [0, 0.5, 1.5], [1, 0.5, 1.5]],
    ],
    dtype=np.float64,
)
CELLS = {
    "hexahedron": [[0, 1, 2, 3, 4, 5, 6, 7]],
    "pyramid": [[1, 2, 6, 5, 8]],
    "tetra": [[6, 2, 11, 8], [11, 2, 9, 8], [10, 5, 11, 8], [11, 5, 6, 8]],
    "wedge": [[4, 12, 7, 5, 13, 6]],
}
PATCHES = {
    "floor": {"quad": [[0, 3, 2, 1]], "triangle": [[1, 2, 8], [2, 9, 8]]},
    "inlet": {"quad": [[0, 4, 7, 3]], "triangle": [[4, 12, 7]]},
    "outlet": {"triangle": [[8, 9, 11], [8, 11, 10]]},
    "left wall": {"quad": [[0, 1, 5, 4]], "triangle": [[1, 8, 5], [8, 10, 5]]},
    "right wall": {"quad": [[3, 7, 6, 2]], "triangle": [[2, 6, 11], [2, 11, 9]]},
    "roof": {"quad": [[4, 5, 13, 12], [7, 12, 13, 6]], "triangle": [[5, 6, 13], [5, 10, 11], [5, 11, 6]]},
}
# Numbers of the cell types of VTK.
KINDS = {"hexahedron": 12, "pyramid": 14, "tetra": 10, "wedge": 13}


def hybrid(zones: int = 1) -> Mesh:
    """A hexahedron, a pyramid, four tetrahedra and a wedge with shared faces, in six patches.

    Every cell has a positive volume by VTK's order of nodes, every boundary face is on one patch and its normal
    points out of the flow. Coordinates are irrational, so that a round trip of all 17 digits is a test. With
    several zones, copies stand side by side, each with points of its own; patches after the first copy are named
    ``"floor 2"`` and so on.
    """
    wobble = np.sin(np.arange(POINTS.size).reshape(POINTS.shape)) * np.pi / 100.0
    points = [POINTS + wobble + [0.0, 3.0 * i, 0.0] for i in range(zones)]
    cells = tuple(_cells(CELLS, 14 * i) for i in range(zones))
    patches = tuple(
        Patch(name if i == 0 else f"{name} {i + 1}", _cells(faces, 14 * i))
        for i in range(zones)
        for name, faces in PATCHES.items()
    )
    parts = tuple(Zone(f"block {i + 1}", 14 * i, 14 * (i + 1)) for i in range(zones)) if zones > 1 else ()
    return Mesh(np.vstack(points), tuple(block for zone in cells for block in zone), patches, parts)


def _cells(blocks: dict[str, list[list[int]]], first: int) -> tuple[Cells, ...]:
    return tuple(Cells(shape, np.array(nodes, dtype=np.intp) + first) for shape, nodes in blocks.items())


def grid(mesh: Mesh):
    """The same mesh for VTK."""
    return pv.UnstructuredGrid({KINDS[block.shape]: block.nodes for block in mesh.cells}, mesh.points)


def polyhedral(mesh: Mesh) -> Mesh:
    """The same cells as polyhedra."""
    cells = [(block.shape, row) for block in mesh.cells for row in block.nodes]
    pairs: dict[frozenset, list] = {}
    for i, (shape, row) in enumerate(cells):
        for face in FACES[shape]:
            pairs.setdefault(frozenset(row[list(face)].tolist()), []).append((i, row[list(face)]))
    ordered = sorted(pairs.values(), key=len, reverse=True)
    sizes = [len(pair[0][1]) for pair in ordered]
    faces = Polygons(np.concatenate([pair[0][1] for pair in ordered]), np.cumsum([0, *sizes]))
    owner = np.array([pair[0][0] for pair in ordered])
    neighbour = np.array([pair[1][0] for pair in ordered if len(pair) == 2])
    return Mesh(mesh.points, (Polyhedra(faces, owner, neighbour),), mesh.patches, (Zone("Zone", 0, 14),))


def with_gmsh(*paths):
    """A box of tetrahedra under a box of prisms."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.7)
        box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        top = max(gmsh.model.getEntities(2), key=lambda face: gmsh.model.occ.getCenterOfMass(*face)[2])
        layers = [tag for dim, tag in gmsh.model.occ.extrude([top], 0, 0, 0.2, [2], recombine=True) if dim == 3]
        gmsh.model.occ.synchronize()
        outer = [tag for _, tag in gmsh.model.getBoundary([(3, box), (3, layers[0])], oriented=False)]
        gmsh.model.addPhysicalGroup(3, [box, *layers], name="fluid")
        gmsh.model.addPhysicalGroup(2, outer[:2], name="wing")
        gmsh.model.addPhysicalGroup(2, outer[2:], name="far_field")
        gmsh.model.mesh.generate(3)
        for path in paths:
            gmsh.write(str(path))
    finally:
        gmsh.finalize()

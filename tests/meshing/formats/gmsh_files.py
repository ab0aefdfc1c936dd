"""Files of Gmsh: in binary made by hand, version 4.1, and in every version by Gmsh itself."""

from pathlib import Path
from struct import pack

import numpy as np

from sdm_deflect.meshing.formats.gmsh import FACES, SOLIDS
from sdm_deflect.meshing.formats.shapes import mirror_nodes
from sdm_deflect.meshing.mesh.cells import Cells
from sdm_deflect.meshing.mesh.mesh import Mesh

VARIANTS = [(version, binary) for version in (2.2, 4.1) for binary in (0, 1)]
KINDS = {shape: kind for kind, shape in {**SOLIDS, **FACES}.items()}


def gmsh_data(mesh: Mesh, numbers=None, groups=None) -> bytes:
    """A file as Gmsh writes it; the first nodes have parameters, the first cells of each shape are apart.

    Nodes have `numbers` (N,), or count from 1; patch i is the surface i of the geometry, in its groups, or in group i.
    """
    count, surfaces = len(mesh.points) // 3, range(1, len(mesh.patches) + 1)
    numbers = np.arange(1, len(mesh.points) + 1) if numbers is None else numbers
    several = {i: (i,) for i in surfaces} | (groups or {})
    names = "".join(f'2 {i} "{name}"\n' for i, name in enumerate(mesh.names, 1))
    entities = [pack("<4Q", 0, 0, len(mesh.patches), 2)]
    entities += [pack(f"<i6dQ{len(own)}iQ", i, *[0.0] * 6, len(own), *own, 0) for i, own in several.items()]
    entities += [pack("<i6dQQ", i, *[0.0] * 6, 0, 0) for i in (1, 2)]
    sections = {"PhysicalNames": f"{len(mesh.names)}\n{names}".encode(), "Entities": b"".join(entities)}
    nodes = pack("<4Q", 2, len(mesh.points), min(numbers), max(numbers))
    for dimension, part in ((2, slice(count)), (3, slice(count, None))):
        points = mesh.points[part]
        stored = np.column_stack([points, points[:, :2]]) if dimension == 2 else points
        nodes += pack("<3iQ", dimension, 1, int(dimension == 2), len(points)) + numbers[part].astype("<i8").tobytes()
        nodes += stored.astype("<f8").tobytes()
    sections["Nodes"] = nodes
    parts = [(2, i, face) for i, patch in enumerate(mesh.patches, 1) for face in patch.faces]
    for volume in (1, 2):
        for own in mesh.cells:
            rows = own.nodes[: len(own) // 3] if volume == 1 else own.nodes[len(own) // 3 :]
            parts.append((3, volume, Cells(own.shape, mirror_nodes("wedge", rows) if own.shape == "wedge" else rows)))
    total = sum(len(own) for _, _, own in parts)
    elements, first = pack("<4Q", len(parts), total, 1, total), 1
    for dimension, entity, own in parts:
        rows = np.column_stack([np.arange(first, first + len(own)), numbers[own.nodes]])
        elements += pack("<3iQ", dimension, entity, KINDS[own.shape], len(own)) + rows.astype("<i8").tobytes()
        first += len(own)
    sections["Elements"] = elements
    text = b"$MeshFormat\n4.1 1 8\n" + pack("<i", 1) + b"\n$EndMeshFormat\n"
    return text + b"".join(b"$%b\n%b\n$End%b\n" % (key.encode(), own, key.encode()) for key, own in sections.items())


def by_gmsh(source: Path, out: Path, version: float, binary: int, order: int = 1) -> Path:
    """Have Gmsh read a file and write it in a version, as text or in binary."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.open(str(source))
        if order > 1:
            gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(out))
    finally:
        gmsh.finalize()
    return out

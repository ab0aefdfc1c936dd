"""Gmsh files of version 2.2 in text, which every reader of .msh files knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.formats.orientation import mirrored
from sdm_deflect.meshing.formats.polygons import simple_faces
from sdm_deflect.meshing.formats.standard import standard_cells

VOLUME = "volume"


def write_mesh(mesh: Mesh, out: Path) -> tuple[str, ...]:
    """Write boundary faces, then cells; patch i is physical group i + 1, the cells are the group ``volume`` after them.

    Raises
    ------
    MeshFileError
        For polyhedra of other than the usual shapes, and faces of more than four corners.
    """
    import meshio

    names = [patch.name.replace('"', "'") for patch in mesh.patches]
    faces = [(f, tag) for tag, patch in enumerate(mesh.patches, 1) for f in simple_faces(patch) if len(f)]
    solids = [(block, len(names) + 1) for block in standard_cells(mesh) if len(block)]
    groups = [np.full(len(block), tag, dtype=np.int32) for block, tag in faces + solids]
    turned = [mirrored("wedge", block.nodes) if block.shape == "wedge" else block.nodes for block, _ in faces + solids]
    fields = {name: np.array([tag, 2]) for tag, name in enumerate(names, 1)} | {
        _free(names): np.array([len(names) + 1, 3])
    }
    whole = meshio.Mesh(
        mesh.points,
        [(block.shape, nodes) for (block, _), nodes in zip(faces + solids, turned, strict=True)],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data=fields,
    )
    meshio.write(out, whole, file_format="gmsh22", binary=False)
    renamed = [
        f"patch {p.name} is called {name}" for p, name in zip(mesh.patches, names, strict=True) if p.name != name
    ]
    return (*renamed, *(["its zones are one mesh"] if len(mesh.zones) > 1 else []))


def _free(names: list[str]) -> str:
    name = VOLUME
    while name in names:
        name += "_"
    return name

"""What two meshes have in common."""

import h5py
import numpy as np

from sdm_deflect.meshing.formats.cgns_hdf5 import HdfNode
from sdm_deflect.meshing.formats.cgns_nodes import children
from sdm_deflect.meshing.mesh.cells import Cells, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh


def rows(block: Cells | Polygons) -> list[tuple[int, ...]]:
    """Nodes of each cell or face."""
    if isinstance(block, Cells):
        return [tuple(row) for row in block.nodes.tolist()]
    return [tuple(part.tolist()) for part in np.split(block.nodes, block.offsets[1:-1])]


def content(mesh: Mesh) -> dict[str, object]:
    """Cells by shape and faces by patch, in order, as plain lists."""
    cells: dict[str, list] = {}
    for block in mesh.cells:
        assert not isinstance(block, Polyhedra)
        cells.setdefault(block.shape, []).extend(rows(block))
    patches = {patch.name: [row for faces in patch.faces for row in rows(faces)] for patch in mesh.patches}
    return {"cells": cells, "patches": patches, "zones": [(zone.name, zone.start, zone.stop) for zone in mesh.zones]}


def tree(path) -> dict[str, tuple]:
    """Everything in an HDF5 file by path: attributes, and type, shape and bytes of each dataset."""
    found: dict[str, tuple] = {}

    def visit(name, node):
        values = (node.dtype.str, node.shape, node[()].tobytes()) if isinstance(node, h5py.Dataset) else ()
        attributes = {key: np.asarray(value).tobytes() for key, value in node.attrs.items()}
        found[name] = (attributes, values)

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return found


def zone_of(file, name="Zone"):
    return file["Base"][name]


def replace_data(node, values):
    del node[" data"]
    node.create_dataset(" data", data=values)


def groups(group, label: str) -> list[tuple[str, h5py.Group]]:
    """Names and groups of the children with a label, in order of creation."""
    return [(name, node.group) for name, node in children(HdfNode(group), label)]

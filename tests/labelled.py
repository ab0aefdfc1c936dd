"""Meshes of tetrahedra with labelled boundaries, and the same with something changed."""

from typing import Any

from sdm_deflect.meshing.mesh.labelled import Skin, skin, tetrahedral, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh


def changed(mesh: Mesh, **change: Any) -> Mesh:
    """Return a mesh with other points, tets, triangles, patch, face or names."""
    parts = {"points": mesh.points, "tets": tets_of(mesh), **skin(mesh)._asdict(), "names": mesh.names, **change}
    boundary = Skin(*(parts[name] for name in Skin._fields))
    return tetrahedral(parts["points"], parts["tets"], boundary, parts["names"], mesh.name)

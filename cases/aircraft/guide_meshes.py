"""The meshes of the guide: their sizes, hashes of their points, and the libraries that made them."""

import hashlib
from importlib.metadata import version
from typing import NamedTuple

import numpy as np

from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case, mesh_parameters
from .registry import CASES, case_named


class KnownMesh(NamedTuple):
    """Sizes of a mesh of the guide, and the first 16 digits of the SHA-256 of its points."""

    nodes: int
    cells: int
    hash: str


# Libraries whose versions decide the bits of a mesh, and those of the guide.
VERSIONS = {
    "cadquery": "2.8.0",
    "cadquery-ocp": "7.9.3.1.1",
    "gmsh": "4.15.2",
    "numpy": "2.4.6",
    "pytetwild": "0.4.2",
    "scipy": "1.17.1",
}

# The undeflected meshes of the guide, by the name in `mesh_name` and the scale.
GUIDE = {
    ("aircraft", "small"): KnownMesh(24473, 127459, "701d46e21732195a"),
    ("notch", "small"): KnownMesh(28126, 146652, "83e97df745727058"),
    ("block", "small"): KnownMesh(8032, 37263, "56aedf43be1e62ad"),
    ("aircraft", "medium"): KnownMesh(181809, 1019672, "9a62dd2d1dce45af"),
    ("notch", "medium"): KnownMesh(209301, 1173216, "9d17382edf8eff52"),
    ("block", "medium"): KnownMesh(56561, 298104, "089dc9d2fd7d1332"),
    ("aircraft", "paper"): KnownMesh(612380, 3315112, "538996a1795609da"),
    ("block", "paper"): KnownMesh(937082, 5248472, "91453af7a0e30600"),
}


def mesh_name(case: Case) -> str:
    """Return the mesh's kind: "aircraft", "notch" (aircraft with gaps around its ailerons) or "block"."""
    return "block" if case.domain == "block" else "notch" if case.notch else "aircraft"


def points_hash(mesh: Mesh) -> str:
    """Return the first 16 digits of the SHA-256 of the points (N, 3), 64-bit, least byte first."""
    return hashlib.sha256(np.ascontiguousarray(mesh.points, dtype="<f8").tobytes()).hexdigest()[:16]


def guide_text(case: Case, mesh: Mesh, unseeded: str) -> str:
    """Return a sentence on whether an undeflected mesh is that of the guide, and if not, why.

    `unseeded` is the reason why another run gives another mesh; "" if it gives the same.
    """
    reason = _difference(case, mesh, unseeded)
    return f"not the mesh of the guide: {reason}" if reason else "the mesh of the guide"


def _difference(case: Case, mesh: Mesh, unseeded: str) -> str:
    known, own = GUIDE.get((mesh_name(case), case.scale)), mesh_parameters(case)
    if all(mesh_parameters(case_named(name, case.scale)) != own for name in CASES):
        return "its settings are others"
    if known is None:
        return f"the guide has none of this case at scale {case.scale}"
    found = KnownMesh(len(mesh.points), len(tets_of(mesh)), points_hash(mesh))
    if known == found:
        return ""
    others = [f"{name} {version(name)} for {wanted}" for name, wanted in VERSIONS.items() if version(name) != wanted]
    if others:
        return f"made by {', '.join(others)}"
    many = "as many nodes and cells" if known[:2] == found[:2] else f"{found.nodes:,} nodes for {known.nodes:,}"
    return unseeded or f"it has {many}; probably this processor or its C library rounds coordinates otherwise"

"""The meshes of the guide: their sizes, hashes of their points, and the libraries that made them."""

import hashlib
from importlib.metadata import version
from typing import NamedTuple

import numpy as np

from sdm_deflect.meshing.mesh.labelled import tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case, mesh_parameters
from .registry import case_named


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
    ("aircraft", "small"): KnownMesh(24473, 127459, "a575e86351a20995"),
    ("notch", "small"): KnownMesh(28126, 146652, "6163686cebea35f6"),
    ("block", "small"): KnownMesh(8032, 37263, "a73567ed5edf7c7b"),
    ("aircraft", "medium"): KnownMesh(181809, 1019672, "eb546e5984135d77"),
    ("notch", "medium"): KnownMesh(209301, 1173216, "aa91457ffa768a12"),
    ("block", "medium"): KnownMesh(56561, 298104, "c02357c8e7259cc9"),
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
    usual, known = case_named(case.name, case.scale), GUIDE.get((mesh_name(case), case.scale))
    if mesh_parameters(case) != mesh_parameters(usual):
        return "its settings are others"
    if known is None:
        return f"the guide has none of this case at scale {case.scale}"
    if known == KnownMesh(len(mesh.points), len(tets_of(mesh)), points_hash(mesh)):
        return ""
    others = [f"{name} {version(name)} for {wanted}" for name, wanted in VERSIONS.items() if version(name) != wanted]
    if others:
        return f"made by {', '.join(others)}"
    return unseeded or f"it has other bits, and {len(mesh.points):,} nodes for {known.nodes:,}"

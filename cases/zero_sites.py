"""Data sites of zero displacement on a hexahedron's faces and on a Chimera face that it cuts (sections 3, 5.2)."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.motion import FloatArray
from sdm_deflect.deform.rbf.sites import DataSites, pinned
from sdm_deflect.deform.volume.hexahedron import Hexahedron, polygon_sites
from sdm_deflect.geometry.confinement import gap_faces, inward_face, rib_faces
from sdm_deflect.geometry.datum import hinged

BLOCK = "chimera"
"""Patch of a Chimera block's outer faces."""
ON_FACE = 1e-7
"""A node within this distance (m) of a plane counts as in it: boundary nodes are on the CAD to that."""
APART = 0.5
"""Zero sites keep this share of their spacing from the surface's nodes and from each other."""


def zero_sites(
    case: Case, surface: str, hexahedron: Hexahedron, points: FloatArray, spacing: float
) -> tuple[DataSites, ...]:
    """Return the zero sites of one control surface, whose nodes are `points` (K, 3).

    All faces carry sites for all directions, but a tail's inward face, and the faces of an aileron's hexahedron
    that lie beyond a Chimera block's faces in the gaps. There, sites on the section of the block's face are for
    its normal direction y only, so that nodes slide in its plane.
    """
    faces = hexahedron.face_sites(spacing, skip=open_faces(case, surface))
    faces = apart_from(faces, points, APART * spacing)
    sections = block_sections(case, surface, hexahedron)
    if not sections:
        return (pinned(faces),)
    known = np.vstack([points, faces])
    on_block = np.vstack([apart_from(polygon_sites(section, spacing), known, APART * spacing) for section in sections])
    return pinned(faces), pinned(on_block, (1,) if case.confinement.slide else (0, 1, 2))


def open_faces(case: Case, surface: str) -> frozenset[str]:
    """Faces of the hexahedron without zero sites."""
    if not hinged(surface):
        return frozenset({inward_face(surface)})
    return frozenset(rib_faces(case.fighter, surface)) if case.domain == "block" else frozenset()


def block_stations(case: Case, surface: str) -> FloatArray:
    """Stations y (k,) of the Chimera block's faces in the gaps; none where there is no block."""
    if case.domain != "block":
        return np.empty(0)
    return gap_faces(case.fighter, case.block, surface)


def on_gap_faces(case: Case, surface: str, points: FloatArray) -> NDArray[np.bool_]:
    """True for points (N, 3) in the planes of the Chimera block's faces in the gaps."""
    stations = block_stations(case, surface)
    return np.asarray(np.abs(points[:, 1, None] - stations).min(axis=1, initial=np.inf) <= ON_FACE)


def block_sections(case: Case, surface: str, hexahedron: Hexahedron) -> list[FloatArray]:
    """Polygons (k, 3) in which the hexahedron cuts the block's faces in the gaps."""
    normal = np.array([0.0, 1.0, 0.0])
    return [hexahedron.section(normal * station, normal) for station in block_stations(case, surface)]


def apart_from(sites: FloatArray, points: FloatArray, distance: float) -> FloatArray:
    """Return the sites (P, 3) that keep at least this distance from all points (K, 3)."""
    nearest, _ = cKDTree(points).query(sites)
    return np.ascontiguousarray(sites[nearest >= distance])

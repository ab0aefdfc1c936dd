"""Lengths that set how dense data sites are, and zero sites that are none."""

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.boundary import SAME, Boundary
from sdm_deflect.cases.own.region import Region
from sdm_deflect.cases.own.walls import Plane
from sdm_deflect.deform.edges import median_edge
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

MOST_ZERO = 12_000  # sites on the box, about: beyond, they stand farther apart


def surface_edge(boundary: Boundary, distinct: IndexArray) -> float:
    """Return the median edge of the moving surfaces; without faces, the median distance of nearest nodes."""
    subject = boundary.subject
    faces = [faces for surface in boundary.surfaces for faces in subject.faces_of(surface.patches)]
    if faces:
        return median_edge(subject.points, faces)
    if len(distinct) < 2:
        raise InputError(f"{subject.name}: the moving surface has {len(distinct)} distinct nodes")
    points = subject.points[boundary.nodes[distinct]]
    return float(np.median(cKDTree(points).query(points, 2)[0][:, 1]))


def spacing_for(region: Region, wanted: float) -> float:
    """Return the distance of sites on the box: as wanted, unless that takes too many."""
    faces = [region.hexahedron.face(name) for name in ("x-", "x+", "y-", "y+", "z-", "z+")]
    area = sum(float(np.linalg.norm(np.cross(f[2] - f[0], f[3] - f[1]))) / 2.0 for f in faces)
    return max(wanted, float(np.sqrt(area / MOST_ZERO)))


def in_front(boundary: Boundary, sites: FloatArray) -> FloatArray:
    """Drop sites behind a sliding plane that bounds the mesh: nothing is there to be held."""
    for sheet in boundary.sheets:
        if isinstance(sheet.wall, Plane):
            side = sheet.wall.distance(boundary.subject.points[boundary.nodes])
            tol = SAME * boundary.size
            if (side >= -tol).all() or (side <= tol).all():
                sites = sites[sheet.wall.distance(sites) * np.copysign(1.0, side.sum()) >= -tol]
    return np.ascontiguousarray(sites)

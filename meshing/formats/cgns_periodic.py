"""Periodic interfaces of a CGNS file: the motion to the other zone, and the points that are images. SIDS, section 8.5.

Files have the motion in single precision, and some writers count angles in degrees, or backward, without saying so. So
it only serves to find images that the file does not list, by whichever reading of it all points have one.
"""

from collections.abc import Callable, Iterator
from math import prod
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.mesh.cells import LARGEST, Periodic
from sdm_deflect.deform.mesh.images import TOLERANCE, RigidMotion
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.formats.cgns_nodes import Integer, child, children, create, has, reals
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.periodic import written_pairs

PROPERTY, PERIODIC = "GridConnectivityProperty_t", "Periodic_t"
VECTORS = ("RotationCenter", "RotationAngle", "Translation")


def motions(node: Any) -> tuple[RigidMotion, ...] | None:
    """Return what may lead to the other zone; None if the interface is not periodic.

    MeshFileError if its vectors are none.
    """
    for _, own in children(node, PROPERTY):
        for _, periodic in children(own, PERIODIC):
            return tuple(_readings(*(_vector(periodic, name) for name in VECTORS)))
    return None


def images(
    own: FloatArray, other: FloatArray, nodes: IntArray, found: tuple[RigidMotion, ...], tree: Callable[[], cKDTree]
) -> IntArray | None:
    """Return rows (K, 2): nodes of a zone with points (N, 3), and their images in another one (M, 3), by its `tree`.

    None if by no motion all have one.
    """
    allowed = TOLERANCE * max(float(np.abs(points).max(initial=0.0)) for points in (own, other))
    for rotation, shift in found:
        apart, partners = tree().query(own[nodes] @ rotation.T + shift)
        if apart.max(initial=0.0) <= allowed:
            return np.stack([nodes, partners], axis=1)
    return None


def write_pairs(zone: Any, name: str, mesh: Mesh, kind: Integer, axes: int) -> None:
    """Write the periodic pairs of a zone with so many coordinates, each from either side."""
    pairs = written_pairs(mesh)
    group = create(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t") if pairs else None
    for i, pair in enumerate(pairs, 1):
        turn, shift = pair.rotation.T, -pair.shift @ pair.rotation
        back = Periodic(pair.name, pair.patches[::-1], pair.nodes[:, ::-1], turn, shift)
        for way, one in (("to", pair), ("from", back)):
            node = create(group, f"Periodic {i} {way}", "GridConnectivity_t", name)
            create(node, "GridConnectivityType", "GridConnectivityType_t", "Abutting1to1")
            create(node, "GridLocation", "GridLocation_t", "Vertex")
            create(node, "PointList", "IndexArray_t", (one.nodes[:, :1] + 1).astype(kind))
            create(node, "PointListDonor", "IndexArray_t", (one.nodes[:, 1:] + 1).astype(kind))
            own = create(create(node, "GridConnectivityProperty", PROPERTY), "Periodic", PERIODIC)
            for vector, values in zip(VECTORS, _vectors(one), strict=True):
                create(own, vector, "DataArray_t", values[:axes].astype(np.float32))


def _vector(periodic: Any, name: str) -> FloatArray:
    """Return a vector (3,), zero if it is not there; those of a plane mesh have two numbers."""
    if not has(periodic, name):
        return np.zeros(3)
    stored = reals(child(periodic, name))
    values = np.ravel(stored[()]).astype(np.float64) if prod(stored.shape) <= 3 else None
    if values is None or not (np.abs(values) < LARGEST).all():
        raise MeshFileError(f"its {name} is no vector of three numbers")
    return np.append(values, np.zeros(3 - len(values)))


def _readings(centre: FloatArray, angle: FloatArray, shift: FloatArray) -> Iterator[RigidMotion]:
    for unit in (1.0, np.pi / 180.0) if angle.any() else (0.0,):
        rotation = Rotation.from_euler("xyz", unit * angle).as_matrix()
        offset = centre - rotation @ centre + shift
        yield rotation, offset
        yield rotation.T, -rotation.T @ offset


def _vectors(pair: Periodic) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centre and angles (in radians) of the rotation, and the translation after it, which is along its axis."""
    angles = Rotation.from_matrix(pair.rotation).as_euler("xyz")
    part = np.eye(3) - pair.rotation
    centre = np.asarray(np.linalg.lstsq(part, pair.shift, rcond=1e-9)[0])
    return centre, np.asarray(angles), pair.shift - part @ centre

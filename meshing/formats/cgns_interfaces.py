"""Interfaces of a CGNS file (SIDS, section 8): points of a zone that lie on points of another zone or of itself.

Periodic interfaces (section 8.5) have a motion, and pairs of points that are images by it. Files store the motion in
single precision; some have angles in degrees, or backward, without saying so. So the motion only serves to find images
that the file does not list: of the possible readings, the one by which all points have an image.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from math import prod
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import LARGEST, Cells, Periodic
from sdm_deflect.meshing.mesh.images import TOLERANCE, RigidMotion
from sdm_deflect.meshing.mesh.mesh import Mesh

from .cgns_blocks import Size, bounds, check_face, donors_of, faces_at, points_in, strides
from .cgns_boundary import Fault, NumberedFaces, location
from .cgns_hdf5 import Integer, create
from .cgns_nodes import check_taken, child, children, has, integers, label_of, reals, text
from .shapes import places
from .zones import pairs_to_write

PROPERTY, PERIODIC = "GridConnectivityProperty_t", "Periodic_t"
VECTORS = ("RotationCenter", "RotationAngle", "Translation")
# Largest distance of equal points, as a share of the distance from the origin; single precision keeps it.
NEAR = 2e-6
LABELS = ("GridConnectivity1to1_t", "GridConnectivity_t")


def motions(node: Any) -> tuple[RigidMotion, ...] | None:
    """Return the possible motions to the other zone; None if the interface is not periodic.

    MeshFileError if it lacks three numbers for a vector.
    """
    for _, group in children(node, PROPERTY):
        for _, periodic in children(group, PERIODIC):
            return tuple(_readings(*(_vector(periodic, name) for name in VECTORS)))
    return None


def images(
    here: FloatArray, there: FloatArray, nodes: IntArray, possible: tuple[RigidMotion, ...], tree: Callable[[], cKDTree]
) -> IntArray | None:
    """Return pairs (K, 2): nodes of a zone with points (N, 3), and their images (M, 3) in another zone with a `tree`.

    None if no motion leads every node to an image.
    """
    allowed = TOLERANCE * max(float(np.abs(points).max(initial=0.0)) for points in (here, there))
    for rotation, shift in possible:
        apart, partners = tree().query(here[nodes] @ rotation.T + shift)
        if apart.max(initial=0.0) <= allowed:
            return np.stack([nodes, partners], axis=1)
    return None


def write_pairs(zone: Any, name: str, mesh: Mesh, kind: Integer, axes: int) -> None:
    """Write the periodic pairs of a zone, each from both sides; vectors have one number per coordinate."""
    pairs = pairs_to_write(mesh)
    group = create(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t") if pairs else None
    for i, pair in enumerate(pairs, 1):
        turn, shift = pair.rotation.T, -pair.shift @ pair.rotation
        back = Periodic(pair.name, pair.patches[::-1], pair.nodes[:, ::-1], turn, shift)
        for way, side in (("to", pair), ("from", back)):
            node = create(group, f"Periodic {i} {way}", "GridConnectivity_t", name)
            create(node, "GridConnectivityType", "GridConnectivityType_t", "Abutting1to1")
            create(node, "GridLocation", "GridLocation_t", "Vertex")
            create(node, "PointList", "IndexArray_t", (side.nodes[:, :1] + 1).astype(kind))
            create(node, "PointListDonor", "IndexArray_t", (side.nodes[:, 1:] + 1).astype(kind))
            periodic = create(create(node, "GridConnectivityProperty", PROPERTY), "Periodic", PERIODIC)
            for vector, values in zip(VECTORS, _vectors(side), strict=True):
                create(periodic, vector, "DataArray_t", values[:axes].astype(np.float32))


def _vector(periodic: Any, name: str) -> FloatArray:
    """Return a vector (3,), zero if it is absent; vectors of a plane mesh have two numbers."""
    if not has(periodic, name):
        return np.zeros(3)
    stored = reals(child(periodic, name))
    values = np.ravel(stored.read(np.float64)) if prod(stored.shape) <= 3 else None
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
    """Return centre and angles (radians) of the rotation, and the translation that follows it."""
    angles = Rotation.from_matrix(pair.rotation).as_euler("xyz")
    part = np.eye(3) - pair.rotation
    centre = np.asarray(np.linalg.lstsq(part, pair.shift, rcond=1e-9)[0])
    return centre, np.asarray(angles), pair.shift - part @ centre


@dataclass(frozen=True, slots=True, eq=False)
class Interface:
    """Where a zone meets another one.

    Parameters
    ----------
    name, donor : names of the interface and of the other zone.
    nodes : (K,) points of the interface, as numbers within the zone.
    partners : (K,) the points of the other zone that they lie on, or that are their images; None if the file does not
        pair them.
    matching : whether the file says that every point lies on one of the other zone; else the two may only touch along a
        surface.
    motions : possible motions to the other zone; None if the interface is not periodic.
    """

    name: str
    donor: str
    nodes: IntArray = field(repr=False)
    partners: IntArray | None = field(repr=False)
    matching: bool
    motions: tuple[RigidMotion, ...] | None = field(default=None, repr=False)

    @property
    def is_periodic(self) -> bool:
        """Whether the file says that its points are images of others."""
        return self.motions is not None


def interfaces(
    zone: Any, name: str, sizes: Mapping[str, Size], faces: Sequence[NumberedFaces]
) -> tuple[list[Interface], list[Fault]]:
    """Return the interfaces where a zone touches another, and those that could not be read.

    Overlapping interfaces are left out.

    Parameters
    ----------
    sizes : By zone, the number of points along each axis of a block, or of all points of an unstructured zone.
    faces : Faces of an unstructured zone by their numbers.

    Raises InputError if they name too many points for the file.
    """
    touching, total = [], 0
    faults: list[Fault] = []
    for group in (group for _, group in children(zone, "ZoneGridConnectivity_t")):
        for title, node in chain(*(children(group, label) for label in LABELS)):
            try:
                interface = _interface(title, node, sizes[name], sizes, faces)
                interface = replace(interface, motions=motions(node)) if interface else None
            except MeshFileError as error:
                faults.append(Fault("", False, f"interface {title}: {error}"))
                continue
            if interface is not None:
                total += len(interface.nodes)
                check_taken(zone, 64 * total, "what its interfaces name")
                touching.append(interface)
    return touching, faults


def pairs(points: FloatArray, others: FloatArray, interface: Interface, tree: Callable[[], cKDTree]) -> IntArray | None:
    """Return pairs (K, 2): points of a zone (N, 3), and the points of the other zone (M, 3) on which they lie.

    Where the file lists no pair, or a wrong one, the nearest point counts, from the other zone's `tree`. None if a
    point lies on no other: the interface is periodic, or the zones only touch.
    """
    here = points[interface.nodes]
    distance = np.linalg.norm(here, axis=1)
    allowed = NEAR * np.maximum(distance, np.median(distance))
    for given in (interface.partners, None):
        partners = tree().query(here)[1] if given is None else given
        if len(partners) == len(here) and np.all(np.linalg.norm(others[partners] - here, axis=1) <= allowed):
            return np.stack([interface.nodes, partners], axis=1)
    return None


def periodic_pairs(
    points: FloatArray, others: FloatArray, interface: Interface, tree: Callable[[], cKDTree]
) -> IntArray | None:
    """Return pairs (K, 2): points of a zone (N, 3), and their images in the other zone (M, 3).

    None if a point has no image, neither in the file's list nor by its motion.
    """
    nodes, partners = interface.nodes, interface.partners
    if partners is not None and len(partners) == len(nodes):
        return np.stack([nodes, partners], axis=1)
    return images(points, others, nodes, interface.motions or (), tree)


def meeting(points: FloatArray, faces: IntArray) -> IntArray:
    """Return pairs (K, 2) of points of faces (F, k) that coincide to the bit, where two faces meet.

    Faces with fewer than k distinct places, and places that three or more faces share, are left out.
    """
    nodes, corner = np.unique(faces, return_inverse=True)
    _, place = np.unique(points[nodes] + 0.0, axis=0, return_inverse=True)  # -0.0 is 0.0
    corners = place.ravel()[corner.reshape(faces.shape)]
    order = np.argsort(corners, axis=1)
    rows, each, count = np.unique(
        np.take_along_axis(corners, order, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    whole = (np.diff(rows, axis=1) > 0).all(axis=1) & (count == 2)
    at_corners = np.flatnonzero(whole[each.ravel()])
    at_corners = at_corners[np.argsort(each.ravel()[at_corners], kind="stable")]
    ranked = np.take_along_axis(faces, order, axis=1)
    return np.stack([ranked[at_corners[0::2]].ravel(), ranked[at_corners[1::2]].ravel()], axis=1)


def _interface(
    name: str, node: Any, size: Size, sizes: Mapping[str, Size], faces: Sequence[NumberedFaces]
) -> Interface | None:
    kind = text(child(node, "GridConnectivityType")) if has(node, "GridConnectivityType") else "Overset"
    if label_of(node) == LABELS[1] and kind not in ("Abutting", "Abutting1to1"):
        return None
    donor = text(node).rpartition("/")[2]
    if donor not in sizes:
        donor = donor.replace(" ", "_")  # Gmsh puts them in the names of zones, and not here
    if donor not in sizes:
        raise MeshFileError(f"it leads to the zone {donor!r}, which the file does not have")
    if has(node, "PointRangeDonor") and has(node, "PointRange"):
        return _of_ranges(name, node, donor, size, sizes[donor])
    matching = kind == "Abutting1to1"
    where = location(node)
    nodes = _points(node, where, size, faces)
    if not len(nodes):
        return None
    partners = _partners(node, sizes[donor]) if matching and where == "Vertex" else None
    return Interface(name, donor, nodes, partners, matching)


def _of_ranges(name: str, node: Any, donor: str, size: Size, other: Size) -> Interface:
    begin, end = bounds(node, "PointRange", size)
    if len(size) > 1:
        check_face(begin, end, size)
    if len(size) != len(other):
        raise MeshFileError(f"the zone {donor} has {len(other)} axes, its own has {len(size)}")
    turn = integers(child(node, "Transform")).tolist() if has(node, "Transform") else [1, 2, 3][: len(size)]
    if sorted(map(abs, turn)) != [1, 2, 3][: len(size)]:
        raise MeshFileError(f"its Transform {turn} does not name every axis once")
    first, _ = bounds(node, "PointRangeDonor", other)
    return Interface(name, donor, points_in(begin, end, size), donors_of(begin, end, first, turn, other), True)


def _points(node: Any, where: str, size: Size, faces: Sequence[NumberedFaces]) -> IntArray:
    """Points (K,) of an interface that is given by points or by faces."""
    if has(node, "PointRange"):
        if len(size) > 1:
            begin, end = bounds(node, "PointRange", size)
            if where != "Vertex":
                return _corners([faces_at(begin, end, where, size)])
            check_face(begin, end, size)
            return points_in(begin, end, size)
        first, last = _two(integers(child(node, "PointRange")))
        most = max([*size, *(int(part.numbers.max(initial=0)) for part in faces)])
        if not 1 <= first <= last <= most:
            raise MeshFileError(f"its range is {first} to {last} of {most}")
        values = np.arange(first, last + 1)
    elif has(node, "PointList"):
        values = integers(child(node, "PointList"))
    else:
        raise MeshFileError("it does not say where it is")
    if len(size) > 1:
        at = _triples(values, size)
        return (
            _corners([faces_at(at.min(axis=0), at.max(axis=0), where, size)])
            if where != "Vertex"
            else at @ strides(size)
        )
    return _in_zone(values, size) if where == "Vertex" else _corners(_nodes_of_faces(values, faces))


def _partners(node: Any, size: Size) -> IntArray | None:
    """Points (K,) of the other zone that are listed; None if the list is of cells or faces."""
    if not has(node, "PointListDonor"):
        return None
    values = integers(child(node, "PointListDonor"))
    try:
        return _triples(values, size) @ strides(size) if len(size) > 1 else _in_zone(values, size)
    except MeshFileError:
        return None


def _triples(values: IntArray, size: Size) -> IntArray:
    if not len(values) or len(values) % len(size):
        raise MeshFileError(f"it lists {len(values)} numbers, no multiple of {len(size)}")
    at = values.reshape(-1, len(size)) - 1
    if at.min() < 0 or np.any(at >= size):
        raise MeshFileError(f"it lists points that are not among the {' x '.join(map(str, size))}")
    return at


def _in_zone(values: IntArray, size: Size) -> IntArray:
    if len(values) and (values.min() < 1 or values.max() > size[0]):
        raise MeshFileError(f"it lists points that are not among the {size[0]}")
    return values - 1


def _two(values: IntArray) -> tuple[int, int]:
    if len(values) != 2:
        raise MeshFileError(f"its range has {len(values)} numbers, expected 2")
    return int(values[0]), int(values[1])


def _nodes_of_faces(values: IntArray, faces: Sequence[NumberedFaces]) -> Iterator[IntArray]:
    """Nodes of the faces with these numbers."""
    for part in faces:
        rows, there = places(values, part.numbers)
        if isinstance(part.faces, Cells):
            yield part.faces.nodes[rows[there]].ravel()
        else:
            offsets = part.faces.offsets
            listed = np.zeros(len(part.faces), dtype=np.bool_)
            listed[rows[there]] = True
            yield part.faces.nodes[np.repeat(listed, np.diff(offsets))]


def _corners(parts: Iterator[IntArray] | Sequence[IntArray]) -> IntArray:
    return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *parts]))

"""Mirrored surfaces: the mesh in one box as the reflection, in the plane y = 0, of the mesh in another."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.box.automatic import Given
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.meshing.mesh.edges import polygons_of
from sdm_deflect.meshing.mesh.mesh import Mesh, Warned
from sdm_deflect.meshing.mesh.sliding import Triangulated

from .job import Job

# Reflects a point, or a displacement, in the plane y = 0.
FLIP = np.array([1.0, -1.0, 1.0])
# Share of a surface's size within which two meshes of one shape differ: by rounding, and by how faces cut curves.
ALIKE = 1e-3
# Corners of a reflected hexahedron in the order of `Hexahedron`.
SWAPPED = [2, 3, 0, 1, 6, 7, 4, 5]


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """Nodes that are mirror images to the bit.

    Attributes
    ----------
    nodes, images : (M,) nodes of a mirrored box, and their images in the other box.
    """

    nodes: IntArray = field(repr=False)
    images: IntArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, nodes: IntArray, others: IntArray) -> "Mirror | None":
        """Pair the nodes (M,) that may move in two boxes; None if they are not images to the bit."""
        distance, row = cKDTree(mesh.points[others]).query(mesh.points[nodes] * FLIP)
        paired = len(nodes) == len(others) == len(np.unique(row)) and not distance.any()
        return cls(nodes, others[row]) if paired else None

    def reflect(self, values: FloatArray, start: FloatArray) -> FloatArray:
        """Return `start` (N, 3) with the values (N, 3) at the images reflected to the nodes."""
        out = start.copy()
        out[self.nodes] = values[self.images] * FLIP
        return out


def reflection_note(mesh: Mesh, patches: Sequence[str], others: Sequence[str]) -> str:
    """Say how far patches are from the reflection of others, as a warning if that is more than rounding and meshing."""
    faces, name = mesh.faces_of(others), ", ".join(patches)
    places = mesh.points[mesh.on(*patches)] * FLIP
    if not faces:
        return f"{name} is fitted by itself: the mesh is not its own mirror image to the bit"
    far = float(Triangulated.of(mesh.points, polygons_of(faces)).distance(places).max())
    text = f"its nodes are up to {far:.2g} from the reflection of {', '.join(others)}"
    if far > ALIKE * float(np.ptp(places, axis=0).max()):
        return Warned(f"{name}: {text}: is it the right patch?")
    return f"{name} is fitted by itself: {text}"


def with_box_of(job: Job, box: Hexahedron) -> Job:
    """Return a mirrored job with the reflection of the other job's box; InputError if that crosses y = 0."""
    y = box.corners[:, 1]
    if y.min() < 0.0 < y.max():
        raise InputError("mirror: the box crosses the plane y = 0, so it holds both surfaces; give a smaller margin")
    return replace(job, box=Given(Hexahedron((box.corners * FLIP)[SWAPPED])))

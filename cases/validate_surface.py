"""Checks of one deflected control surface against the CAD whose surface was rotated rigidly, or blended."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.motion import FloatArray, IndexArray, Wedge
from sdm_deflect.cases.reference import Faces, Reference
from sdm_deflect.cases.tail import fuselage_cylinder, panel_of
from sdm_deflect.cases.turn import Turn
from sdm_deflect.cases.validation import Check, plane_deviation, plane_normal, worst
from sdm_deflect.deform.surface.axis import Axis
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.meshing.mesh import TetMesh

ANGLE_LIMIT = 1e-9
"""Largest deviation (deg) of the trailing edge from its angle: rounding only."""
ON_CYLINDER = 1e-12
"""Largest distance (m) of panel nodes from the cylinder: rounding only."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A deflected control surface: the mesh before and after, what was asked, and the axis."""

    case: Case
    mesh: TetMesh
    deflected: TetMesh
    turn: Turn
    axis: Axis

    @property
    def exact(self) -> IndexArray:
        """Nodes that must lie on the deflected CAD."""
        return self.turn.motion.nodes[self.turn.motion.exact]

    def faces(self, nodes: IndexArray) -> Iterator[tuple[IndexArray, FloatArray]]:
        """For each CAD face of the surface: its nodes among those given, and its undeflected unit normal (3,)."""
        own = self.mesh.patch == self.mesh.names.index(self.turn.surface)
        for face in np.unique(self.mesh.face[own]):
            on_face = np.unique(self.mesh.triangles[own & (self.mesh.face == face)])
            yield np.intersect1d(on_face, nodes), plane_normal(self.mesh.points[on_face])


def surface_checks(shape: Shape, reference: Reference) -> Iterator[Check]:
    """Checks of one control surface."""
    rigid, blended = (faces[shape.turn.surface] for faces in (reference.rigid, reference.blended))
    yield planarity(shape)
    if hinged(shape.turn.surface):
        yield surface_to_cad(shape, blended, shape.exact, shape.case.limits.surface_to_cad)
        yield trailing_edge_angle(shape)
        yield hinge_offset(shape, rigid)
    else:
        panel = shape.mesh.on(panel_of(shape.turn.surface))
        root = np.intersect1d(shape.exact, panel, assume_unique=True)
        rest = np.setdiff1d(shape.exact, root, assume_unique=True)
        yield surface_to_cad(shape, rigid, rest, shape.case.limits.surface_to_cad)
        yield cylindricity(shape, panel)
        yield root_on_cylinder(shape, rigid, root)


def surface_to_cad(shape: Shape, cad: Faces, nodes: IndexArray, limit: float) -> Check:
    """Distance of the moved nodes from the trimmed faces of the deflected CAD."""
    points = shape.deflected.points[nodes]
    distance = distance_to_faces(points, cad)
    return Check(
        "surface_to_cad", float(distance.max()), limit, "m", worst(distance, points), nodes=nodes, distances=distance
    )


def planarity(shape: Shape) -> Check:
    """Distance of each planar face's nodes from their own best plane (three nodes always have one)."""
    faces = [nodes for nodes, _ in shape.faces(shape.exact) if len(nodes) > 3]
    off = np.concatenate([plane_deviation(shape.deflected.points[nodes]) for nodes in faces])
    points = shape.deflected.points[np.concatenate(faces)]
    return Check("planarity", float(off.max()), shape.case.limits.planarity, "m", worst(off, points))


def trailing_edge_angle(shape: Shape) -> Check:
    """How far the trailing edge is from having turned by exactly the angle, in degrees."""
    wedge = Wedge.of(shape.mesh, shape.case.fighter, shape.turn.surface)
    nodes = wedge.nodes[wedge.trailing & ~wedge.fixed & shape.turn.motion.exact]
    before, after = (shape.axis.radial(mesh.points[nodes]) for mesh in (shape.mesh, shape.deflected))
    sine, cosine = np.cross(before, after) @ shape.axis.direction, np.einsum("ij,ij->i", before, after)
    error = np.abs(np.degrees(np.arctan2(sine, cosine)) - shape.turn.angle)
    where = f"{len(nodes)} nodes, asked {shape.turn.angle:g} deg"
    return Check("trailing_edge_angle", float(error.max()), ANGLE_LIMIT, "deg", where)


def hinge_offset(shape: Shape, rigid: Faces) -> Check:
    """Blended and rigid wedge differ at the hinge by a known amount: check that it is exactly that.

    The blended surface keeps its hinge edges; in a rigid rotation by theta they go half thickness x sin theta
    fore or aft and half thickness x (1 - cos theta) up or down. A fixed hinge node P on a face with unit normal
    n is therefore |(P - R P) . R n| from the plane of the rotated face: that is compared with the CAD.
    """
    wedge = Wedge.of(shape.mesh, shape.case.fighter, shape.turn.surface)
    hinge = wedge.nodes[wedge.hinge & shape.turn.motion.exact]
    rotation, off, largest = shape.axis.matrix(shape.turn.angle), [np.zeros(1)], 0.0
    for nodes, normal in shape.faces(hinge):
        if abs(normal @ shape.axis.direction) > 0.5:  # an end of the wedge
            continue
        before = shape.mesh.points[nodes]
        expected = np.abs((before - shape.axis.rotated(before, shape.turn.angle)) @ (rotation @ normal))
        away = distance_to_plane(shape.deflected.points[nodes], rigid, rotation @ normal)
        off.append(np.abs(away - expected))
        largest = max(largest, float(expected.max()))
    half = float(np.linalg.norm(shape.axis.radial(shape.mesh.points[hinge]), axis=1).max())
    shift = 1e3 * half * abs(np.sin(np.radians(shape.turn.angle)))
    where = f"{len(hinge)} nodes; rigid CAD up to {1e3 * largest:.3f} mm away, half thickness x sin = {shift:.3f} mm"
    return Check("hinge_offset", float(np.concatenate(off).max()), shape.case.limits.planarity, "m", where)


def cylindricity(shape: Shape, panel: IndexArray) -> Check:
    """Distance of the panel's nodes from the fuselage cylinder."""
    points = shape.deflected.points[panel]
    off = np.abs(fuselage_cylinder(shape.case.fighter).distance(points))
    return Check("cylindricity", float(off.max()), ON_CYLINDER, "m", worst(off, points))


def root_on_cylinder(shape: Shape, rigid: Faces, root: IndexArray) -> Check:
    """Distance of the root line's nodes from the cylinder and from each rotated plane of the tail they are on."""
    points = shape.deflected.points[root]
    off = np.abs(fuselage_cylinder(shape.case.fighter).distance(points))
    rotation = shape.axis.matrix(shape.turn.angle)
    for nodes, normal in shape.faces(root):
        if len(nodes):
            place = np.searchsorted(root, nodes)
            away = distance_to_plane(shape.deflected.points[nodes], rigid, rotation @ normal)
            off[place] = np.maximum(off[place], away)
    limit = shape.case.limits.planarity
    return Check("root_on_cylinder", float(off.max()), limit, "m", worst(off, points), nodes=root, distances=off)


def distance_to_faces(points: FloatArray, faces: Faces) -> FloatArray:
    """Distance (N,) of points (N, 3) from trimmed CAD faces, exact on planes."""
    parts = [trimesh.Trimesh(face.points, face.triangles, process=False) for face in faces]
    _, distance, _ = trimesh.proximity.closest_point(trimesh.util.concatenate(parts), points)
    return np.asarray(distance, dtype=np.float64)


def distance_to_plane(points: FloatArray, faces: Faces, normal: FloatArray) -> FloatArray:
    """Distance (N,) of points (N, 3) from the plane of that face which looks along `normal` (3,)."""
    planes = [face for face in faces if np.isfinite(face.normal).all()]
    face = max(planes, key=lambda one: abs(float(one.normal @ normal)))
    return np.asarray(np.abs((points - face.points[0]) @ face.normal), dtype=np.float64)

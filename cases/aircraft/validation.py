"""Checks of a deflected mesh, among them the distance from CAD whose surfaces were rotated rigidly."""

from collections.abc import Iterator, Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct, union
from sdm_deflect.deform.checks import Check, slid_nodes, with_surface, worst
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.meshing.generate.attachment import boundary_failures
from sdm_deflect.meshing.generate.parameters import FAR_FIELD, MeshParameters
from sdm_deflect.meshing.generate.verify import verify
from sdm_deflect.meshing.mesh.labelled import FREE_FORM, nodes_by_face, skin, tets_of, triangles_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import mean_ratio

from .case import Case
from .job import Wedge, fuselage_cylinder, panel_of
from .overset import overset_checks
from .reference import Faces, Reference
from .rigid import Shape, closest, corners_of, distance, plane_normal, prediction, rigid_checks

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel

# Largest distance (m) of nodes that slid on a planar CAD face from it.
ON_PLANE = 1e-9
# Largest deviation (deg) of the trailing edge from its angle: rounding only.
ANGLE_LIMIT = 1e-9
# Largest distance (m) of panel nodes from the cylinder: rounding only.
ON_CYLINDER = 1e-12


def validate(
    case: Case,
    deflection: Deflection,
    mesh_checks: Sequence[Check],
    reference: Reference | None,
    background: Mesh | None = None,
) -> tuple[Check, ...]:
    """Return every check that applies to the case.

    Parameters
    ----------
    deflection : every control surface at its angle.
    mesh_checks : the result of `checks_of`.
    reference : the deflected CAD; without it the checks that need it are left out.
    background : the mesh around a Chimera block.
    """
    mesh, repair = deflection.plan.mesh, deflection.moved_by_repair
    deflected, slid = mesh.with_points(deflection.points), slid_nodes(deflection)
    checks = [fixed_moved(deflection), whole_quality(case, deflected)]
    if repair is not None:
        free = union(*(repair.freedom.nodes for repair in deflection.repairs))
        still = np.setdiff1d(np.arange(len(repair)), free, assume_unique=True)
        checks.append(check_unmoved("repair_elsewhere", repair, still, mesh.points))
    if len(slid) and reference:
        checks.append(slid_on_surfaces(mesh, deflected, slid, reference))
    if reference:
        for box in deflection.plan.boxes:
            shape = Shape(case, mesh, deflected, box, repair)
            checks += with_surface(surface_checks(shape, reference), box, deflection.plan)
    if background is not None:
        checks += overset_checks(case, mesh, deflected, background)
    names = {check.name for check in checks}
    return (*(check for check in mesh_checks if check.name not in names), *checks)


def fixed_moved(deflection: Deflection) -> Check:
    """Check that the fixed nodes of moving patches stayed, such as the border of a panel."""
    fixed, sliding = [], union(*(repair.freedom.sliding for repair in deflection.repairs))
    for box in deflection.boxes:
        boundary = box.plan.boundary
        fixed.append(boundary.nodes[~boundary.displacement(box.amounts).any(axis=1)])
    nodes = np.setdiff1d(union(*fixed), sliding, assume_unique=True)
    return check_unmoved("held_moved", deflection.points - deflection.plan.mesh.points, nodes, deflection.points)


def check_unmoved(name: str, moved: FloatArray, nodes: IntArray, points: FloatArray) -> Check:
    """Check that these nodes (K,) did not move (N, 3) by a single bit."""
    distance = np.linalg.norm(moved[nodes], axis=1)
    return Check(name, float(distance.max(initial=0.0)), 0.0, "m", worst(distance, points[nodes]), over=len(nodes))


def whole_quality(case: Case, deflected: Mesh) -> Check:
    """Check the worst cell of the whole mesh."""
    quality = mean_ratio(deflected.points, tets_of(deflected))
    x, y, z = deflected.points[tets_of(deflected)[quality.argmin()]].mean(axis=0)
    where = f"mean ratio, worst cell at ({x:.4f}, {y:.4f}, {z:.4f})"
    return Check("quality_min", float(quality.min()), case.limits.quality_min, "-", where, "at least")


def slid_on_surfaces(mesh: Mesh, deflected: Mesh, slid: IntArray, reference: Reference) -> Check:
    """Check the distance of nodes (K,) of fixed patches, which a repair slid, from their undeflected CAD faces."""
    off, limit = np.zeros(len(slid)), ON_PLANE
    for name, faces in reference.still.items():
        for on_face in nodes_by_face(mesh, name):
            nodes = np.intersect1d(on_face, slid, assume_unique=True)
            if len(nodes):
                cad = min(faces, key=lambda face: float(distance(mesh.points[on_face], corners_of((face,))).max()))
                rows = np.searchsorted(slid, nodes)
                off[rows] = np.maximum(off[rows], distance(deflected.points[nodes], corners_of((cad,))))
                limit = limit if np.isfinite(cad.normal).all() else FREE_FORM
    off[~np.isin(slid, mesh.on(*reference.still), assume_unique=True)] = np.inf
    return Check("slid_on_surfaces", float(off.max()), limit, "m", worst(off, deflected.points[slid]))


def surface_checks(shape: Shape, reference: Reference) -> Iterator[Check]:
    """Return the checks of one control surface."""
    rigid, cad = shape.rigid(reference.undeflected[shape.surface]), reference.deflected[shape.surface]
    if shape.repair is not None:
        yield kept_shape(shape, shape.repair)
    yield planarity(shape)
    yield from surface_to_cad(shape, cad)
    yield from rigid_checks(shape, rigid)
    if shape.law != "rooted":
        yield trailing_edge_angle(shape)
    if shape.law == "blended":
        yield hinge_offset(shape, rigid)
    if shape.law == "rooted":
        panel = shape.mesh.on(panel_of(shape.surface))
        yield cylindricity(shape, panel)
        yield root_on_cylinder(shape, rigid, np.intersect1d(shape.exact, panel, assume_unique=True))


def kept_shape(shape: Shape, repair: FloatArray) -> Check:
    """Check the distance of nodes that a repair slid from the control surface's triangles before it."""
    nodes = shape.mesh.on(shape.surface)
    nodes = nodes[repair[nodes].any(axis=1)]
    points, triangles = shape.deflected.points, triangles_of(shape.mesh, shape.surface)
    off = closest(points[nodes], points - repair, triangles)[0]
    return Check("surface_kept", float(off.max(initial=0.0)), ON_PLANE, "m", worst(off, points[nodes]), over=len(nodes))


def surface_to_cad(shape: Shape, cad: Faces) -> Iterator[Check]:
    """Check the distance of all nodes from the deflected CAD, and of those that must lie on it to rounding.

    Beside a closed rib the CAD's faces are ruled and the mesh is blended: there the limit follows from the predicted
    places. A tail's root line is on a curved edge.
    """
    nodes, exact, corners = shape.nodes, shape.exact, corners_of(cad)
    if shape.law == "rooted":
        exact = np.setdiff1d(exact, shape.mesh.on(panel_of(shape.surface)), assume_unique=True)
    rows, points = np.isin(nodes, exact, assume_unique=True), shape.deflected.points[nodes]
    away, limit = distance(points, corners), shape.case.limits.surface_to_cad
    largest = limit + float(distance(prediction(shape)[0], corners).max())
    yield Check("surface_to_cad", float(away.max()), largest, "m", worst(away, points), nodes=nodes, distances=away)
    yield Check("exact_to_cad", float(away[rows].max()), limit, "m", worst(away[rows], points[rows]))


def planarity(shape: Shape) -> Check:
    """Check the distance of each planar face's nodes from their least-squares plane."""
    faces = [nodes for nodes, _ in shape.faces(shape.exact) if len(nodes) > 3]
    off = np.concatenate([plane_deviation(shape.deflected.points[nodes]) for nodes in faces])
    points = shape.deflected.points[np.concatenate(faces)]
    return Check("planarity", float(off.max()), shape.case.limits.planarity, "m", worst(off, points))


def trailing_edge_angle(shape: Shape) -> Check:
    """Check the largest deviation of the trailing edge from its angle, in degrees."""
    wedge = Wedge.of(shape.plan.mesh, shape.case.fighter, shape.surface)
    nodes = np.intersect1d(wedge.nodes[wedge.trailing & ~wedge.fixed], shape.exact, assume_unique=True)
    before, after = (shape.axis.radial(mesh.points[nodes]) for mesh in (shape.mesh, shape.deflected))
    sine, cosine = np.cross(before, after) @ shape.axis.direction, np.einsum("ij,ij->i", before, after)
    error = np.abs(np.degrees(np.arctan2(sine, cosine)) - shape.angle)
    where = f"{len(nodes)} nodes, asked {shape.angle:g} deg"
    return Check("trailing_edge_angle", float(error.max()), ANGLE_LIMIT, "deg", where)


def hinge_offset(shape: Shape, rigid: Faces) -> Check:
    """Check that blended and rigid wedge differ at the hinge by exactly the known amount.

    A hinge node P stays where the rigid wedge's turns to R P. Its distance from the plane of the rotated face, of
    normal R n, is therefore |(P - R P) . R n|: that is compared with the CAD.
    """
    hinge = np.intersect1d(shape.hinge, shape.exact, assume_unique=True)
    off, largest = [np.zeros(1)], 0.0
    for nodes, normal in shape.sides(hinge):
        expected = shape.left_behind(nodes, normal)
        away = distance_to_plane(shape.deflected.points[nodes], rigid, normal)
        off.append(np.abs(away - expected))
        largest = max(largest, float(expected.max()))
    half = float(np.linalg.norm(shape.axis.radial(shape.mesh.points[hinge]), axis=1).max())
    shift = 1e3 * half * abs(np.sin(np.radians(shape.angle)))
    where = (
        f"{len(hinge)} nodes; a rigid turn would move the hinge edges {shift:.3f} mm fore or aft, "
        f"which is {1e3 * largest:.3f} mm measured across the tilted faces"
    )
    return Check("hinge_offset", float(np.concatenate(off).max()), shape.case.limits.planarity, "m", where)


def cylindricity(shape: Shape, panel: IntArray) -> Check:
    """Check the distance of the panel's nodes from the fuselage cylinder."""
    points = shape.deflected.points[panel]
    off = np.abs(fuselage_cylinder(shape.case.fighter).distance(points))
    return Check("cylindricity", float(off.max()), ON_CYLINDER, "m", worst(off, points))


def root_on_cylinder(shape: Shape, rigid: Faces, root: IntArray) -> Check:
    """Check the distance of the root line's nodes from the cylinder and from their rotated planes of the tail."""
    points = shape.deflected.points[root]
    off = np.abs(fuselage_cylinder(shape.case.fighter).distance(points))
    rotation = shape.axis.matrix(shape.angle)
    for nodes, normal in shape.faces(root):
        if len(nodes):
            place = np.searchsorted(root, nodes)
            away = distance_to_plane(shape.deflected.points[nodes], rigid, rotation @ normal)
            off[place] = np.maximum(off[place], away)
    limit = shape.case.limits.planarity
    return Check("root_on_cylinder", float(off.max()), limit, "m", worst(off, points), nodes=root, distances=off)


def distance_to_plane(points: FloatArray, faces: Faces, normal: FloatArray) -> FloatArray:
    """Return the distance (N,) of points (N, 3) from the plane of the face with outward `normal` (3,)."""
    planes = [face for face in faces if np.isfinite(face.normal).all()]
    face = max(planes, key=lambda plane: abs(float(plane.normal @ normal)))
    return np.asarray(np.abs((points - face.points[0]) @ face.normal), dtype=np.float64)


def plane_deviation(points: FloatArray) -> FloatArray:
    """Return the distance (N,) of points (N, 3) from their least-squares plane."""
    return np.asarray(np.abs((points - points.mean(axis=0)) @ plane_normal(points)), dtype=np.float64)


def mesh_check(name: str, mesh: Mesh, model: "CadModel", parameters: MeshParameters) -> Check:
    """Check that a mesh fills the flow domain without gap and overlap, with its boundary on the CAD.

    Its value is the largest distance (m) of a boundary node from the CAD, infinite if anything else is wrong.
    """
    faults = mesh_faults(mesh, model)
    if not faults:
        measured = verify(mesh, model, parameters)
        if not measured.failures:
            return Check(name, measured.boundary_to_cad_max, FREE_FORM, "m", "filled, closed, on the CAD")
        faults = list(measured.failures)
    return Check(name, inf, FREE_FORM, "m", "; ".join(faults[:3]))


def mesh_faults(mesh: Mesh, model: "CadModel") -> list[str]:
    """Return a sentence for each fault of a mesh's patches and topology."""
    names = (*model.patches, *(() if model.fluid_inside else (FAR_FIELD,)))
    if mesh.names != names:
        return [f"the patches are {', '.join(mesh.names)}, those of the CAD {', '.join(names)}"]
    boundary = skin(mesh)
    patch_of_face = np.array([*(names.index(face.patch) for face in model.faces), len(names) - 1])
    if boundary.face.max(initial=-1) >= len(model.faces) or (patch_of_face[boundary.face] != boundary.patch).any():
        return ["triangles are on another patch than their CAD face"]
    unused = len(mesh.points) - len(distinct(tets_of(mesh)))
    return [f"{unused} nodes belong to no cell"] if unused else boundary_failures(mesh)

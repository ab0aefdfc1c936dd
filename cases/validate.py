"""Measure a deflected mesh against what it should be, and against the deflected CAD."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import trimesh

from cases.cad import deflected_cad
from cases.case import Case
from cases.deflect import Deflected
from cases.motion import FloatArray, IndexArray, Wedge, axis_of
from cases.validation import Check, plane_deviation, worst
from geometry.model import CadModel
from meshing.mesh import TetMesh
from meshing.quality import mean_ratio, signed_volumes

ANGLE_LIMIT = 1e-9
"""Largest deviation (deg) of the trailing edge from its angle: rounding only."""


def validate(case: Case, mesh: TetMesh, deflected: TetMesh, results: tuple[Deflected, ...]) -> tuple[Check, ...]:
    """Return every check that applies to the case."""
    checks = list(mesh_checks(case, mesh, deflected, results))
    blended = deflected_cad(case, "blended")
    for result in results:
        suffix = f":{result.region.surface}" if len(results) > 1 else ""
        for check in surface_checks(case, mesh, deflected, result, blended):
            checks.append(replace(check, name=check.name + suffix))
    return tuple(checks)


def mesh_checks(
    case: Case, mesh: TetMesh, deflected: TetMesh, results: tuple[Deflected, ...]
) -> Iterator[Check]:
    """Checks of the whole mesh: nothing outside or on a fixed patch moved, no cell inverted, good shape."""
    moved = np.linalg.norm(deflected.points - mesh.points, axis=1)
    outside = np.ones(len(moved), dtype=bool)
    for result in results:
        outside[result.region.inside] = False
    yield Check("outside_moved", float(moved[outside].max()), 0.0, "m", worst(moved[outside], mesh.points[outside]))
    volumes = signed_volumes(deflected.points, deflected.tets)
    inverted = np.count_nonzero(volumes <= 0.0)
    yield Check("inverted_cells", float(inverted), 0.0, "cells", f"of {len(volumes)}")
    moving = [patch for result in results for patch in result.motion.patches]
    fixed = mesh.on(*(name for name in mesh.names[1:] if name not in moving))
    text = worst(moved[fixed], mesh.points[fixed])
    yield Check("fixed_surfaces_moved", float(moved[fixed].max()), 0.0, "m", text)
    quality = mean_ratio(deflected.points, deflected.tets)
    x, y, z = deflected.points[deflected.tets[quality.argmin()]].mean(axis=0)
    where = f"mean ratio, worst cell at ({x:.4f}, {y:.4f}, {z:.4f})"
    yield Check("quality_min", float(quality.min()), case.limits.quality_min, "-", where, "at least")


def surface_checks(
    case: Case, mesh: TetMesh, deflected: TetMesh, result: Deflected, cad: CadModel
) -> Iterator[Check]:
    """Checks of one control surface against its CAD."""
    patch, motion, limits = result.region.surface, result.motion, case.limits
    nodes = motion.nodes[motion.exact]
    points = deflected.points[nodes]
    distance = distance_to_patch(points, cad, patch)
    yield Check("surface_to_cad", float(distance.max()), limits.surface_to_cad, "m", worst(distance, points))
    bend = np.concatenate([plane_deviation(deflected.points[face]) for face in planar_faces(mesh, patch, nodes)])
    yield Check("planarity", float(bend.max()), limits.planarity, "m", f"{len(bend)} nodes of planar faces")
    yield trailing_edge_check(case, mesh, deflected, result)


def trailing_edge_check(case: Case, mesh: TetMesh, deflected: TetMesh, result: Deflected) -> Check:
    """How far the trailing edge is from having turned by exactly the angle, in degrees."""
    wedge = Wedge.of(mesh, case.fighter, result.region.surface)
    nodes = wedge.nodes[wedge.trailing & ~wedge.fixed & result.motion.exact]
    axis = axis_of(case.fighter, result.region.surface)
    before, after = axis.radial(mesh.points[nodes]), axis.radial(deflected.points[nodes])
    sine, cosine = np.cross(before, after) @ axis.direction, np.einsum("ij,ij->i", before, after)
    error = np.abs(np.degrees(np.arctan2(sine, cosine)) - result.angle)
    return Check(
        "trailing_edge_angle", float(error.max()), ANGLE_LIMIT, "deg", f"{len(nodes)} nodes, asked {result.angle:g} deg"
    )


def planar_faces(mesh: TetMesh, patch: str, nodes: IndexArray) -> Iterator[IndexArray]:
    """Nodes of each CAD face of a patch, of those given; faces with fewer than four tell nothing."""
    own = mesh.patch == mesh.names.index(patch)
    for face in np.unique(mesh.face[own]):
        on_face = np.intersect1d(mesh.triangles[own & (mesh.face == face)], nodes)
        if len(on_face) >= 4:
            yield on_face


def distance_to_patch(points: FloatArray, cad: CadModel, patch: str) -> FloatArray:
    """Distance (N,) of points (N, 3) from the trimmed CAD faces of a patch, exact on planes."""
    parts = [face.tessellation() for face in cad.faces_of(patch)]
    surface = trimesh.util.concatenate([trimesh.Trimesh(v, f, process=False) for v, f in parts])
    _, distance, _ = trimesh.proximity.closest_point(surface, points)
    return np.asarray(distance, dtype=np.float64)

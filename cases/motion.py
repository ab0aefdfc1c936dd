"""Where the nodes of a deflecting surface go (appendix A)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.case import Case
from sdm_deflect.deform.rbf.kernels import Multiquadric
from sdm_deflect.deform.surface.appendix import blend, blend_strip
from sdm_deflect.deform.surface.axis import Axis
from sdm_deflect.geometry import datum
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.mesh import TetMesh

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

ON_LINE = 1e-6
"""Nodes within this distance (m) of a datum line are on it: boundary nodes lie on the CAD to 1e-7 m."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMotion:
    """Prescribed displacements of the surface mesh.

    Attributes
    ----------
    nodes : (K,) indices into the mesh's points, ascending; every node that the surface motion decides.
    displacements : (K, 3), metres.
    exact : (K,) True where the node must lie on the deflected CAD (outside blended strips).
    patches : names of the patches whose nodes may move.
    """

    nodes: IndexArray
    displacements: FloatArray
    exact: BoolArray
    patches: tuple[str, ...]


def axis_of(fighter: Fighter, surface: str) -> Axis:
    """Return the axis of rotation of a control surface."""
    start, end = datum.hinge_line(fighter, surface)
    return Axis.through(start, end)


def wedge_motion(case: Case, mesh: TetMesh, surface: str, angle: float) -> SurfaceMotion:
    """Aileron or rudder: hinge edges fixed, trailing edge rotated, multiquadric in between.

    Nodes shared with another patch stay: the hinge edges, and the rib where no gap separates the surface
    from its parent. Beside such a closed rib a strip is blended spanwise; beyond it the faces stay planar.
    """
    wedge, blending = Wedge.of(mesh, case.fighter, surface), case.blending
    points, kernel = wedge.points, Multiquadric(blending.epsilon)
    turned = axis_of(case.fighter, surface).displacement(points[wedge.trailing], angle)
    moved = blend(points, points[wedge.hinge], points[wedge.trailing], turned, kernel)
    moved[wedge.trailing] = turned
    strip = wedge.distance_to_closed_rib < blending.strip
    if strip.any():
        moved = blend_strip(points, strip, moved, points[wedge.fixed], kernel)
    moved[wedge.fixed] = 0.0
    return SurfaceMotion(wedge.nodes, moved, ~strip, (surface,))


@dataclass(frozen=True, slots=True, eq=False)
class Wedge:
    """The nodes of a hinged trailing-edge wedge, found by topology and by its datum lines.

    Attributes
    ----------
    nodes : (K,) node indices of the patch.
    points : (K, 3) their undeflected coordinates.
    fixed, hinge, trailing : (K,) masks: shared with another patch; on the hinge edges; on the trailing edge.
    distance_to_closed_rib : (K,) spanwise distance to the nearest rib without a gap; inf if there is none.
    """

    nodes: IndexArray
    points: FloatArray
    fixed: BoolArray
    hinge: BoolArray
    trailing: BoolArray
    distance_to_closed_rib: FloatArray

    @classmethod
    def of(cls, mesh: TetMesh, fighter: Fighter, surface: str) -> "Wedge":
        """Sort the nodes of a patch; ValueError if the mesh has none of that name."""
        nodes = mesh.on(surface)
        points = mesh.points[nodes]
        others = [name for name in mesh.names[1:] if name != surface]
        fixed = np.isin(nodes, mesh.on(*others), assume_unique=True)
        upper, lower = datum.hinge_edges(fighter, surface)
        hinge = (distance_to_line(points, upper) < ON_LINE) | (distance_to_line(points, lower) < ON_LINE)
        trailing = distance_to_line(points, datum.trailing_edge(fighter, surface)) < ON_LINE
        span = points[:, 2 if surface == "rudder" else 1]
        ribs = span[fixed & ~hinge & ~between_hinge_edges(points, upper, lower)]
        gap = np.abs(span[:, None] - ribs).min(axis=1) if len(ribs) else np.full(len(nodes), np.inf)
        return cls(nodes, points, fixed, hinge, trailing, gap)


def distance_to_line(points: FloatArray, line: FloatArray) -> FloatArray:
    """Distance of points (N, 3) from the infinite line through line (2, 3)."""
    direction = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    offset = points - line[0]
    away: Any = offset - np.outer(offset @ direction, direction)
    return np.asarray(np.linalg.norm(away, axis=1), dtype=np.float64)


def between_hinge_edges(points: FloatArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
    """True for points (N, 3) in the plane of the two hinge edges (the hinge wall)."""
    normal = np.cross(upper[1] - upper[0], lower[0] - upper[0])
    normal /= np.linalg.norm(normal)
    return np.asarray(np.abs((points - upper[0]) @ normal) < ON_LINE)

"""A moved surface beside its undeflected CAD faces that were turned rigidly: every node, by parts, and as predicted.

Where the surface differs from a rigid turn is known before it moves. A hinged one keeps its hinge edges: behind them
the displacement is affine, in closed form. Beside a closed rib the angle falls to zero, and the root of a tail is
extended to the fuselage: there the law of appendix A is solved again by SciPy.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import trimesh
from scipy.interpolate import RBFInterpolator

from sdm_deflect.cases.aircraft.case import Case
from sdm_deflect.cases.aircraft.job import Wedge, apex_of, axis_of, fuselage_cylinder, panel_of
from sdm_deflect.cases.aircraft.reference import Faces
from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.points import farthest
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.deform.mesh.closest import Triangles
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.surface.appendix_a import STRIP_SITES
from sdm_deflect.deform.surface.tail_root import RootRegion
from sdm_deflect.geometry import datum
from sdm_deflect.meshing.mesh import triangles_of

PREDICTED = 1e-9
"""Largest difference (m) of a measured distance from the predicted one."""
ROUNDING = 1e-12
"""Distances (m) up to this are rounding."""
SCALE = 1e6
"""Of lengths for trimesh, which takes squared distances within 1e-8 for equal: 0.03 mm in metres, nothing so."""
SAMPLES = 60
"""Points on the CAD faces from which the way back to the mesh is measured: about half the square of this number."""
WORDS = {
    "strip": "beside the closed rib, where the angle falls to zero",
    "hinge_edges": "at the hinge edges, which stay",
    "faces": "on the faces behind, falling to zero aft",
    "trailing_edge": "at the trailing edge",
    "root": "at the root, which was extended to the fuselage",
    "beyond_root": "beyond the root",
    "cad_to_surface": "from the CAD back to the surface",
}
"""The parts of a surface, and how each differs from a rigid turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """A control surface of a case that turned by an angle (deg).

    Attributes
    ----------
    before, after : the mesh.
    slid : (N,) nodes that a repair slid on the surface; None without a repair.
    """

    case: Case
    surface: str
    angle: float
    before: Mesh = field(repr=False)
    after: Mesh = field(repr=False)
    slid: BoolArray | None = field(repr=False)

    @property
    def nodes(self) -> IntArray:
        """Nodes (K,) of the surface."""
        return self.before.patch(self.surface).nodes

    @property
    def triangles(self) -> IntArray:
        """Triangles (T, 3) of the surface, as rows of its nodes."""
        return np.searchsorted(self.nodes, triangles_of(self.before, self.surface))


def rigid_checks(moved: Moved, rigid: Faces) -> Iterator[Check]:
    """Yield the distance from rigid CAD, over all nodes and back, and how far it is from what is predicted."""
    nodes, triangles, corners = moved.nodes, moved.triangles, corners_of(rigid)
    points, samples, (places, parts) = moved.after.points[nodes], lattice(corners), predicted(moved)
    there, back = distance(points, corners), distance(samples.points, points[triangles])
    shares, expected = nodal_areas(points, triangles), _closest(places, corners)
    figures = {name: _figures(there[rows], expected[rows], shares[rows]) for name, rows in parts.items() if rows.any()}
    figures["cad_to_surface"] = _figures(back, _closest(samples.points, places[triangles]), samples.weights)
    largest, asked, off = (max(one[key] for one in figures.values()) for key in ("largest", "predicted", "off"))
    where = f"{sentence(moved.surface, figures)}; {worst(there, points)}"
    yield Check("surface_to_rigid_cad", largest, asked + PREDICTED, "m", where, nodes=nodes, distances=there)
    where = f"{len(nodes)} nodes in {len(figures) - 1} parts, and {len(back)} points of the CAD"
    yield Check("rigid_cad_predicted", off, PREDICTED, "m", where, figures=figures)


def sentence(surface: str, figures: Mapping[str, Mapping[str, float]]) -> str:
    """Say how far a surface is from CAD that turned rigidly, part by part, and how well that was predicted."""
    off = [f"{1e3 * one['largest']:.3g} mm {WORDS[part]}" for part, one in figures.items() if one["largest"] > ROUNDING]
    on = [f"none {WORDS[part]}" for part, one in figures.items() if one["largest"] <= ROUNDING]
    error = max(one["off"] for one in figures.values())
    return f"{surface} against CAD turned rigidly: {', '.join(off + on)}; as predicted to {error:.0e} m"


def _figures(measured: FloatArray, predicted: FloatArray, weights: FloatArray) -> dict[str, float]:
    """Return the largest, mean and rms of distances (K,) by area, what was predicted, and the largest difference."""
    share = weights / weights.sum()
    return {
        "points": len(measured),
        "largest": float(measured.max()),
        "mean": float(share @ measured),
        "rms": float(np.sqrt(share @ measured**2)),
        "predicted": float(predicted.max()),
        "off": float(np.abs(measured - predicted).max()),
    }


def parts_of(moved: Moved) -> dict[str, BoolArray]:
    """Return the parts (K,) of a surface's nodes, each in one: by topology and by the CAD's datum lines."""
    fighter, points = moved.case.fighter, moved.before.points[moved.nodes]
    if not datum.hinged(moved.surface):
        root = root_region(moved).inside
        return {"root": root, "beyond_root": ~root}
    wedge = Wedge.of(moved.before, fighter, moved.surface)
    station, ribs = points[:, 2 if moved.surface == "rudder" else 1], datum.ribs(fighter, moved.surface)
    strip = np.full(len(points), wedge.rib.any())
    strip &= np.any(np.abs(station[:, None] - ribs) < moved.case.blending.strip, axis=1)
    hinge, trailing = wedge.hinge & ~strip, wedge.trailing & ~strip
    return {"strip": strip, "hinge_edges": hinge, "faces": ~(strip | hinge | trailing), "trailing_edge": trailing}


def predicted(moved: Moved) -> tuple[FloatArray, dict[str, BoolArray]]:
    """Return where the nodes (K, 3) must be, and the parts (K,) that they are in.

    Nodes that a repair slid must be on the surface of the others. They belong to the first part if they came into it.
    """
    points, parts = moved.before.points[moved.nodes], parts_of(moved)
    expected = points + (blended(moved) if datum.hinged(moved.surface) else extended(moved))
    if moved.slid is not None and (slid := moved.slid[moved.nodes]).any():
        found = Triangles.of(expected[moved.triangles]).closest(moved.after.points[moved.nodes[slid]])
        first = next(iter(parts.values()))
        came = np.zeros(len(points), dtype=np.bool_)
        came[slid] = np.any(first[moved.triangles[found.rows]] & (found.weights > ROUNDING), axis=1)
        parts = {name: rows & ~came if k else rows | came for k, (name, rows) in enumerate(parts.items())}
        expected[slid] = found.places
    return expected, parts


def blended(moved: Moved) -> FloatArray:
    """Return the displacement (K, 3) of a hinged surface: affine behind the hinge plane, blended beside a rib."""
    points, fighter = moved.before.points[moved.nodes], moved.case.fighter
    (first, second), lower = datum.hinge_edges(fighter, moved.surface)
    normal, trailing = np.cross(second - first, lower[0] - first), datum.trailing_edge(fighter, moved.surface)[:1]
    turned = (axis_of(fighter, moved.surface).rotated(trailing, moved.angle) - trailing)[0]
    out = np.outer((points - first) @ normal / ((trailing[0] - first) @ normal), turned)
    held, strip = Wedge.of(moved.before, fighter, moved.surface).fixed, parts_of(moved)["strip"]
    if strip.any():
        rows = np.flatnonzero(~strip & ~held)
        known = np.concatenate([np.flatnonzero(held), rows[farthest(points[rows], STRIP_SITES)]])
        values = np.where(held[known, None], 0.0, out[known])
        out[strip] = _solved(points[known], values, moved.case.blending.epsilon, points[strip])
    out[held] = 0.0
    return out


def extended(moved: Moved) -> FloatArray:
    """Return the displacement (K, 3) of a tail: turned rigidly, its root stretched along rays to its apex."""
    case, points, region = moved.case, moved.before.points[moved.nodes], root_region(moved)
    axis, root = axis_of(case.fighter, moved.surface), root_of(moved)
    turned = axis.rotated(points, moved.angle)
    rays = axis.rotated(apex_of(datum.ends(case.fighter, moved.surface))[None], moved.angle) - turned
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    way = np.einsum(
        "ij,ij->i", fuselage_cylinder(case.fighter).projected_along(turned[root], rays[root]) - turned[root], rays[root]
    )
    low, high = turned[root].min(axis=0) - case.blending.root, turned[root].max(axis=0) + case.blending.root
    still = low + region.still * (high - low)
    sites, values = np.vstack([turned[root], still]), np.concatenate([way, np.zeros(len(still))])[:, None]
    inside = region.inside
    turned[inside] += _solved(sites, values, case.blending.epsilon, turned[inside]) * rays[inside]
    return turned - points


def root_of(moved: Moved) -> BoolArray:
    """Return which nodes (K,) of a tail are on the fuselage."""
    return np.isin(moved.nodes, moved.before.on(panel_of(moved.surface)), assume_unique=True)


def root_region(moved: Moved) -> RootRegion:
    """Return which nodes of a tail are extended."""
    turned = axis_of(moved.case.fighter, moved.surface).rotated(moved.before.points[moved.nodes], moved.angle)
    return RootRegion.of(turned, turned[root_of(moved)], moved.case.blending.root)


def _solved(sites: FloatArray, values: FloatArray, epsilon: float, points: FloatArray) -> FloatArray:
    """Interpolate values (S, k) at sites (S, 3) by SciPy's multiquadric with a linear polynomial."""
    solved = RBFInterpolator(sites, values, kernel="multiquadric", epsilon=epsilon, degree=1)
    return np.asarray(solved(points), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Points (S, 3) on triangles, and the areas (S,) that they stand for."""

    points: FloatArray
    weights: FloatArray


def lattice(corners: FloatArray) -> Samples:
    """Return points at fixed barycentric places of triangles (T, 3, 3): equally many for equal areas, corners too."""
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    points, weights = [], []
    for corner, area in zip(corners, areas, strict=True):
        n = int(np.ceil(SAMPLES * np.sqrt(area / areas.sum())))
        places = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)])
        inner = np.array([6.0, 3.0, 1.0])[(places == 0).sum(axis=1)]  # how many of the small triangles meet there
        points.append(places / n @ corner)
        weights.append(inner * area / (3.0 * n * n))
    return Samples(np.concatenate(points), np.concatenate(weights))


def nodal_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return a third of the area (K,) of the triangles (T, 3) around each of points (K, 3)."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(triangles.ravel(), np.repeat(areas, 3), len(points)).astype(np.float64)


def corners_of(faces: Faces) -> FloatArray:
    """Return the corners (T, 3, 3) of the triangles of CAD faces, exact on planes."""
    return np.concatenate([one.points[one.triangles] for one in faces])


def distance(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance (N,) of points (N, 3) from triangles (T, 3, 3); trimesh, which made neither, measures it."""
    rows = np.arange(3 * len(corners)).reshape(-1, 3)
    mesh = trimesh.Trimesh(SCALE * corners.reshape(-1, 3), rows, process=False)
    return np.asarray(trimesh.proximity.closest_point(mesh, SCALE * points)[1] / SCALE)


def _closest(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the distances (N,) of points (N, 3) from triangles (T, 3, 3), by our own tree."""
    return np.asarray(np.linalg.norm(points - Triangles.of(corners).closest(points).places, axis=1))

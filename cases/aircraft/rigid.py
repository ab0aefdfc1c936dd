"""Distance of a moved surface's nodes from its rigidly turned CAD faces, by parts, beside the predicted distance.

The difference from a rigid turn is known in advance. A hinged surface keeps its hinge edges; behind them the
displacement is affine, in closed form. Beside a closed rib the angle falls to zero, and the root of a tail is extended
to the fuselage: there SciPy solves the law of appendix A again.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RBFInterpolator

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, farthest
from sdm_deflect.deform.checks import Check, Judgement, worst
from sdm_deflect.deform.surface.appendix_a import STRIP_SITES
from sdm_deflect.deform.surface.tail_root import RootRegion
from sdm_deflect.deform.volume.plan import BoxPlan
from sdm_deflect.geometry import datum
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.closest import Triangles
from sdm_deflect.meshing.mesh.labelled import nodes_by_face, triangles_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case, Law
from .job import Wedge, apex_of, axis_of, fuselage_cylinder, panel_of
from .reference import Faces, ReferenceFace

# Largest difference (m) of a measured distance from the predicted one.
PREDICTED = 1e-9
# Distances (m) up to this are rounding.
ROUNDING = 1e-12
# Factor of lengths for trimesh, which confuses squared distances within 1e-8: 0.03 mm, if in metres.
SCALE = 1e6
# Points on the CAD faces from which the way back to the mesh is measured: about half the square of this number.
SAMPLES = 60
# The parts of a surface, and how each differs from a rigid turn.
WORDS = {
    "strip": "beside the closed rib, where the angle falls to zero",
    "hinge_edges": "at the hinge edges, which stay",
    "faces": "on the faces behind, falling to zero aft",
    "trailing_edge": "at the trailing edge",
    "whole": "over the whole surface",
    "node_by_node": "from node to node",
    "root": "at the root, which is extended to the fuselage",
    "beyond_root": "beyond the root",
    "cad_to_surface": "from the CAD back to the surface",
}


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A deflected control surface: mesh before and after, its job, and the repair's displacement (N, 3)."""

    case: Case
    mesh: Mesh
    deflected: Mesh
    plan: BoxPlan
    repair: FloatArray | None = None

    @property
    def surface(self) -> str:
        """Name of the control surface."""
        return self.plan.patches[0]

    @property
    def angle(self) -> float:
        """Its angle, degrees."""
        return self.plan.job.angle

    @property
    def law(self) -> Law:
        """How it moves."""
        return self.case.law(self.surface)

    @property
    def axis(self) -> Axis:
        """Its hinge."""
        return axis_of(self.case.fighter, self.surface)

    def rigid(self, faces: Faces) -> Faces:
        """Return undeflected CAD faces turned rigidly."""
        turn, matrix = self.axis.rotated, self.axis.matrix(self.angle)
        return tuple(
            ReferenceFace(turn(face.points, self.angle), face.triangles, matrix @ face.normal) for face in faces
        )

    @property
    def exact(self) -> IntArray:
        """Nodes that must lie on the deflected CAD; those that a repair slid only if now in triangles of others."""
        nodes, exact = self.plan.sites.moving, self.plan.boundary.laws[0].exact
        if self.repair is None:
            return nodes[exact]
        slid = np.any(self.repair[nodes] != 0.0, axis=1)
        triangles, start = self.triangles, self.deflected.points - self.repair
        inner = np.all(np.isin(triangles, nodes[exact]), axis=1)
        _, hit = closest(self.deflected.points[nodes[slid]], start, triangles)
        return np.union1d(nodes[exact & ~slid], nodes[slid][inner[hit]])

    @property
    def nodes(self) -> IntArray:
        """Its nodes (K,)."""
        return self.mesh.patch(self.surface).nodes

    @property
    def rows(self) -> IntArray:
        """Its triangles (T, 3), as rows of its nodes."""
        return np.searchsorted(self.nodes, triangles_of(self.mesh, self.surface))

    @property
    def triangles(self) -> IntArray:
        """Triangles (T, 3) of all patches that move."""
        return np.concatenate([triangles_of(self.mesh, name) for name in self.plan.patches])

    @property
    def hinge(self) -> IntArray:
        """Nodes on the hinge edges, which keep their place."""
        wedge = Wedge.of(self.plan.mesh, self.case.fighter, self.surface)
        return wedge.nodes[wedge.hinge]

    def faces(self, nodes: IntArray) -> Iterator[tuple[IntArray, FloatArray]]:
        """For each CAD face of the surface: its nodes among those given, and its undeflected unit normal (3,)."""
        for on_face in nodes_by_face(self.mesh, self.surface):
            yield np.intersect1d(on_face, nodes), plane_normal(self.mesh.points[on_face])

    def sides(self, nodes: IntArray) -> Iterator[tuple[IntArray, FloatArray]]:
        """For each side of a hinged surface: its nodes among those given, and its rigidly rotated unit normal (3,)."""
        for rows, normal in self.faces(nodes):
            if abs(normal @ self.axis.direction) <= 0.5:  # an end of the wedge turns in its plane
                yield rows, self.axis.matrix(self.angle) @ normal

    def left_behind(self, nodes: IntArray, normal: FloatArray) -> FloatArray:
        """Return the distance (N,) of unturned nodes from the rotated plane, of normal (3,), on which they were.

        A repair may have slid them along the hinge edge; their present places count.
        """
        now = self.deflected.points[nodes]
        return np.asarray(np.abs((now - self.axis.rotated(now, self.angle)) @ normal), dtype=np.float64)


def rigid_checks(shape: Shape, rigid: Faces) -> Iterator[Check]:
    """Yield checks of the distance from rigid CAD, in both senses, and of its difference from the prediction.

    A surface that turns rigidly must lie on rigid CAD, node by node.
    """
    nodes, triangles, corners = shape.nodes, shape.rows, corners_of(rigid)
    points, (samples, areas), (places, parts) = shape.deflected.points[nodes], lattice(corners), prediction(shape)
    there, back = distance(points, corners), distance(samples, points[triangles])
    shares, expected = nodal_areas(points, triangles), _closest(places, corners)
    figures = {name: _figures(there[rows], expected[rows], shares[rows]) for name, rows in parts.items() if rows.any()}
    figures["cad_to_surface"] = _figures(back, _closest(samples, places[triangles]), areas)
    if shape.law == "rigid":
        apart = np.linalg.norm(points - shape.axis.rotated(shape.mesh.points[nodes], shape.angle), axis=1)
        figures["node_by_node"] = _figures(apart, np.zeros(len(nodes)), shares)
    largest, asked, off = (max(figure[key] for figure in figures.values()) for key in ("largest", "predicted", "off"))
    where = f"{sentence(shape.surface, figures)}; {worst(there, points)}"
    judged: tuple[float, Judgement] = (ROUNDING, "at most") if shape.law == "rigid" else (asked, "information")
    yield Check("surface_to_rigid_cad", largest, judged[0], "m", where, judged[1], nodes=nodes, distances=there)
    where = f"{len(nodes)} nodes in {len(figures) - 1} parts, and {len(back)} points of the CAD"
    yield Check("rigid_cad_predicted", off, PREDICTED, "m", where, figures=figures)


def sentence(surface: str, figures: Mapping[str, Mapping[str, float]]) -> str:
    """Return a sentence on a surface's distance from rigid CAD, by part, and the error of its prediction."""
    off = [
        f"{1e3 * values['largest']:.3g} mm {WORDS[part]}"
        for part, values in figures.items()
        if values["largest"] > ROUNDING
    ]
    on = ["nothing elsewhere" if off else "nothing"] * (len(off) < len(figures))
    error = max(figure["off"] for figure in figures.values())
    return f"{surface} against CAD turned rigidly: {', '.join(off + on)}; as predicted to {error:.0e} m"


def _figures(measured: FloatArray, predicted: FloatArray, weights: FloatArray) -> dict[str, float]:
    """Return the largest, mean and rms of distances (K,) by area, those predicted, and the largest difference."""
    share = weights / weights.sum()
    return {
        "points": len(measured),
        "largest": float(measured.max()),
        "mean": float(share @ measured),
        "rms": float(np.sqrt(share @ measured**2)),
        "predicted": float(predicted.max()),
        "off": float(np.abs(measured - predicted).max()),
    }


def parts_of(shape: Shape) -> dict[str, BoolArray]:
    """Return the part (K,) of each node of a surface, by topology and the CAD's datum lines."""
    fighter, points = shape.case.fighter, shape.mesh.points[shape.nodes]
    if shape.law == "rigid":
        return {"whole": np.ones(len(points), dtype=np.bool_)}
    if shape.law == "rooted":
        root = root_region(shape).inside
        return {"root": root, "beyond_root": ~root}
    wedge = Wedge.of(shape.mesh, fighter, shape.surface)
    station, ribs = points[:, 2 if shape.surface == "rudder" else 1], datum.ribs(fighter, shape.surface)
    strip = np.full(len(points), wedge.rib.any())
    strip &= np.any(np.abs(station[:, None] - ribs) < shape.case.blending.strip, axis=1)
    hinge, trailing = wedge.hinge & ~strip, wedge.trailing & ~strip
    return {"strip": strip, "hinge_edges": hinge, "faces": ~(strip | hinge | trailing), "trailing_edge": trailing}


def prediction(shape: Shape) -> tuple[FloatArray, dict[str, BoolArray]]:
    """Return the predicted places (K, 3) of the nodes, and their parts (K,).

    Nodes that a repair slid must lie on the surface of the others. They count in the first part if they are now within
    it.
    """
    points, parts = shape.mesh.points[shape.nodes], parts_of(shape)
    expected = points + LAWS[shape.law](shape)
    if shape.repair is not None and (slid := np.any(shape.repair[shape.nodes], axis=1)).any():
        nearest = Triangles.of(expected[shape.rows]).closest(shape.deflected.points[shape.nodes[slid]])
        first = next(iter(parts.values()))
        came = np.zeros(len(points), dtype=np.bool_)
        came[slid] = np.any(first[shape.rows[nearest.rows]] & (nearest.weights > ROUNDING), axis=1)
        parts = {name: rows & ~came if k else rows | came for k, (name, rows) in enumerate(parts.items())}
        expected[slid] = nearest.places
    return expected, parts


def blended_law(shape: Shape) -> FloatArray:
    """Return the displacement (K, 3) of a hinged surface: affine behind the hinge plane, blended beside a rib."""
    points, fighter = shape.mesh.points[shape.nodes], shape.case.fighter
    (first, second), lower = datum.hinge_edges(fighter, shape.surface)
    normal, trailing = np.cross(second - first, lower[0] - first), datum.trailing_edge(fighter, shape.surface)[:1]
    turned = (axis_of(fighter, shape.surface).rotated(trailing, shape.angle) - trailing)[0]
    out = np.outer((points - first) @ normal / ((trailing[0] - first) @ normal), turned)
    fixed, strip = Wedge.of(shape.mesh, fighter, shape.surface).fixed, parts_of(shape)["strip"]
    if strip.any():
        rows = np.flatnonzero(~strip & ~fixed)
        known = np.concatenate([np.flatnonzero(fixed), rows[farthest(points[rows], STRIP_SITES)]])
        values = np.where(fixed[known, None], 0.0, out[known])
        out[strip] = _multiquadric(points[known], values, shape.case.blending.epsilon, points[strip])
    out[fixed] = 0.0
    return out


def tail_law(shape: Shape) -> FloatArray:
    """Return the displacement (K, 3) of a tail: turned rigidly, its root stretched along rays to its apex."""
    case, points, region = shape.case, shape.mesh.points[shape.nodes], root_region(shape)
    axis, root = axis_of(case.fighter, shape.surface), root_of(shape)
    turned = axis.rotated(points, shape.angle)
    rays = axis.rotated(apex_of(datum.ends(case.fighter, shape.surface))[None], shape.angle) - turned
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    way = np.einsum(
        "ij,ij->i", fuselage_cylinder(case.fighter).projected_along(turned[root], rays[root]) - turned[root], rays[root]
    )
    low, high = turned[root].min(axis=0) - case.blending.root, turned[root].max(axis=0) + case.blending.root
    still = low + region.still * (high - low)
    sites, values = np.vstack([turned[root], still]), np.concatenate([way, np.zeros(len(still))])[:, None]
    inside = region.inside
    turned[inside] += _multiquadric(sites, values, case.blending.epsilon, turned[inside]) * rays[inside]
    return turned - points


def rigid_law(shape: Shape) -> FloatArray:
    """Return the displacement (K, 3) of a surface that turns rigidly."""
    return shape.axis.displacement(shape.mesh.points[shape.nodes], shape.angle)


# Displacement of a surface, by law.
LAWS: dict[Law, Callable[[Shape], FloatArray]] = {"blended": blended_law, "rigid": rigid_law, "rooted": tail_law}


def root_of(shape: Shape) -> BoolArray:
    """Return which nodes (K,) of a tail are on the fuselage."""
    return np.isin(shape.nodes, shape.mesh.on(panel_of(shape.surface)), assume_unique=True)


def root_region(shape: Shape) -> RootRegion:
    """Return which nodes of a tail are extended."""
    turned = axis_of(shape.case.fighter, shape.surface).rotated(shape.mesh.points[shape.nodes], shape.angle)
    return RootRegion.of(turned, turned[root_of(shape)], shape.case.blending.root)


def _multiquadric(sites: FloatArray, values: FloatArray, epsilon: float, points: FloatArray) -> FloatArray:
    """Interpolate values (S, k) at sites (S, 3) by SciPy's multiquadric with a linear polynomial."""
    solved = RBFInterpolator(sites, values, kernel="multiquadric", epsilon=epsilon, degree=1)
    return np.asarray(solved(points), dtype=np.float64)


def lattice(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (S, 3) at fixed barycentric places of triangles (T, 3, 3), and the areas (S,) they stand for."""
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    points, weights = [], []
    for corner, area in zip(corners, areas, strict=True):
        n = int(np.ceil(SAMPLES * np.sqrt(area / areas.sum())))
        places = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)])
        inner = np.array([6.0, 3.0, 1.0])[(places == 0).sum(axis=1)]  # how many of the small triangles meet there
        points.append(places / n @ corner)
        weights.append(inner * area / (3.0 * n * n))
    return np.concatenate(points), np.concatenate(weights)


def nodal_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return a third of the area (K,) of the triangles (T, 3) around each of points (K, 3)."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(triangles.ravel(), np.repeat(areas, 3), len(points)).astype(np.float64)


def corners_of(faces: Faces) -> FloatArray:
    """Return the corners (T, 3, 3) of the triangles of CAD faces, exact on planes."""
    return np.concatenate([face.points[face.triangles] for face in faces])


def distance(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the distance (N,) of points (N, 3) from triangles (T, 3, 3), measured by trimesh, which made neither."""
    rows = np.arange(3 * len(corners)).reshape(-1, 3)
    import trimesh  # while the CAD is being built; a finished run is validated without it

    mesh = trimesh.Trimesh(SCALE * corners.reshape(-1, 3), rows, process=False)
    return np.asarray(trimesh.proximity.closest_point(mesh, SCALE * points)[1] / SCALE)


def _closest(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the distances (N,) of points (N, 3) from triangles (T, 3, 3), measured by `Triangles`."""
    return np.asarray(np.linalg.norm(points - Triangles.of(corners).closest(points).places, axis=1))


def closest(points: FloatArray, nodes: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the distance (N,) of points (N, 3) from triangles (T, 3), and the row (N,) of the nearest one."""
    if not len(points):
        return np.empty(0), np.empty(0, dtype=np.intp)
    nearest = Triangles.of(nodes[triangles]).closest(points)
    return np.linalg.norm(points - nearest.places, axis=1), nearest.rows


def plane_normal(points: FloatArray) -> FloatArray:
    """Return the unit normal (3,) of the least-squares plane of points (N, 3); its sign is arbitrary."""
    return np.asarray(np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2], dtype=np.float64)

"""Target edge lengths as a function of position, and graded octrees that give them to the mesh generators.

h(x) = min over sources of (h_i + growth |x - p_i|).

Sources are the places where the CAD needs small cells: patches, curves, gaps, sharp corners and short edges.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, component
from sdm_deflect.geometry.model import CadFace, CadModel
from sdm_deflect.meshing.mesh.quality import signed_volumes

from .parameters import MeshParameters

# Sources whose sizes differ by less than this factor share a search tree.
LEVEL_RATIO = 1.12

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
# Least number of cubes along the longest edge of a box, before any is split.
ROOTS = 4
# Half the diagonal of a unit cube: how far a cube's corners are from its centre.
HALF_DIAGONAL = 0.87
# A cube is split for the background mesh if its edge exceeds this many target lengths.
COARSENESS = 2.5
# The same for seed points: a little sparse, because a mesher that has to refine is made to optimise, too.
SPACING = 1.9
# Largest random shift of seed points, as a share of the spacing: exact lattices are degenerate for Delaunay.
JITTER = 0.05
# How far seed points stay from the surface and from the box's sides, in target lengths.
CLEARANCE = 0.7
# Chord error in metres of the triangulation that samples are drawn from, and samples per squared edge length.
DEFLECTION = 5e-4
DENSITY = 4.0
# Least number of samples on a face, so that small faces have some, too.
FEWEST = 40
# Degrees. Interior angles of faces below it ask for small cells.
SHARP_CORNER = 25.0
# Cells from where a sharp edge ends on a face to the border of that face.
TO_BORDER = 2.5
# Two faces face each other across a gap if their normals oppose and the line between them is near the normal.
OPPOSED = -0.7
AHEAD = 0.8
# No gap and no curvature asks for cells smaller than this many envelopes.
ENVELOPES = 10.0
# Points (S, 3) on CAD faces, normals (S, 3) into the fluid, and target edge lengths (S,) in metres.
Samples = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class SizeField:
    """A graded field of target edge lengths; `levels` are search trees of source points with their length."""

    levels: tuple[tuple[cKDTree, float], ...]
    growth: float
    largest: float

    @property
    def smallest(self) -> float:
        """The smallest target edge length anywhere, in metres."""
        return min(self.levels[0][1], self.largest) if self.levels else self.largest

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the target edge lengths (N,) in metres at points (N, 3)."""
        lengths = np.full(len(points), self.largest)
        for tree, length in self.levels:
            open_points = np.flatnonzero(lengths > length)
            if len(open_points):
                reach = (lengths[open_points].max() - length) / self.growth
                distance, _ = tree.query(points[open_points], distance_upper_bound=reach * 1.0001)
                grown = length + self.growth * distance
                lengths[open_points] = np.minimum(lengths[open_points], grown)
        return lengths


def size_field(points: FloatArray, lengths: FloatArray, growth: float, largest: float) -> SizeField:
    """Return the field of sources at points (S, 3) with target edge lengths (S,) in metres.

    Lengths are rounded down by at most LEVEL_RATIO; sources that others make superfluous are left out.
    """
    level = np.floor(np.log(lengths / lengths.min()) / np.log(LEVEL_RATIO) + 1e-9).astype(np.intp)
    field = SizeField((), growth, largest)
    for index in np.unique(level):
        members, length = points[level == index], float(lengths[level == index].min())
        needed = members[field(members) > length]
        if len(needed):
            field = SizeField((*field.levels, (cKDTree(needed), length)), growth, largest)
    return field


def leaves(
    low: FloatArray, high: FloatArray, split: Callable[[FloatArray, float], BoolArray]
) -> tuple[FloatArray, FloatArray]:
    """Return low corners (K, 3) and edge lengths (K,) of the cubes that cover a box, in metres.

    Cubes are split while `split(centres, edge)` is true for them.
    """
    edge = float((high - low).max()) / ROOTS
    count = np.ceil((high - low) / edge - 1e-9).astype(np.intp)
    cubes = low + edge * np.array(list(itertools.product(*map(range, count))), dtype=np.float64)
    corners, edges = [], []
    while len(cubes):
        finer = split(cubes + 0.5 * edge, edge)
        corners.append(cubes[~finer])
        edges.append(np.full(len(corners[-1]), edge))
        edge *= 0.5
        cubes = (cubes[finer][:, None] + edge * CORNERS).reshape(-1, 3)
    return np.concatenate(corners), np.concatenate(edges)


def background(field: SizeField, low: FloatArray, high: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return points (N, 3), tetrahedra (M, 4) that cover a box, and target edge lengths (N,) in metres."""

    def split(centres: FloatArray, edge: float) -> BoolArray:
        within = np.maximum(field(centres) - field.growth * HALF_DIAGONAL * edge, field.smallest)
        return np.asarray(edge > COARSENESS * within)

    cubes, edges = leaves(low, high, split)
    points = _cube_corners(cubes, edges)
    # Cube corners are cospherical, which Delaunay triangulations answer with flat cells.
    points += 1e-2 * edges.min() * (np.random.default_rng(0).random(points.shape) - 0.5)
    tets = Delaunay(points).simplices.astype(np.intp)
    volumes = signed_volumes(points, tets)
    tets[volumes < 0.0] = tets[volumes < 0.0][:, [0, 2, 1, 3]]
    return points, tets[np.abs(volumes) > 1e-9 * edges.min() ** 3], field(points)


def seeds(field: SizeField, low: FloatArray, high: FloatArray, surface: FloatArray) -> FloatArray:
    """Return points (K, 3) of graded body-centred cubic lattices in a box, from which the mesher starts.

    Such lattices have the best-shaped Delaunay tetrahedra: the mesher starts with a better mesh than it reaches in five
    passes from a simple cubic lattice. The points keep away from the box's sides and from points (S, 3) of the surface.
    """
    cubes, edges = leaves(low, high, lambda centres, edge: edge > SPACING * field(centres))
    points = np.concatenate([cubes + 0.5 * edges[:, None], _cube_corners(cubes, edges)])
    lengths = field(points)[:, None]
    points = points + JITTER * lengths * (np.random.default_rng(0).random(points.shape) - 0.5)
    margin = CLEARANCE * lengths
    inside = ((points > low + margin) & (points < high - margin)).all(axis=1)
    distance, _ = cKDTree(surface).query(points)
    return np.asarray(points[inside & (distance > margin[:, 0])])


def _cube_corners(cubes: FloatArray, edges: FloatArray) -> FloatArray:
    corners = (cubes[:, None] + edges[:, None, None] * CORNERS).reshape(-1, 3)
    grain = edges.min() / 64.0
    return np.asarray(grain * np.unique(np.round(corners / grain), axis=0))


def sources(model: CadModel, parameters: MeshParameters) -> tuple[FloatArray, FloatArray]:
    """Return points (S, 3) and the target edge lengths (S,) there, in metres."""
    samples = [_sample(face, model.fluid_inside, parameters) for face in model.faces]
    points, normals, lengths = (np.concatenate(each) for each in zip(*samples, strict=True))
    floor = ENVELOPES * parameters.envelope
    gaps = np.maximum(_gap_widths((points, normals, lengths), parameters.gap_cells) / parameters.gap_cells, floor)
    angles = [_interior_angles(face, model.vertices) for face in model.faces]
    sharp = np.any([(angle > 0.0) & (angle < SHARP_CORNER) for angle in angles], axis=0)
    corners = model.vertices[sharp]
    at_corners = np.full(len(corners), parameters.corner)
    ends, ways = _sharp_ends(model, angles)
    middles, along = _middles(model)
    wanted = (np.minimum(lengths, gaps), at_corners, ways / TO_BORDER, along / parameters.edge_cells)
    return np.concatenate([points, corners, ends, middles]), np.concatenate(wanted)


def _sample(face: CadFace, fluid_inside: bool, parameters: MeshParameters) -> Samples:
    length = parameters.edge_length(face.patch)
    points = _spread(face.tessellation(DEFLECTION), DENSITY / length**2)
    normals = face.normal_at(points)
    lengths = np.full(len(points), length)
    if not face.planar:
        floor = min(length, max(parameters.corner, ENVELOPES * parameters.envelope))
        lengths = np.clip(np.deg2rad(parameters.turn) / _curvature(points, normals), floor, length)
    return points, -normals if fluid_inside else normals, lengths


def _spread(triangulation: tuple[FloatArray, IntArray], density: float) -> FloatArray:
    """Return random points (S, 3) on triangles, with a given number per square metre; each call returns the same."""
    points, triangles = triangulation
    a, b, c = (points[triangles[:, i]] for i in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    count = max(FEWEST, round(density * float(areas.sum())))
    random = np.random.default_rng(0)
    chosen = random.choice(len(triangles), size=count, p=areas / areas.sum())
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return np.asarray(a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen])


def _curvature(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the largest change of the normal per length (S,), in radians per metre, towards the nearest samples."""
    distance, near = cKDTree(points).query(points, k=8)
    turn = np.linalg.norm(normals[near[:, 1:]] - normals[:, None], axis=2)
    apart = np.maximum(distance[:, 1:], 1e-4)
    return np.asarray(np.maximum((turn / apart).max(axis=1), 1e-9))


def _gap_widths(samples: Samples, cells: float) -> FloatArray:
    """Return the distance (S,) in metres from each sample through the fluid to the opposite face; inf without one.

    Gaps wider than `cells` times the sample's edge length need no smaller cells; for these it is inf.
    """
    points, normals, lengths = samples
    widths = np.full(len(points), np.inf)
    for i, near in enumerate(cKDTree(points).query_ball_point(points, cells * lengths)):
        other = np.asarray(near)
        opposed = other[component(normals[other], normals[i]) < OPPOSED]
        if len(opposed):
            way = points[opposed] - points[i]
            distance = np.linalg.norm(way, axis=1)
            facing = distance[component(way, normals[i]) > AHEAD * distance]
            widths[i] = facing.min(initial=np.inf)
    return widths


def _middles(model: CadModel) -> tuple[FloatArray, FloatArray]:
    """Return the middle (E, 3) and the length (E,) of each CAD edge: a cell should not be longer than a short edge."""
    ends = model.vertices[[edge.vertices for edge in model.edges]]
    middles = [edge.project(pair.mean(axis=0)[None])[0] for edge, pair in zip(model.edges, ends, strict=True)]
    return np.concatenate(middles), np.array([edge.length for edge in model.edges])


def _interior_angles(face: CadFace, vertices: FloatArray) -> FloatArray:
    """Return the angle (V,) in degrees of a face at each vertex of the model; 0 if the vertex is on another face."""
    points, triangles = face.tessellation(DEFLECTION)
    distance, vertex = cKDTree(vertices).query(points)
    angle = np.zeros(len(vertices))
    for i in range(3):
        at, left, right = (points[triangles[:, (i + j) % 3]] for j in range(3))
        on_vertex = distance[triangles[:, i]] < 1e-6
        np.add.at(angle, vertex[triangles[on_vertex, i]], _angle(left - at, right - at)[on_vertex])
    return np.rad2deg(angle)


def _sharp_ends(model: CadModel, angles: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return points (P, 3) where a sharp edge ends on a face, and their distances (P,), m, from the face's border.

    A tail drags the panel on which its trailing edge ends. A single cell between that point and the panel's border
    would take all of the displacement.
    """
    points, ways = [np.empty((0, 3))], []
    for index, angle in enumerate(angles):
        for vertex in np.flatnonzero(angle > 360.0 - SHARP_CORNER):
            at = model.vertices[[vertex]]
            border = [e for e in model.edges if index in e.faces and vertex not in e.vertices]
            points.append(at)
            ways.append(min(float(np.linalg.norm(edge.project(at)[0] - at)) for edge in border))
    return np.concatenate(points), np.array(ways)


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    across = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.arctan2(across, np.einsum("ij,ij->i", a, b)))

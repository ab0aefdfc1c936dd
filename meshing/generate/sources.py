"""Where the CAD asks for small cells: on patches, in curves, in gaps, at sharp corners and on short edges."""

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.geometry.model import CadFace, CadModel
from sdm_deflect.meshing.generate.parameters import MeshParameters

# Chord error in metres of the triangulation that samples are drawn from, and samples per squared edge length.
DEFLECTION = 5e-4
DENSITY = 4.0
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


def sources(model: CadModel, parameters: MeshParameters) -> tuple[FloatArray, FloatArray]:
    """Points (S, 3) and the edge lengths (S,) wanted there, in metres."""
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
    """Random points (S, 3), the same ones every time, of the given number per square metre on triangles."""
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
    """Largest turn of the normal per length (S,), in radians per metre, towards the nearest samples."""
    distance, near = cKDTree(points).query(points, k=8)
    turn = np.linalg.norm(normals[near[:, 1:]] - normals[:, None], axis=2)
    apart = np.maximum(distance[:, 1:], 1e-4)
    return np.asarray(np.maximum((turn / apart).max(axis=1), 1e-9))


def _gap_widths(samples: Samples, cells: float) -> FloatArray:
    """Distance (S,) in metres from each sample through the fluid to a face opposite; inf where there is none.

    Gaps wider than `cells` times the sample's own edge length need no attention and read inf.
    """
    points, normals, lengths = samples
    widths = np.full(len(points), np.inf)
    for i, near in enumerate(cKDTree(points).query_ball_point(points, cells * lengths)):
        other = np.asarray(near)
        opposed = other[normals[other] @ normals[i] < OPPOSED]
        if len(opposed):
            way = points[opposed] - points[i]
            distance = np.linalg.norm(way, axis=1)
            facing = distance[way @ normals[i] > AHEAD * distance]
            widths[i] = facing.min(initial=np.inf)
    return widths


def _middles(model: CadModel) -> tuple[FloatArray, FloatArray]:
    """Middle (E, 3) and length (E,) of each CAD edge: a cell should not be longer than a short edge."""
    ends = model.vertices[[edge.vertices for edge in model.edges]]
    middles = [edge.project(pair.mean(axis=0)[None])[0] for edge, pair in zip(model.edges, ends, strict=True)]
    return np.concatenate(middles), np.array([edge.length for edge in model.edges])


def _interior_angles(face: CadFace, vertices: FloatArray) -> FloatArray:
    """Angle (V,) in degrees of a face at each vertex of the model; 0 where it has none."""
    points, triangles = face.tessellation(DEFLECTION)
    distance, vertex = cKDTree(vertices).query(points)
    angle = np.zeros(len(vertices))
    for i in range(3):
        at, left, right = (points[triangles[:, (i + j) % 3]] for j in range(3))
        on_vertex = distance[triangles[:, i]] < 1e-6
        np.add.at(angle, vertex[triangles[on_vertex, i]], _angle(left - at, right - at)[on_vertex])
    return np.rad2deg(angle)


def _sharp_ends(model: CadModel, angles: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Points (P, 3) where a sharp edge ends on a face, and the ways (P,) in metres from there to the face's border.

    A tail drags the panel on which its trailing edge ends. With one cell on the way to the panel's border, that cell
    has to take all of the displacement.
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
    """Angles (N,) in radians between vectors (N, 3)."""
    across = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.arctan2(across, np.einsum("ij,ij->i", a, b)))

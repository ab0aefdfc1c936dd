"""How far a run's control surface is from CAD that was turned rigidly, by other means than sdm-deflect's.

    python rigid_cad.py RUN SURFACE ANGLE [--hinge X,Y,Z X,Y,Z] [--limit METRES]

The angle is in degrees; a positive one moves the trailing edge down, that of a rudder to port. The hinge of an aileron
or rudder is the mean of its two foremost long edges in the CAD; that of a tail must be given, from port to starboard. A
rotation written out turns the deflected nodes back. The CAD kernel measures them against the faces of the undeflected
CAD, PyVista measures the faces against the mesh. It ends with 1 if a distance is above the limit.

Not independent of sdm-deflect: the CAD is what `sdm geometry` builds from RUN/case.toml, so that the shape and the CAD
kernel are the same. Nothing of RUN/metrics.json is read.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import cadquery as cq
import numpy as np
import pyvista as pv

LIMIT = 1e-12  # m: rounding
SAME = 1e-6  # m: a CAD face is one of the surface if the mesh there is so near to its centre
SAMPLES = 24  # points along each edge of the triangles of a face
LONG = 0.5  # of the surface's largest extent: shorter edges are no hinge edges


def distances(run: Path, surface: str, angle: float, brep: Path, hinge: np.ndarray | None = None) -> dict[str, float]:
    """Return the largest distance (m) node by node, from nodes to the CAD's faces, and from the faces to the mesh.

    `hinge` is two points (2, 3); None for the mean of the CAD's hinge edges.
    """
    before, triangles = surface_of(run / "undeflected.vtu", surface)
    after, _ = surface_of(run / "deflected.vtu", surface)
    undeflected = pv.PolyData.from_regular_faces(before, triangles)
    faces = [
        face
        for face in cq.Shape.importBrep(str(brep)).Faces()
        if to_triangles(undeflected, np.array([face.Center().toTuple()])) < SAME
    ]
    first, second = hinge_of(faces) if hinge is None else hinge
    back = rotated(after, first, second, -angle)
    deflected = pv.PolyData.from_regular_faces(back, triangles)
    nodes, cad = [cq.Vertex.makeVertex(*point) for point in back], cq.Compound.makeCompound(faces)
    return {
        "node by node": float(np.linalg.norm(after - rotated(before, first, second, angle), axis=1).max()),
        "nodes to CAD": max(node.distance(cad) for node in nodes),
        "CAD to mesh": max(to_triangles(deflected, samples(face)) for face in faces),
    }


def hinge_of(faces: list[cq.Face]) -> np.ndarray:
    """Return the mean (2, 3) of the two foremost long edges of a surface's faces, to starboard, or of a rudder down."""
    ends = np.array([[p.toTuple() for p in (e.startPoint(), e.endPoint())] for face in faces for e in face.Edges()])
    size = np.ptp(ends.reshape(-1, 3), axis=0)
    span = 1 + int(np.argmax(size[1:]))
    ends = np.array([edge[np.argsort(edge[:, span])] for edge in ends if np.ptp(edge[:, span]) > LONG * size.max()])
    _, one_of_each = np.unique(np.round(ends, 9), axis=0, return_index=True)  # faces share their edges
    ends = ends[one_of_each]
    hinge = ends[np.argsort(ends[:, :, 0].mean(axis=1))[:2]].mean(axis=0)
    return hinge if span == 1 else hinge[::-1]


def surface_of(file: Path, patch: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes (K, 3) of a patch and its triangles (T, 3)."""
    mesh = pv.read(file)
    names = bytes(mesh.field_data["patch_names"]).decode().split("\0")
    if patch not in names:
        sys.exit(f"{file}: has no patch {patch}, but {', '.join(names)}")
    on_patch = mesh["patch"][mesh.celltypes == pv.CellType.TRIANGLE] == names.index(patch)
    nodes, rows = np.unique(mesh.cells_dict[pv.CellType.TRIANGLE][on_patch], return_inverse=True)
    return np.asarray(mesh.points)[nodes], rows.reshape(-1, 3)


def rotated(points: np.ndarray, first: np.ndarray, second: np.ndarray, degrees: float) -> np.ndarray:
    """Turn points (N, 3) about the line through two points, right-handed, by Rodrigues' formula."""
    k, angle, arm = (second - first) / np.linalg.norm(second - first), np.radians(degrees), points - first
    along = np.outer(arm @ k, k)
    return first + along + (arm - along) * np.cos(angle) + np.cross(k, arm) * np.sin(angle)


def to_triangles(surface: pv.PolyData, points: np.ndarray) -> float:
    """Return the largest distance (m) of points (N, 3) from a triangulated surface."""
    _, nearest = surface.find_closest_cell(points, return_closest_point=True)
    return float(np.linalg.norm(nearest - points, axis=1).max())


def samples(face: cq.Face) -> np.ndarray:
    """Return points (N, 3) all over a plane face of the CAD."""
    corners, triangles = face.tessellate(1e-6)
    i, j = np.divmod(np.arange((SAMPLES + 1) ** 2), SAMPLES + 1)
    weights = np.column_stack([i, j, SAMPLES - i - j])[i + j <= SAMPLES] / SAMPLES
    return np.concatenate([weights @ np.array([corners[row].toTuple() for row in rows]) for rows in triangles])


def point(text: str) -> list[float]:
    """Return the coordinates in X,Y,Z."""
    x, y, z = map(float, text.split(","))
    return [x, y, z]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run")
    parser.add_argument("surface", help="patch of the control surface")
    parser.add_argument("angle", type=float, help="degrees")
    parser.add_argument("--hinge", type=point, nargs=2, metavar="X,Y,Z", help="two points, for a tail")
    parser.add_argument("--limit", type=float, default=LIMIT, help="largest distance that is allowed, in metres")
    given = parser.parse_args()
    if given.hinge is None and given.surface.startswith("tail"):
        parser.error("a tail turns about a pivot that no edge shows: give --hinge")
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "sdm.brep"
        command = [sys.executable, "-m", "sdm_deflect", "geometry", "--config", given.run / "case.toml", "--out", file]
        subprocess.run([*map(str, command), "--angle", "0", "--quiet"], check=True, stdout=subprocess.DEVNULL)
        found = distances(given.run, given.surface, given.angle, file, given.hinge and np.array(given.hinge))
    for what, metres in found.items():
        print(f"{given.surface}: {what} {metres:.2e} m")
    largest = max(found.values())
    sys.exit(f"{largest:.2e} m is above the limit of {given.limit:g} m" if largest > given.limit else 0)

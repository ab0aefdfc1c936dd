"""How far a run's control surface is from CAD that was turned rigidly, without any code of sdm-deflect.

    python rigid_cad.py RUN [LIMIT]

Angle and hinge are those in RUN/metrics.json; `sdm geometry` writes the CAD. A rotation written out turns the deflected
nodes back. The CAD kernel measures them against the faces of the undeflected CAD, PyVista measures the faces against
the mesh. It ends with 1 if a distance is above LIMIT (m).
"""

import json
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


def distances(run: Path, surface: str, brep: Path) -> dict[str, float]:
    """Return the largest distance (m) node by node, from nodes to the CAD's faces, and from the faces to the mesh."""
    said = json.loads((run / "metrics.json").read_text())["deflections"][surface]["surfaces"]
    before, triangles = surface_of(run / "undeflected.vtu", surface)
    after, _ = surface_of(run / "deflected.vtu", surface)
    said = next(iter(said.values()))  # its panel goes with a tail
    first, second = np.array(said["hinge"])
    back = rotated(after, first, second, -said["amount"])
    deflected = pv.PolyData.from_regular_faces(back, triangles)
    undeflected = pv.PolyData.from_regular_faces(before, triangles)
    faces = [
        face
        for face in cq.Shape.importBrep(str(brep)).Faces()
        if to_triangles(undeflected, np.array([face.Center().toTuple()])) < SAME
    ]
    nodes, cad = [cq.Vertex.makeVertex(*point) for point in back], cq.Compound.makeCompound(faces)
    return {
        "node by node": float(np.linalg.norm(after - rotated(before, first, second, said["amount"]), axis=1).max()),
        "nodes to CAD": max(node.distance(cad) for node in nodes),
        "CAD to mesh": max(to_triangles(deflected, samples(face)) for face in faces),
    }


def surface_of(file: Path, patch: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes (K, 3) of a patch and its triangles (T, 3)."""
    mesh = pv.read(file)
    number = bytes(mesh.field_data["patch_names"]).decode().split("\0").index(patch)
    on_patch = mesh["patch"][mesh.celltypes == pv.CellType.TRIANGLE] == number
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


if __name__ == "__main__":
    folder, limit = Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else LIMIT
    surfaces, largest = json.loads((folder / "metrics.json").read_text())["deflections"], 0.0
    with tempfile.TemporaryDirectory() as scratch:
        brep = Path(scratch) / "sdm.brep"
        command = [sys.executable, "-m", "sdm_deflect", "geometry", "--config", folder / "case.toml", "--out", brep]
        subprocess.run([*map(str, command), "--angle", "0", "--quiet"], check=True, stdout=subprocess.DEVNULL)
        for name in surfaces:
            for what, metres in distances(folder, name, brep).items():
                print(f"{name}: {what} {metres:.2e} m")
                largest = max(largest, metres)
    sys.exit(f"{largest:.2e} m is above the limit of {limit:g} m" if largest > limit else 0)

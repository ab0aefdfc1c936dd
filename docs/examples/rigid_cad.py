"""How far a run's aileron is from CAD that was turned rigidly, by PyVista and a rotation written out."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyvista as pv

from sdm_deflect.geometry.datum import hinge_line
from sdm_deflect.geometry.parameters import Fighter


def largest_distance(run: Path, surface: str, degrees: float, fighter: Fighter, stl: Path) -> float:
    """Return the largest distance (m) of the surface's nodes in `run` from the same faces in an `.stl`, turned."""
    mesh = pv.read(run / "deflected.vtu")
    patch = bytes(mesh.field_data["patch_names"]).decode().split("\0").index(surface)
    nodes = np.unique(
        mesh.cells_dict[pv.CellType.TRIANGLE][mesh["patch"][mesh.celltypes == pv.CellType.TRIANGLE] == patch]
    )
    solid = stl.read_text().split(f"solid {surface}\n")[1].split("endsolid")[0]
    corners = np.array([line.split()[1:] for line in solid.splitlines() if "vertex" in line], dtype=np.float64)
    first, second = hinge_line(fighter, surface)
    k, a = (second - first) / np.linalg.norm(second - first), np.radians(degrees)
    p = corners - first  # Rodrigues' formula
    turned = p * np.cos(a) + np.cross(k, p) * np.sin(a) + np.outer(p @ k, k) * (1.0 - np.cos(a)) + first
    cad = pv.PolyData(turned, np.insert(np.arange(len(turned)).reshape(-1, 3), 0, 3, axis=1))
    _, nearest = cad.find_closest_cell(mesh.points[nodes], return_closest_point=True)
    return float(np.linalg.norm(nearest - mesh.points[nodes], axis=1).max())


if __name__ == "__main__":
    here = Path(sys.argv[1])
    subprocess.run([sys.executable, "-m", "sdm_deflect", "geometry", "--out", str(here / "sdm.stl")], check=True)
    print(largest_distance(here, "aileron_left", -12.0, Fighter(), here / "sdm.stl"))

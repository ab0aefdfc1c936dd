"""A control surface that the package does not know: the tip of the fin bends to one side.

It needs a mesh with named patches, a displacement of the patch's nodes, and a hexahedron that holds no other patch.

    python docs/examples/own_surface.py runs/aileron/undeflected.vtu
"""

import sys
from pathlib import Path

import numpy as np
from sdm_deflect.deform.volume.fused import displacement, fused, inside, prescribe

from sdm_deflect.deform.quality import mean_ratio, signed_volumes
from sdm_deflect.deform.rbf.greedy import GreedyOptions, adapt
from sdm_deflect.deform.rbf.kernels import FloatArray, ThinPlateSpline
from sdm_deflect.deform.rbf.points import farthest
from sdm_deflect.deform.rbf.sites import DataSites, joined, pinned
from sdm_deflect.deform.volume.hexahedron import box
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.mesh import TetMesh

BEND = 0.125
"""Height (m) above which the fin bends."""
REGION = box(np.array([0.70, -0.06, BEND]), np.array([1.00, 0.06, 0.27]))
SIDEWAYS = (1,)
"""Only y is displaced: one interpolant for one direction."""


def bent(points: FloatArray, tip: float = 0.010) -> FloatArray:
    """Return the displacement (N, 1) in y of points of the fin: a parabola, `tip` metres at the top."""
    share = np.maximum(points[:, 2:] - BEND, 0.0) / (0.2133 - BEND)
    return tip * share**2


def deflected(mesh: TetMesh) -> TetMesh:
    """Return the mesh with the fin bent; nodes outside the region keep their bits."""
    fin = mesh.on("fin", "rudder")
    fin = fin[REGION.contains(mesh.points[fin])]
    moving = DataSites(mesh.points[fin], bent(mesh.points[fin]), SIDEWAYS)
    sites = joined([moving, pinned(REGION.face_sites(0.015), SIDEWAYS)])
    options = GreedyOptions(n_add=10, tol_add=5e-5, tol_stop=5e-5)
    fit = adapt(sites, ThinPlateSpline(), farthest(sites.points, 30), options)
    moved = displacement(mesh.points, inside(mesh.points, REGION), fused([fit]))
    exact = np.column_stack([np.zeros(len(fin)), moving.values, np.zeros(len(fin))])
    return mesh.with_points(mesh.points + prescribe(moved, fin, exact).displacement)


def main(file: Path) -> TetMesh:
    """Bend the fin of a mesh in a .vtu file, and judge the result."""
    mesh = read_vtu(file)
    after = deflected(mesh)
    moved = np.linalg.norm(after.points - mesh.points, axis=1)
    inverted = np.count_nonzero(signed_volumes(after.points, after.tets) <= 0.0)
    worst = mean_ratio(after.points, after.tets).min()
    print(f"{np.count_nonzero(moved)} of {len(moved)} nodes moved, by at most {1e3 * moved.max():.1f} mm")
    print(f"{inverted} cells inverted, smallest mean ratio {worst:.3f}")
    return after


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""Evaluate the deformation of a finished run anywhere, from `interpolant.npz` and NumPy alone.

python docs/examples/evaluate_interpolant.py runs/aileron
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def displacement(file: Path, points: FloatArray) -> FloatArray:
    """Return the displacement (N, 3) in metres at points (N, 3) inside the run's hexahedron.

    In each direction, s(p) = alpha . [1, p] + sum over the centres c of beta r^2 log r, with r = |p - c|.
    """
    columns = []
    with np.load(file, allow_pickle=False) as stored:
        for direction in "xyz":
            centers, beta, alpha = (stored[f"{name}_{direction}"] for name in ("centers", "beta", "alpha"))
            r2 = np.sum((points[:, None] - centers) ** 2, axis=2)
            phi = 0.5 * r2 * np.log(np.where(r2 > 0.0, r2, 1.0))
            columns.append(alpha[0] + points @ alpha[1:] + phi @ beta)
    return np.column_stack(columns)


def main(folder: Path) -> None:
    """Print the displacement at the middle of the hexahedron and at its corners, where it is nearly zero."""
    with np.load(folder / "interpolant.npz", allow_pickle=False) as stored:
        corners = stored["hexahedron"]
    points = np.vstack([corners.mean(axis=0), corners])
    for point, moved in zip(points, displacement(folder / "interpolant.npz", points), strict=True):
        print("({:.4f}, {:.4f}, {:.4f}) m moves by ({:.6f}, {:.6f}, {:.6f}) m".format(*point, *moved))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

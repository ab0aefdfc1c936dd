"""What the mean ratio says of a tetrahedron that is sheared or squeezed."""

import numpy as np
from matplotlib.figure import Figure

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.meshing.mesh.quality import mean_ratio

REGULAR = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
BLUE, RED = "#1a73c9", "#d1350f"


def quality(matrix: FloatArray) -> float:
    """Return the mean ratio of the regular tetrahedron mapped by a matrix (3, 3) of positive determinant."""
    return float(mean_ratio(REGULAR @ matrix.T, np.array([[0, 2, 1, 3]]))[0])


def energy(matrix: FloatArray) -> float:
    """Return E = |J|^2 / det(J)^(2/3), which meshers minimise: Q = 3 / E."""
    return float(np.sum(matrix**2) / np.cbrt(np.linalg.det(matrix) ** 2))


def sheared(amount: float) -> FloatArray:
    """Return a simple shear in the plane x, z."""
    return np.eye(3) + amount * np.outer([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def squeezed(factor: float) -> FloatArray:
    """Return a change of height by a factor."""
    return np.diag([1.0, 1.0, factor])


def draw() -> Figure:
    """Draw the mean ratio against shear and against the height that is left."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    shear, height = np.linspace(0.0, 4.0, 81), np.linspace(0.02, 1.0, 81)
    left.plot(shear, [quality(sheared(g)) for g in shear], color=BLUE)
    right.plot(height, [quality(squeezed(h)) for h in height], color=RED)
    left.set(xlabel="shear over one height", ylabel="mean ratio Q", ylim=(0.0, 1.05), title="sheared: Q = 3 / (3 + g²)")
    right.set(xlabel="height over the regular one", title="squeezed")
    for axes in (left, right):
        axes.axhline(0.4, color="0.5", lw=0.8, ls=":")
        axes.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    draw().savefig("mean_ratio.png", dpi=100)

"""A kernel of one's own: the inverse multiquadric, positive definite, so that it needs no polynomial.

A kernel is one class: phi for NumPy, and its formula for the compiled loops with the numbers that it needs:

    python docs/examples/own_kernel.py
"""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sdm_deflect.base.arrays import FloatArray, farthest
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.greedy import Adaptation, adapt
from sdm_deflect.deform.rbf.kernels import Kernel, Rescaling, ThinPlateSpline
from sdm_deflect.deform.rbf.rules import GreedyOptions


class InverseMultiquadricCode(NamedTuple):
    """Number of the inverse multiquadric."""

    inverse2: float  # 1 / radius**2


@dataclass(frozen=True, slots=True)
class InverseMultiquadric(Kernel):
    """phi(r) = 1 / sqrt(1 + (r / radius)**2)."""

    radius: float
    numbers: ClassVar[type] = InverseMultiquadricCode

    def __call__(self, r2: FloatArray) -> FloatArray:
        """Return phi for squared distances r2 of any shape."""
        return np.asarray(1.0 / np.sqrt(1.0 + r2 / self.radius**2))

    @staticmethod
    def formula(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
        """Return phi at a squared distance, compiled; names and annotations of the arguments must be these."""
        return 1.0 / np.sqrt(1.0 + code.inverse2 * r2)

    def code(self) -> InverseMultiquadricCode:
        """Return the number of the formula."""
        return InverseMultiquadricCode(self.radius**-2)

    def rescaled(self, length: float) -> Rescaling:
        """Return the kernel for distances in units of `length`."""
        return Rescaling(InverseMultiquadric(self.radius / length), 1.0, 0.0)


def wave() -> DataSites:
    """Return 2,000 sites with a smooth displacement in z."""
    points = np.random.default_rng(1).random((2000, 3))
    return DataSites(points, 0.01 * np.sin(4.0 * points[:, :1]) * points[:, 1:2], (2,))


def adapted(kernel: Kernel) -> Adaptation:
    """Choose centres for the wave until the residual is below a hundredth of a millimetre."""
    sites, options = wave(), GreedyOptions(n_add=10, tol_add=1e-5, tol_stop=1e-5)
    return adapt(sites, kernel, farthest(sites.points, 10), options)


if __name__ == "__main__":
    for kernel in (ThinPlateSpline(), InverseMultiquadric(0.5)):
        found = adapted(kernel)
        print(f"{type(kernel).__name__}: {len(found.chosen)} centres, largest error {found.max_error:.1e} m")

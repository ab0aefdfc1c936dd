"""A kernel of one's own: the cubic r^3, conditionally positive definite of order 2 like the thin plate spline.

Compiled loops know a kernel by the type of the named tuple that `compiled()` returns, and find its formula in
`sdm_deflect.deform.rbf.kernels.FORMULAS`:

    python docs/examples/own_kernel.py
"""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sdm_deflect.deform.rbf.greedy import Adaptation, GreedyOptions, adapt
from sdm_deflect.deform.rbf.kernels import FORMULAS, FloatArray, Kernel, Rescaling, ThinPlateSpline
from sdm_deflect.deform.rbf.points import farthest
from sdm_deflect.deform.rbf.sites import DataSites


class CubicCode(NamedTuple):
    """Selects the compiled cubic; a kernel with parameters keeps them here."""


@dataclass(frozen=True, slots=True)
class Cubic:
    """phi(r) = r**3."""

    sign: ClassVar[float] = 1.0
    unit: ClassVar[float] = 1.0

    def __call__(self, r2: FloatArray) -> FloatArray:
        """Return phi for squared distances r2 of any shape."""
        return np.asarray(r2 * np.sqrt(r2))

    def compiled(self) -> CubicCode:
        """Return what selects the compiled phi."""
        return CubicCode()

    def rescaled(self, length: float) -> Rescaling:
        """Return the kernel for distances in units of `length`: (length rho)**3 = length**3 rho**3."""
        return Rescaling(self, length**3, 0.0)


def _cubic(code: Any, r2: Any) -> Any:  # pragma: no cover - machine code
    """Return phi at a squared distance; names and annotations of the arguments must be these."""
    return r2 * np.sqrt(r2)


FORMULAS[CubicCode] = _cubic


def wave() -> DataSites:
    """Return 2,000 sites with a smooth displacement in z."""
    points = np.random.default_rng(1).random((2000, 3))
    return DataSites(points, 0.01 * np.sin(4.0 * points[:, :1]) * points[:, 1:2], (2,))


def adapted(kernel: Kernel) -> Adaptation:
    """Choose centres for the wave until the residual is below a hundredth of a millimetre."""
    sites, options = wave(), GreedyOptions(n_add=10, tol_add=1e-5, tol_stop=1e-5)
    return adapt(sites, kernel, farthest(sites.points, 10), options)


if __name__ == "__main__":
    for kernel in (ThinPlateSpline(), Cubic()):
        found = adapted(kernel)
        print(f"{type(kernel).__name__}: {len(found.chosen)} centres, largest error {found.max_error:.1e} m")

"""An interpolation system on fixed centres, factorised once for any number of right-hand sides (paper eqs. 5 to 7)."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.deform.rbf.interpolant import SolveError, UnitBox, coefficient_matrix
from sdm_deflect.deform.rbf.kernels import Kernel
from sdm_deflect.deform.rbf.sums import kernel_matrix
from sdm_deflect.deform.rbf.threads import single_threaded_blas


@dataclass(frozen=True, slots=True, eq=False)
class Factored:
    """The interpolant on fixed centres as a linear map from values at the centres to values at fixed points.

    Attributes
    ----------
    factor, pivots : (q + C, q + C) and (q + C,), the LU factorisation of the matrix of eq. 6 in the unit box.
    evaluation : (n, q + C), polynomials and kernel at the points; times the coefficients it gives the values.
    """

    factor: FloatArray
    pivots: IndexArray
    evaluation: FloatArray

    @classmethod
    def of(cls, kernel: Kernel, centers: FloatArray, points: FloatArray) -> Self:
        """Factorise for centres (C, 3) and prepare the evaluation at points (n, 3).

        Raises
        ------
        SolveError
            If the system is singular.
        """
        with single_threaded_blas():
            box = UnitBox.around(centers)
            scaled, at = box.scaled(centers), box.scaled(points)
            unit = kernel.rescaled(box.length).kernel
            matrix = coefficient_matrix(box.polynomials(scaled), unit, scaled)
            try:
                factor, pivots = lu_factor(matrix, overwrite_a=True)
            except (LinAlgError, ValueError) as error:
                raise SolveError(f"the system of {len(matrix)} unknowns cannot be factorised: {error}") from None
            return cls(factor, pivots, np.hstack([box.polynomials(at), kernel_matrix(unit, at, scaled)]))

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return the values (n, k) at the points of the interpolant with values (C, k) at the centres."""
        with single_threaded_blas():
            right = np.zeros((len(self.factor), values.shape[1]))
            right[len(right) - len(values) :] = values
            return np.asarray(self.evaluation @ lu_solve((self.factor, self.pivots), right, overwrite_b=True))

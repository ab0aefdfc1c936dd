"""A Cholesky factor that grows block by block and is never computed again.

The matrix is R' R with R upper triangular. R is kept in panels of some hundred columns: in triangular solves all but
the small corners of the panels is then matrix products.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from sdm_deflect.deform.kernels import FloatArray

WIDTH = 256  # columns of a panel, unless one block is larger


class NotPositiveDefiniteError(ArithmeticError):
    """A further row of the matrix depends on the others to rounding error."""


class Panel(NamedTuple):
    """Columns start to start + used of R; the arrays have room for more."""

    start: int
    used: int
    above: FloatArray  # (WIDTH, start): transpose of R's rows above the corner
    corner: FloatArray  # (WIDTH, WIDTH): inverse of R's triangle on the diagonal

    @property
    def stop(self) -> int:
        """End of the columns in use."""
        return self.start + self.used

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the parts of `above` and `corner` that are in use."""
        return self.above[: self.used], self.corner[: self.used, : self.used]


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """The factor R (n, n).

    A factor and those extended from it share memory, each seeing its own part. One may go back to an earlier factor
    and extend it otherwise; those that were extended from it before are then void.
    """

    panels: tuple[Panel, ...] = ()

    def __len__(self) -> int:
        return self.panels[-1].stop if self.panels else 0

    def forward(self, right: FloatArray) -> FloatArray:
        """Solve R' x = right for right (n, m)."""
        x = np.empty_like(right)
        for panel in self.panels:
            above, corner = panel.rows()
            rest = right[panel.start : panel.stop] - above @ x[: panel.start]
            x[panel.start : panel.stop] = corner.T @ rest
        return x

    def backward(self, right: FloatArray) -> FloatArray:
        """Solve R x = right for right (n, k)."""
        x = np.array(right)
        for panel in reversed(self.panels):
            above, corner = panel.rows()
            x[panel.start : panel.stop] = corner @ x[panel.start : panel.stop]
            x[: panel.start] -= above.T @ x[panel.start : panel.stop]
        return x

    def extended(self, above: FloatArray, corner: FloatArray) -> tuple["Factor", FloatArray]:
        """Return the factor with m further columns, and the inverse (m, m) of its further triangle.

        Parameters
        ----------
        above
            (n, m) solution of R' x = further columns of the matrix, in its first n rows.
        corner
            (m, m) the matrix in the further rows and columns.

        Raises
        ------
        NotPositiveDefiniteError
            If the extended matrix is not positive definite to rounding.
        """
        upper, info = dpotrf(corner - above.T @ above, lower=0, clean=1)
        if info != 0:
            raise NotPositiveDefiniteError(f"row {len(self) + info - 1}")
        inverse, _ = dtrtri(upper, lower=0)
        m = len(corner)
        if self.panels and self.panels[-1].used + m <= len(self.panels[-1].corner):
            return Factor((*self.panels[:-1], _joined(self.panels[-1], above, inverse))), inverse
        width = max(WIDTH, m)
        panel = Panel(len(self), m, np.zeros((width, len(self))), np.zeros((width, width)))
        panel.above[:m], panel.corner[:m, :m] = above.T, inverse
        return Factor((*self.panels, panel)), inverse


def _joined(panel: Panel, above: FloatArray, inverse: FloatArray) -> Panel:
    """Put m further columns into a panel with room for them."""
    start, used, m = panel.start, panel.used, len(inverse)
    new = slice(used, used + m)
    panel.above[new] = above[:start].T
    panel.corner[new, :used] = 0.0
    panel.corner[:used, new] = -(panel.corner[:used, :used] @ above[start:]) @ inverse
    panel.corner[new, new] = inverse
    return panel._replace(used=used + m)

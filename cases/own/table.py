"""Displacements known at points of another mesh, such as those of a structure under load."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.surface import Surface
from sdm_deflect.deform.rbf.interpolant import Interpolant, fit
from sdm_deflect.deform.rbf.kernels import FloatArray, ThinPlateSpline
from sdm_deflect.deform.rbf.points import farthest, first_coincident
from sdm_deflect.deform.surface.axis import Axis

MOST = 3000  # points of a table that a direct solve takes


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Bending and torsion: displacements at points, interpolated onto the surface by thin plate splines.

    Attributes
    ----------
    points, vectors : (P, 3) each, in the mesh's unit of length.
    hinge : an axis along the surface, where the box should follow one.
    """

    points: FloatArray = field(repr=False)
    vectors: FloatArray = field(repr=False)
    hinge: Axis | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1:] != (3,) or self.points.shape != self.vectors.shape:
            raise InputError(f"table: points {self.points.shape} and vectors {self.vectors.shape} must be (P, 3) both")
        if len(self.points) < 4 or not (np.isfinite(self.points).all() and np.isfinite(self.vectors).all()):
            raise InputError(f"table: {len(self.points)} points; it needs at least 4, all finite")

    @classmethod
    def read(cls, path: Path, hinge: Axis | None = None) -> "Table":
        """Read a .csv of x, y, z, dx, dy, dz with a line of titles, or an .npz with `points` and `vectors`.

        Raises
        ------
        InputError
            If the file cannot be read as one of these.
        """
        try:
            if path.suffix == ".npz":
                with np.load(path, allow_pickle=False) as arrays:
                    return cls(arrays["points"].astype(float), arrays["vectors"].astype(float), hinge)
            rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
            if rows.shape[1] != 6:
                raise ValueError(f"rows of {rows.shape[1]} numbers instead of x, y, z, dx, dy, dz")
            return cls(rows[:, :3], rows[:, 3:], hinge)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (OSError, KeyError, ValueError, IndexError) as error:
            raise InputError(f"{path}: no table of points and displacements: {error}") from None

    @property
    def unit(self) -> str:
        """Unit of the amount: the whole table is 1."""
        return "of the table"

    @property
    def axis(self) -> Axis | None:
        """The axis along the surface, if given."""
        return self.hinge

    def displacement(self, surface: Surface, amount: float) -> FloatArray:
        """Return the share `amount` of the interpolated table at the nodes (K, 3)."""
        return np.asarray(amount * self._interpolant()(surface.points))

    def rate(self, surface: Surface, amount: float) -> FloatArray:
        """Return the interpolated table (K, 3)."""
        del amount
        return self._interpolant()(surface.points)

    def _interpolant(self) -> Interpolant:
        rows = np.flatnonzero(first_coincident(self.points) == np.arange(len(self.points)))
        rows = rows[farthest(self.points[rows], MOST)] if len(rows) > MOST else rows
        return fit(ThinPlateSpline(), self.points[rows], self.vectors[rows])

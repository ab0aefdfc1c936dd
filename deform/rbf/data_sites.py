"""Data sites: where displacements are known, and in which directions (paper sections 3 and 4)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IndexArray, first_coincident
from sdm_deflect.base.errors import InputError

from .interpolant import check_finite

XYZ = (0, 1, 2)
DIRECTIONS = ("x", "y", "z")


class CoincidentSitesError(InputError):
    """Two data sites coincide."""


@dataclass(frozen=True, slots=True, eq=False)
class DataSites:
    """Known components of the displacement at distinct points."""

    points: FloatArray  # (N, 3) m
    values: FloatArray  # (N, k) m
    components: tuple[int, ...] = XYZ  # direction of each of the k columns: 0, 1 or 2
    merged: int = field(default=0, kw_only=True)  # points that `join` dropped

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3 or not len(self.points):
            raise ValueError(f"points {self.points.shape} must be (N, 3) with N > 0")
        if not self.components or not set(self.components) <= set(XYZ):
            raise ValueError(f"components {self.components} must be of 0, 1, 2")
        if len(set(self.components)) != len(self.components):
            raise ValueError(f"components {self.components} name a direction twice")
        if self.values.shape != (len(self.points), len(self.components)):
            raise ValueError(
                f"values {self.values.shape} must be ({len(self.points)}, {len(self.components)}): one row a "
                f"point, one column for each of the components {self.components}"
            )
        check_finite(points=self.points, values=self.values)
        first = first_coincident(self.points)
        twice = np.flatnonzero(first != np.arange(len(first)))
        if len(twice):
            raise CoincidentSitesError(
                f"{len(twice)} data sites coincide with another, for example rows {first[twice[0]]} and {twice[0]} at "
                f"({', '.join(f'{x:.6g}' for x in self.points[twice[0]])}): two nodes there may move differently"
            )

    def __len__(self) -> int:
        return len(self.points)

    def column(self, component: int) -> "DataSites":
        """Return the same points with this component alone."""
        j = self.components.index(component)
        return DataSites(self.points, self.values[:, [j]], (component,), merged=self.merged)


def fixed_sites(points: FloatArray, components: tuple[int, ...] = XYZ) -> DataSites:
    """Return sites of zero displacement."""
    return DataSites(points, np.zeros((len(points), len(components))), components)


def join(parts: Sequence[DataSites], tol: float = 1e-9) -> DataSites:
    """Return the sites of all parts; points within `tol` metres of an earlier one are dropped and counted.

    Raises ValueError if the parts have different components, or coincident points different values.
    """
    if not parts:
        raise ValueError("no data sites to join")
    components = parts[0].components
    for part in parts:
        if part.components != components:
            raise ValueError(f"cannot join sites for components {components} and {part.components}")
    points = np.vstack([part.points for part in parts])
    values = np.vstack([part.values for part in parts])
    first = first_coincident(points, tol)
    _check_agreement(points, values, first, tol)
    keep = np.flatnonzero(first == np.arange(len(first)))
    dropped = len(points) - len(keep) + sum(part.merged for part in parts)
    return DataSites(points[keep], values[keep], components, merged=dropped)


def _check_agreement(points: FloatArray, values: FloatArray, first: IndexArray, tol: float) -> None:
    gap = np.abs(values - values[first]).max(axis=1)
    worst = int(np.argmax(gap))
    if gap[worst] > tol:
        raise CoincidentSitesError(
            f"{int(np.count_nonzero(gap > tol))} pairs of coinciding data sites are to move differently, such as "
            f"at {points[worst]}: by {values[first[worst]]} and by {values[worst]} m"
        )


def univariate(parts: Sequence[DataSites], tol: float = 1e-9) -> tuple[DataSites, ...]:
    """Group sites for SQUV (section 4): one problem for each direction, with the parts that hold it."""
    groups = []
    for c in XYZ:
        carrying = [part.column(c) for part in parts if c in part.components]
        if carrying:
            groups.append(join(carrying, tol))
    return tuple(groups)


def multivariate(parts: Sequence[DataSites], tol: float = 1e-9) -> tuple[DataSites, ...]:
    """Group sites for MV (section 4): directions with the same sites form one problem with common centres.

    Directions with sites of their own (the sliding Chimera face of section 5.2) are separate problems.
    """
    carriers: dict[tuple[int, ...], list[int]] = {}
    for c in XYZ:
        where = tuple(i for i, part in enumerate(parts) if c in part.components)
        carriers.setdefault(where, []).append(c)
    return tuple(join([_columns(parts[i], tuple(cs)) for i in where], tol) for where, cs in carriers.items() if where)


def rows_of_parts(
    parts: Sequence[DataSites], components: tuple[int, ...], tol: float = 1e-9
) -> list[tuple[int, IndexArray, IndexArray]]:
    """Return where the sites of a group come from: number of each part, rows of the part, rows in the group."""
    carrying = [i for i, part in enumerate(parts) if set(components) <= set(part.components)]
    points = np.vstack([parts[i].points for i in carrying])
    kept = first_coincident(points, tol) == np.arange(len(points))
    place, start, out = np.cumsum(kept) - 1, 0, []
    for i in carrying:
        rows = np.flatnonzero(kept[start : start + len(parts[i])])
        out.append((i, rows, place[start + rows]))
        start += len(parts[i])
    return out


def _columns(sites: DataSites, components: tuple[int, ...]) -> DataSites:
    columns = [sites.components.index(c) for c in components]
    return DataSites(sites.points, sites.values[:, columns], components, merged=sites.merged)

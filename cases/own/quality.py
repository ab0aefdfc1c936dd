"""Quality of all cells that a deformation touches, by type, and cells that are inverted."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own import jacobians, polyhedra
from sdm_deflect.deform.mesh import Mesh, Polyhedra, Volume
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray


@dataclass(frozen=True, slots=True)
class Quality:
    """Shape of the cells of one type: scaled Jacobian, or for polyhedra the smallest pyramid over the volume."""

    shape: str
    cells: int
    min: float
    p01: float
    mean: float
    inverted: int


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """The cells that a deformation may change.

    Attributes
    ----------
    subject : the mesh.
    rows : for each block of cells, those with a node that may move.
    hand : for each block +1, or -1 if the file counts nodes the other way round (most of its Jacobians negative).
    inverted : number of inverted cells of the whole mesh before, for each block.
    """

    subject: Mesh
    rows: tuple[IndexArray, ...] = field(repr=False)
    hand: tuple[float, ...]
    inverted: tuple[int, ...]

    @classmethod
    def of(cls, subject: Mesh, inside: IndexArray) -> "Touched":
        """Find the cells that have a node of `inside`, and judge all cells as they are."""
        moved = np.zeros(len(subject.points), dtype=bool)
        moved[inside] = True
        rows = tuple(_touching(block, moved) for block in subject.cells)
        signs = [_volumes(subject.points, block, None) for block in subject.cells]
        hand = tuple(-1.0 if np.count_nonzero(sign < 0.0) > 0.5 * len(sign) else 1.0 for sign in signs)
        bad = tuple(int(np.count_nonzero(h * sign <= 0.0)) for h, sign in zip(hand, signs, strict=True))
        return cls(subject, rows, hand, bad)

    @property
    def count(self) -> int:
        """Number of cells touched."""
        return sum(len(rows) for rows in self.rows)

    def inverted_at(self, points: FloatArray) -> int:
        """Return the number of touched cells that are inverted with the nodes at `points` (N, 3)."""
        return sum(
            int(np.count_nonzero(hand * _volumes(points, block, rows) <= 0.0))
            for block, rows, hand in zip(self.subject.cells, self.rows, self.hand, strict=True)
        )

    def quality(self, points: FloatArray) -> tuple[Quality, ...]:
        """Return the quality of the touched cells of each type."""
        values: dict[str, list[FloatArray]] = {}
        for block, rows, hand in zip(self.subject.cells, self.rows, self.hand, strict=True):
            if len(rows):
                shape = "polyhedron" if isinstance(block, Polyhedra) else block.shape
                values.setdefault(shape, []).append(hand * _shapes(points, block, rows))
        return tuple(_summary(shape, np.concatenate(parts)) for shape, parts in values.items())

    def check(self) -> None:
        """Raise InputError if the mesh has inverted cells before anything moves."""
        for block, count in zip(self.subject.cells, self.inverted, strict=True):
            if count:
                shape = "polyhedra" if isinstance(block, Polyhedra) else f"cells ({block.shape})"
                raise InputError(
                    f"{self.subject.name}: {count} of {len(block)} {shape} are inverted in the file already; mend the "
                    "mesh, or take it as it is with --allow-inverted"
                )


def _touching(block: Volume, moved: NDArray[np.bool_]) -> IndexArray:
    return polyhedra.touching(block, moved) if isinstance(block, Polyhedra) else jacobians.touching(block, moved)


def _volumes(points: FloatArray, block: Volume, rows: IndexArray | None) -> FloatArray:
    if isinstance(block, Polyhedra):
        return polyhedra.smallest_pyramid(points, block, rows)
    return jacobians.smallest_jacobian(points, block, rows)


def _shapes(points: FloatArray, block: Volume, rows: IndexArray) -> FloatArray:
    if isinstance(block, Polyhedra):
        return polyhedra.smallest_pyramid(points, block, rows)
    return jacobians.scaled_jacobian(points, block, rows)


def _summary(shape: str, values: FloatArray) -> Quality:
    return Quality(
        shape, len(values), float(values.min()), float(np.percentile(values, 1.0)), float(values.mean()),
        int(np.count_nonzero(values <= 0.0)),
    )  # fmt: skip

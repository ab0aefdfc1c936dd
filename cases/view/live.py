"""A finished run that turns to any angle: the same centres, a factor used again, no adaptation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from sdm_deflect.cases.case import LARGEST_ANGLE, Case
from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.view.part import Part
from sdm_deflect.cases.view.stored import Stored
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.meshing.mesh import TetMesh

SAME_MESH = 1e-6
"""The mesh at the run's angle is no further (m) from that of the run."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The mesh at one angle.

    Attributes
    ----------
    angle : of the case, degrees.
    points : (N, 3) coordinates of all nodes, metres; those outside the hexahedra have the bits of the run's mesh.
    quality : (L,) mean ratio of the cells that touch a hexahedron; 0 where inverted.
    residual : largest error (m) of the interpolants at any data site, in any direction.
    tolerance : what the run allowed for it (m).
    """

    angle: float
    points: FloatArray
    quality: FloatArray
    residual: float
    tolerance: float

    @property
    def inverted(self) -> IndexArray:
        """Rows of `quality` of the inverted cells."""
        return np.flatnonzero(self.quality <= 0.0)

    @property
    def verified(self) -> bool:
        """True if the residual is below the tolerance and no cell is inverted."""
        return self.residual < self.tolerance and not len(self.inverted)


@dataclass(frozen=True, slots=True, eq=False)
class Live:
    """A run, its control surfaces ready to turn together.

    Attributes
    ----------
    cells : (L, 4) the tetrahedra that touch a hexahedron.
    outer : (M - L, 4) the others, which never move.
    """

    case: Case
    mesh: TetMesh
    parts: tuple[Part, ...]
    cells: IndexArray
    outer: IndexArray

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read a run's folder and factorise.

        Raises
        ------
        InputError
            If it is not the folder of a finished run, or its files do not belong together.
        """
        stored = Stored.of(folder)
        parts = tuple(Part.of(stored, one) for one in stored.case.deflections)
        inside = np.concatenate([part.changed for part in parts])
        touched = stored.mesh.touching(inside)
        live = cls(stored.case, stored.mesh, parts, stored.mesh.tets[touched], stored.mesh.tets[~touched])
        if np.abs(live.at(stored.case.angle).points - stored.deflected).max() > SAME_MESH:
            raise stored.foreign("deflected.vtu")
        return live

    def at(self, angle: float) -> Frame:
        """Turn every surface to its share of the angle (deg).

        Raises
        ------
        ValueError
            If an angle is not a number or beyond what any surface can turn.
        ConfinementError
            If a surface cannot move so far within its hexahedron.
        """
        if not abs(angle) <= self.largest:
            raise ValueError(f"{angle:g} deg is outside {-self.largest:g} ... {self.largest:g} deg")
        points, residual = self.mesh.points.copy(), 0.0
        for part in self.parts:
            moved = part.moved(part.factor * angle)
            points[part.changed] = moved.points[part.changed]
            residual = max(residual, moved.residual)
        return Frame(angle, points, mean_ratio(points, self.cells), residual, self.case.adaptation.tolerance)

    @property
    def largest(self) -> float:
        """Angle (deg) that no surface can exceed."""
        return LARGEST_ANGLE / max(abs(part.factor) for part in self.parts)

"""A finished run that turns to any angle: the same centres, a factor used again, no adaptation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import deflected, plans_of
from sdm_deflect.cases.sdm.run_folder import read_run
from sdm_deflect.deform.errors import InputError
from sdm_deflect.deform.fitting import LARGEST_ANGLE
from sdm_deflect.deform.mesh import FloatArray, IntArray
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.deform.volume.deflection import Deflection, Plan, turned
from sdm_deflect.deform.volume.region import check_moving
from sdm_deflect.geometry import datum
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
    def inverted(self) -> IntArray:
        """Rows of `quality` of the inverted cells."""
        return np.flatnonzero(self.quality <= 0.0)

    @property
    def verified(self) -> bool:
        """True if the residual is below the tolerance and no cell is inverted."""
        return self.residual < self.tolerance and not len(self.inverted)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A control surface, which turns by `factor` times the angle of the case.

    Attributes
    ----------
    known : its deflection at the run's angle.
    trailing : the node nearest to the middle of the trailing edge.
    """

    factor: float
    known: Deflection
    trailing: int

    @property
    def plan(self) -> Plan:
        """Its nodes, box and sites."""
        return self.known.plan

    @property
    def surface(self) -> str:
        """Its name."""
        return self.plan.surface

    def centres(self, points: FloatArray) -> FloatArray:
        """Return the centres (C, 3) of the first step, those on the surface where it is in points (N, 3)."""
        step = self.known.steps[0]
        moving, sites = self.plan.sites.moving, [factor.kernel.problem.sites.points for factor in step.fits.factors]
        rows = [fit.chosen for fit in step.fits.adaptations]
        surface = np.unique(np.concatenate([own[own < len(moving)] for own in rows]))
        others = [place[own[own >= len(moving)]] for place, own in zip(sites, rows, strict=True)]
        return np.unique(np.vstack([points[moving[surface]], *others]), axis=0)


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
    cells: IntArray
    outer: IntArray

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read a run's folder and fit again.

        Raises
        ------
        InputError
            If it is not the folder of a finished run, or its files do not belong together.
        """
        case, mesh, stored = read_run(folder)
        results = deflected(case, plans_of(case, mesh.as_mesh(case.name)))
        parts = tuple(
            Part(turn.factor, one, trailing_edge_node(case, mesh, turn.surface))
            for turn, one in zip(case.deflections, results, strict=True)
        )
        touched = mesh.touching(np.concatenate([part.plan.changed for part in parts]))
        live = cls(case, mesh, parts, mesh.tets[touched], mesh.tets[~touched])
        if np.abs(live.at(case.angle).points - stored.points).max() > SAME_MESH:
            raise InputError(
                f"{folder}: deflected.vtu does not belong to undeflected.vtu and case.toml; run the case again"
            )
        return live

    def at(self, angle: float) -> Frame:
        """Turn every surface to its share of the angle (deg).

        Raises
        ------
        ValueError
            If an angle is not a number or beyond what any surface can turn.
        InputError
            If a surface cannot move so far within its hexahedron.
        """
        if not abs(angle) <= self.largest:
            raise ValueError(f"{angle:g} deg is outside {-self.largest:g} ... {self.largest:g} deg")
        points, residual = self.mesh.points.copy(), 0.0
        for part in self.parts:
            moved = turned(part.known, part.factor * angle)
            points[part.plan.changed] = moved.points[part.plan.changed]
            residual = max(residual, moved.steps[0].error)
        return Frame(angle, points, mean_ratio(points, self.cells), residual, self.case.adaptation.tolerance)

    def check(self, angle: float) -> None:
        """Raise InputError if a surface cannot move to its share of the angle (deg) within its hexahedron."""
        for part in self.parts:
            amounts = part.plan.job.amounts_at(part.factor * angle)
            check_moving(part.plan.boundary, part.plan.region.hexahedron, [amounts])

    @property
    def largest(self) -> float:
        """Angle (deg) that no surface can exceed."""
        return LARGEST_ANGLE / max(abs(part.factor) for part in self.parts)


def trailing_edge_node(case: Case, mesh: TetMesh, surface: str) -> int:
    """Return the node of a surface that is nearest to the middle of its trailing edge."""
    nodes, middle = mesh.on(surface), datum.trailing_edge(case.fighter, surface).mean(axis=0)
    return int(nodes[np.argmin(np.linalg.norm(mesh.points[nodes] - middle, axis=1))])

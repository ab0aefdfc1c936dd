"""The nodes whose displacement is known: those that move, those that stay, those that slide."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.job import Job
from sdm_deflect.cases.own.sheets import Sheet, check_parts, sheet_of
from sdm_deflect.cases.own.surface import BoolArray, Surface
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray

SAME = 1e-9  # of the moving surfaces' size: lengths below are zero
ON_WALL = 1e-6  # of it: a moving node this near to a wall is put on it


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """Moving, fixed and sliding nodes of the whole mesh; a node that is several of these moves, else stays.

    Attributes
    ----------
    job : what is asked.
    surfaces : the moving surfaces, in the job's order.
    nodes : (K,) sorted indices of their nodes, each once.
    fixed : patches that stay.
    still : (F,) sorted indices of the nodes of fixed patches that do not move.
    sheets : sliding patches.
    size : largest extent of the moving nodes.
    """

    job: Job
    surfaces: tuple[Surface, ...]
    nodes: IndexArray = field(repr=False)
    fixed: tuple[str, ...]
    still: IndexArray = field(repr=False)
    sheets: tuple[Sheet, ...]
    size: float

    @classmethod
    def of(cls, subject: Mesh, job: Job) -> "Boundary":
        """Sort the patches of a mesh; InputError for names that are no patches, or that are given two parts."""
        surfaces = tuple(Surface.of(subject, moving.patches) for moving in job.surfaces)
        fixed = subject.named(job.fixed, "--fixed")
        moves = [name for surface in surfaces for name in surface.patches]
        sliding = {name: one.shape for one in job.slides for name in subject.named([one.patch], "--slide")}
        fixed = tuple(name for name in fixed if name in job.fixed or name not in (*moves, *sliding))
        check_parts(subject, moves, fixed, sliding)
        nodes = np.unique(np.concatenate([surface.nodes for surface in surfaces]))
        sheets = tuple(sheet_of(subject, name, shape) for name, shape in sliding.items())
        still = np.setdiff1d(subject.on(*fixed), nodes, assume_unique=True)
        size = float(np.ptp(subject.points[nodes], axis=0).max())
        return cls(job, surfaces, nodes, fixed, still, sheets, size)

    @property
    def subject(self) -> Mesh:
        """The mesh."""
        return self.surfaces[0].subject

    @property
    def declared(self) -> tuple[str, ...]:
        """Every patch that the job names."""
        moving = tuple(name for surface in self.surfaces for name in surface.patches)
        return (*moving, *self.fixed, *(sheet.patch for sheet in self.sheets))

    def displacement(self, angle: float) -> FloatArray:
        """Return how far each of `nodes` (K, 3) moves, each of them once.

        Raises
        ------
        InputError
            If two surfaces move a shared node differently, a node shared with a fixed patch moves, or one shared
            with a sliding patch leaves its shape.
        """
        amounts = self.job.amounts(angle)
        parts = [
            moving.motion.displacement(surface, amount)
            for moving, surface, amount in zip(self.job.surfaces, self.surfaces, amounts, strict=True)
        ]
        out = self._joined(parts, "move differently")
        self._check_fixed(out)
        out[self.held] = 0.0
        for sheet, rows in self._on_sheets():
            out[rows] = self._kept(sheet, rows, out[rows])
        return out

    def rate(self, angle: float) -> FloatArray:
        """Return the derivative (K, 3) of the displacement with respect to the first surface's angle."""
        parts = [
            self.job.ratio(moving) * moving.motion.rate(surface, amount)
            for moving, surface, amount in zip(self.job.surfaces, self.surfaces, self.job.amounts(angle), strict=True)
        ]
        out, displacement = self._joined(parts, "move at different rates"), self.displacement(angle)
        out[self.held] = 0.0
        points = self.subject.points[self.nodes]
        for sheet, rows in self._on_sheets():
            out[rows] = sheet.wall.rate(points[rows], displacement[rows], out[rows])
        return out

    @property
    def held(self) -> BoolArray:
        """Which of the moving nodes (K,) are shared with a fixed patch."""
        return np.isin(self.nodes, self.subject.on(*self.fixed), assume_unique=True)

    def _on_sheets(self) -> Iterable[tuple[Sheet, IndexArray]]:
        """Yield the sliding patches with the rows of the moving nodes that they share."""
        for sheet in self.sheets:
            rows = np.flatnonzero(np.isin(self.nodes, sheet.nodes, assume_unique=True))
            if len(rows):
                yield sheet, rows

    def _joined(self, parts: list[FloatArray], fault: str) -> FloatArray:
        out = np.full((len(self.nodes), 3), np.nan)
        for surface, part in zip(self.surfaces, parts, strict=True):
            rows = np.searchsorted(self.nodes, surface.nodes)
            known = out[rows]
            apart = np.abs(known - part).max(axis=1) > SAME * self.size  # nan, not known yet, compares false
            if apart.any():
                raise InputError(
                    f"{self.subject.name}: {int(apart.sum())} nodes of {', '.join(surface.patches)} also belong to "
                    f"another moving surface, and the two {fault} there; blend one of them"
                )
            out[rows] = np.where(np.isnan(known), part, known)
        return out

    def _check_fixed(self, displacement: FloatArray) -> None:
        moves = np.linalg.norm(displacement, axis=1) > SAME * self.size
        for name in self.fixed:
            shared = np.isin(self.nodes, self.subject.patch(name).nodes, assume_unique=True)
            count = int(np.count_nonzero(shared & moves))
            if count:
                raise InputError(
                    f"{self.subject.name}: {count} nodes shared by the moving surface and {name}, which is fixed, "
                    f"would move by up to {float(np.abs(displacement[shared]).max()):.4g}; use a blended motion, or "
                    f"let {name} slide"
                )

    def _kept(self, sheet: Sheet, rows: IndexArray, displacement: FloatArray) -> FloatArray:
        points = self.subject.points[self.nodes[rows]]
        kept = sheet.wall.kept(points, displacement)
        off = np.linalg.norm(kept - displacement, axis=1)
        leaving = off > ON_WALL * self.size
        if leaving.any():
            raise InputError(
                f"{self.subject.name}: {int(leaving.sum())} nodes shared by the moving surface and {sheet.patch} would "
                f"leave its shape by up to {float(off.max()):.4g}; the hinge must be normal to a plane, or blend the "
                "motion there"
            )
        return kept

"""The course of an adaptation, and why it ended (paper section 4, step 6)."""

from dataclasses import dataclass, field
from enum import Enum
from time import perf_counter

import numpy as np

from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.kernels import FloatArray
from sdm_deflect.deform.progress import Progress, silent
from sdm_deflect.deform.selection import GreedyOptions


class Stop(Enum):
    """Why the adaptation ended."""

    CONVERGED = "largest error below tol_stop"
    MAX_CENTERS = "limit on the number of centres reached: raise max_centers or accept the error"
    MAX_ITERATIONS = "limit on the number of iterations reached: raise max_iterations or n_add"
    ROUNDING = "largest error below tol_stop in the adaptation, but not afresh in metres: raise tol_stop"
    EXHAUSTED = "no remaining site is off by more than tol_add: lower tol_add to go on"


@dataclass(frozen=True, slots=True)
class Step:
    """One row of the convergence history."""

    iteration: int
    n_centers: int
    max_residual: float  # m, over all sites and columns
    seconds: float  # since the start


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Records one step for each interpolant that was evaluated at all sites."""

    options: GreedyOptions
    progress: Progress
    start: float
    steps: list[Step] = field(default_factory=list)

    def record(self, n_centers: int, errors: FloatArray) -> None:
        """Append the step of an interpolant with errors (N, k)."""
        largest = float(np.abs(errors).max())
        self.steps.append(Step(len(self.steps), n_centers, largest, perf_counter() - self.start))
        if self.progress is not silent:
            self.progress(f"{n_centers} centres, error {largest:.2e} m", self._fraction())

    def _fraction(self) -> float:
        """Estimate how much is done from the fall of the residual and the use of centres."""
        tol, last = self.options.tol_stop, self.steps[-1]
        first = max(self.steps[0].max_residual, tol)
        fallen = np.log(first / max(last.max_residual, tol)) / np.log(first / tol) if first > tol else 1.0
        return float(max(fallen, last.n_centers / self.options.max_centers))

    def stop(self, block: IndexArray) -> Stop | None:
        """Return why to stop after the last step (step 6), or None to go on with `block`."""
        last, options = self.steps[-1], self.options
        if last.max_residual < options.tol_stop:
            return Stop.CONVERGED
        if last.n_centers >= options.max_centers:
            return Stop.MAX_CENTERS
        if last.iteration >= options.max_iterations:
            return Stop.MAX_ITERATIONS
        return None if len(block) else Stop.EXHAUSTED

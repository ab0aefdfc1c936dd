"""From rest to an angle, in as few steps as keep every cell positive."""

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.cases.own.plan import Plan
from sdm_deflect.cases.own.rates import rate
from sdm_deflect.cases.own.start import Start
from sdm_deflect.cases.own.step import Solution, solve
from sdm_deflect.cases.progress import Report
from sdm_deflect.deform.rbf.kernels import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The mesh at one angle and how it got there.

    Attributes
    ----------
    angle : the first surface's amount.
    solutions : one for each step.
    last : the mesh at the start of the last step.
    inverted : number of touched cells that are inverted at the end.
    """

    angle: float
    solutions: tuple[Solution, ...]
    last: Start = field(repr=False)
    inverted: int

    @property
    def points(self) -> FloatArray:
        """Deflected coordinates (N, 3); outside the box they have the same bits as before."""
        return self.solutions[-1].points


def followed(plan: Plan, angle: float, report: Report, earlier: Course | None = None) -> Course:
    """Bring the mesh to an angle; the angle is halved into steps while further cells are inverted.

    If no number of steps does, the course with the fewest inverted cells is the result. A single step uses the
    centres and factors of an earlier course of a single step.
    """
    before = sum(plan.touched.inverted)
    reused = earlier if earlier is not None and len(earlier.solutions) == 1 else None
    best = _stepped(plan, angle, 1, report, reused)
    count = 2
    while best.inverted > before and count <= plan.job.fitting.max_steps:
        course = _stepped(plan, angle, count, report, None)
        best = min(best, course, key=lambda one: one.inverted)
        count *= 2
    return best


def sensitivity(plan: Plan, course: Course) -> FloatArray:
    """Return d(points)/d(angle) (N, 3) in length units per unit of the amount, from the same centres.

    With several steps it is the derivative with respect to the end of the last one.
    """
    boundary, steps = plan.boundary, len(course.solutions)
    between = boundary.displacement(course.angle * (steps - 1) / steps) if steps > 1 else 0.0
    move = boundary.displacement(course.angle) - between
    return rate(course.last, course.solutions[-1], np.asarray(move), boundary.rate(course.angle))


def _stepped(plan: Plan, angle: float, count: int, report: Report, earlier: Course | None) -> Course:
    """Go to the angle in `count` equal steps, each interpolated from where the last one ended."""
    points, solutions, reached = plan.subject.points, [], np.zeros((len(plan.boundary.nodes), 3))
    for k in range(1, count + 1):
        start = earlier.last if earlier else Start.of(plan.boundary, plan.sites, plan.region.inside, points)
        target = plan.boundary.displacement(angle * k / count)
        solution = solve(start, target - reached, report, earlier.solutions[0] if earlier else None)
        points, reached = solution.points, target
        solutions.append(solution)
    points[plan.boundary.nodes] = plan.subject.points[plan.boundary.nodes] + reached
    return Course(angle, tuple(solutions), start, plan.touched.inverted_at(points))

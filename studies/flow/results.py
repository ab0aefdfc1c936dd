"""What the forces of all members say: increments due to the control, and whether meshes agree."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path

import numpy as np
from scipy import stats

from sdm_deflect.base.arrays import FloatArray, IntArray
from studies.flow.forces import LIFT, PITCH, ROLL, YAW, Forces, coefficients, hinge_moment
from studies.flow.members import DEFLECTED, FRESH, FRESH_DEFLECTED, REPAIRED, UNDEFLECTED, FlowStudy, Member
from studies.flow.openfoam import WHOLE
from studies.flow.reference import surface_reference

HINGE = "Ch"
# Iterations over which values are averaged, and the last ones, over which averages must not change.
WINDOW, LAST = 500, 200
# Largest change of an average, and least difference that is allowed, by the control increment.
CONVERGED, ALLOWED = 0.005, 0.02
CONFIDENCE = 0.95
# Coefficients that a control surface is there to change, by the beginning of its name.
JUDGED = {"aileron": (LIFT, PITCH, ROLL, HINGE), "tail": (LIFT, PITCH, ROLL, HINGE), "rudder": (YAW, ROLL, HINGE)}


@dataclass(frozen=True, slots=True)
class Value:
    """A coefficient of one member: average over the window, change of averages over the last iterations, amplitude.

    The flow behind the blunt base of the fuselage does not become quite steady: forces swing about their averages by
    `amplitude`, half the range within the window.
    """

    mean: float
    change: float
    amplitude: float

    @classmethod
    def of(cls, iteration: IntArray, series: FloatArray) -> "Value":
        """Average the end of a series (K,); of one that is shorter than two windows its second half."""
        span = int(iteration[-1] - iteration[0])
        window = min(WINDOW, max(span // 2, 1))
        ends = iteration[iteration >= iteration[-1] - min(LAST, window)]
        means = [series[(iteration > end - window) & (iteration <= end)].mean() for end in ends]
        own = series[iteration > iteration[-1] - window]
        return cls(float(means[-1]), float(np.ptp(means)), float(np.ptp(own)) / 2.0)


@dataclass(frozen=True, slots=True)
class Increment:
    """What one coefficient changes by from the undeflected mesh to those at an angle.

    Attributes
    ----------
    angle, name : degrees, and the coefficient.
    base : that of the undeflected mesh.
    deflected, repaired : increments; None where there is no such mesh.
    fresh : increments of the new meshes, each from a new undeflected one; see `fresh_increments`.
    change : largest change of an average over the last iterations, of all these.
    judged : whether the control surface is there to change it.
    elsewhere : scatter at the study's first angle, which counts where there is one new mesh alone; nan without one.
    others : increments on other meshes that were deflected: new ones, each on its own cells.
    """

    angle: float
    name: str
    base: float
    deflected: float | None
    repaired: float | None
    fresh: tuple[float, ...]
    change: float
    amplitude: float
    judged: bool
    elsewhere: float = nan
    others: tuple[float, ...] = ()

    @property
    def own(self) -> float:
        """The increment that is compared: of the repaired mesh, where there is one."""
        found = self.deflected if self.repaired is None else self.repaired
        assert found is not None
        return found

    @property
    def expected(self) -> float:
        """Mean over the new meshes; without any, nan."""
        return float(np.mean(self.fresh)) if self.fresh else nan

    @property
    def scatter(self) -> float:
        """Largest distance of a new mesh from their mean; of a single one that at the first angle."""
        if len(self.fresh) == 1:
            return self.elsewhere
        return max((abs(one - self.expected) for one in self.fresh), default=nan)

    @property
    def difference(self) -> float:
        """Own increment minus that of the new meshes."""
        return self.own - self.expected

    @property
    def share(self) -> float:
        """Difference by the increment of the new meshes: above 0 where the deflected mesh has the larger effect."""
        return self.difference / self.expected

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the scatter, or within 2 % of the increment."""
        return bool(abs(self.difference) <= np.fmax(self.scatter, ALLOWED * abs(self.expected)))

    @property
    def all_deflected(self) -> tuple[float, ...]:
        """The increments on all meshes that were deflected."""
        return (self.own, *self.others)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % confidence interval of the mean of all deflected meshes minus that of the new ones.

        By Welch's t-test; nan where there is but one mesh of a kind.
        """
        if min(len(self.others) + 1, len(self.fresh)) < 2:
            return nan, nan
        found = stats.ttest_ind(self.all_deflected, self.fresh, equal_var=False).confidence_interval(CONFIDENCE)
        return float(found.low), float(found.high)

    @property
    def converged(self) -> bool:
        """Whether averages change by less than .5 % of the increment over the last iterations."""
        return self.change < CONVERGED * abs(self.expected if self.fresh else self.own)


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """All members with their coefficients, and the increments at every angle."""

    study: FlowStudy
    values: Mapping[Member, Mapping[str, Value]] = field(repr=False)
    increments: tuple[Increment, ...]

    def of(self, name: str) -> tuple[Increment, ...]:
        """Return the increments of one coefficient, by rising angle."""
        return tuple(sorted((one for one in self.increments if one.name == name), key=lambda one: one.angle))

    @property
    def judged(self) -> tuple[Increment, ...]:
        """Increments that decide: of what the control surface is there to change, where there are new meshes."""
        return tuple(one for one in self.increments if one.judged and one.fresh)

    @property
    def passed(self) -> bool:
        """Whether all of these agree."""
        return all(one.agrees for one in self.judged)


def results_of(study: FlowStudy, members: Sequence[Member], cases: Path) -> Results:
    """Read the forces of all members; InputError where a solver has not run."""
    values = {member: dict(values_of(study, cases / member.name)) for member in members}
    return Results(study, values, tuple(increments(study, values)))


def values_of(study: FlowStudy, case: Path) -> Iterator[tuple[str, Value]]:
    """Yield the coefficients of one member by name."""
    whole, setup = Forces.read(case, WHOLE), study.setup(True)
    for name, series in coefficients(whole, setup).items():
        yield name, Value.of(whole.iteration, series)
    hinge = next(one for one in setup.hinges if one.name == study.surface)
    reference = surface_reference(study.case.fighter, study.surface)
    own = Forces.read(case, study.surface)
    scale = study.stream.dynamic_pressure * reference.area * reference.chord
    yield HINGE, Value.of(own.iteration, hinge_moment(own, hinge) / scale)


def judged(study: FlowStudy) -> tuple[str, ...]:
    """Return the coefficients that decide."""
    return next(names for surface, names in JUDGED.items() if study.surface.startswith(surface))


def increments(study: FlowStudy, values: Mapping[Member, Mapping[str, Value]]) -> Iterator[Increment]:
    """Yield what each coefficient changes by at each angle; `values` are those of all members."""
    base = values[Member(UNDEFLECTED)]
    undeflected = [own for member, own in values.items() if member.kind == FRESH and not member.angle]
    decisive = judged(study)
    scatter: dict[str, float] = {}
    for angle in study.angles:
        there = {member: own for member, own in values.items() if member.angle == angle and member.kind != UNDEFLECTED}
        for name, start in base.items():
            found = {
                kind: [own[name] for member, own in there.items() if member.kind == kind]
                for kind in (DEFLECTED, REPAIRED, FRESH)
            }
            moved = [next((own.mean - start.mean for own in found[kind]), None) for kind in (DEFLECTED, REPAIRED)]
            bases = [own[name] for own in undeflected] or [start]
            used = [start, *(bases if found[FRESH] else ()), *(own[name] for own in there.values())]
            one = Increment(
                angle=angle,
                name=name,
                base=start.mean,
                deflected=moved[0],
                repaired=moved[1],
                fresh=fresh_increments([own.mean for own in found[FRESH]], [own.mean for own in bases]),
                change=max(one.change for one in used),
                amplitude=max(one.amplitude for one in used),
                judged=name in decisive,
                elsewhere=scatter.get(name, nan),
                others=tuple(
                    own[name].mean - values[Member(FRESH, number=member.number)][name].mean
                    for member, own in there.items()
                    if member.kind == FRESH_DEFLECTED
                ),
            )
            scatter.setdefault(name, one.scatter)
            yield one


def fresh_increments(deflected: Sequence[float], undeflected: Sequence[float]) -> tuple[float, ...]:
    """Return increments between new meshes: pairs, where there are as many of both, else from the latter's mean.

    No mesh takes part in two pairs, so the increments scatter by what both ends of one are worth. The increment of a
    mesh that is deflected has the same cells at both ends.
    """
    if len(deflected) == len(undeflected):
        return tuple(one - base for one, base in zip(deflected, undeflected, strict=True))
    return tuple(one - float(np.mean(undeflected)) for one in deflected)

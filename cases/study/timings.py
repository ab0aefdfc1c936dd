"""Timings of section 5: the filter, and evaluation inside the hexahedron against the whole mesh."""

from collections.abc import Callable
from dataclasses import replace
from statistics import median
from time import perf_counter

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.study.loops import GROWN
from sdm_deflect.cases.study.measure import ENOUGH_SECONDS, REPETITIONS, Job, measure, sites_of
from sdm_deflect.cases.study.paper import Evaluation
from sdm_deflect.cases.study.trend import Finding
from sdm_deflect.meshing.mesh import TetMesh

ALIKE = 1.5
"""Time may fall short of the number of points by this factor: measured times vary that much."""


def timed(theirs: Evaluation, case: Case, mesh: TetMesh) -> Evaluation:
    """Find the interpolant as the paper did and time filter and evaluation, medians of several runs."""
    sites = sites_of(replace(case, angle=theirs.setting.angle), mesh)
    region, fit = sites.region, measure([Job.of(sites, theirs.setting, theirs, GROWN)])[0]
    inside = mesh.points[region.inside]
    return replace(
        theirs,
        centers=fit.row.centers,
        inside=len(inside),
        filter_seconds=_median_seconds(lambda: region.hexahedron.contains(mesh.points)),
        inside_seconds=_median_seconds(lambda: fit.interpolant(inside)),
        whole_seconds=_median_seconds(lambda: fit.interpolant(mesh.points)),
    )


def savings(one: Evaluation, points: int) -> Finding:
    """Judge whether confined evaluation is faster at least by the ratio of the numbers of points."""
    time, share = one.whole_seconds / one.inside_seconds, points / one.inside
    return Finding(time * ALIKE >= share, f"{time:.3g} times faster, {share:.3g} times fewer points")


def filter_is_cheap(one: Evaluation) -> Finding:
    """Judge whether filter and evaluation inside together take less time than evaluation on the whole mesh."""
    confined = one.filter_seconds + one.inside_seconds
    return Finding(confined < one.whole_seconds, f"{confined:.3g} s against {one.whole_seconds:.3g} s")


def _median_seconds(work: Callable[[], object]) -> float:
    work()  # loads compiled code
    spent: list[float] = []
    while len(spent) < REPETITIONS and sum(spent) < ENOUGH_SECONDS:
        start = perf_counter()
        work()
        spent.append(perf_counter() - start)
    return median(spent)

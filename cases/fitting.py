"""The adaptation of one group of data sites (section 4), for the SDM cases and for any mesh."""

from collections.abc import Callable

import numpy as np

from sdm_deflect.cases.case import RULES, AdaptationSettings
from sdm_deflect.cases.confine import DIRECTIONS
from sdm_deflect.cases.progress import Report
from sdm_deflect.deform.rbf.factor import Grown
from sdm_deflect.deform.rbf.greedy import Adaptation, Basis, adapt
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.points import IndexArray, farthest
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.sites import DataSites

Start = Callable[[Problem, IndexArray], Basis]
"""Makes the first interpolant of an adaptation: the problem, and the rows of the initial centres."""


def fit_group(sites: DataSites, surface: int, settings: AdaptationSettings, report: Report) -> Adaptation:
    """Adapt the centres of one group; its first `surface` sites are on the control surface, the rest pinned."""
    initial = initial_centers(sites, surface, (settings.initial_surface, settings.initial_hexahedron))
    return fit_from(sites, initial, settings, report)


def fit_from(
    sites: DataSites, initial: IndexArray, settings: AdaptationSettings, report: Report, start: Start = Grown.of
) -> Adaptation:
    """Adapt the centres of one group from the rows `initial` of its sites."""
    names = "".join(DIRECTIONS[c] for c in sites.components)

    def tell(text: str, fraction: float) -> None:
        report(f"{names}: {text}", fraction)

    rule = RULES[settings.rule]
    return adapt(sites, ThinPlateSpline(), initial, settings.options, rule=rule, basis=start, progress=tell)


def initial_centers(group: DataSites, surface: int, count: tuple[int, int]) -> IndexArray:
    """Return the rows of the initial centres: so many of the control surface's sites and of the hexahedron's."""
    own, zero = group.points[:surface], group.points[surface:]
    return np.concatenate([farthest(own, count[0]), surface + farthest(zero, count[1])])

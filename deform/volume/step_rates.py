"""The derivative of a step: how all nodes follow small changes of the moving nodes, on the same centres."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.threads import HERE, Runner
from sdm_deflect.deform.around.modifier import Linearized
from sdm_deflect.deform.confined import GROUPINGS, Confined
from sdm_deflect.deform.rbf.data_sites import DataSites, rows_of_parts

from .step import Start, along_axes, evaluate, sites_of


@dataclass(frozen=True, slots=True, eq=False)
class StepRates:
    """The derivative of a step at one displacement of the moving nodes.

    Attributes
    ----------
    start : the mesh at the start of the step.
    first, last : the fits for bound nodes and for free nodes; `first` is None without bound nodes.
    at_first, at_last : the derivative of each modifier in the two passes.
    """

    start: Start = field(repr=False)
    first: Confined | None = field(repr=False)
    last: Confined = field(repr=False)
    at_first: tuple[Linearized, ...] = field(repr=False)
    at_last: tuple[Linearized, ...] = field(repr=False)

    @classmethod
    def of(cls, start: Start, first: Confined | None, last: Confined, moving: FloatArray) -> "StepRates":
        """Linearise a step with these fits at a displacement (K, 3) of the moving nodes."""
        known, at_first = np.zeros((len(start.known), 3)), list[Linearized]()
        known[: len(moving)] = moving
        if first:
            further = [sites for modifier in start.modifiers for sites in modifier.sites(known, False)]
            fits = first.refit(sites_of(start, known, further, False), start.how.strategy)
            u = along_axes(start, fits(start.points[start.known[-start.bound :]]))
            for modifier in start.modifiers:
                at_first.append(modifier.linearized(u, known, False))
                u = modifier.correct(u, known, False)
            known[-start.bound :] = u
        at_last = tuple(modifier.linearized(known, known, True) for modifier in start.modifiers)
        return cls(start, first, last, tuple(at_first), at_last)

    def forward(self, moving: FloatArray, runner: Runner = HERE) -> FloatArray:
        """Return the rates (N, 3) of all nodes, given those (K, 3) of the moving nodes."""
        start, known = self.start, np.zeros((len(self.start.known), 3))
        known[: len(moving)] = moving
        if self.first:
            fits = self._fitted(self.first, known, self.at_first, False)
            rate = along_axes(start, fits(start.points[self._bound]))
            known[-start.bound :] = _corrected(rate, known, self.at_first)
        fits = self._fitted(self.last, known, self.at_last, True)
        out = np.zeros_like(start.points)
        out[start.free] = _corrected(evaluate(fits.interpolant, start.points[start.free], runner), known, self.at_last)
        out[start.known] = known
        return out

    def reverse(self, gradient: FloatArray) -> FloatArray:
        """Return the gradient (B, 3) by the known nodes, the moving ones first, given that (N, 3) by all nodes.

        Of bound nodes it is zero: they follow from the others.
        """
        start = self.start
        known = gradient[start.known]
        known += self._handed(self.last, gradient[start.free], start.free, self.at_last, None)
        if self.first:
            bound = np.array(known[-start.bound :])
            known[-start.bound :] = 0.0
            known += self._handed(self.first, bound, self._bound, self.at_first, start.directions)
        return known

    @property
    def _bound(self) -> IntArray:
        """The bound nodes."""
        return self.start.known[-self.start.bound :]

    def _fitted(self, fits: Confined, known: FloatArray, modifiers: Sequence[Linearized], last: bool) -> Confined:
        """Fit the rates (B, 3) of the known nodes in a pass."""
        further = [sites for modifier in modifiers for sites in modifier.sites(known)]
        return fits.refit(sites_of(self.start, known, further, last), self.start.how.strategy)

    def _handed(
        self, fits: Confined, gradient: FloatArray, nodes: IntArray, modifiers: Sequence[Linearized],
        directions: FloatArray | None,
    ) -> FloatArray:  # fmt: skip
        """Return the gradient (B, 3) by the known nodes, given that (M, 3) by the nodes of a pass.

        `directions` (3, 3) are those of the pass; None for x, y and z.
        """
        start, known = self.start, np.zeros((len(self.start.known), 3))
        for modifier in reversed(modifiers):
            gradient, more = modifier.reverse(gradient)
            known += more
        further = [(modifier, sites) for modifier in modifiers for sites in modifier.sites(known)]
        parts = sites_of(start, known, [sites for _, sites in further], directions is None)
        at_sites = [np.zeros((len(part), 3)) for part in parts]
        groups = GROUPINGS[start.how.strategy](parts)
        turned = gradient if directions is None else gradient @ directions.T
        for group, values in zip(groups, fits.reverse(start.points[nodes], turned), strict=True):
            _share_out(group, values, parts, at_sites)
        if directions is not None:
            at_sites = [values @ directions for values in at_sites]
        np.add.at(known, start.rows, at_sites[0])
        for (modifier, _), values in zip(further, at_sites[1:], strict=False):
            known += modifier.sites_reverse(values)
        return known


def _corrected(rate: FloatArray, known: FloatArray, modifiers: Sequence[Linearized]) -> FloatArray:
    for modifier in modifiers:
        rate = modifier.forward(rate, known)
    return rate


def _share_out(group: DataSites, values: FloatArray, parts: Sequence[DataSites], out: Sequence[FloatArray]) -> None:
    """Add values (S, k) at the sites of a group to those (R, 3) of the parts from which it was joined."""
    for part, rows, places in rows_of_parts(parts, group.components):
        out[part][rows[:, None], group.components] += values[places]

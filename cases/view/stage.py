"""One solve of a run, kept ready for other angles: the same data sites and centres, other displacements."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from sdm_deflect.cases.confine import Region
from sdm_deflect.cases.motion import FloatArray, IndexArray
from sdm_deflect.cases.view.factored import Factored
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.sites import DataSites


class Moved(NamedTuple):
    """Where the nodes of a stage are, and how far its interpolant is off at its data sites."""

    points: FloatArray  # (N, 3) m, of the whole mesh
    residual: float  # m, largest over all data sites and directions


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """One interpolation problem: its data sites and those of them that the run chose as centres.

    Attributes
    ----------
    components : directions of its columns.
    sites : (n, 3) data sites; the first of them are the surface's nodes, all others must not move.
    chosen : (C,) rows of the sites that are centres.
    system : values at the centres to values at the nodes inside (M) and at the sites (n), one below the other.
    """

    components: tuple[int, ...]
    sites: FloatArray
    chosen: IndexArray
    system: Factored

    @classmethod
    def of(cls, sites: DataSites, chosen: IndexArray, inside: FloatArray) -> Self:
        """Factorise for the chosen sites; `inside` (M, 3) are the nodes to move."""
        points = np.vstack([inside, sites.points])
        system = Factored.of(ThinPlateSpline(), sites.points[chosen], points)
        return cls(sites.components, sites.points, chosen, system)

    def moved(self, surface: FloatArray) -> tuple[FloatArray, float]:
        """Return the displacement (M, k) of the nodes inside for one (K, 3) of the surface, and the residual."""
        values = np.zeros((len(self.sites), len(self.components)))
        values[: len(surface)] = surface[:, self.components]
        result = self.system(values[self.chosen])
        inside = len(result) - len(self.sites)
        return result[:inside], float(np.abs(result[inside:] - values).max())


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A step of a run: from `base` (N, 3) to wherever the surface nodes (K,) are told to go.

    `held` are the positions (B, 3) of the region's held nodes.
    """

    base: FloatArray
    nodes: IndexArray
    region: Region
    held: FloatArray
    groups: tuple[Group, ...]

    def moved(self, target: FloatArray) -> Moved:
        """Bring the surface nodes to target (K, 3); the nodes inside follow, all others keep their bits."""
        points, region = self.base.copy(), self.region
        surface, worst = target - self.base[self.nodes], 0.0
        shift = np.zeros((len(region.inside), 3))
        for group in self.groups:
            inside, residual = group.moved(surface)
            shift[:, group.components] = inside
            worst = max(worst, residual)
        points[region.inside] += shift
        points[self.nodes] = target
        points[region.held] = np.where(region.held_components, self.held, points[region.held])
        return Moved(points, worst)

    def centres(self, points: FloatArray) -> FloatArray:
        """Return the centres (C, 3) of all directions, those on the surface where it is in points (N, 3)."""
        chosen = np.concatenate([np.where(g.chosen < len(self.nodes), g.chosen, -1) for g in self.groups])
        others = [g.sites[g.chosen[g.chosen >= len(self.nodes)]] for g in self.groups]
        surface = points[self.nodes[np.unique(chosen[chosen >= 0])]]
        return np.unique(np.vstack([surface, *others]), axis=0)

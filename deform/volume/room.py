"""Room for layers in a gap between two walls that may move differently."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.ties import clearly_less, first_largest
from sdm_deflect.deform.around.near_wall import MOST_RIGID

if TYPE_CHECKING:
    from .plan import BoxPlan


@dataclass(frozen=True, slots=True)
class Crowding:
    """Measured layers that do not fit into the rigid part of a gap.

    Attributes
    ----------
    patch : the wall below the worst of them.
    layers : their numbers, counted from the wall.
    place : (x, y, z) of the worst.
    thickness : height of the measured layers there.
    room : height up to which layers are rigid there: a third of the gap.
    """

    patch: str
    layers: tuple[int, ...]
    place: tuple[float, float, float]
    thickness: float
    room: float

    @classmethod
    def of(cls, plan: "BoxPlan") -> "Crowding | None":
        """Return what does not fit in a box; None if all measured layers do."""
        columns, boundary = plan.layers, plan.boundary
        nodes = np.intersect1d(columns.measured, plan.region.inside, assume_unique=True)
        if not len(nodes) or not plan.job.near_wall:
            return None
        nearby = plan.nearby(nodes)
        need = nearby.needed(np.ones(len(nodes), dtype=np.bool_), plan.reach)
        tight = clearly_less(MOST_RIGID, need) & (nearby.second < plan.reach)
        if not tight.any():
            return None
        worst = first_largest(np.where(tight, need, 0.0))
        number = np.zeros(len(boundary.mesh.points), dtype=np.intp)
        for k, layer in reversed([*enumerate(columns.cells, 1)]):
            for cells in layer:
                number[cells.top] = k
        wall = plan.sites.known[nearby.node[worst]]
        names = (*boundary.moving, *boundary.mesh.names)
        patch = next((name for name in names if wall in boundary.mesh.patch(name).nodes), "a wall")
        place = boundary.mesh.points[nodes[worst]].tolist()
        thickness = float(nearby.first[nearby.node == nearby.node[worst]].max())
        gap = float(nearby.first[worst] + nearby.second[worst])
        layers = np.unique(number[nodes[tight]]).tolist()
        return cls(patch, tuple(layers), tuple(place), thickness, MOST_RIGID / (1.0 + MOST_RIGID) * gap)

    def __str__(self) -> str:
        """Return it as a sentence with what helps."""
        first, last = self.layers[0], self.layers[-1]
        which = (
            f"layer {last} of {self.patch} has" if first == last else f"layers {first} to {last} of {self.patch} have"
        )
        place = ", ".join(f"{x:.4g}" for x in self.place)
        return (
            f"{which} no room in the gap at ({place}): the measured layers are {self.thickness:.3g} thick there, and "
            f"keep their heights up to {self.room:.3g}, a third of the gap; thinner layers, more room or an overset "
            "block help"
        )

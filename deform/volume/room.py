"""Room for layers in a gap between two walls that may move differently."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.ties import clearly_less, first_largest
from sdm_deflect.deform.around.near_wall import MOST_RIGID, Nearby
from sdm_deflect.meshing.mesh.layers import LayerColumns
from sdm_deflect.meshing.mesh.mesh import Mesh


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
    def of(
        cls, mesh: Mesh, columns: LayerColumns, nodes: IntArray, nearby: Nearby, walls: IntArray, reach: float,
        names: Sequence[str],
    ) -> "Crowding | None":  # fmt: skip
        """Return the measured layers that do not fit; None if all do.

        Parameters
        ----------
        mesh, columns : The mesh and its layers.
        nodes : (M,) nodes of measured layers.
        nearby : The nodes of walls, rows of `walls`, that are nearest to them.
        reach : Distance up to which nodes follow walls.
        names : Patches, in whose order the wall is named.
        """
        need = nearby.needed(np.ones(len(nodes), dtype=np.bool_), reach)
        tight = clearly_less(MOST_RIGID, need) & (nearby.second < reach)
        if not tight.any():
            return None
        worst = first_largest(np.where(tight, need, 0.0))
        number = np.zeros(len(mesh.points), dtype=np.intp)
        for k, layer in reversed([*enumerate(columns.cells, 1)]):
            for cells in layer:
                number[cells.top] = k
        wall = walls[nearby.node[worst]]
        patch = next((name for name in names if wall in mesh.patch(name).nodes), "a wall")
        x, y, z = mesh.points[nodes[worst]].tolist()
        thickness = float(nearby.first[nearby.node == nearby.node[worst]].max())
        gap = float(nearby.first[worst] + nearby.second[worst])
        layers = np.unique(number[nodes[tight]]).tolist()
        return cls(patch, tuple(layers), (x, y, z), thickness, MOST_RIGID / (1.0 + MOST_RIGID) * gap)

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

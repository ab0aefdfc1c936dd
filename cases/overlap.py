"""Hexahedra of several control surfaces must not overlap: each confines its own deformation."""

from itertools import combinations

import numpy as np
from scipy.optimize import linprog

from sdm_deflect.cases.confine import ConfinementError, Region
from sdm_deflect.deform.volume.hexahedron import Hexahedron

TOUCHING = 1e-9
"""Hexahedra that share less than this depth (m) only touch."""


def check_disjoint(regions: list[Region]) -> None:
    """Raise ConfinementError naming the first pair of hexahedra that overlap, and by how much."""
    for a, b in combinations(regions, 2):
        depth = shared_depth(a.hexahedron, b.hexahedron)
        if depth > TOUCHING:
            raise ConfinementError(
                f"the hexahedra of {a.surface} and {b.surface} overlap by {2000.0 * depth:.3g} mm; "
                "reduce confinement.up, down, aft or outboard"
            )


def shared_depth(a: Hexahedron, b: Hexahedron) -> float:
    """Radius (m) of the largest ball in both hexahedra; negative if they are apart (linear program)."""
    planes = np.vstack([a.planes, b.planes])
    constraints = np.column_stack([planes[:, :3], np.ones(len(planes))])
    result = linprog([0.0, 0.0, 0.0, -1.0], A_ub=constraints, b_ub=planes[:, 3], bounds=[(None, None)] * 4)
    return float(result.x[3])

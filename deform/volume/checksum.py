"""Checksum of the places that a plan may move: it tells the mesh of the plan from others.

Two meshes have the same checksum if the same distinct places lie inside the plan's boxes. The order of nodes, repeated
nodes and the partition of the mesh do not matter.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, distinct

Keys = NDArray[np.uint64]
FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers with well-mixed bits, one for each coordinate: 64-bit constants of Fibonacci hashing and of xxHash."""
LAST = np.uint64(0xBF58476D1CE4E5B9)
"""Odd number of the last multiplication, from SplitMix64."""


class Checksum(NamedTuple):
    """Checksum of a mesh.

    Attributes
    ----------
    points : number of all nodes of the mesh.
    places : number of distinct places of these nodes inside the boxes.
    total : sum of the hashes of these places, modulo 2^64.
    """

    points: int
    places: int
    total: int

    @classmethod
    def of(cls, points: int, keys: Iterable[Keys]) -> "Checksum":
        """Combine the keys of all parts of a mesh with that many nodes."""
        own = distinct(np.concatenate([np.empty(0, dtype=np.uint64), *keys]))
        return cls(points, len(own), int(own.sum(dtype=np.uint64)))


def place_keys(places: FloatArray) -> Keys:
    """Return the sorted distinct hashes (K,) of places (N, 3), which depend on every bit but the sign of zero."""
    bits = np.ascontiguousarray(places + 0.0).view(np.uint64)
    mixed = bits * FACTORS  # wraps around
    mixed ^= mixed >> np.uint64(29)
    keys = mixed.sum(axis=1, dtype=np.uint64) * LAST
    return distinct(keys ^ (keys >> np.uint64(32)))

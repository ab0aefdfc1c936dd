"""Solids with planar faces from their listed corners: no lofts, no booleans on thin parts."""

from collections.abc import Sequence

import numpy as np
from cadquery import Face, Shell, Solid, Vector, Wire
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Loops = tuple[FloatArray, ...]


def prism(first: FloatArray, last: FloatArray) -> Loops:
    """Faces between two rings of corners (n, 3) of equal length, with both ends closed."""
    following = np.roll(np.arange(len(first)), -1)
    strips = [
        np.array([first[i], first[j], last[j], last[i]]) for i, j in enumerate(following.tolist())
    ]
    return (first[::-1], last, *strips)


def solid(loops: Sequence[FloatArray]) -> Solid:
    """The solid inside planar polygons (n, 3) that close a volume, in any orientation."""
    faces = [Face.makeFromWires(Wire.makePolygon([Vector(*p) for p in loop], close=True)) for loop in loops]
    closed = Solid.makeSolid(Shell.makeShell(faces))
    return closed if closed.Volume() > 0.0 else Solid(closed.wrapped.Reversed())

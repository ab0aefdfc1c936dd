"""Deflect marked surfaces of any CFD mesh."""

from cases.own.api import Result, deflect, sweep
from cases.own.blended import Blended
from cases.own.box import Automatic, Given
from cases.own.job import Fitting
from cases.own.motion import Rotation
from cases.own.surface import Listed, OnPatches, TrailingEdge
from cases.own.table import Table

__all__ = [
    "Automatic", "Blended", "Fitting", "Given", "Listed", "OnPatches", "Result", "Rotation", "Table", "TrailingEdge",
    "deflect", "sweep",
]  # fmt: skip

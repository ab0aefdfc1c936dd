"""Deflect marked surfaces of any CFD mesh."""

from cases.own.api import Result, deflect, deflect_job, sweep
from cases.own.blended import Blended
from cases.own.box import Automatic, Given
from cases.own.job import Fitting, Job, Sliding
from cases.own.motion import Moving, Rotation
from cases.own.surface import Listed, OnPatches, TrailingEdge
from cases.own.table import Table

__all__ = [
    "Automatic", "Blended", "Fitting", "Given", "Job", "Listed", "Moving", "OnPatches", "Result", "Rotation", "Sliding",
    "Table", "TrailingEdge", "deflect", "deflect_job", "sweep",
]  # fmt: skip

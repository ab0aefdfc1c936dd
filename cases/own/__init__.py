"""Deflect marked surfaces of any CFD mesh."""

from sdm_deflect.cases.own.api import Result, deflect, deflect_job, sweep
from sdm_deflect.cases.own.blended import Blended
from sdm_deflect.cases.own.box import Automatic, Given
from sdm_deflect.cases.own.job import Fitting, Job, Sliding
from sdm_deflect.cases.own.motion import Moving, Rotation
from sdm_deflect.cases.own.surface import Listed, OnPatches, TrailingEdge
from sdm_deflect.cases.own.table import Table

__all__ = [
    "Automatic", "Blended", "Fitting", "Given", "Job", "Listed", "Moving", "OnPatches", "Result", "Rotation", "Sliding",
    "Table", "TrailingEdge", "deflect", "deflect_job", "sweep",
]  # fmt: skip

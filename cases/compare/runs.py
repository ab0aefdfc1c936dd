"""Finished runs, read to be compared."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sdm_deflect.cases.finished import finished
from sdm_deflect.cases.report.data import RUN, ReportData
from sdm_deflect.deform.base.errors import InputError, damaged
from sdm_deflect.deform.base.threads import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh

LEAST, MOST = 2, 8
"""Runs that a page compares."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """A finished run.

    Attributes
    ----------
    name : what it is called here: the name of its folder, or the path if several folders have that name.
    data : what its report shows, with the checks that it made itself.
    """

    name: str
    folder: Path
    data: ReportData = field(repr=False)


def read_runs(folders: Sequence[Path], progress: Progress = silent) -> tuple[ComparedRun, ...]:
    """Read the folders of `sdm run` or `sdm deflect`.

    Raises InputError or MeshFileError if they are too few or too many, one is given twice, or is none.
    """
    if not LEAST <= len(folders) <= MOST:
        raise InputError(f"{len(folders)} runs cannot be compared: give {LEAST} to {MOST} folders of finished runs")
    places = [folder.resolve() for folder in folders]
    for folder, place in zip(folders, places, strict=True):
        if places.count(place) > 1:
            raise InputError(f"{folder} is given twice: name each run once")
    names = [place.name for place in places]
    alone = len(set(names)) == len(names)
    found = []
    for i, (folder, name) in enumerate(zip(folders, names, strict=True)):
        progress(str(folder), i / len(folders))
        data = finished(folder).report_data()
        with damaged(folder, RUN):
            sum(check.passed and len(check.name) for check in data.checks)  # what the page says of each
        found.append(ComparedRun(name if alone else str(folder), folder, data))
    return tuple(found)


def alike(runs: Sequence[ComparedRun]) -> tuple[ComparedRun, ...]:
    """Return the runs whose undeflected mesh is that of the first one, itself included: their pictures fit."""
    first = runs[0].data.mesh
    return tuple(run for run in runs if run is runs[0] or _same_mesh(run.data.mesh, first))


def _same_mesh(one: Mesh, other: Mesh) -> bool:
    return (
        one.names == other.names and one.cell_counts == other.cell_counts and np.array_equal(one.points, other.points)
    )

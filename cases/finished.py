"""The folder of any finished run, opened."""

from pathlib import Path

from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.run.mesh_files import is_report
from sdm_deflect.deform.base.errors import InputError


def finished(folder: Path) -> FinishedRun:
    """Read the folder of `sdm run`, or that beside a mesh of `sdm deflect`.

    Raises InputError or MeshFileError if it is none, a file is missing or damaged, or the files do not belong together.
    """
    if is_report(folder):
        from sdm_deflect.cases.report.folder import FinishedJob

        return FinishedJob.of(folder)
    if (folder / "case.toml").is_file():
        from sdm_deflect.cases.aircraft.run_folder import FinishedCase

        return FinishedCase.of(folder)
    beside = folder.with_name(f"{folder.name.removesuffix(folder.suffix)}-deflected-report")
    hint = f"; try {beside}" if beside.is_dir() else ""
    raise InputError(f"{folder} is not the output folder of a run: it has no case.toml and no settings.toml{hint}")

"""Reading of any finished run's folder, and export of its mesh for flow solvers."""

from pathlib import Path

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.files import permitted_as
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.cases.run.mesh_files import is_report
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.zones import join_zones


def read_run(folder: Path) -> FinishedRun:
    """Read the folder of `sdm run`, or that beside a mesh of `sdm deflect`.

    Raises InputError or MeshFileError for another folder, missing or damaged files, or files of different runs.
    """
    if is_report(folder):
        return FinishedRun.of(folder)
    if (folder / "case.toml").is_file():
        from sdm_deflect.cases.aircraft.run_folder import finished_case

        return finished_case(folder)
    beside = folder.with_name(f"{folder.name.removesuffix(folder.suffix)}-deflected-report")
    hint = f"; try {beside}" if beside.is_dir() else ""
    raise InputError(f"{folder} is not the output folder of a run: it has no case.toml and no settings.toml{hint}")


def export_run(
    run: FinishedRun, form: str, which: str = "deflected", out: Path | None = None, progress: Progress = silent
) -> tuple[Path, tuple[str, ...]]:
    """Write a mesh of a finished run in another format, boundary names included.

    Parameters
    ----------
    run : nothing in its folder changes.
    form : a name in `FORMATS`.
    which : "deflected" or "undeflected".
    out : file to write (for OpenFOAM a folder); beside the run's folder if None. It appears whole or not at all.
    progress : called with what is being done.

    Returns
    -------
    out : what was written.
    lost : a sentence for each thing that the format cannot hold.

    Raises InputError if `out` lies in the folder under the name of a file there, MeshFileError if it cannot be written.
    """
    known, folder = FORMATS[form], run.folder.resolve()
    target = out or folder.with_name(f"{folder.name}-{which}{'' if known.folder else known.suffixes[0]}")
    if target.exists() and any(path.samefile(target) for path in folder.iterdir()):
        raise InputError(f"--out {target} is a file of the run; export to another name")
    mesh = run.plan.mesh if which == "undeflected" else run.plan.mesh.with_points(run.points)
    if known.zoned and run.validation and (background := run.validation.background) is not None:
        mesh = join_zones(("block", "background"), (mesh, background))
    with permitted_as(folder):
        return target, known.write(mesh, target, progress)

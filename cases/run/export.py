"""Meshes of finished runs in the files that flow solvers read."""

from pathlib import Path

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.meshing.files import permitted_as
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.zones import joined


def export_run(
    run: Path, form: str, which: str = "deflected", out: Path | None = None, progress: Progress = silent
) -> tuple[Path, tuple[str, ...]]:
    """Write a mesh of a finished run in another format, boundary names included.

    Parameters
    ----------
    run : output folder of a run; nothing in it changes.
    form : a name in `FORMATS`.
    which : "deflected" or "undeflected".
    out : file to write (for OpenFOAM a folder); beside `run` if None. It appears whole or not at all.
    progress : called with what is being done.

    Returns
    -------
    out : what was written.
    lost : a sentence for each thing that the format cannot hold.

    Raises
    ------
    InputError
        If `run` has no such mesh, or `out` lies in it under the name of one of the run's own files.
    MeshFileError
        If `out` cannot be written.
    """
    source = run / f"{which}.vtu"
    if not source.is_file():
        raise InputError(f"{run} is not the output folder of a run: it has no {which}.vtu")
    known = FORMATS[form]
    suffix = "" if known.folder else known.suffixes[0]
    target = out or run.resolve().with_name(f"{run.resolve().name}-{which}{suffix}")
    if target.exists() and any(path.samefile(target) for path in run.iterdir()):
        raise InputError(f"--out {target} is a file of the run; export to another name")
    progress(f"reading {source.name}", 0.0)
    mesh = read_vtu(source)
    background = run / "background.vtu"
    if background.is_file() and known.zoned:
        mesh = joined(("block", "background"), (mesh, read_vtu(background)))
    with permitted_as(run):
        return target, known.write(mesh, target, progress)

"""Meshes of finished runs in the files that flow solvers read; for OpenFOAM a case that it can start from."""

from pathlib import Path

from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.meshing.files.staged import fresh_folder, permitted_as
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.openfoam_write import field_file, patch_types, write_files
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.vtu import read_vtu
from sdm_deflect.meshing.formats.zones import joined

SPEED = 10.0
"""Speed (m/s) of the free stream along x."""
VISCOSITY = 1.5e-5
"""Kinematic viscosity (m2/s) of air."""
STREAM = f"({SPEED:g} 0 0)"
FIELDS = {"U": ("[0 1 -1 0 0 0 0]", STREAM), "p": ("[0 2 -2 0 0 0 0]", "0")}
"""Dimensions and free stream of velocity and kinematic pressure."""
CONDITIONS = {
    "U": {"patch": f"type freestreamVelocity; freestreamValue uniform {STREAM};", "wall": "type slip;"},
    "p": {"patch": "type freestreamPressure; freestreamValue uniform 0;", "wall": "type zeroGradient;"},
}
"""By field and type of patch; a plane of symmetry has its own type's condition."""
ROW = "    {patch}\n    {{\n        {condition}\n    }}\n"
PROPERTIES = {
    "constant/transportProperties": f"transportModel Newtonian;\nnu {VISCOSITY:g};\n",
    "constant/turbulenceProperties": "simulationType laminar;\n",
}


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
        if isinstance(known, OpenFoam):
            return target, write_case(mesh, target, progress)
        return target, known.write(mesh, target, progress)


def write_case(mesh: Mesh, out: Path, progress: Progress) -> tuple[str, ...]:
    """Write the folders ``constant``, ``system`` and ``0``; return what OpenFOAM cannot hold.

    The free stream enters and leaves through the patches of type ``patch``, walls slip, the flow is laminar: a start
    for settings of one's own. ``potentialFoam`` and ``simpleFoam`` run as it is.

    Raises MeshFileError if `out` is there and not empty, or cannot be written.
    """
    with fresh_folder(out) as beside:
        lost = OpenFoam().write(mesh, beside, progress)
        patches = patch_types(beside)
        fields = {
            f"0/{name}": field_file(dimensions, f"uniform {value}", patches, CONDITIONS[name], ROW)
            for name, (dimensions, value) in FIELDS.items()
        }
        write_files(beside, fields | PROPERTIES)
    return lost

"""Meshes of finished runs in the files that flow solvers read."""

from __future__ import annotations

from pathlib import Path

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.export_foam import write_case
from sdm_deflect.deform.mesh import Cells, Mesh, Patch
from sdm_deflect.meshing.formats.format import Progress, silent
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.formats.zones import joined
from sdm_deflect.meshing.mesh import TetMesh
from sdm_deflect.meshing.vtu import read_vtu

WHICH = ("deflected", "undeflected")
WITH_ZONES = ("cgns",)
"""Formats in which the background of a Chimera block is a second zone of the same file."""


def export_run(
    run: Path, form: str, which: str = "deflected", out: Path | None = None, progress: Progress = silent
) -> tuple[Path, tuple[str, ...]]:
    """Write a mesh of a finished run in another format, boundary names included.

    Parameters
    ----------
    run
        Output folder of a run; nothing in it changes.
    form
        A name in `FORMATS`.
    which
        One of `WHICH`.
    out
        File to write (for OpenFOAM a folder); beside `run` if None. It appears whole or not at all.
    progress
        Called with what is being done.

    Returns
    -------
    out
        What was written.
    lost
        A sentence for each thing that the format cannot hold.

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
    suffix = "" if form == "openfoam" else known.suffixes[0]
    target = out or run.resolve().with_name(f"{run.resolve().name}-{which}{suffix}")
    own = [path for path in run.iterdir() if target.exists() and path.samefile(target)]
    if own:
        raise InputError(f"--out {target} is a file of the run; export to another name")
    progress(f"reading {source.name}", 0.0)
    mesh = flow_mesh(read_vtu(source))
    background = run / "background.vtu"
    if background.is_file() and form in WITH_ZONES:
        mesh = joined(("block", "background"), (mesh, flow_mesh(read_vtu(background))))
    if isinstance(known, OpenFoam):
        return target, write_case(mesh, target, progress)
    return target, known.write(mesh, target, progress)


def flow_mesh(mesh: TetMesh) -> Mesh:
    """Return the tetrahedra and the triangles of each patch; patches without triangles are left out."""
    patches = tuple(Patch(name, (Cells("triangle", mesh.triangles_of(name)),)) for name in mesh.names[1:])
    return Mesh(mesh.points, (Cells("tetra", mesh.tets),), tuple(patch for patch in patches if len(patch)))

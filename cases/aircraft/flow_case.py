"""A finished run's mesh as a case for a flow solver, with all control surfaces as monitors."""

from pathlib import Path

from sdm_deflect.cases.aircraft.registry import resolve
from sdm_deflect.cases.flow.flow_case import FlowCase, write_flow
from sdm_deflect.cases.flow.setup import FreeStream, Hinge, Setup
from sdm_deflect.cases.run.mesh_files import Targets
from sdm_deflect.cases.run.output import output_files
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.geometry.datum import SURFACES, hinge_line
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.geometry.reference_values import reference_values
from sdm_deflect.meshing.files.staged import permitted_as
from sdm_deflect.meshing.formats.vtu import read_vtu


def export_flow(
    run: Path, flow: FlowCase, which: str = "deflected", out: Path | None = None, progress: Progress = silent
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write a mesh of a finished run as a case for a flow solver; all files appear, or none.

    Parameters
    ----------
    run : output folder of a run; nothing in it changes.
    flow : the case that is wanted.
    which : "deflected" or "undeflected".
    out : the folder of an OpenFOAM case, or the .su2 file; beside `run` if None.
    progress : called with what is being done.

    Returns
    -------
    files : what was written.
    lost : a sentence for each thing that the format cannot hold.

    Raises
    ------
    InputError
        If `run` has no such mesh, or that of a Chimera block, which is no flow by itself, or `out` is there already.
    """
    for name in ("case.toml", f"{which}.vtu"):
        if not (run / name).is_file():
            raise InputError(f"{run} is not the output folder of a run: it has no {name}")
    case = resolve("", config=run / "case.toml")
    if case.domain == "block":
        raise InputError(f"{run}: a Chimera block is no flow without its background; export both with --format cgns")
    suffix = "" if flow.solver == "openfoam" else ".su2"
    source, place = run / f"{which}.vtu", run.resolve()
    wanted = Targets.of(source, out or place.with_name(f"{place.name}-{which}{suffix}"), (case.angle,), flow=flow)
    wanted.check()
    mesh = read_vtu(source)
    with permitted_as(run), output_files(wanted.out.parent) as scratch:
        written, lost = write_flow(
            flow.solver,
            mesh,
            setup_of(case.fighter, flow.stream, flow.iterations, flow.far),
            scratch / wanted.out.name,
            progress,
        )
    return tuple(wanted.out.with_name(path.name) for path in written), lost


def setup_of(fighter: Fighter, stream: FreeStream, iterations: int, far: tuple[str, ...] = ()) -> Setup:
    """Return a flow about the aircraft, with its reference values and a monitor for each control surface."""
    values = reference_values(fighter)
    hinges = tuple(Hinge.through(name, [name], hinge_line(fighter, name)) for name in SURFACES)
    return Setup(stream, hinges, values.point, values.area, values.chord, values.span, iterations=iterations, far=far)

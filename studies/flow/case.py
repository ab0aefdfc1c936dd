"""Any deflected mesh as a case that OpenFOAM's rhoCentralFoam or SU2 starts as it is."""

from dataclasses import replace
from pathlib import Path

from sdm_deflect.base.errors import InputError
from sdm_deflect.geometry.datum import SURFACES, hinge_line
from sdm_deflect.geometry.parameters import Fighter, reference_values
from sdm_deflect.meshing.formats.format import fitting_names
from sdm_deflect.meshing.formats.registry import FORMATS, format_of
from sdm_deflect.meshing.formats.su2 import PARALLEL, UNFIT
from sdm_deflect.meshing.mesh.mesh import Mesh
from studies.flow.openfoam import write_case
from studies.flow.setup import FreeStream, Hinge, Setup
from studies.flow.su2 import check_name, configuration


def write_flow(mesh: Mesh, out: Path, setup: Setup) -> tuple[str, ...]:
    """Write a flow as a case of OpenFOAM, or as a mesh and a configuration of SU2 where `out` is called .su2.

    Returns a sentence for each thing that the format cannot hold. Raises InputError if there is no far field or no
    wall, several zones, or a file in the place of the case; MeshFileError as the solver's format does.
    """
    if len(mesh.zones) > 1:
        several = ", ".join(zone.name for zone in mesh.zones)
        raise InputError(f"{mesh.name}: a flow is of a mesh of one zone, and this one has several: {several}")
    if format_of(out).name == "openfoam":
        return write_case(mesh, out, setup)
    check_name(out)
    config = out.with_suffix(".cfg")
    for target in (out, config):
        if target.exists():
            raise InputError(f"{target} exists already; delete it, or choose another name")
    names = fitting_names(mesh.names, UNFIT, (PARALLEL,))
    kinds = {names[name]: kind for name, kind in setup.kinds_on(mesh).items()}
    text = configuration(kinds, out, replace(setup, hinges=tuple(hinge.renamed(names) for hinge in setup.hinges)))
    lost = FORMATS["su2"].write(mesh, out)
    config.write_text(text, encoding="utf-8")
    return lost


def setup_of(fighter: Fighter, stream: FreeStream, iterations: int) -> Setup:
    """Return a flow about the aircraft, with its reference values and a monitor for each control surface."""
    values = reference_values(fighter)
    hinges = tuple(Hinge.through(name, [name], hinge_line(fighter, name)) for name in SURFACES)
    return Setup(stream, hinges, values.point, values.area, values.chord, values.span, iterations=iterations)

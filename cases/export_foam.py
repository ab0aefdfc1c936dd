"""OpenFOAM cases that potentialFoam and simpleFoam can start from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.formats.folder import fresh_folder
from sdm_deflect.meshing.formats.format import Progress
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.openfoam_boundary import parse
from sdm_deflect.meshing.formats.openfoam_file import open_foam
from sdm_deflect.meshing.formats.openfoam_write import header

SPEED = 10.0
"""Speed (m/s) of the free stream along x."""
VISCOSITY = 1.5e-5
"""Kinematic viscosity (m2/s) of air."""
FIELDS = {
    "U": ("volVectorField", "[0 1 -1 0 0 0 0]", f"({SPEED:g} 0 0)"),
    "p": ("volScalarField", "[0 2 -2 0 0 0 0]", "0"),
}
CONDITIONS = {
    ("U", "patch"): f"type freestreamVelocity; freestreamValue uniform ({SPEED:g} 0 0);",
    ("p", "patch"): "type freestreamPressure; freestreamValue uniform 0;",
    ("U", "wall"): "type slip;",
    ("p", "wall"): "type zeroGradient;",
}
"""By field and type of patch; a plane of symmetry has its own type's condition."""


def write_case(mesh: Mesh, out: Path, progress: Progress) -> tuple[str, ...]:
    """Write the folders ``constant``, ``system`` and ``0``; return what OpenFOAM cannot hold.

    The free stream enters and leaves through the patches of type ``patch``, walls slip, the flow is laminar: a start
    for settings of one's own. ``potentialFoam`` and ``simpleFoam`` run as it is.

    Raises
    ------
    MeshFileError
        If `out` is there and not empty, or cannot be written.
    """
    with fresh_folder(out) as beside:
        lost = OpenFoam().write(mesh, beside, progress)
        patches = {patch.name: patch.type for patch in parse(open_foam(beside / MESH, "boundary").text())}
        (beside / "0").mkdir()
        for name in FIELDS:
            (beside / "0" / name).write_text(_field(name, patches), encoding="utf-8")
        properties = {
            "transportProperties": f"transportModel Newtonian;\nnu {VISCOSITY:g};\n",
            "turbulenceProperties": "simulationType laminar;\n",
        }
        for name, content in properties.items():
            (beside / "constant" / name).write_text(header("dictionary", name, "constant") + content, encoding="utf-8")
    return lost


def _field(name: str, patches: Mapping[str, str]) -> str:
    kind, dimensions, value = FIELDS[name]
    conditions = (
        f"    {patch}\n    {{\n        {CONDITIONS.get((name, form), f'type {form};')}\n    }}\n"
        for patch, form in patches.items()
    )
    return (
        f"{header(kind, name, '0')}dimensions {dimensions};\ninternalField uniform {value};\n"
        f"boundaryField\n{{\n{''.join(conditions)}}}\n"
    )

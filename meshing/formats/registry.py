"""The formats we know, by name and by suffix."""

from pathlib import Path

from sdm_deflect.meshing.formats.cgns import Cgns
from sdm_deflect.meshing.formats.format import Format, MeshFileError
from sdm_deflect.meshing.formats.gmsh import Gmsh
from sdm_deflect.meshing.formats.openfoam import OpenFoam
from sdm_deflect.meshing.formats.other import advice
from sdm_deflect.meshing.formats.su2 import Su2
from sdm_deflect.meshing.formats.vtu import Vtu

FORMATS: dict[str, Format] = {
    "su2": Su2(),
    "cgns": Cgns(),
    "gmsh": Gmsh(),
    "vtu": Vtu(),
    "openfoam": OpenFoam(),
}
"""Every format by its name; a format is added here and nowhere else."""


def format_of(path: str | Path) -> Format:
    """Return the format of a file by its suffix; a folder, or a new name without suffix, is an OpenFOAM case.

    What follows a point and begins with a digit is no suffix: ``alpha-12.5`` is a case.

    Raises
    ------
    MeshFileError
        If no format has that suffix.
    """
    path = Path(path)
    if path.is_dir() or not (path.is_file() or path.suffix[1:2].isalpha()):
        return FORMATS["openfoam"]
    for known in FORMATS.values():
        if path.suffix.lower() in known.suffixes:
            return known
    suffixes = sorted(suffix for known in FORMATS.values() for suffix in known.suffixes)
    hint = advice(path) or f"known are {', '.join(suffixes)}"
    raise MeshFileError(f"{path}: no mesh format has the suffix {path.suffix!r}; {hint}")

"""The formats we know, by name and by suffix."""

from pathlib import Path

from meshing.formats.format import Format, MeshFileError
from meshing.formats.su2 import Su2

FORMATS: dict[str, Format] = {
    "su2": Su2(),
}
"""Every format by its name; a format is added here and nowhere else."""


def format_of(path: Path) -> Format:
    """Return the format of a file by its suffix (an OpenFOAM case: by its folder constant/polyMesh).

    Raises
    ------
    MeshFileError
        If no format has that suffix.
    """
    for known in FORMATS.values():
        if path.suffix.lower() in known.suffixes:
            return known
    suffixes = sorted(suffix for known in FORMATS.values() for suffix in known.suffixes)
    raise MeshFileError(f"{path}: no mesh format has the suffix {path.suffix!r}; known are {', '.join(suffixes)}")

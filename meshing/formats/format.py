"""What every mesh format can do."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.mesh import FloatArray

Progress = Callable[[str, float], None]
"""Called with what is being done and the fraction done (nan where that is unknown)."""


def silent(text: str, fraction: float) -> None:
    """Report nothing."""


class MeshFileError(RuntimeError):
    """A mesh file is damaged, or holds what we cannot read; the message names the file and what is wrong."""


class Format(Protocol):
    """Reads, rewrites and writes the files of one format."""

    @property
    def name(self) -> str:
        """What users call it, such as ``"su2"``."""
        ...

    @property
    def suffixes(self) -> tuple[str, ...]:
        """The suffixes of its files, such as ``(".su2",)``; an OpenFOAM case is a folder."""
        ...

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """Return the mesh in a file.

        Raises
        ------
        MeshFileError
            If the file is missing, truncated, damaged, or not of this format.
        """
        ...

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """Write a copy of the file `source` with coordinates `points` (N, 3); all other bytes stay.

        `out` appears whole or not at all, and is never `source`. Coordinates that did not change keep their bytes.
        """
        ...

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """Write a mesh that came from elsewhere; return a sentence for each thing that the format cannot hold."""
        ...

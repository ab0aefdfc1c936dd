"""SU2 meshes (.su2) in three dimensions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.formats.format import Progress, silent
from sdm_deflect.meshing.formats.guard import about, fresh
from sdm_deflect.meshing.formats.standard import standard_cells
from sdm_deflect.meshing.formats.su2_read import read_zones
from sdm_deflect.meshing.formats.su2_source import Su2File
from sdm_deflect.meshing.formats.su2_write import copy_moved, write_mesh
from sdm_deflect.meshing.mesh import FloatArray


@dataclass(frozen=True, slots=True)
class Su2:
    """Text with one line for each point, cell and boundary face; markers by name, several zones in one file.

    Points of other processes (markers SEND_RECEIVE), free-form boxes, periodic data and comments are no part of the
    mesh; a rewritten file keeps them. Cells are one block of each shape, in the file's order within the shape.
    """

    name: str = "su2"
    suffixes: tuple[str, ...] = (".su2",)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        with about(path), path.open("rb") as file:
            return read_zones(Su2File.opened(file, partial(progress, f"reading {path.name}")))

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; each coordinate that changed is written with as many digits as it needs."""
        with fresh(out, source) as beside, about(source), source.open("rb") as file, beside.open("wb") as copy:
            copy_moved(Su2File.opened(file, partial(progress, f"writing {out.name}")), points, copy)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; polyhedra that are no usual cells, or faces of five corners, are a MeshFileError."""
        with fresh(out) as beside, about(out), beside.open("wb") as file:
            usual = replace(mesh, cells=standard_cells(mesh))
            renamed = write_mesh(usual, file, partial(progress, f"writing {out.name}"))
        lost = [f"patch {old} is marker {new}" for old, new in renamed.items()]
        if len(mesh.zones) > 1:
            lost.append("SU2 numbers its zones; the names " + ", ".join(z.name for z in mesh.zones) + " are lost")
        return tuple(lost)

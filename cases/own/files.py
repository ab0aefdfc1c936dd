"""The files of a deflection: the mesh in its own format or another, sensitivities, the report."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.progress import Report
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.meshing.formats.registry import format_of
from sdm_deflect.meshing.formats.vtu_write import write_vtu

SENSITIVITY = "d_points_d_angle"


def read(path: Path, progress: Report) -> Mesh:
    """Read a mesh file; MeshFileError, an error of one line, if that is impossible."""
    return format_of(path).read(path, progress)


def output_of(source: Path, out: Path | None) -> Path:
    """Return where the deflected mesh goes: `out`, or beside the source.

    Raises
    ------
    InputError
        If that is the source itself, a folder with files in it, or of an unknown format.
    """
    target = out or source.with_name(f"{source.stem}-deflected{source.suffix}")
    format_of(target)
    if target.exists() and target.samefile(source):
        raise InputError(f"--out {target}: this is the mesh that is read; name another file")
    if target.is_dir() and any(target.iterdir()):
        raise InputError(f"--out {target}: this folder exists already; name a new one, or delete it")
    return target


def numbered(out: Path, angle: float) -> Path:
    """Return the file of one angle of a sweep, such as ``wing-deflected_-12.su2``."""
    return out.with_name(f"{out.stem}_{angle:+g}{out.suffix}")


def write_mesh(source: Path, mesh: Mesh, points: FloatArray, out: Path, progress: Report) -> tuple[str, ...]:
    """Write the mesh with new points; return what the format of `out` cannot hold.

    In the format of the source only coordinates change; all else in the file stays, byte by byte.
    """
    own, other = format_of(source), format_of(out)
    if own is other:
        own.rewrite(source, points, out, progress)
        return ()
    return other.write(mesh.with_points(points), out, progress)


def write_sensitivity(mesh: Mesh, points: FloatArray, rates: FloatArray, out: Path, unit: str) -> None:
    """Write d(points)/d(angle) beside `out`: an .npz with the points, and a .vtu to look at."""
    base = out.with_name(f"{out.stem}-sensitivity")
    np.savez_compressed(
        base.with_name(base.name + ".npz"), points=points, unit=np.array(unit), d_points_d_angle=rates
    )
    cells = replace(mesh, points=points, patches=())
    write_vtu(base.with_name(base.name + ".vtu"), cells, {SENSITIVITY: rates})


def write_report(figures: Mapping[str, Any], out: Path) -> None:
    """Write the figures of a job as JSON beside `out`."""
    path = out.with_name(f"{out.stem}.json")
    path.write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")

"""Points, cells, patches and quality of any mesh file."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.deform.errors import InputError, printable
from sdm_deflect.deform.mesh import VOLUMES, Cells, Mesh
from sdm_deflect.deform.quality import POLYHEDRON, by_shape, oriented
from sdm_deflect.deform.reading import RATIO_VARIABLE, unpack_limit
from sdm_deflect.meshing.child import call
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.formats.registry import known_format

Json = dict[str, Any]

WORKER = "sdm_deflect.cases.vtk_worker"
MEMORY, SECONDS, SPEED = 1 << 29, 20.0, 1e8
"""Bytes and seconds for PyVista itself, and bytes of data that it reads in a second at least."""
NAMES = {
    "triangle": "triangles",
    "quad": "quadrilaterals",
    "tetra": "tetrahedra",
    "hexahedron": "hexahedra",
    "wedge": "prisms",
    "pyramid": "pyramids",
    POLYHEDRON: "polyhedra",
}


def inspect(path: Path) -> str:
    """Return what a mesh file holds, in a few lines; errors as in `inspected`."""
    found = inspected(path)
    plane = ", two-dimensional" if found["plane"] else ""
    lines = [f"{found['file']}: {found['points']} points, {found['cells']} cells{plane}"]
    if len(found["zones"]) > 1:
        lines.append("zones (points): " + _listed(found["zones"]))
    lines += [_quality_line(quality) for quality in found["quality"]]
    if found["left_handed"]:
        lines.append("the file counts the nodes of cells left-handed; judged accordingly")
    if found["patches"]:
        lines.append("patches (faces): " + _listed(found["patches"]))
    return "\n".join(printable(line) for line in lines)


def inspected(path: Path) -> Json:
    """Return what a mesh file holds.

    Returns
    -------
    dict
        ``file``; ``points`` and ``cells``, how many there are; ``plane``, whether the mesh is two-dimensional;
        ``zones``, name: number of points; ``patches``, name: number of faces; ``quality``, the fields of `Quality` for
        each type of cell; ``left_handed``, whether the file counts the nodes of cells the other way round.

    Raises InputError or MeshFileError if the file is missing, damaged, of an unknown format, or holds no cells with a
    volume.
    """
    if not path.exists():
        raise InputError(f"{path} is not a file")
    mesh = _read(path)
    parts = [(block, None, oriented(mesh.points, block)[0]) for block in mesh.cells]
    return {
        "file": str(path),
        "points": len(mesh.points),
        "cells": sum(len(block) for block in mesh.cells),
        "plane": mesh.plane,
        "zones": {zone.name: zone.stop - zone.start for zone in mesh.zones},
        "patches": {patch.name: len(patch) for patch in mesh.patches},
        "quality": [asdict(quality) for quality in by_shape(mesh.points, parts)],
        "left_handed": min(orientation for _, _, orientation in parts) < 0.0,
    }


def _read(path: Path) -> Mesh:
    known = known_format(path)
    mesh = known.read(path) if known else _read_other(path)
    if not sum(len(block) for block in mesh.cells):
        raise InputError(f"{path} holds no tetrahedra, hexahedra, prisms, pyramids or polyhedra, nor plane cells")
    return mesh


def _read_other(path: Path) -> Mesh:
    """Points and cells of a file that PyVista can read, without patches."""
    length = path.stat().st_size
    memory, seconds = MEMORY + unpack_limit(length), SECONDS + unpack_limit(length) / SPEED
    question = {"path": np.array(str(path)), "bytes": np.array(memory)}
    try:
        found = call(WORKER, question, seconds)
    except MeshingError as error:
        reason = " ".join(str(error).removeprefix(WORKER).split())[:300]
        raise InputError(
            f"{path} cannot be read as a mesh: the process that reads it {reason} (it may take {memory / 1e6:.0f} MB; "
            f"{RATIO_VARIABLE} allows more)"
        ) from error
    cells = tuple(Cells(shape, found[shape].astype(np.intp)) for shape in VOLUMES if shape in found)
    return Mesh(found["points"].astype(np.float64), cells, ())


def _quality_line(found: Json) -> str:
    line = (
        f"{found['cells']} {NAMES[found['shape']]}, {found['inverted']} inverted; {found['measure']} "
        f"min {found['min']:.3f}, 1 % {found['p01']:.3f}, mean {found['mean']:.3f}"
    )
    if found["shape"] == POLYHEDRON:  # an ideal cell of many faces is far below 1
        return line
    return f"{line}, {found['below_0_2']:.3%} below 0.2, {found['below_0_4']:.3%} below 0.4"


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())

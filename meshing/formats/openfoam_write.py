"""The files of an OpenFOAM mesh, written anew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.meshing.formats.openfoam_boundary import FoamPatch, kind_of, words, written
from sdm_deflect.meshing.formats.polyhedral import Bounded, bounded
from sdm_deflect.meshing.mesh import FloatArray

LABEL, SCALAR = np.dtype("<i4"), np.dtype("<f8")
FLAT = 1e-9
"""Fraction of a patch's extent by which its nodes may leave a plane that is called planar."""
BANNER = "// Written by sdm-deflect.\n"


def header(kind: str, name: str, folder: str = "constant/polyMesh", form: str = "ascii", note: str = "") -> str:
    """Return the header of an OpenFOAM file."""
    lines = ["version 2.0", f"format {form}", f"class {kind}", f'location "{folder}"', f"object {name}"]
    if form == "binary":
        lines.insert(2, f'arch "LSB;label={8 * LABEL.itemsize};scalar={8 * SCALAR.itemsize}"')
    if note:
        lines.append(f'note "{note}"')
    return "FoamFile\n{\n" + "".join(f"    {line};\n" for line in lines) + "}\n" + BANNER + "\n"


def write_mesh(mesh: Mesh, folder: Path) -> tuple[str, ...]:
    """Write points, faces, owner, neighbour (binary) and boundary (text); return what could not be kept.

    Raises
    ------
    MeshFileError
        See `bounded`.
    """
    whole = bounded(mesh)
    cells = whole.cells
    note = (
        f"nPoints:{len(mesh.points)}  nCells:{len(cells)}  nFaces:{len(cells.faces)}  "
        f"nInternalFaces:{len(cells.neighbour)}"
    )
    folder.mkdir(parents=True)
    _binary(folder / "points", "vectorField", [mesh.points.astype(SCALAR)])
    lists = [cells.faces.offsets.astype(LABEL), cells.faces.nodes.astype(LABEL)]
    _binary(folder / "faces", "faceCompactList", lists)
    _binary(folder / "owner", "labelList", [cells.owner.astype(LABEL)], note)
    _binary(folder / "neighbour", "labelList", [cells.neighbour.astype(LABEL)], note)
    patches, renamed = _patches(mesh, whole)
    content = header("polyBoundaryMesh", "boundary") + written(patches)
    (folder / "boundary").write_text(content, encoding="utf-8")
    return (*whole.lost, *renamed)


def _patches(mesh: Mesh, whole: Bounded) -> tuple[list[FoamPatch], list[str]]:
    names = words([name for name, _, _ in whole.patches])
    patches = []
    for name, start, count in whole.patches:
        own = whole.cells.faces.rows(start, start + count).nodes
        patches.append(FoamPatch(names[name], kind_of(name, is_planar(mesh.points[own])), count, start))
    return patches, [f"patch {old} is called {new}" for old, new in names.items() if old != new]


def is_planar(points: FloatArray) -> bool:
    """Whether points (K, 3) lie in a plane."""
    if not len(points):
        return True
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return bool(np.abs(centred @ axes[:, 0]).max() <= FLAT * np.abs(centred).max())


def _binary(path: Path, kind: str, lists: Sequence[NDArray[np.generic]], note: str = "") -> None:
    with path.open("wb") as file:
        file.write(header(kind, path.name, form="binary", note=note).encode())
        for values in lists:
            file.write(b"%d\n" % len(values))
            if len(values):
                file.write(b"(")
                file.write(np.ascontiguousarray(values).data)
                file.write(b")\n")

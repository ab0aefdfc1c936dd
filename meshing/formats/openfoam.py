"""OpenFOAM cases: the mesh in the folder ``constant/polyMesh``.

New meshes come with the settings that checkMesh needs.
"""

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.files import fresh_folder
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import Polyhedra, Zone
from sdm_deflect.meshing.mesh.images import THIN
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.precision import DOUBLE, fewest_bits

from .format import Format, fitting_names
from .openfoam_case import (
    case_folder,
    copy_case,
    mesh_folder,
    meshes_beside,
    move_points,
    pairs_of,
    patches_of,
    points_folder,
    read_foam,
)
from .openfoam_files import HEAD, MESH, FoamPatch, faces, labels, parse, read_header, vectors
from .openfoam_pieces import in_pieces
from .polyhedra import Bounded, check_cells, polyhedral_cells
from .shapes import refuse_plane
from .zones import unwritten

LABEL, SCALAR = np.dtype("<i4"), np.dtype("<f8")
# Largest distance of a planar patch's nodes from its plane, as a share of the patch's extent.
FLAT = 1e-9
# Pattern of what a name in OpenFOAM must not contain; a name must not begin like a number either.
UNFIT = r"[\s\"'/;{}()\[\]$#\\]|^(?=[\d+.-])"
BANNER = "// Written by sdm-deflect.\n"
SYMMETRY = ("symmetry", "sym")
OPEN = ("far", "inlet", "outlet", "inflow", "outflow", "freestream", "chimera", "overset", "interface", "volume")
# What a ``controlDict`` says, unless a solver needs something else.
CONTROL = {
    "application": "simpleFoam", "startFrom": "startTime", "startTime": 0, "stopAt": "endTime", "endTime": 500,
    "deltaT": 1, "writeControl": "timeStep", "writeInterval": 500, "purgeWrite": 1, "writeFormat": "binary",
}  # fmt: skip
# Classes of files by their names; all others are dictionaries.
CLASSES = {
    "U": "volVectorField", "p": "volScalarField", "T": "volScalarField", "zoneID": "volScalarField",
    "pointDisplacement": "pointVectorField",
}  # fmt: skip
SCHEMES = ("ddt", "grad", "div", "laplacian", "interpolation", "snGrad")


def header(kind: str, name: str, folder: str = MESH.as_posix(), form: str = "ascii", note: str = "") -> str:
    """Return the header of an OpenFOAM file."""
    lines = ["version 2.0", f"format {form}", f"class {kind}", f'location "{folder}"', f"object {name}"]
    if form == "binary":
        lines.insert(2, f'arch "LSB;label={8 * LABEL.itemsize};scalar={8 * SCALAR.itemsize}"')
    if note:
        lines.append(f'note "{note}"')
    return "FoamFile\n{\n" + "".join(f"    {line};\n" for line in lines) + "}\n" + BANNER + "\n"


def write_mesh(mesh: Mesh, folder: Path, types: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Write points, faces, owner, neighbour (binary) and boundary (text); return a sentence for each loss.

    The sides of a case one cell thick keep their types. Other patches have the type in `types`, by name, or else
    `kind_of`. Errors as of `polyhedral_cells`.
    """
    whole = polyhedral_cells(mesh)
    cells = whole.cells
    note = (
        f"nPoints:{len(mesh.points)}  nCells:{len(cells)}  nFaces:{len(cells.faces)}  "
        f"nInternalFaces:{len(cells.neighbour)}"
    )
    folder.mkdir(parents=True)
    write_list(folder / "points", "vectorField", [mesh.points.astype(SCALAR)])
    lists = [cells.faces.offsets.astype(LABEL), cells.faces.nodes.astype(LABEL)]
    write_list(folder / "faces", "faceCompactList", lists)
    write_list(folder / "owner", "labelList", [cells.owner.astype(LABEL)], note)
    write_list(folder / "neighbour", "labelList", [cells.neighbour.astype(LABEL)], note)
    patches, renamed = _patches(mesh, whole, types or {})
    content = header("polyBoundaryMesh", "boundary") + boundary_text(patches)
    (folder / "boundary").write_text(content, encoding="utf-8")
    return (*whole.lost, *renamed, *unwritten(pair for pair in mesh.periodic if not pair.thin))


def _patches(mesh: Mesh, whole: Bounded, types: Mapping[str, str]) -> tuple[list[FoamPatch], list[str]]:
    names = fitting_names([name for name, _, _ in whole.patches], UNFIT)
    thin = {patch.name: str(patch.constraint) for patch in mesh.patches if patch.constraint in THIN}
    patches = []
    for name, start, count in whole.patches:
        patch_nodes = whole.cells.faces.rows(start, start + count).nodes
        kind = kind_of(name, is_planar(mesh.points[patch_nodes]), count_sides(mesh.points, patch_nodes) > 0)
        patches.append(FoamPatch(names[name], thin.get(name, types.get(name, kind)), count, start))
    return patches, [f"patch {old} is called {new}" for old, new in names.items() if old != new]


def is_planar(points: FloatArray) -> bool:
    """Whether points (K, 3) lie in a plane."""
    if not len(points):
        return True
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return bool(np.abs(centred @ axes[:, 0]).max() <= FLAT * np.abs(centred).max())


def write_list(
    path: Path, kind: str, lists: Sequence[NDArray[np.generic]], note: str = "", location: str = MESH.as_posix()
) -> None:
    """Write a binary file of lists, one after another."""
    with path.open("wb") as file:
        file.write(header(kind, path.name, location, "binary", note).encode())
        for values in lists:
            file.write(b"%d\n" % len(values))
            if len(values):
                file.writelines((b"(", np.ascontiguousarray(values).data, b")\n"))


def boundary_text(patches: Sequence[FoamPatch]) -> str:
    """Return the content of a `boundary` file."""
    lines = [f"{len(patches)}", "("]
    for patch in patches:
        group = "    inGroups 1(wall);\n" if patch.type == "wall" else ""
        lines.append(
            f"{patch.name}\n{{\n    type {patch.type};\n{group}    nFaces {patch.count};\n"
            f"    startFace {patch.start};\n}}"
        )
    return "\n".join([*lines, ")", ""])


def count_sides(points: FloatArray, nodes: IntArray) -> int:
    """Count the sides of the bounding box of points (N, 3) on which nodes (K,) lie; a plane mesh has four."""
    return int(touches_sides(points, nodes).sum()) if len(nodes) else 0


def touches_sides(points: FloatArray, nodes: IntArray) -> BoolArray:
    """Return whether nodes reach the low and the high side (2, 3) of each axis with an extent."""
    low, high, places = points.min(axis=0), points.max(axis=0), points[nodes]
    near = FLAT * (high - low).max()
    reached = np.array([places.min(axis=0) <= low + near, places.max(axis=0) >= high - near])
    return np.asarray(reached & (high - low > near), dtype=np.bool_)


def kind_of(name: str, planar: bool, outside: bool = True) -> str:
    """Return the type of a patch by its name; a name without a known word is a wall.

    A curved plane of symmetry is a ``symmetry``: OpenFOAM allows ``symmetryPlane`` on planes alone. A patch called
    inlet that does not reach the outside of the mesh is a wall, such as the closed inlet of an aircraft.
    """
    low = name.lower()
    if any(low.startswith(word) for word in SYMMETRY):
        return "symmetryPlane" if planar else "symmetry"
    return "patch" if outside and any(word in low for word in OPEN) else "wall"


def control(**changed: object) -> str:
    """Return a ``controlDict``: `CONTROL` with changes and additions; entries that are None are left out."""
    return "".join(f"{name:<15} {value};\n" for name, value in {**CONTROL, **changed}.items() if value is not None)


def write_files(case: Path, files: Mapping[str, str]) -> None:
    """Write text files of a case, given by their paths in it; each gets its header."""
    for name, content in files.items():
        path = case / name
        path.parent.mkdir(exist_ok=True)
        kind = CLASSES.get(path.name, "dictionary")
        path.write_text(header(kind, path.name, path.parent.name) + content, encoding="utf-8")


# Settings for checkMesh and decomposePar; a solver needs its own.
BARE = {
    "system/controlDict": control(runTimeModifiable="false"),
    "system/fvSchemes": "".join(f"{what}Schemes {{ }}\n" for what in SCHEMES),
    "system/fvSolution": "solvers { }\n",
}


class OpenFoam(Format):
    """A case folder, its folder ``polyMesh``, or a file such as ``case.foam`` in the case folder.

    Cells are polyhedra, patches are polygons. Files may be text or binary (labels of 32 or 64 bits) and packed
    (.gz). Patch types are read if they bind nodes, see `pairs_of`; zones and sets are not read. A rewritten case
    keeps them, and every file but `points`; only the parts of a decomposed case (``processor0`` and so on) are not
    copied. Meshes of time folders are not read. Output is a folder that must not exist, or be empty.
    """

    name = "openfoam"
    suffixes = (".foam",)

    folder = True
    for_workers = "OpenFOAM cases in binary"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        return in_pieces(path)

    def files(self, path: Path) -> list[Path]:
        """See `Format.files`: those in the folder of a case's mesh."""
        return [file for file in sorted(mesh_folder(path).iterdir()) if file.is_file()]

    def size(self, path: Path) -> int:
        lists = ("points", "faces", "owner", "neighbour")
        return sum(file.stat().st_size for name in lists for file in mesh_folder(path).glob(f"{name}*"))

    def place(self, path: Path) -> Path:
        """See `Format.place`: the folder of a case."""
        return case_folder(path)

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        folder = mesh_folder(path)
        points = read_foam(folder, "points", vectors).values
        progress("reading faces", 0.3)
        polygons, owner = read_foam(folder, "faces", faces), read_foam(folder, "owner", labels)
        neighbour = read_foam(folder, "neighbour", labels)[: len(owner)]
        progress("reading patches", 0.8)
        patches = read_foam(folder, "boundary", lambda file: parse(file.text()))
        with about(folder):
            cells = Polyhedra(polygons, owner, neighbour[neighbour >= 0])
            check_cells(cells)
            named = patches_of(patches, len(polygons), len(cells.neighbour), polygons.rows)
            mesh = Mesh(points, (cells,), named, notes=meshes_beside(case_folder(path)))
            return replace(mesh, periodic=pairs_of(patches, named, lambda nodes: points[nodes]))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        if source is None:
            return DOUBLE
        plain = points_folder(source) / "points"
        with about(plain), plain.open("rb") if plain.is_file() else gzip.open(f"{plain}.gz") as file:
            head = read_header(file.read(HEAD), plain.name, HEAD)
        return fewest_bits([head.kind("scalar")] if head.binary else [])

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; `out` is a copy of the case (of the folder ``polyMesh`` if `source` is one)."""
        with copy_case(source, out, progress) as mesh:
            move_points(mesh_folder(source), mesh, points)

    def points(self, path: Path, progress: Progress = silent) -> tuple[FloatArray, tuple[Zone, ...]]:
        """See `Format.points`; `path` may be a part of a decomposed case."""
        return read_foam(points_folder(path), "points", vectors).values, ()

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; types of patches follow from their names, the case can be read by checkMesh.

        A name that begins with ``sym`` is a plane of symmetry; one with ``far``, ``inlet``, ``outlet``,
        ``chimera`` or ``overset`` in it a ``patch``; all others are walls.
        """
        refuse_plane(mesh, "OpenFOAM")
        with fresh_folder(case_folder(out)) as beside, about(out):
            progress(f"writing {out.name}", 0.0)
            lost = write_mesh(mesh, beside / MESH)
            write_files(beside, BARE)
            (beside / "case.foam").touch()
        return lost

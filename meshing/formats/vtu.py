"""VTK unstructured grids (.vtu) as meshes with patches."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.mesh.mesh import CORNERS, Cells, Mesh, Patch, Polygons, Polyhedra
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.deform.mesh.precision import DOUBLE
from sdm_deflect.deform.mesh.quality import quality_of
from sdm_deflect.meshing.files.staged import fresh
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points, fewest_bits
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.periodic import unwritten
from sdm_deflect.meshing.formats.polyhedra import polyhedra
from sdm_deflect.meshing.formats.shapes import check_faces, oriented, polygons
from sdm_deflect.meshing.formats.vtu_file import Array, DataArray, GridPiece, VtuFile
from sdm_deflect.meshing.formats.vtu_write import POLYGON, POLYHEDRON, TYPES, write_vtu
from sdm_deflect.meshing.mesh import VOLUME, Skin, tetrahedral

PIXEL, VOXEL = 8, 11
FLAT = {TYPES["triangle"]: "triangle", TYPES["quad"]: "quad", PIXEL: "quad"}
SOLID = {TYPES[shape]: shape for shape in ("tetra", "pyramid", "wedge", "hexahedron")} | {VOXEL: "hexahedron"}
IMAGES = {VOXEL: [0, 1, 3, 2, 4, 5, 7, 6], PIXEL: [0, 1, 3, 2]}
"""Nodes of cells of image data, in the order of the other cell."""
LINES = {TYPES["line"]: "line"}
PASSED = (0, 1, 2, 3, 4)
"""Empty cells, vertices and lines."""
LABELS = (
    "patch", "patch_id", "patchid", "marker", "markers", "boundary", "boundaryid", "cellentityids", "gmsh:physical",
    "su2:tag", "ref",
)  # fmt: skip
"""Cell arrays that tell patches apart, the first that is there, in lower case."""
NAMES = "patch_names"


@registered("vtu", ".vtu")
class Vtu(Format):
    """Any linear cells and polyhedra; patches are labels of the faces among the cells.

    Labels are the cell array ``patch`` with the names in the field array ``patch_names``, as our runs write them; else
    the first array of a usual name such as ``marker`` or ``CellEntityIds``, whose patches are called ``marker_3``;
    else all faces are one patch ``boundary``. Points and lines are passed over; but without volume cells, if all points
    have one z, the faces are the cells of a plane mesh, and lines the faces on its boundary. Coordinates in single
    precision stay in single precision.
    """

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        progress(f"reading {path.name}", 0.0)
        with about(path):
            return _mesh(VtuFile(path.read_bytes()))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        """See `Format.real`."""
        if source is None:
            return DOUBLE
        with about(source):
            arrays = map(_points, VtuFile(source.read_bytes()).pieces)
            return fewest_bits(np.dtype(own.attributes["type"].lower()) for own in arrays)

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; of encoded coordinates, the bytes of all change if one does."""
        with about(source):
            file = VtuFile(source.read_bytes())
            check_points(points, sum(piece.points for piece in file.pieces))
            starts = np.cumsum([piece.points for piece in file.pieces])
            progress(f"writing {out.name}", 0.5)
            data = file.replaced(list(zip(map(_points, file.pieces), np.split(points, starts), strict=False)))
        with fresh(out, source) as beside:
            beside.write_bytes(data)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; zones become one grid."""
        return self._write(mesh, out, progress)

    def write_moved(self, mesh: Mesh, points: FloatArray, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write_moved`; the point array ``displacement`` and the cell array ``quality`` show the change."""
        quality = np.concatenate([np.empty(0), *(quality_of(points, block) for block in mesh.cells)])
        arrays = {"displacement": points - mesh.points}, {"quality": quality}
        return self._write(mesh.with_points(points), out, progress, *arrays)

    def _write(self, mesh: Mesh, out: Path, progress: Progress, *arrays: Mapping[str, Array]) -> tuple[str, ...]:
        progress(f"writing {out.name}", 0.0)
        write_vtu(out, mesh, *arrays)
        return (*(["its zones are one grid"] if len(mesh.zones) > 1 else []), *unwritten(mesh.periodic))


def read_vtu(path: Path) -> Mesh:
    """Read a mesh of tetrahedra that `write_vtu` wrote.

    Raises MeshFileError if the file does not exist, is damaged, or lacks our arrays.
    """
    with about(path):
        file = VtuFile(path.read_bytes())
        grid = _grid(file)
        wide = grid.types == TYPES["tetra"]
        if not (wide | (grid.types == TYPES["triangle"])).all():
            raise MeshFileError("holds cells other than tetrahedra and triangles")
        if NAMES not in file.fields:
            raise MeshFileError(f"has no field array {NAMES}")
        kinds = (TYPES["tetra"], TYPES["triangle"])
        tets, triangles = (grid.block(kind, np.flatnonzero(grid.types == kind)).nodes for kind in kinds)
        patch, face = (_cell_array(file, name)[~wide].astype(np.intp) for name in ("patch", "cad_face"))
        names = file.strings(file.fields[NAMES])
        if names[:1] != (VOLUME,):
            raise MeshFileError(f"{NAMES} must start with {VOLUME!r}, but are {', '.join(names)}")
        return tetrahedral(grid.points, tets, Skin(triangles, patch - 1, face), names[1:])


def vtu_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays on the nodes and on the cells of a file's first piece by name.

    Raises MeshFileError if the file does not exist, or is damaged.
    """
    with about(path):
        file = VtuFile(path.read_bytes())
        piece = file.pieces[0]
        sections = {"PointData": piece.points, "CellData": piece.cells}
        return {
            name: file.values(array, rows)
            for section, rows in sections.items()
            for name, array in piece.sections.get(section, {}).items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Points (N, 3); types (C,) of cells; nodes of all cells, and where those of each begin; faces of polyhedra."""

    points: FloatArray = field(repr=False)
    types: NDArray[np.uint8] = field(repr=False)
    nodes: IntArray = field(repr=False)
    offsets: IntArray = field(repr=False)
    faces: Polygons = field(repr=False)
    cell: IntArray = field(repr=False)

    def block(self, kind: int, rows: IntArray) -> Cells:
        """Cells of one type."""
        shape = (SOLID | FLAT | LINES)[kind]
        corners = CORNERS[shape]
        if np.any(np.diff(self.offsets)[rows] != corners):
            raise MeshFileError(f"some cells of type {shape} have other than {corners} nodes; the file is damaged")
        own = self.nodes[self.offsets[rows][:, None] + np.arange(corners)]
        return Cells(shape, own[:, IMAGES[kind]] if kind in IMAGES else own)

    def polygons(self, rows: IntArray) -> Polygons:
        """Cells of any number of nodes."""
        sizes = np.diff(self.offsets)[rows]
        first = np.repeat(self.offsets[rows] - np.cumsum(sizes) + sizes, sizes)
        return polygons(self.nodes[first + np.arange(len(first))], sizes)


def _mesh(file: VtuFile) -> Mesh:
    grid = _grid(file)
    if not len(grid.types):
        raise MeshFileError("there are no cells")
    other = grid.types[~np.isin(grid.types, [*SOLID, *FLAT, *PASSED, POLYGON, POLYHEDRON])]
    if len(other):
        raise MeshFileError(f"{len(other)} cells are of VTK's type {other[0]}, which is not linear or not known")
    z = grid.points[:, 2]
    plane = (
        bool(z.min(initial=np.inf) == z.max(initial=-np.inf)) and not np.isin(grid.types, [*SOLID, POLYHEDRON]).any()
    )
    if plane and POLYGON in grid.types:
        raise MeshFileError("has polygons; cells of a plane mesh are triangles and quads")
    solids: list[Cells | Polyhedra] = []
    for kind in _kinds(grid.types):
        if kind == POLYHEDRON:
            solids.append(polyhedra(grid.faces, grid.cell, len(grid.points)))
        elif kind in (FLAT if plane else SOLID):
            solids.append(oriented(grid.points, grid.block(kind, np.flatnonzero(grid.types == kind))))
    mesh = Mesh(grid.points, tuple(solids), _patches(file, grid, (*LINES,) if plane else (*FLAT, POLYGON)))
    check_faces(mesh)
    return mesh


def _kinds(types: NDArray[np.uint8]) -> list[int]:
    """Types in the order in which they first appear."""
    kinds, first = np.unique(types, return_index=True)
    return [int(kind) for kind in kinds[np.argsort(first)]]


def _patches(file: VtuFile, grid: _Grid, kinds: tuple[int, ...]) -> tuple[Patch, ...]:
    flat = np.flatnonzero(np.isin(grid.types, kinds))
    labels, names = _labels(file)
    own = labels[flat]
    found: dict[str, list[Cells | Polygons]] = {}
    for label in np.unique(own).tolist():
        name = names.get(label, f"{names[-1]}_{label}")
        rows = flat[own == label]
        for kind in _kinds(grid.types[rows]):
            some = rows[grid.types[rows] == kind]
            found.setdefault(name, []).append(grid.polygons(some) if kind == POLYGON else grid.block(kind, some))
    return tuple(Patch(name, tuple(faces)) for name, faces in found.items())


def _labels(file: VtuFile) -> tuple[IntArray, dict[int, str]]:
    """Label of every cell, and names of labels; name -1 begins the names of all others."""
    stored = {name.lower(): name for name in file.pieces[0].sections.get("CellData", {})}
    for name in (stored[known] for known in LABELS if known in stored):
        values = _cell_array(file, name)
        if values.ndim == 1:
            names = dict(enumerate(file.strings(file.fields[NAMES]))) if NAMES in file.fields else {}
            return values.astype(np.intp), {**names, -1: name}
    return np.zeros(sum(piece.cells for piece in file.pieces), dtype=np.intp), {-1: "boundary", 0: "boundary"}


def _cell_array(file: VtuFile, name: str) -> Array:
    found = [piece.sections.get("CellData", {}).get(name) for piece in file.pieces]
    if None in found:
        raise MeshFileError(f"has no cell array {name}")
    parts = zip(found, file.pieces, strict=True)
    return np.concatenate([file.values(array, piece.cells) for array, piece in parts if array is not None])


def _points(piece: GridPiece) -> DataArray:
    return _array(piece, "Points", next(iter(piece.sections.get("Points", {})), "Points"))


def _array(piece: GridPiece, section: str, name: str) -> DataArray:
    found = piece.sections.get(section, {}).get(name)
    if found is None:
        raise MeshFileError(f"is damaged: it has no array {name} in {section}")
    return found


def _grid(file: VtuFile) -> _Grid:
    """All pieces of a file, one after another."""
    parts = [_part(file, piece) for piece in file.pieces]
    if len(parts) == 1:
        return parts[0]
    counts = [(len(p.points), len(p.nodes), len(p.faces.nodes), np.count_nonzero(p.types == POLYHEDRON)) for p in parts]
    points, nodes, faces, cells = np.cumsum([(0, 0, 0, 0), *counts], axis=0).T

    def merged(arrays: Iterable[IntArray], starts: IntArray) -> IntArray:
        return np.concatenate([array + start for array, start in zip(arrays, starts, strict=False)])

    return _Grid(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.types for part in parts]),
        merged((part.nodes for part in parts), points),
        np.insert(merged((part.offsets[1:] for part in parts), nodes), 0, 0),
        Polygons(
            merged((part.faces.nodes for part in parts), points),
            np.insert(merged((part.faces.offsets[1:] for part in parts), faces), 0, 0),
        ),
        merged((part.cell for part in parts), cells),
    )


def _part(file: VtuFile, piece: GridPiece) -> _Grid:
    points = file.values(_points(piece), piece.points)
    if points.shape != (piece.points, 3):
        raise MeshFileError("there are no points" if not points.size else f"points {points.shape} are not (N, 3)")
    types = file.values(_array(piece, "Cells", "types"), piece.cells).astype(np.uint8)
    nodes = _nodes(file, _array(piece, "Cells", "connectivity"), len(points))
    offsets = _offsets(file.values(_array(piece, "Cells", "offsets"), piece.cells), len(nodes))
    faces, cell = _faces(file, piece, types) if POLYHEDRON in types else (polygons(nodes[:0], nodes[:0]), nodes[:0])
    return _Grid(points.astype(np.float64, copy=False), types, nodes, offsets, faces, cell)


def _nodes(file: VtuFile, array: DataArray, points: int) -> IntArray:
    nodes = file.values(array).astype(np.intp, copy=False)
    if bad := np.count_nonzero((nodes < 0) | (nodes >= points)):
        raise MeshFileError(f"{bad} nodes of cells are not among the {points} points")
    return nodes


def _offsets(ends: Array, count: int) -> IntArray:
    offsets = np.concatenate([[0], ends.astype(np.intp)])
    if np.any(np.diff(offsets) < 0) or offsets[-1] > count:
        raise MeshFileError(f"is damaged: cells end after {offsets.max()} of {count} entries")
    return offsets


def _faces(file: VtuFile, piece: GridPiece, types: NDArray[np.uint8]) -> tuple[Polygons, IntArray]:
    """Faces of all polyhedra, and the polyhedron (counted by itself) of each."""
    solid = types == POLYHEDRON
    number = np.cumsum(solid) - 1
    if "polyhedron_to_faces" not in piece.sections["Cells"]:
        stream = file.values(_array(piece, "Cells", "faces")).astype(np.intp)
        begin = np.concatenate([[0], file.values(_array(piece, "Cells", "faceoffsets"), piece.cells)[solid]])
        heads, count = _walked(stream, begin.tolist())
        inside = np.ones(len(stream), dtype=np.bool_)
        inside[begin[:-1]] = inside[heads] = False
        faces = polygons(stream[inside], stream[heads])
        if faces.nodes.min(initial=0) < 0 or faces.nodes.max(initial=-1) >= piece.points:
            raise MeshFileError(f"nodes of faces are not among the {piece.points} points")
        return faces, np.repeat(np.arange(len(count)), count)
    nodes = _nodes(file, _array(piece, "Cells", "face_connectivity"), piece.points)
    stored = file.values(_array(piece, "Cells", "face_offsets"))
    own = file.values(_array(piece, "Cells", "polyhedron_to_faces")).astype(np.intp)
    offsets = _offsets(file.values(_array(piece, "Cells", "polyhedron_offsets"), piece.cells), len(own))
    if own.min(initial=0) < 0 or own.max(initial=-1) >= len(stored):
        raise MeshFileError(f"faces of polyhedra are not among the {len(stored)}")
    return taken(Polygons(nodes, _offsets(stored, len(nodes))), own), np.repeat(number, np.diff(offsets))


def _walked(stream: IntArray, begin: list[int]) -> tuple[IntArray, IntArray]:
    """Where each face's number of nodes stands, and how many faces each cell has."""
    heads, counts, words = [], [], stream.data
    for first, end in pairwise(begin):
        if not 0 <= first < end <= len(words):
            raise MeshFileError(f"is damaged: faces of a polyhedron from {first} to {end} of {len(words)} numbers")
        at, count = first + 1, words[first]
        for _ in range(min(count, end - at)):
            heads.append(at)
            at += 1 + words[at] if at < end and words[at] > 2 else end + 1
        if at != end:
            raise MeshFileError("is damaged: the faces of a polyhedron do not fill its place")
        counts.append(count)
    return np.array(heads, dtype=np.intp), np.array(counts, dtype=np.intp)

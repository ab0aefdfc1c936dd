"""VTK unstructured grids (.vtu): those that `vtu_write` writes are read, too."""

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.progress import Progress, silent
from sdm_deflect.deform.base.reading import check_unpacked
from sdm_deflect.deform.mesh.mesh import CORNERS, Cells, Mesh, Patch, Polygons, Polyhedra
from sdm_deflect.deform.mesh.quality import quality_of
from sdm_deflect.meshing.files import fresh
from sdm_deflect.meshing.formats.format import MeshFileError, about, check_points
from sdm_deflect.meshing.formats.known import registered
from sdm_deflect.meshing.formats.layout import Format
from sdm_deflect.meshing.formats.periodic import unwritten
from sdm_deflect.meshing.formats.polyhedra import polyhedra
from sdm_deflect.meshing.formats.shapes import check_faces, polygons
from sdm_deflect.meshing.formats.vtu_write import HEAD, POLYHEDRON, TYPES, write_vtu
from sdm_deflect.meshing.mesh import VOLUME, Skin, tetrahedral

Array = NDArray[Any]
SHAPES = {kind: shape for shape, kind in TYPES.items()}
START = b'<AppendedData encoding="raw">\n_'
NAMES = "patch_names"
FOREIGN = (
    "this .vtu file was not written by sdm-deflect; read it by PyVista and name the patches of its faces: "
    '`grid.cell_data["patch"] = NUMBERS; grid.field_data["patch_names"] = NAMES`, then sdm_deflect.deflect(grid, ...)'
)


@registered("vtu", ".vtu")
class Vtu(Format):
    """Any linear cells and polyhedra, and faces with the patch of each, as `write_vtu` writes them."""

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        """See `Format.read`."""
        progress(f"reading {path.name}", 0.0)
        with _opened(path) as grid:
            mesh = grid.mesh()
            check_faces(mesh)
            return mesh

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; arrays but those of the patches are left out."""
        mesh = self.read(source, progress)
        with about(source):
            check_points(points, len(mesh.points))
        with fresh(out, source) as beside:
            self.write(mesh.with_points(points), beside, progress)

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
    with _opened(path) as grid:
        wide = grid.types == TYPES["tetra"]
        if not (wide | (grid.types == TYPES["triangle"])).all():
            raise MeshFileError("holds cells other than tetrahedra and triangles")
        if grid.names[:1] != (VOLUME,):
            raise MeshFileError(f"{NAMES} must start with {VOLUME!r}, but are {', '.join(grid.names)}")
        tets, triangles = (grid.block(np.flatnonzero(own)) for own in (wide, ~wide))
        patch, face = (grid.array("CellData", name)[~wide].astype(np.intp) for name in ("patch", "cad_face"))
        assert isinstance(tets, Cells)
        assert isinstance(triangles, Cells)
        return tetrahedral(grid.points, tets.nodes, Skin(triangles.nodes, patch - 1, face), grid.names[1:])


def vtu_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays on the nodes and on the cells of a file by name.

    Raises MeshFileError if the file does not exist, or is damaged.
    """
    with _opened(path) as grid:
        return {name: grid.array(section, name) for section in ("PointData", "CellData") for name in grid.all(section)}


@contextmanager
def _opened(path: Path) -> Iterator["_Grid"]:
    """Give a file's grid; MeshFileError, with its name, for whatever is wrong with it."""
    with about(path):
        try:
            yield _Grid.of(path)
        except (LookupError, TypeError, ArithmeticError, StopIteration, ParseError, zlib.error) as error:
            raise MeshFileError(f"is damaged: {error}") from error


@dataclass(frozen=True)
class _Grid:
    """The bytes of a file, the elements of its header, and where its arrays begin."""

    data: bytes
    head: Element
    start: int

    @classmethod
    def of(cls, path: Path) -> "_Grid":
        data = path.read_bytes()
        if not data.startswith(HEAD.encode()):
            raise MeshFileError(FOREIGN if b"VTKFile" in data[:1000] else "is not a VTK unstructured grid (.vtu)")
        at = data.find(START)
        if at < 0 or not data.endswith(b"</VTKFile>\n"):
            raise MeshFileError("is damaged: it is truncated")
        return cls(data, fromstring(data[:at] + b"</VTKFile>"), at + len(START))

    def all(self, section: str) -> dict[str, Element]:
        """Return the arrays of a section by name."""
        return {one.get("Name", ""): one for one in self.head.iterfind(f".//{section}/*")}

    def count(self, name: str) -> int:
        """Return how many points or cells there are."""
        return int(next(self.head.iter("Piece")).get(name, "none"))

    def array(self, section: str, name: str) -> Array:
        """Return an array (K,) or (K, columns)."""
        found = self.all(section).get(name)
        if found is None:
            raise MeshFileError(f"has no array {name} in {section}")
        begin = self.start + int(found.get("offset", "none"))
        blocks, size, last = np.frombuffer(self.data, "<u8", 3, begin).tolist()
        packed = np.frombuffer(self.data, "<u8", blocks, begin + 24).astype(np.intp)
        ends = begin + 24 + 8 * blocks + np.cumsum(packed)
        sizes = [size] * (blocks - 1) + [last or size] * bool(blocks)
        check_unpacked(sum(sizes), len(self.data), f"the array {name}")
        parts = zip((ends - packed).tolist(), ends.tolist(), sizes, strict=True)
        body = [zlib.decompressobj().decompress(self.data[a:b], length + 1) for a, b, length in parts]
        if [len(part) for part in body] != sizes:
            raise MeshFileError("is damaged: a packed block is of another size than is announced")
        kind, columns = found.get("type", "").lower(), int(found.get("NumberOfComponents", "1"))
        values = np.frombuffer(b"".join(body), np.dtype("uint8" if kind == "string" else kind))
        return values.reshape(-1, columns) if columns > 1 else values

    @property
    def points(self) -> FloatArray:
        """The points (N, 3)."""
        found = self.array("Points", "Points")
        if found.shape != (self.count("NumberOfPoints"), 3):
            raise MeshFileError(f"is damaged: points {found.shape} are not (N, 3)")
        return found.astype(np.float64)

    @cached_property
    def types(self) -> NDArray[np.uint8]:
        """Types (C,) of cells and faces."""
        return self.array("Cells", "types").astype(np.uint8)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the patches, of the volume first; none of a mesh without patches."""
        if NAMES not in self.all("FieldData"):
            return ()
        return tuple(bytes(self.array("FieldData", NAMES).tolist()).decode("utf-8", "replace").split("\0")[:-1])

    @cached_property
    def cells(self) -> tuple[IntArray, IntArray]:
        """Nodes of all cells, and where those of each begin, and of the last one end."""
        nodes, ends = (self.array("Cells", name).astype(np.intp) for name in ("connectivity", "offsets"))
        if len(nodes) and not 0 <= nodes.min() <= nodes.max() < self.count("NumberOfPoints"):
            raise MeshFileError("is damaged: nodes of cells are not among the points")
        return nodes, np.append(0, ends)

    def block(self, rows: IntArray) -> Cells | Polygons:
        """Return cells of one type, or polygons."""
        nodes, offsets = self.cells
        begin = offsets[rows]
        sizes = offsets[rows + 1] - begin
        shape = SHAPES.get(int(self.types[rows[0]])) if len(rows) else "triangle"
        if shape is None:
            first = np.repeat(begin - np.cumsum(sizes) + sizes, sizes)
            return polygons(nodes[first + np.arange(len(first))], sizes)
        if np.any(sizes != CORNERS[shape]):
            raise MeshFileError(f"is damaged: some cells of type {shape} have other than {CORNERS[shape]} nodes")
        return Cells(shape, nodes[begin[:, None] + np.arange(CORNERS[shape])])

    def solids(self, rows: IntArray) -> Polyhedra:
        """Return polyhedra."""
        stream, ends = (self.array("Cells", name).astype(np.intp) for name in ("faces", "faceoffsets"))
        heads, count = _walked(stream, [0, *ends[rows].tolist()])
        inside = np.ones(len(stream), dtype=np.bool_)
        inside[np.append(0, ends[rows[:-1]])] = inside[heads] = False
        faces = polygons(stream[inside], stream[heads])
        return polyhedra(faces, np.repeat(np.arange(len(count)), count), self.count("NumberOfPoints"))

    def mesh(self) -> Mesh:
        """Return cells by type, in the order in which types first appear, and patches."""
        types, names = self.types, self.names
        label = self.array("CellData", "patch") if names else np.zeros(len(types), dtype=np.intp)
        found: list[list[Any]] = [[] for _ in (names or (VOLUME,))]
        for number, own in enumerate(found):
            kinds, first = np.unique(types[rows := np.flatnonzero(label == number)], return_index=True)
            for kind in kinds[np.argsort(first)]:
                some = rows[types[rows] == kind]
                own.append(self.solids(some) if kind == POLYHEDRON else self.block(some))
        patches = tuple(Patch(name, tuple(faces)) for name, faces in zip(names[1:], found[1:], strict=True))
        return Mesh(self.points, tuple(found[0]), patches)


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

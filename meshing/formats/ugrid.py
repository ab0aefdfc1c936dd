"""UGRID meshes of AFLR3, FUN3D, Flow360 and Pointwise (.ugrid), text and binary."""

import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import HERE, Progress, Runner, silent
from sdm_deflect.meshing.errors import about, check_points
from sdm_deflect.meshing.mesh.cells import CORNERS, MIRRORED, Cells, Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk
from sdm_deflect.meshing.mesh.precision import fewest_bits

from .coordinates import ByteColumns, Words
from .format import Format, fitting_names
from .polyhedra import standard_cells
from .shapes import refuse_plane, simple_faces
from .table_pieces import CellTable, PointRange, TablePieces
from .tables import FileTable, MemoryTable
from .ugrid_file import ENCODINGS, ORDER, POINTS, SUFFIX, SURFACE, UgridFile, check_range, encode, encoding_of, ending
from .zones import unwritten

FACES, SOLIDS = ("triangle", "quad"), ("tetra", "pyramid", "wedge", "hexahedron")
# Position in UGRID's cell of each node of VTK's: the apex of a pyramid is the third node.
TO_VTK = {"pyramid": (1, 0, 3, 4, 2), "wedge": MIRRORED["wedge"]}
FROM_VTK = {shape: tuple(np.argsort(order).tolist()) for shape, order in TO_VTK.items()}
# Largest number of surfaces; a larger one is damage.
SURFACES = 10_000
NUMBER, COUNT = re.compile(r"[1-9][0-9]{0,8}"), re.compile(r"[0-9]{1,9}")
# FUN3D's numbers of boundary conditions: symmetry in x (then y and z), and viscous wall.
SYMMETRY, VISCOUS = 6661, 4000
# FUN3D's boundary condition by the first pattern that is in a patch's name: far field, symmetry in x (then y and z);
# all others are viscous walls.
CONDITIONS = ((r"far.?field|freestream|in(let|flow)|out(let|flow)", 5000), (r"symm", SYMMETRY))


@dataclass(frozen=True, slots=True)
class UgridPieces(TablePieces):
    """See `Pieces`; a copy gets the file of surface names that stands beside the file `given` by the user."""

    given: Path

    def rewrite(
        self, nodes: IntArray, points: FloatArray, out: Path, progress: Progress = silent, runner: Runner = HERE
    ) -> None:
        """See `Pieces.rewrite`; MeshFileError as for `Ugrid.rewrite`."""
        with names_copied(self.given, out):
            TablePieces.rewrite(self, nodes, points, out, progress, runner)


class Ugrid(Format):
    """Points, one block of cells of each shape, and boundary faces with surface ids.

    The word before the suffix tells the encoding (`ENCODINGS`); without one the file is text. FUN3D's ``.mapbc`` beside
    the file, such as ``wing.mapbc`` for ``wing.b8.ugrid``, names the ids; an id without a name is the patch's name. Ids
    of one name are one patch. Every written mesh gets such a file, a copy of the source's if there is one; an existing
    one is never changed. Data after the cells are no part of the mesh; a rewritten file keeps them.
    """

    name = "ugrid"
    suffixes = (".ugrid",)

    for_workers = "binary UGRID files"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk | None:
        """See `Format.layout`; a damaged ``.mapbc`` is a MeshFileError, too."""
        if scratch and not encoding_of(path):
            return None
        with about(path):
            tables = _tables(path, partial(progress, f"reading {path.name}"))
            count = tables[POINTS].rows
            faces = [Cells(shape, CellTable(shape, tables[shape]).everything(count)) for shape in FACES]
            border = patches(faces, tables[SURFACE].integers().ravel(), surface_names(path))
            cells = tuple(
                CellTable(name, tables[name], 1, TO_VTK.get(name, ())) for name in SOLIDS if tables[name].rows
            )
            pieces = replace(_pieces(path, tables), cells=cells).orient()
        return MeshOnDisk(path.resolve().name, pieces, border, (Zone("", 0, count),))

    def coordinates(self, path: Path) -> ByteColumns | Words:
        if encoding_of(path):
            return ByteColumns(_pieces(path, _tables(path, lambda _: None)))
        with path.open("rb") as file:
            count = UgridFile.open(file, "", lambda _: None).shapes[POINTS][0]
        return Words(path, count, lambda file, report: UgridFile.open(file, "", report).coordinates())

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        encoding = encoding_of(out)
        return fewest_bits([ENCODINGS[encoding].real] if encoding else [])

    def finer(self, out: Path, mesh: Mesh) -> str:
        return ending(out).replace("4", "8")

    def rewrite(self, source: Path, points: FloatArray, out: Path, progress: Progress = silent) -> None:
        """See `Format.rewrite`; a file of another encoding has the same content without data after the cells.

        In text, changed coordinates are written with as many digits as they need. Single precision stays single.
        """
        if encoding_of(out) == encoding_of(source):
            with about(source):
                if encoding := encoding_of(source):
                    check_range(points, ENCODINGS[encoding].real)
            with names_copied(source, out):
                Format.rewrite(self, source, points, out, progress)
            return
        report = partial(progress, f"writing {out.name}")
        with names_copied(source, out), fresh(out, source) as beside, about(source), source.open("rb") as file:
            stored = UgridFile.open(file, encoding_of(source), report)
            check_points(points, stored.shapes[POINTS][0])
            arrays = {name: table.read(0, table.rows) for name, table in stored.tables(source).items()}
            with beside.open("wb") as copy:
                copy.writelines(encode(arrays | {POINTS: points}, encoding_of(out)))

    def files(self, path: Path) -> Iterable[Path]:
        return path, mapbc(path)

    def ending(self, path: Path) -> str:
        return ending(path)

    def name_files(self, path: Path) -> tuple[Path, ...]:
        return (mapbc(path),)

    def check_named(self, mesh: Mesh, out: Path) -> None:
        names = fitting_names(mesh.names, r"\s")
        wanted = {number: names[name] for name, number in _ids(mesh).items()}
        if mapbc(out).exists() and any(surface_names(out).get(i, str(i)) != name for i, name in wanted.items()):
            raise _other_names(mapbc(out))

    def named_otherwise(self, source: Path, out: Path) -> bool:
        return stands_otherwise(source, out)

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; MeshFileError for polyhedra of other shapes, and for faces of five corners.

        Names of patches are written to a ``.mapbc``, unless all are numbers. MeshFileError if it exists with other
        names.
        """
        refuse_plane(mesh, "UGRID")
        progress(f"writing {out.name}", 0.0)
        self.check_named(mesh, out)
        ids, names, table = _ids(mesh), fitting_names(mesh.names, r"\s"), mapbc(out)
        named = any(str(number) != name for name, number in ids.items())
        with fresh(out) as beside:
            with about(out), beside.open("wb") as file:
                file.writelines(encode(_arrays(mesh, ids), encoding_of(out)))
            if named and not table.exists():
                with fresh(table) as text:
                    text.write_text(_conditions(mesh, ids, names), encoding="utf-8", errors="replace")
        lost = [f"patch {patch.name} has no faces and is left out" for patch in mesh.patches if not len(patch)]
        lost += [f"patch {name} is called {new}" for name, new in names.items() if name != new]
        lost += [f"{table.name} tells boundary conditions by the names of patches alone; check them"] * named
        return (*lost, *(["its zones are one mesh"] if len(mesh.zones) > 1 else []), *unwritten(mesh.periodic))


def mapbc(path: Path) -> Path:
    """Return the path of the file with a mesh's surface names."""
    return path.with_name(path.name.removesuffix(ending(path)) + ".mapbc")


def stands_otherwise(source: Path, out: Path) -> bool:
    """Return whether the ``.mapbc`` beside `out` differs from that beside a UGRID mesh `source`."""
    named, table = mapbc(source), mapbc(out)
    if source.suffix.lower() != SUFFIX or not named.is_file() or not table.exists():
        return False
    with about(table):
        return table.read_bytes() != named.read_bytes()


@contextmanager
def names_copied(source: Path, out: Path) -> Iterator[None]:
    """Copy the source's file of surface names to the mesh `out`, which the block writes.

    MeshFileError if an existing ``.mapbc`` has other names.
    """
    if stands_otherwise(source, out):
        raise _other_names(mapbc(out))
    yield
    if mapbc(source).is_file() and not mapbc(out).exists():
        with fresh(mapbc(out)) as table:
            shutil.copyfile(mapbc(source), table)


def _other_names(table: Path) -> MeshFileError:
    return MeshFileError(f"{table}: is there and names other surfaces; move it away, or choose another name")


def surface_names(path: Path) -> dict[int, str]:
    """Return the names of surface ids in the ``.mapbc`` beside a mesh; none if there is no such file.

    The first line has the number of surfaces; each further one id, boundary condition and name (FUN3D manual, boundary
    conditions). MeshFileError if it is damaged.
    """
    beside = mapbc(path)
    if not beside.is_file():
        return {}
    with about(beside):
        rows = _rows(beside.read_text("utf-8", "replace"))
        if bad := [row for row in rows if len(row) < 2 or not COUNT.fullmatch(row[0])]:
            raise MeshFileError(f"{len(bad)} lines are not a surface id, a boundary condition and a name")
        if twice := len(rows) - len({int(row[0]) for row in rows}):
            raise MeshFileError(f"{twice} of its {len(rows)} surface ids are there twice")
        return {int(row[0]): row[2] for row in rows if len(row) > 2}


def _rows(text: str) -> list[list[str]]:
    """Return the words of each line, as many lines as a ``.mapbc`` announces."""
    if "\0" in text:
        raise MeshFileError("is a binary file; names of surfaces are text")
    lines = [line.split() for line in text.splitlines() if line.strip()]
    if not lines or not COUNT.fullmatch(lines[0][0]):
        raise MeshFileError("does not begin with the number of surfaces; correct it, or move it away")
    count = int(lines[0][0])
    rows = lines[1 : count + 1]
    if len(rows) < count:
        raise MeshFileError(f"should name {count} surfaces, but names {len(rows)}; it is truncated")
    return rows


def _tables(path: Path, report: Callable[[float], None]) -> dict[str, FileTable | MemoryTable]:
    with path.open("rb") as file:
        return UgridFile.open(file, encoding_of(path), report).tables(path.resolve())


def _pieces(path: Path, tables: Mapping[str, FileTable | MemoryTable]) -> UgridPieces:
    """Return the points as pieces without cells."""
    count = tables[POINTS].rows
    return UgridPieces(str(path.resolve()), count, (PointRange(0, count, tables[POINTS]),), (), path.absolute())


def patches(faces: Sequence[Cells], labels: IntArray, names: Mapping[int, str]) -> tuple[Patch, ...]:
    """Return the patches of triangles and quads with surface ids `labels` (F,), in the order of their least ids."""
    ids, index = np.unique(labels, return_inverse=True)
    if len(ids) > SURFACES:
        raise MeshFileError(f"has {len(ids)} surface ids; more than {SURFACES} are not supported")
    given = set(names.values())
    patches: dict[str, list[Cells]] = {}
    parts = np.split(index, [len(faces[0])])
    blocks = [_by_label(block, part, len(ids)) for block, part in zip(faces, parts, strict=True)]
    for number, *several in zip(ids.tolist(), *blocks, strict=True):
        name = names.get(number, str(number))
        while number not in names and name in given:
            name += "_"
        patches.setdefault(name, []).extend(faces_of for faces_of in several if len(faces_of))
    return tuple(Patch(name, tuple(faces_of)) for name, faces_of in patches.items())


def _by_label(faces: Cells, labels: IntArray, count: int) -> list[Cells]:
    """Return the faces of each label (0 to count - 1), in their order."""
    order = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels, np.arange(1, count), sorter=order)
    return [Cells(faces.shape, faces.nodes[rows]) for rows in np.split(order, ends)[:count]]


def _ids(mesh: Mesh) -> dict[str, int]:
    """Return the surface id of each patch: its name if all names are numbers, else 1, 2, ..."""
    if all(NUMBER.fullmatch(name) for name in mesh.names):
        return {name: int(name) for name in mesh.names}
    return {name: number for number, name in enumerate(mesh.names, 1)}


def _conditions(mesh: Mesh, ids: Mapping[str, int], names: Mapping[str, str]) -> str:
    lines = [str(len(ids))]
    for patch in mesh.patches:
        kind = next((kind for pattern, kind in CONDITIONS if re.search(pattern, patch.name.lower())), VISCOUS)
        if kind == SYMMETRY and len(patch):
            kind += int(np.argmin(np.ptp(mesh.points[patch.nodes], axis=0)))
        lines.append(f"{ids[patch.name]} {kind} {names[patch.name]}")
    return "\n".join([*lines, ""])


def _arrays(mesh: Mesh, ids: Mapping[str, int]) -> dict[str, Any]:
    blocks: dict[str, list[IntArray]] = {shape: [] for shape in (*FACES, *SOLIDS)}
    surfaces: dict[str, list[IntArray]] = {shape: [np.empty((0, 1), np.intp)] for shape in FACES}
    for patch in mesh.patches:
        for faces in simple_faces(patch):
            blocks[faces.shape].append(faces.nodes + 1)
            surfaces[faces.shape].append(np.full((len(faces), 1), ids[patch.name]))
    for cells in standard_cells(mesh):
        order = FROM_VTK.get(cells.shape, range(cells.nodes.shape[1]))
        blocks[cells.shape].append(cells.nodes[:, [*order]] + 1)
    arrays: dict[str, Any] = {shape: _one(parts, CORNERS[shape]) for shape, parts in blocks.items()}
    arrays |= {
        POINTS: mesh.points,
        SURFACE: np.concatenate([surface for shape in FACES for surface in surfaces[shape]]),
    }
    return {name: arrays[name] for name in ORDER}


def _one(parts: Sequence[IntArray], width: int) -> IntArray:
    """Return the nodes (M, width) of all blocks; a single block is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.empty((0, width), np.intp), *parts])

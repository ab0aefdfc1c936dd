"""Meshes of Ansys Fluent in HDF5 (.msh.h5, .cas.h5), of two and three dimensions.

Source: vtkFLUENTCFFReader (VTK, IO/FLUENTCFF) for the layout; Ansys Fluent User's Guide, appendix Mesh File Format, for
zones, types and the cells c0 and c1 of a face.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, MeshFileError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Periodic, Polygons, Polyhedra, take_faces
from sdm_deflect.meshing.mesh.images import PeriodicPatches, pair_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.polyhedra import face_centres_and_areas

from .format import Format
from .hdf5 import Dataset, Datasets, dataset, integers, member, number, open_hdf5
from .polyhedra import check_cells, faces_by_cell
from .shapes import orient, polygons, turn_faces

MESH = "meshes/1"
# Type of a zone of interior faces.
INTERIOR = 2
# Types of zones of faces that are images of one another; the appendix calls them periodic and periodic-shadow.
TWINS = 12, 8
INTERFACES = (
    "the file holds mesh interfaces that are cut into common faces; delete them in Fluent, write the file, and create "
    "them anew for the deflected mesh"
)
ADAPTED = (
    "the mesh is adapted with hanging nodes; convert them to polyhedra in Fluent "
    "(mesh/polyhedra/convert-hanging-nodes) and write the file again"
)
# Groups of a file that make its mesh unreadable here, with what to do.
REFUSED = (("faces", "interface", INTERFACES), ("faces", "tree", ADAPTED), ("cells", "tree", ADAPTED))
KIND = "a mesh of this name"


class Fluent(Format):
    """Polyhedra by their faces, in a plane triangles and quadrilaterals; patches are zones of faces, by name.

    Both layouts are read: that of meshing, where each zone has its section of each array, and that of the solver, with
    one section for all zones. Zones of the interior are no patches; periodic zones are pairs with their shadows. Zones
    of cells, settings and results are no part of the mesh; a rewritten file keeps them. Coordinates in single precision
    stay in single precision. Faces of no cell, such as those of a geometry, are left out.
    """

    name = "fluent"
    suffixes = (".msh.h5", ".cas.h5")
    written = False

    def read(self, path: Path, progress: Progress = silent) -> Mesh:
        with about(path), open_hdf5(path, KIND) as file:
            return read_mesh(_group(file), partial(progress, f"reading {path.name}"))

    def real(self, out: Path, source: Path | None = None) -> np.dtype[Any]:
        return Format.real(self, out, source or out)

    def coordinates(self, path: Path) -> Datasets:
        with open_hdf5(path, KIND) as file:
            parts = [
                Dataset(
                    coordinate.node.name,
                    coordinate.node.dtype,
                    coordinate.first - 1,
                    coordinate.last,
                    0,
                    coordinate.node.shape[1],
                )
                for coordinate in coordinates(_group(file))
            ]
        return Datasets.of(path, parts)

    def ending(self, path: Path) -> str:
        """See `Format.ending`: ``.msh.h5``."""
        suffix = Path(path.stem).suffix + path.suffix
        return suffix if suffix.lower() in self.suffixes else path.suffix


@dataclass(frozen=True, slots=True)
class FluentSection:
    """A part of an array: entries first to last, counted from 1, in a dataset or a group of datasets."""

    first: int
    last: int
    node: Any = field(repr=False)

    def __len__(self) -> int:
        return self.last - self.first + 1


def coordinates(mesh: Any) -> list[FluentSection]:
    """Return the datasets (K, 3), or (K, 2), of the nodes' coordinates, in the order of the nodes.

    MeshFileError if one is missing or has another shape.
    """
    sections = _sections(mesh, "nodes/coords", _count(mesh, "nodeCount"))
    for section in sections:
        stored = dataset(mesh, _path(mesh, section), "f", "real numbers")
        expected = len(section), number(mesh, "dimension")
        if stored.shape != expected:
            raise MeshFileError(f"{_path(mesh, section)} holds {stored.shape} numbers, expected {expected}")
    return sections


def read_mesh(mesh: Any, report: Callable[[float], None]) -> Mesh:
    """Return the mesh of a group such as ``meshes/1``; MeshFileError or ValueError if it is damaged."""
    report(0.0)
    stored = np.concatenate([coordinate.node[()] for coordinate in coordinates(mesh)])
    points = np.zeros((len(stored), 3))
    points[:, : stored.shape[1]] = stored
    faces = _faces(mesh)
    report(0.5)
    cells, rows = _cells_within(points, faces, *(_cells(mesh, name, len(faces)) for name in ("c0", "c1")))
    if len(cells) != (count := number(mesh, "cellCount")):
        raise MeshFileError(f"cellCount is {count}, but faces are of {len(cells)} cells; the file is damaged")
    report(0.9)
    plane = stored.shape[1] == 2
    place = np.full(len(faces), -1, dtype=np.intp)
    place[rows] = np.arange(len(rows))
    zones = _zones(mesh, len(faces))
    by_name: dict[str, list[IntArray]] = {}
    for zone in zones:
        by_name.setdefault(zone.name, []).append(place[zone.first - 1 : zone.last])
    patches = []
    for name, parts in by_name.items():
        file_rows = np.concatenate(parts)
        if (file_rows >= 0).any():
            kept = take_faces(cells.faces, file_rows[file_rows >= 0])
            patches.append(Patch(name, (Cells("line", kept.nodes.reshape(-1, 2)) if plane else kept,)))
    fluent_mesh = Mesh(points, plane_cells(points, cells) if plane else (cells,), tuple(patches))
    return _with_pairs(fluent_mesh, zones)


def _group(file: Any) -> Any:
    """Return the group of the mesh; MeshFileError for meshes that cannot be read."""
    mesh = member(file, MESH)
    if (dimension := number(mesh, "dimension")) not in (2, 3):
        raise MeshFileError(f"the mesh has {dimension} dimensions, expected 2 or 3; the file is damaged")
    for kind, part, sentence in REFUSED:
        if part not in member(mesh, kind):
            continue
        array = member(mesh, f"{kind}/{part}")
        if len(array) and not ("nZones" in array.attrs and number(array, "nZones") == 0):
            raise MeshFileError(sentence)
    return mesh


def _count(mesh: Any, name: str) -> int:
    if (count := number(mesh, name)) < 1:
        raise MeshFileError(f"{name} is {count}; the file holds no mesh")
    return count


def _path(mesh: Any, section: FluentSection) -> str:
    return str(section.node.name).removeprefix(f"{mesh.name}/")


def _sections(mesh: Any, path: str, count: int, gaps: bool = False) -> list[FluentSection]:
    """Return the sections of an array in order; MeshFileError unless they cover the entries 1 to `count` once."""
    sections, after = _by_number(member(mesh, path)), 1
    for section in sections:
        if section.first < after or (section.first > after and not gaps):
            raise MeshFileError(
                f"{path} goes on with {section.first} to {section.last} at number {after}; the file is damaged"
            )
        after = section.last + 1
    if after > count + 1 or (after <= count and not gaps):
        raise MeshFileError(f"{path} ends at number {after - 1}, expected {count}; the file is truncated or damaged")
    return sections


def _by_number(group: Any) -> list[FluentSection]:
    nodes = (member(group, name) for name in group if name.isdecimal())
    sections = (FluentSection(number(node, "minId"), number(node, "maxId"), node) for node in nodes)
    return sorted(filter(len, sections), key=lambda section: section.first)


def _faces(mesh: Any) -> Polygons:
    nodes, sizes, plane = [], [], number(mesh, "dimension") == 2
    for section in _sections(mesh, "faces/nodes", _count(mesh, "faceCount")):
        corners, flat = integers(section.node, "nnodes"), integers(section.node, "nodes")
        wrong = (corners != 2) if plane else (corners < 3)
        if len(corners) != len(section) or wrong.any() or corners.sum() != len(flat):
            raise MeshFileError(
                f"{_path(mesh, section)} has {len(flat)} nodes of {len(corners)} faces, expected {len(section)} faces "
                f"of {'two nodes' if plane else 'three nodes or more'}; the file is damaged"
            )
        nodes.append(flat)
        sizes.append(corners)
    return polygons(np.concatenate(nodes) - 1, np.concatenate(sizes))


def _cells(mesh: Any, name: str, faces: int) -> IntArray:
    """Return the cell (F,) on one side of each face, counted from 1; 0 without a cell."""
    cells = np.zeros(faces, dtype=np.intp)
    for section in _sections(mesh, f"faces/{name}", faces, gaps=True):
        values = integers(mesh, _path(mesh, section))
        if len(values) != len(section):
            raise MeshFileError(f"{_path(mesh, section)} holds {len(values)} numbers, expected {len(section)}")
        cells[section.first - 1 : section.last] = values
    return cells


def _cells_within(points: FloatArray, faces: Polygons, c0: IntArray, c1: IntArray) -> tuple[Polyhedra, IntArray]:
    """Return the cells, and the index in the file of each of their faces; faces of no cell are left out.

    Normals point out of owners; a line has its owner on its left. In most files a face's normal points into the cell
    c0; the manual says c1, and some programs follow it. The sign of the volume decides.
    """
    inner, outer = np.flatnonzero((c0 > 0) & (c1 > 0)), np.flatnonzero((c0 > 0) != (c1 > 0))
    rows = np.concatenate([inner, outer])
    if not len(rows):
        raise MeshFileError("there are no volume cells")
    kept = take_faces(faces, rows)
    if len(kept.nodes) and (kept.nodes.min() < 0 or kept.nodes.max() >= len(points)):
        raise MeshFileError(f"faces name nodes that are not among the {len(points)} (1 to {len(points)})")
    plane = len(faces.nodes) == 2 * len(faces)
    kept = turn_faces(kept, (c0 > 0)[rows] != plane)
    if _volume(points, kept.rows(len(inner), len(rows)), plane) < 0.0:
        kept = turn_faces(kept, np.ones(len(rows), dtype=np.bool_))
    cells = Polyhedra(kept, np.where(c0 > 0, c0, c1)[rows] - 1, c1[inner] - 1)
    check_cells(cells, 3 if plane else 4)
    return cells, rows


def _volume(points: FloatArray, boundary: Polygons, plane: bool) -> float:
    """Return the volume, or area, within all boundary faces; positive if the cells are on their inner sides."""
    with np.errstate(all="ignore"):  # `Mesh` refuses coordinates that are not finite
        middle = points - points.mean(axis=0)
        if plane:
            begin, end = middle[boundary.nodes[0::2]], middle[boundary.nodes[1::2]]
            return float(np.sum(begin[:, 0] * end[:, 1] - end[:, 0] * begin[:, 1])) / 2.0
        centres, areas = face_centres_and_areas(middle, boundary)
        return float(np.vdot(areas, centres)) / 3.0


def plane_cells(points: FloatArray, cells: Polyhedra) -> tuple[Cells, ...]:
    """Return plane cells, given by their lines, as triangles and quadrilaterals in the same order.

    MeshFileError for cells with more than four sides, and for open ones.
    """
    lines, cell = faces_by_cell(cells)
    sides = np.bincount(cell, minlength=len(cells))
    if more := np.count_nonzero(sides > 4):
        raise MeshFileError(f"{more} plane cells have more than four sides; triangles and quadrilaterals can be read")
    blocks = []
    for count, shape in ((3, "triangle"), (4, "quad")):
        edges = lines.nodes.reshape(-1, 2)[sides[cell] == count].reshape(-1, count, 2)
        nodes = [edges[:, 0, 0], edges[:, 0, 1]]
        while len(nodes) < count:
            nodes.append(edges[np.arange(len(edges)), np.argmax(edges[:, :, 0] == nodes[-1][:, None], axis=1), 1])
        corners = np.stack(nodes, axis=1)
        if torn := np.count_nonzero((np.sort(corners, axis=1) != np.sort(edges[:, :, 0], axis=1)).any(axis=1)):
            raise MeshFileError(f"the lines of {torn} plane cells do not close; the file is damaged")
        if len(corners):
            blocks.append(orient(points, Cells(shape, corners)))
    return tuple(blocks)


@dataclass(frozen=True, slots=True)
class _FluentZone:
    """A zone of faces first to last, counted from 1; `shadow` is the number of the zone with their images, or 0."""

    name: str
    first: int
    last: int
    kind: int
    number: int
    shadow: int


def _zones(mesh: Any, faces: int) -> list[_FluentZone]:
    """Return the zones of boundary faces that are not empty."""
    zones = []
    for name, (begin, end, kind, zone, shadow) in _topology(member(mesh, "faces/zoneTopology")):
        if kind == INTERIOR or end < begin:
            continue
        if begin < 1 or end > faces:
            raise MeshFileError(f"zone {name} has the faces {begin} to {end}, but there are {faces}")
        zones.append(_FluentZone(name.strip() or f"zone-{zone}", begin, end, kind, zone, shadow))
    return zones


def _topology(topology: Any) -> "zip[tuple[str, list[int]]]":
    """Return for each zone its name, first and last face, kind, number, and the number of its shadow (0: none)."""
    columns = [integers(topology, name) for name in ("minId", "maxId", "zoneType", "id")]
    first = columns[0]
    shadows = integers(topology, "shadowZoneId") if "shadowZoneId" in topology else columns[0][:0]
    columns.append(shadows if len(shadows) == len(first) else np.zeros_like(first))
    text = b";".join(dataset(topology, "name", "S", "names")[()].reshape(-1).tolist())
    names = text.decode("utf-8", "replace").replace("\0", "").split(";")
    if any(len(column) != len(first) for column in columns) or len(first) > len(names):
        raise MeshFileError(f"faces/zoneTopology has {len(first)} first faces and {len(names)} names; it is damaged")
    return zip(names, np.column_stack(columns).tolist(), strict=False)  # the names may end with a separator


def _with_pairs(mesh: Mesh, zones: Sequence[_FluentZone]) -> Mesh:
    """Return the mesh with pairs of periodic zones and shadows; their motion is searched, as files have none."""
    patches = {patch.name: patch for patch in mesh.patches}
    periodic, shadows = ([zone for zone in zones if zone.kind == kind and zone.name in patches] for kind in TWINS)
    pairs, notes = [], []
    for zone in periodic:
        try:
            pair, shadow = _pair(mesh.points, zone, shadows, patches)
        except InputError as error:
            notes.append(f"zone {zone.name} is periodic, and its pair is left out: {error}")
        else:
            pairs.append(pair)
            shadows.remove(shadow)
    return replace(mesh, periodic=tuple(pairs), notes=(*mesh.notes, *notes)) if pairs or notes else mesh


def _pair(
    points: FloatArray, zone: _FluentZone, shadows: Sequence[_FluentZone], patches: Mapping[str, Patch]
) -> tuple[Periodic, _FluentZone]:
    """Return a periodic zone's pair with its shadow, or with the first zone that fits; InputError if none fits."""
    named = [other for other in shadows if zone.number == other.shadow or other.number == zone.shadow]
    reason = InputError("there is no zone of its images")
    for other in named or shadows:
        try:
            names = PeriodicPatches(zone.name, other.name)
            return pair_of(points, (patches[zone.name], patches[other.name]), names), other
        except InputError as error:
            reason = error
    raise reason

"""CGNS files written anew: one base, a zone for each zone of the mesh, a family for each patch."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from sdm_deflect.base.arrays import IntArray
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.mesh.cells import Cells, Constraint, Polygons, Polyhedra
from sdm_deflect.meshing.mesh.faces import face_keys, node_keys, patch_keys
from sdm_deflect.meshing.mesh.mesh import Mesh

from .cgns_elements import NFACE, NGON, SHAPES
from .cgns_hdf5 import Integer, create, create_sized, describe, node_names
from .cgns_interfaces import write_pairs
from .cgns_nodes import AXES
from .shapes import mirror_nodes, places, polygons, simple_faces
from .zones import pairs_to_write, part, unwritten

# The oldest CGNS with offsets of mixed elements and of faces, which every later library reads.
VERSION = 3.4
# Numbers up to this one take four bytes.
FITS = np.iinfo(np.int32).max
# Kind of boundary condition by the first pattern that is in the patch's name; all others are walls.
CONDITIONS = (
    (r"far.?field|freestream", "BCFarfield"),
    (r"symm", "BCSymmetryPlane"),
    (r"in(let|flow)", "BCInflow"),
    (r"out(let|flow)", "BCOutflow"),
    (r"chimera|overset|overlap", "UserDefined"),
)
# Elements written at a time.
ROWS = 1 << 18
ELEMENTS = {shape: kind for kind, shape in SHAPES.items()}


def write_base(file: Any, mesh: Mesh, report: Callable[[float], None]) -> tuple[str, ...]:
    """Write a mesh to an empty file; return a sentence for each thing that differs in the file.

    MeshFileError if a zone has polyhedra beside other cells.
    """
    write_root(file)
    dimension, axes = _dimensions(mesh)
    base = create(file, "Base", "CGNSBase_t", np.array([dimension, axes], dtype=np.int32))
    zones = node_names([zone.name or "Zone" for zone in mesh.zones], ())
    families: dict[str, str] = {}
    constraints: dict[str, Constraint] = {}
    lost, written = [], set[str]()
    for i, (zone, zone_name) in enumerate(zip(mesh.zones, zones, strict=True)):
        zone_mesh = part(mesh, zone)
        written |= {pair.name for pair in pairs_to_write(zone_mesh)}
        fresh = [patch.name for patch in zone_mesh.patches if patch.name not in families]
        families |= dict(zip(fresh, node_names(fresh, (*zones, *families.values())), strict=True))
        constraints |= {patch.name: patch.constraint for patch in zone_mesh.patches}
        lost += _write_zone(base, zone_name, zone_mesh, families, AXES[:axes])
        report((i + 1) / len(zones))
    for name, family in families.items():
        _write_family(base, family, constraints[name] == "symmetry")
    lost += unwritten(pair for pair in mesh.periodic if pair.name not in written)
    return (
        *lost,
        *_renamings("zone", [zone.name for zone in mesh.zones], zones),
        *_renamings("patch", families, families.values()),
    )


def _dimensions(mesh: Mesh) -> tuple[int, int]:
    if not mesh.plane:
        return 3, 3
    return 2, 3 if mesh.points[:, 2].any() else 2


def _renamings(what: str, old: Iterable[str], new: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each name that differs in the file."""
    for before, after in zip(old, new, strict=True):
        if before not in ("", after):
            yield f"{what} {before} is named {after}"


def _write_family(base: Any, name: str, plane: bool) -> None:
    """Write a family and its kind of boundary condition: a plane of symmetry, or what its name says."""
    kind = next((kind for pattern, kind in CONDITIONS if re.search(pattern, name.lower())), "BCWall")
    create(create(base, name, "Family_t"), "FamilyBC", "FamilyBC_t", "BCSymmetryPlane" if plane else kind)


def write_root(file: Any) -> None:
    """Write the nodes that make an empty HDF5 file a CGNS file."""
    describe(file, "HDF5 MotherNode", "Root Node of HDF5 File", "MT")
    library = "HDF5 Version " + ".".join(map(str, h5py.h5.get_libversion()))
    for name, letters, length in ((" format", "IEEE_LITTLE_32", 15), (" hdf5version", library, 33)):
        file.create_dataset(name, data=np.frombuffer(letters.encode().ljust(length, b"\0"), dtype=np.int8))
    create(file, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([VERSION], dtype=np.float32))


def _write_zone(base: Any, name: str, mesh: Mesh, families: dict[str, str], axes: tuple[str, ...]) -> list[str]:
    polyhedra = [block for block in mesh.cells if isinstance(block, Polyhedra)]
    if polyhedra and len(mesh.cells) > 1:
        raise MeshFileError(
            f"zone {name}: CGNS holds either one block of polyhedra or cells of simple shapes, not both"
        )
    cells, kind = sum(map(len, mesh.cells)), _kind(mesh, polyhedra)
    zone = create(base, name, "Zone_t", np.array([[len(mesh.points)], [cells], [0]], dtype=kind))
    create(zone, "ZoneType", "ZoneType_t", "Unstructured")
    grid = create(zone, "GridCoordinates", "GridCoordinates_t")
    for axis, values in zip(axes, mesh.points.T, strict=False):
        create(grid, axis, "DataArray_t", np.ascontiguousarray(values, dtype=np.float64))
    write_pairs(zone, name, mesh, kind, len(axes))
    conditions = create(zone, "ZoneBC", "ZoneBC_t")
    faces = write_polyhedra(zone, mesh, polyhedra[0], kind) if polyhedra else write_shapes(zone, mesh, families, kind)
    for patch, numbers in faces.items():
        if len(numbers):
            _write_condition(
                conditions, families[patch], numbers.astype(kind), "EdgeCenter" if mesh.plane else "FaceCenter"
            )
    return [f"patch {patch} has no faces and is left out" for patch, numbers in faces.items() if not len(numbers)]


def _kind(mesh: Mesh, polyhedra: Sequence[Polyhedra]) -> type[np.signedinteger[Any]]:
    """Return the type of the file's integers: of 32 bits if all numbers fit."""
    sizes = [2 * block.faces.nodes.size for block in polyhedra]
    largest = max(len(mesh.points), sum(map(len, mesh.cells)) + sum(map(len, mesh.patches)), *sizes)
    return np.int32 if largest <= FITS else np.int64


def _write_condition(conditions: Any, family: str, numbers: IntArray, where: str) -> None:
    condition = create(conditions, family, "BC_t", "FamilySpecified")
    if numbers[-1] - numbers[0] + 1 == len(numbers):
        create(condition, "PointRange", "IndexRange_t", numbers[[0, -1], None])
    else:
        create(condition, "PointList", "IndexArray_t", numbers[:, None])
    create(condition, "GridLocation", "GridLocation_t", where)
    create(condition, "FamilyName", "FamilyName_t", family)


def write_shapes(zone: Any, mesh: Mesh, names: Mapping[str, str], kind: Integer) -> dict[str, IntArray]:
    """Write cells and boundary faces, and return the numbers of each patch's faces.

    Each block of cells has a section, then each patch has one of its name (`names`: as a valid name of a node), because
    some readers know the boundary by its sections alone. Faces of a second shape get another section, because other
    readers know no mixed sections.
    """
    first = 1
    for block in mesh.cells:
        assert isinstance(block, Cells)
        _write_block(zone, f"cells {block.shape}", block, first, kind)
        first += len(block)
    numbers = {}
    for patch in mesh.patches:
        start = first
        for i, faces in enumerate(simple_faces(patch)):
            _write_block(zone, f"{names[patch.name]} {faces.shape}" if i else names[patch.name], faces, first, kind)
            first += len(faces)
        numbers[patch.name] = np.arange(start, first)
    return numbers


def write_polyhedra(zone: Any, mesh: Mesh, cells: Polyhedra, kind: Integer) -> dict[str, IntArray]:
    """Write all faces and the cells by their faces; return the numbers of each patch's faces.

    MeshFileError if a face of a patch belongs to no cell.
    """
    faces = len(cells.faces)
    _write_polygons(zone, "faces", NGON, 1, Polygons(cells.faces.nodes + 1, cells.faces.offsets), kind)
    cell = np.concatenate([cells.owner, cells.neighbour])
    signed = np.concatenate([np.arange(1, faces + 1), -np.arange(1, len(cells.neighbour) + 1)])
    by_cell = polygons(signed[np.argsort(cell, kind="stable")], np.bincount(cell, minlength=len(cells)))
    _write_polygons(zone, "cells", NFACE, faces + 1, by_cell, kind)
    keys = node_keys(len(mesh.points))
    patch_faces = [patch_keys(patch, keys) for patch in mesh.patches]
    rows, there = places(np.concatenate([keys[:0], *patch_faces]), face_keys(cells.faces, keys))
    ends, numbers = np.cumsum([len(patch) for patch in mesh.patches], dtype=np.intp), {}
    for patch, face_rows, known in zip(mesh.patches, np.split(rows, ends), np.split(there, ends), strict=False):
        if loose := len(patch) - np.count_nonzero(known):
            raise MeshFileError(f"{loose} of {len(patch)} faces of patch {patch.name} are of no cell")
        numbers[patch.name] = np.sort(face_rows) + 1
    return numbers


def _write_block(zone: Any, name: str, block: Cells, first: int, kind: Integer) -> None:
    section = _section(zone, name, ELEMENTS[block.shape], first, len(block), kind)
    out = create_sized(section, "ElementConnectivity", block.nodes.size, kind)
    width = block.nodes.shape[1]
    for start in range(0, len(block), ROWS):
        nodes = block.nodes[start : start + ROWS]
        nodes = mirror_nodes("wedge", nodes) if block.shape == "wedge" else nodes
        out[start * width : start * width + nodes.size] = (nodes + 1).astype(kind).ravel()


def _write_polygons(zone: Any, name: str, element: int, first: int, faces: Polygons, kind: Integer) -> None:
    section = _section(zone, name, element, first, len(faces), kind)
    create(section, "ElementStartOffset", "DataArray_t", faces.offsets.astype(kind))
    create(section, "ElementConnectivity", "DataArray_t", faces.nodes.astype(kind))


def _section(zone: Any, name: str, element: int, first: int, count: int, kind: Integer) -> Any:
    (section_name,) = node_names([name], zone)
    section = create(zone, section_name, "Elements_t", np.array([element, 0], dtype=np.int32))
    create(section, "ElementRange", "IndexRange_t", np.array([first, first + count - 1], dtype=kind))
    return section

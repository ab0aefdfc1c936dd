"""CGNS files written anew: one base, a zone for each zone of the mesh, a family for each patch."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

from sdm_deflect.deform.mesh import Mesh, Polyhedra
from sdm_deflect.meshing.formats.cgns_nodes import Integer, create, describe, node_names
from sdm_deflect.meshing.formats.cgns_read import AXES
from sdm_deflect.meshing.formats.cgns_write_elements import write_polyhedra, write_shapes
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.zones import part
from sdm_deflect.meshing.mesh import IntArray

VERSION = 3.4
"""The oldest CGNS with offsets of mixed elements and of faces, which every later library reads."""
FITS = np.iinfo(np.int32).max
"""Numbers up to this one take four bytes."""
KINDS = (
    (r"far.?field|freestream", "BCFarfield"),
    (r"symm", "BCSymmetryPlane"),
    (r"in(let|flow)", "BCInflow"),
    (r"out(let|flow)", "BCOutflow"),
    (r"chimera|overset|overlap", "UserDefined"),
)
"""Kind of boundary condition by the first pattern that is in the patch's name; all others are walls."""


def write_base(file: Any, mesh: Mesh, report: Callable[[float], None]) -> tuple[str, ...]:
    """Write a mesh to an empty file, and return a sentence for each thing that is not as in the mesh.

    Raises
    ------
    MeshFileError
        If a zone has polyhedra beside other cells.
    """
    _write_root(file)
    base = create(file, "Base", "CGNSBase_t", np.array([3, 3], dtype=np.int32))
    zones = node_names([zone.name or "Zone" for zone in mesh.zones], ())
    families: dict[str, str] = {}
    lost = []
    for i, (zone, zone_name) in enumerate(zip(mesh.zones, zones, strict=True)):
        own = part(mesh, zone)
        fresh = [patch.name for patch in own.patches if patch.name not in families]
        families |= dict(zip(fresh, node_names(fresh, (*zones, *families.values())), strict=True))
        lost += _write_zone(base, zone_name, own, families)
        report((i + 1) / len(zones))
    for name in families.values():
        kind = next((kind for pattern, kind in KINDS if re.search(pattern, name.lower())), "BCWall")
        create(create(base, name, "Family_t"), "FamilyBC", "FamilyBC_t", kind)
    renamed = [("zone", zone.name, name) for zone, name in zip(mesh.zones, zones, strict=True) if zone.name]
    renamed += [("patch", old, new) for old, new in families.items()]
    return (*lost, *(f"{what} {old} is named {new}" for what, old, new in renamed if old != new))


def _write_root(file: Any) -> None:
    describe(file, "HDF5 MotherNode", "Root Node of HDF5 File", "MT")
    for name, letters, length in ((" format", "IEEE_LITTLE_32", 15), (" hdf5version", _library(), 33)):
        file.create_dataset(name, data=np.frombuffer(letters.encode().ljust(length, b"\0"), dtype=np.int8))
    create(file, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([VERSION], dtype=np.float32))


def _library() -> str:
    return "HDF5 Version " + ".".join(map(str, h5py.h5.get_libversion()))


def _write_zone(base: Any, name: str, mesh: Mesh, families: dict[str, str]) -> list[str]:
    polyhedra = [block for block in mesh.cells if isinstance(block, Polyhedra)]
    if polyhedra and len(mesh.cells) > 1:
        raise MeshFileError(
            f"zone {name}: CGNS holds either one block of polyhedra or cells of simple shapes, not both"
        )
    cells = sum(len(block) for block in mesh.cells)
    kind = _integer(mesh)
    zone = create(base, name, "Zone_t", np.array([[len(mesh.points)], [cells], [0]], dtype=kind))
    create(zone, "ZoneType", "ZoneType_t", "Unstructured")
    grid = create(zone, "GridCoordinates", "GridCoordinates_t")
    for axis, values in zip(AXES, mesh.points.T, strict=True):
        create(grid, axis, "DataArray_t", np.ascontiguousarray(values, dtype=np.float64))
    conditions = create(zone, "ZoneBC", "ZoneBC_t")
    faces = write_polyhedra(zone, mesh, polyhedra[0], kind) if polyhedra else write_shapes(zone, mesh, families, kind)
    for patch, numbers in faces.items():
        if len(numbers):
            _write_condition(conditions, families[patch], numbers.astype(kind))
    return [f"patch {patch} has no faces and is left out" for patch, numbers in faces.items() if not len(numbers)]


def _write_condition(conditions: Any, family: str, numbers: IntArray) -> None:
    condition = create(conditions, family, "BC_t", "FamilySpecified")
    if numbers[-1] - numbers[0] + 1 == len(numbers):
        create(condition, "PointRange", "IndexRange_t", numbers[[0, -1], None])
    else:
        create(condition, "PointList", "IndexArray_t", numbers[:, None])
    create(condition, "GridLocation", "GridLocation_t", "FaceCenter")
    create(condition, "FamilyName", "FamilyName_t", family)


def _integer(mesh: Mesh) -> Integer:
    """Four bytes where every count and index fits."""
    sizes = [len(mesh.points), *(block.faces.nodes.size * 2 for block in mesh.cells if isinstance(block, Polyhedra))]
    elements = sum(len(block) for block in (*mesh.cells, *mesh.patches))
    return np.int32 if max(*sizes, elements) <= FITS else np.int64

"""CGNS files in HDF5 read in pieces: one unstructured zone of cells of one shape a section, stored as they are."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sdm_deflect.deform.mesh.cells import MIRRORED, VOLUMES, Zone
from sdm_deflect.deform.mesh.mesh import MeshInPieces
from sdm_deflect.meshing.formats.cgns_boundary import NumberedFaces, notes_of, without, zone_border
from sdm_deflect.meshing.formats.cgns_elements import (
    MIXED,
    NFACE,
    NGON,
    SHAPES,
    SIZES,
    ElementSection,
    blocks,
    sections,
)
from sdm_deflect.meshing.formats.cgns_nodes import child, data
from sdm_deflect.meshing.formats.cgns_read import Base, base_of, coordinate_data, coordinates_beside, may_fit
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.table_pieces import CellTable, PointRange, TablePieces
from sdm_deflect.meshing.formats.tables import FileTable

CELLS = {number: shape for number, shape in SHAPES.items() if shape in VOLUMES}


def in_pieces(path: Path, file: Any) -> MeshInPieces | None:
    """Return the mesh of an open file; None if it must be read as a whole.

    MeshFileError or ValueError if the file is damaged.
    """
    if not isinstance(file, h5py.Group):
        return None
    base = base_of(file)
    if len(base.zones) != 1 or base.dimension != 3 or may_fit(base):
        return None
    ((name, zone),) = base.zones.items()
    found, (count,) = sections(zone), base.sizes[name]
    points, cells = _points(path, base, name, count), _cells(path, found)
    faces = _faces(found, count) if points and cells else None
    if faces is None:
        return None
    border = zone_border(base.node, zone, faces, found[-1].last, count, base.dimension)
    patches = without(border.patches, {fault.patch for fault in border.faults})
    pieces = TablePieces(str(path.resolve()), count, points, cells).oriented()
    notes = (*notes_of({name: border.faults}), *coordinates_beside(file, base))
    return MeshInPieces(path.name, pieces, patches, (Zone(name, 0, count),), notes)


def _points(path: Path, base: Base, zone: str, count: int) -> tuple[PointRange, ...]:
    """Return where the coordinates of a zone are; nothing if some are packed, or two axes share theirs."""
    axes = coordinate_data(base, zone)
    places = [axis.id.get_offset() for axis in axes]
    if not all(places) or len(set(places)) < len(axes):
        return ()
    tables = [FileTable(path, begin, axis.dtype.str, count) for begin, axis in zip(places, axes, strict=True)]
    return tuple(PointRange(0, count, table, i, i + 1) for i, table in enumerate(tables))


def _cells(path: Path, found: Sequence[ElementSection]) -> tuple[CellTable, ...]:
    """Return where the cells of all sections are; nothing if some are packed, mixed or given by their faces."""
    if any(_is_mixed(section) for section in found):
        return ()
    cells = []
    for section in found:
        if shape := CELLS.get(section.kind):
            table = _table(path, section)
            if table is None:
                return ()
            cells.append(CellTable(shape, table, 1, MIRRORED[shape] if shape == "wedge" else ()))
    return tuple(cells)


def _is_mixed(section: ElementSection) -> bool:
    """Whether cells are given by their faces, or are of several shapes, as far as the first element tells."""
    if section.kind == MIXED:
        first = np.ravel(data(child(section.node, "ElementConnectivity"))[:1])[:1].tolist()
        return not first or first[0] not in SHAPES or first[0] in CELLS
    return section.kind in (NGON, NFACE)


def _table(path: Path, section: ElementSection) -> FileTable | None:
    """Return the nodes of a section; None if they are packed."""
    stored, size = data(child(section.node, "ElementConnectivity")), SIZES[section.kind]
    if stored.dtype.kind not in "iu" or stored.size != size * len(section):
        raise MeshFileError(
            f"section {section.name} has {len(section)} elements of {size} nodes, but {stored.size} nodes; the file is "
            "damaged"
        )
    begin = stored.id.get_offset()
    return FileTable(path.resolve(), begin, stored.dtype.str, len(section), size) if begin else None


def _faces(found: Sequence[ElementSection], points: int) -> list[NumberedFaces] | None:
    """Return the faces of all sections that are not of cells alone; None if there are cells in one of them."""
    faces = []
    for section in found:
        for block, numbers in blocks(section, points, 3) if section.kind not in CELLS else ():
            if not len(numbers):
                return None
            faces.append(NumberedFaces(section.name, block, numbers))
    return faces

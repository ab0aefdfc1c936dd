"""The mesh in an open CGNS file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sdm_deflect.deform.mesh import Cells, Mesh, Polyhedra
from sdm_deflect.meshing.formats.cgns_boundary import NumberedFaces, conditions, patches
from sdm_deflect.meshing.formats.cgns_elements import NFACE, NGON, Section, blocks, sections
from sdm_deflect.meshing.formats.cgns_nodes import Array, child, children, data, integers, text
from sdm_deflect.meshing.formats.cgns_polyhedra import read_polyhedra
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.guard import check_faces
from sdm_deflect.meshing.formats.orientation import oriented
from sdm_deflect.meshing.formats.zones import joined
from sdm_deflect.meshing.mesh import FloatArray

AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")


def read_base(file: Any, report: Callable[[float], None]) -> Mesh:
    """Return the mesh of an open file, its zones one after another.

    Raises
    ------
    MeshFileError, ValueError
        If the file is damaged, or holds what is no unstructured mesh in three dimensions.
    """
    base, found = zones(file)
    parts = []
    for i, (name, zone) in enumerate(found):
        report(i / len(found))
        try:
            parts.append(_zone(base, zone))
        except (MeshFileError, ValueError) as error:
            raise MeshFileError(f"zone {name}: {error}") from error
    report(1.0)
    return joined([name for name, _ in found], parts)


def zones(file: Any) -> tuple[Any, list[tuple[str, Any]]]:
    """Return the base of a file, and its zones with their names.

    Raises
    ------
    MeshFileError
        If there is not one base in three dimensions, no zone, or a structured zone.
    """
    bases = [base for _, base in children(file, "CGNSBase_t")]
    if not bases:
        raise MeshFileError("this HDF5 file has no CGNSBase_t; it is no CGNS file, or it is damaged")
    solid = [base for base in bases if data(base)[()].tolist() == [3, 3]]
    if len(solid) != 1:
        raise MeshFileError(
            f"{len(solid)} of {len(bases)} bases have cells and points in three dimensions; one is needed"
        )
    found = list(children(solid[0], "Zone_t"))
    if not found:
        raise MeshFileError("the file has no zones")
    other = [name for name, zone in found if text(child(zone, "ZoneType")) != "Unstructured"]
    if other:
        raise MeshFileError(
            f"{len(other)} zones are structured ({', '.join(other[:3])}); only unstructured zones can be read: export "
            "the mesh as unstructured from the program that made it"
        )
    return solid[0], found


def coordinate_data(zone: Any) -> list[Any]:
    """Return the datasets (N,) of x, y and z of a zone.

    Raises
    ------
    MeshFileError
        If one is missing, or has another length than the zone says.
    """
    grid = child(zone, "GridCoordinates")
    found = [data(child(grid, axis)) for axis in AXES]
    points = int(integers(zone)[0])
    for axis, stored in zip(AXES, found, strict=True):
        if stored.shape != (points,) or stored.dtype.kind != "f":
            raise MeshFileError(f"{axis} holds {stored.shape} {stored.dtype}, expected ({points},) real numbers")
    return found


def _zone(base: Any, zone: Any) -> Mesh:
    points = _points(coordinate_data(zone))
    found = sections(zone)
    if not found:
        raise MeshFileError("it has no elements")
    polyhedral = any(section.kind in (NGON, NFACE) for section in found)
    cells, faces = (_polyhedral if polyhedral else _shaped)(found, points)
    named = patches(conditions(base, zone), faces, found[-1].last)
    mesh = Mesh(points, cells, tuple(named))
    check_faces(mesh)
    return mesh


def _points(stored: Sequence[Any]) -> FloatArray:
    points = np.empty((len(stored[0]), 3))
    for axis, values in enumerate(stored):
        column: Array = values[()]
        points[:, axis] = column
    return points


def _shaped(found: Sequence[Section], points: FloatArray) -> tuple[tuple[Cells, ...], list[NumberedFaces]]:
    cells, faces = [], []
    for section in found:
        for block in blocks(section, len(points)):
            if len(block.numbers):
                faces.append(NumberedFaces(block.section, block.elements, block.numbers))
            else:
                cells.append(oriented(points, block.elements))
    return tuple(cells), faces


def _polyhedral(found: Sequence[Section], points: FloatArray) -> tuple[tuple[Polyhedra], list[NumberedFaces]]:
    others = [section.name for section in found if section.kind not in (NGON, NFACE)]
    if others:
        raise MeshFileError(f"cells by their faces (NGON_n) and other elements ({', '.join(others)}) in one zone")
    block, numbers = read_polyhedra(found, len(points))
    inner = len(block.neighbour)
    faces = [
        NumberedFaces(None, block.faces.rows(0, inner), numbers[:inner], outer=False),
        NumberedFaces(None, block.faces.rows(inner, len(block.faces)), numbers[inner:]),
    ]
    return (block,), faces

"""Zones, points, cells and markers of an SU2 file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sdm_deflect.deform.mesh import CORNERS, Cells, Mesh, Patch
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.guard import check_faces
from sdm_deflect.meshing.formats.orientation import oriented
from sdm_deflect.meshing.formats.su2_source import Su2File, coordinates
from sdm_deflect.meshing.formats.su2_text import Lines, Section
from sdm_deflect.meshing.formats.zones import joined
from sdm_deflect.meshing.mesh import FloatArray, IntArray

SOLIDS = {10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
FACES = {5: "triangle", 9: "quad"}
PARALLEL = "SEND_RECEIVE"
"""Marker of points that other processes hold; it is no boundary."""


def read_zones(source: Su2File) -> Mesh:
    """Return the mesh of an open file.

    Raises
    ------
    MeshFileError, ValueError
        If a section is missing, damaged or contradicts another.
    """
    zones = _zones(source.sections)
    return joined(list(zones), [_zone(source, own) for own in zones.values()])


def _zones(found: Sequence[Section]) -> dict[str, list[Section]]:
    """Sections by zone; in a file without zones, all sections of a zone without a name."""
    zones: dict[str, list[Section]] = {}
    name = ""
    for section in found:
        if section.keyword == "IZONE":
            name = f"zone {section.count}"
            if name in zones:
                raise MeshFileError(f"IZONE= {section.count} is there twice")
        zones.setdefault(name, []).append(section)
    if len(zones) > 1:
        zones.pop("", None)
    announced = [section.count for section in found if section.keyword == "NZONE"]
    if announced and announced[0] != len(zones):
        raise MeshFileError(
            f"NZONE= {announced[0]}, but there are {len(zones)} zones; the file is truncated or damaged"
        )
    return zones


def _zone(source: Su2File, own: Sequence[Section]) -> Mesh:
    points = _points(source, _only(own, "NPOIN"))
    cells = _elements(source, _only(own, "NELEM"), SOLIDS, len(points))
    mesh = Mesh(points, tuple(oriented(points, block) for block in cells), _patches(source, own, len(points)))
    check_faces(mesh)
    return mesh


def _only(own: Sequence[Section], keyword: str) -> Section:
    found = [section for section in own if section.keyword == keyword]
    if len(found) != 1:
        raise MeshFileError(f"{len(found)} lines {keyword}= where there must be one; the file is truncated or damaged")
    return found[0]


def _points(source: Su2File, section: Section) -> FloatArray:
    possible = (section.end - section.begin) // len("0 0 0") + 1
    points = np.empty((min(section.count, possible), 3))  # a damaged count may be any number
    start = 0
    for _, lines in source.lines(section, np.float64):
        own = lines.values[coordinates(lines)][: len(points) - start]
        points[start : start + len(own)] = own
        start += len(own)
    return points


def _patches(source: Su2File, own: Sequence[Section], points: int) -> tuple[Patch, ...]:
    patches = []
    tags = [i for i, section in enumerate(own) if section.keyword == "MARKER_TAG"]
    announced = _only(own, "NMARK").count
    if announced != len(tags):
        raise MeshFileError(f"NMARK= {announced}, but there are {len(tags)} markers; the file is truncated or damaged")
    for i in tags:
        name = own[i].value
        if name == PARALLEL:
            continue
        if own[i + 1 : i + 2] == [] or own[i + 1].keyword != "MARKER_ELEMS":
            raise MeshFileError(f"marker {name} has no MARKER_ELEMS= line; the file is truncated or damaged")
        try:
            patches.append(Patch(name, _elements(source, own[i + 1], FACES, points)))
        except MeshFileError as error:
            raise MeshFileError(f"marker {name}: {error}") from error
    return tuple(patches)


def _elements(source: Su2File, section: Section, shapes: Mapping[int, str], points: int) -> tuple[Cells, ...]:
    """One block of each shape, in the order in which shapes first appear; the order within a shape is the file's."""
    found: dict[int, list[IntArray]] = {}
    for _, lines in source.lines(section, np.int64):
        kinds = np.asarray(lines.values[lines.first[:-1]], dtype=np.int64)
        distinct, first = np.unique(kinds, return_index=True)
        for kind in distinct[np.argsort(first)].tolist():
            if kind not in shapes:
                wanted = ", ".join(f"{number} ({shape})" for number, shape in shapes.items())
                raise MeshFileError(
                    f"{np.count_nonzero(kinds == kind)} elements of type {kind} where there can be {wanted}"
                )
            found.setdefault(kind, []).append(_nodes(lines, np.flatnonzero(kinds == kind), shapes[kind], points))
    blocks = []
    for kind in list(found):
        blocks.append(Cells(shapes[kind], np.concatenate(found.pop(kind))))
    return tuple(blocks)


def _nodes(lines: Lines, rows: IntArray, shape: str, points: int) -> IntArray:
    """Nodes (R, k) on lines of one shape: its type, k nodes, and perhaps the element's own number."""
    corners = CORNERS[shape]
    extra = np.diff(lines.first)[rows] - 1 - corners
    bad = int(np.count_nonzero((extra != 0) & (extra != 1)))
    if bad:
        raise MeshFileError(f"{bad} lines of {shape} elements have other than {corners} nodes")
    nodes: IntArray = lines.values[lines.first[rows, None] + np.arange(1, corners + 1)].astype(np.intp, copy=False)
    missing = int(np.count_nonzero(((nodes < 0) | (nodes >= points)).any(axis=1)))
    if missing:
        raise MeshFileError(
            f"{missing} {shape} elements name points that are not among the {points} (0 to {points - 1})"
        )
    return nodes

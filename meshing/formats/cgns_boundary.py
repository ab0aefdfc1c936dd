"""Boundary conditions of a CGNS zone as named patches."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sdm_deflect.deform.mesh import Cells, Patch, Polygons
from sdm_deflect.meshing.formats.cgns_nodes import child, children, has, integers, text
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.shapes import all_of, chosen
from sdm_deflect.meshing.mesh import BoolArray, IntArray

ON_FACES = ("FaceCenter", "CellCenter")
"""Gmsh and older writers say CellCenter where they mean the boundary's faces."""
PLACES = ("PointRange", "PointList", "ElementRange", "ElementList")


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """A boundary condition: the numbers (K,) of its faces, or of its points where it is given by points.

    `of_family` says whether its patch bears the name of a family.
    """

    patch: str
    of_family: bool
    by_points: bool
    numbers: IntArray = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class NumberedFaces:
    """Faces and their numbers (M,) in the file; the section where they are by themselves; whether they are outside."""

    section: str | None
    faces: Cells | Polygons
    numbers: IntArray = field(repr=False)
    outer: bool = True


def conditions(base: Any, zone: Any, last: int, points: int, dimension: int) -> list[Condition]:
    """Return the boundary conditions of a zone that are on faces or points; faces of plane cells are edges.

    A condition that is specified by its family (FamilySpecified) belongs to the patch of the family's name (of the
    physical group's name in files of Gmsh); any other is a patch of its own name. MeshFileError if one names elements
    or points that are not among the zone's, which are numbered up to `last` and `points`.
    """
    found = []
    for _, group in children(zone, "ZoneBC_t"):
        for name, node in children(group, "BC_t"):
            place = next((place for place in PLACES if has(node, place)), None)
            if place is None:
                raise MeshFileError(f"boundary condition {name} says not where it is; the file is damaged")
            where = location(node)
            numbers = integers(child(node, place))
            if (where == "EdgeCenter" and dimension > 2) or not len(numbers):
                continue
            by_points = where not in (*ON_FACES, "EdgeCenter") and place.startswith("Point")
            if numbers.min() < 1 or numbers.max() > (points if by_points else last):
                held, most = ("points", points) if by_points else ("elements", last)
                raise MeshFileError(
                    f"boundary condition {name} is on {held} {numbers.min()} to {numbers.max()}, but they are numbered "
                    f"from 1 to {most}; the file is damaged"
                )
            if place.endswith("Range"):
                if len(numbers) != 2 or numbers[1] < numbers[0]:
                    raise MeshFileError(
                        f"boundary condition {name} has the range {numbers.tolist()}; the file is damaged"
                    )
                numbers = np.arange(numbers[0], numbers[1] + 1)
            found.append(Condition(*patch_name(base, name, node), by_points, np.unique(numbers)))
    return found


def patches(found: Sequence[Condition], faces: Sequence[NumberedFaces], last: int) -> list[Patch]:
    """Return the patches of a zone whose elements are numbered up to `last`.

    A condition given by points has the boundary faces with all corners among them that no other condition has. Faces of
    a section that no condition has are a patch of the section's name. MeshFileError if a condition names elements that
    are not there, or that are only in part faces.
    """
    free = [np.ones(len(part.numbers), dtype=np.bool_) for part in faces]
    named: dict[str, list[Cells | Polygons]] = {condition.patch: [] for condition in found}
    for condition in sorted(found, key=lambda condition: condition.by_points):
        rows = _on_points(condition, faces, free) if condition.by_points else _by_number(condition, faces, last)
        for part, own, left in zip(faces, rows, free, strict=True):
            left &= ~own
            if own.any():
                named[condition.patch].append(chosen(part.faces, np.flatnonzero(own)))
    for part, left in zip(faces, free, strict=True):
        if part.section is not None and left.any():
            named.setdefault(part.section, []).append(chosen(part.faces, np.flatnonzero(left)))
    return [Patch(name, tuple(own)) for name, own in named.items() if own]


def location(node: Any) -> str:
    """Return where on the mesh a condition or an interface is: ``"Vertex"`` unless it says so."""
    return text(child(node, "GridLocation")) if has(node, "GridLocation") else "Vertex"


def patch_name(base: Any, name: str, node: Any, always: bool = False) -> tuple[str, bool]:
    """Return the patch that a boundary condition belongs to, and whether that is its family.

    It is if the condition is specified by its family, or if it names one at all where that should `always` do.
    """
    if not has(node, "FamilyName") or not (always or text(node) == "FamilySpecified"):
        return name, False
    family = text(child(node, "FamilyName"))
    nested = [own for _, own in children(child(base, family), "FamilyName_t")] if has(base, family) else []
    return (text(nested[0]) if nested else family), True


def _by_number(condition: Condition, faces: Sequence[NumberedFaces], last: int) -> list[BoolArray]:
    rows = [np.isin(part.numbers, condition.numbers) for part in faces]
    missing = len(condition.numbers) - sum(int(own.sum()) for own in rows)
    of_cells_or_edges = missing == len(condition.numbers) and condition.numbers[-1] <= last
    if missing and not of_cells_or_edges:
        count = f"{missing} of its {len(condition.numbers)} elements"
        raise MeshFileError(f"patch {condition.patch}: {count} are no faces of the file; it is damaged")
    return rows


def _on_points(condition: Condition, faces: Sequence[NumberedFaces], free: Sequence[BoolArray]) -> list[BoolArray]:
    last = max([int(condition.numbers[-1]), *(int(part.faces.nodes.max(initial=0)) + 1 for part in faces)])
    marked = np.zeros(1 + last, dtype=np.bool_)
    marked[condition.numbers] = True
    rows = []
    for part, left in zip(faces, free, strict=True):
        whole = all_of(marked[1:], part.faces)
        rows.append(whole & left & part.outer)
    if not any(own.any() for own in rows):
        raise MeshFileError(
            f"boundary condition {condition.patch} is given by points, and no face of the file has all its corners "
            "among them; write the boundary's faces as elements"
        )
    return rows

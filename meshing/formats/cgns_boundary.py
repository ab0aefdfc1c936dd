"""Boundary conditions of a CGNS zone as named patches."""

from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import BoolArray, IntArray
from sdm_deflect.base.errors import MeshFileError, sentence
from sdm_deflect.meshing.mesh.cells import Cells, Constraint, Patch, Polygons
from sdm_deflect.meshing.mesh.mesh import ABSENT

from .cgns_nodes import child, children, has, integers, text
from .shapes import all_of, chosen
from .zones import common_constraints

# Gmsh and older writers say CellCenter where they mean the boundary's faces.
ON_FACES = ("FaceCenter", "CellCenter")
PLACES = ("PointRange", "PointList", "ElementRange", "ElementList")
# Name of the remaining faces of a patch that could only be read in part.
PART = "part of {}"
UNNAMED = "faces without a condition"
# Notes of one file.
SHOWN = 20


class NoFacesError(MeshFileError):
    """A boundary condition has no faces, so its patch lacks nothing without it."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Something of a zone that could not be read, and why.

    `patch` is the patch that lacks faces because of it, perhaps a family's; empty if none does.
    """

    patch: str
    of_family: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryCondition:
    """A boundary condition: the numbers (K,) of its faces, or of its points where it is given by points.

    `of_family` is True if its patch has the name of a family.
    """

    name: str
    patch: str
    of_family: bool
    by_points: bool
    numbers: IntArray = field(repr=False)
    constraint: Constraint = ""


@dataclass(frozen=True, slots=True, eq=False)
class NumberedFaces:
    """Faces, their numbers (M,) in the file, their section if it has no cells, and whether they are on the outside."""

    section: str | None
    faces: Cells | Polygons
    numbers: IntArray = field(repr=False)
    outer: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """Patches of a zone, the families among their names, and the conditions that could not be read."""

    patches: list[Patch]
    families: frozenset[str]
    faults: list[Fault]


def zone_border(base: Any, zone: Any, faces: Sequence[NumberedFaces], last: int, points: int, dimension: int) -> Border:
    """Return the patches of a zone whose elements are numbered up to `last`; faces of plane cells are edges.

    A condition that is specified by its family (FamilySpecified) belongs to the patch of the family's name (of the
    physical group's name in files of Gmsh); any other is a patch of its own name. A condition given by points has the
    boundary faces with all corners among them that no other condition has. Faces of a section that no condition has are
    a patch of the section's name.
    """
    faults: list[Fault] = []
    conditions = _conditions(base, zone, faults, (last, points, dimension))
    free = [np.ones(len(part.numbers), dtype=np.bool_) for part in faces]
    constraints = common_constraints((condition.patch, condition.constraint) for condition in conditions)
    named = _by_patch(conditions, faces, last, free, faults)
    for part, left in zip(faces, free, strict=True):
        if left.any() and (section := part.section or (UNNAMED if part.outer and faults else None)):
            named.setdefault(section, []).append(chosen(part.faces, np.flatnonzero(left)))
    patches = [
        Patch(name, tuple(patch_faces), constraint=constraints.get(name, ""))
        for name, patch_faces in named.items()
        if patch_faces
    ]
    families = {one.patch: one.of_family for one in conditions}
    return Border(patches, frozenset(filter(families.get, families)), faults)


def _by_patch(
    conditions: Sequence[BoundaryCondition],
    faces: Sequence[NumberedFaces],
    last: int,
    free: Sequence[BoolArray],
    faults: list[Fault],
) -> dict[str, list[Cells | Polygons]]:
    """Return the faces of each patch, and remove them from the free ones."""
    named: dict[str, list[Cells | Polygons]] = {condition.patch: [] for condition in conditions}
    for condition in sorted(conditions, key=lambda condition: condition.by_points):
        with as_faults(faults, condition.name, condition.patch, condition.of_family):
            rows = _on_points(condition, faces, free) if condition.by_points else _by_number(condition, faces, last)
            for part, row, left in zip(faces, rows, free, strict=True):
                left &= ~row
                if row.any():
                    named[condition.patch].append(chosen(part.faces, np.flatnonzero(row)))
    return named


def _conditions(base: Any, zone: Any, faults: list[Fault], sizes: tuple[int, int, int]) -> list[BoundaryCondition]:
    """Return the conditions of a zone with faces; `sizes` are last element's number, number of points and dimension."""
    conditions: list[BoundaryCondition] = []
    for name, node, patch, of_family in named_conditions(base, zone, faults, always=False):
        with as_faults(faults, name, patch, of_family):
            by_points, numbers = _numbers(node, place_of(node), location(node), *sizes)
            if len(numbers):
                held_by = constraint(base, node)
                conditions.append(BoundaryCondition(name, patch, of_family, by_points, np.unique(numbers), held_by))
    return conditions


def named_conditions(base: Any, zone: Any, faults: list[Fault], always: bool) -> Iterator[tuple[str, Any, str, bool]]:
    """Yield each boundary condition of a zone: name, node, patch, and whether the patch is a family."""
    for _, group in children(zone, "ZoneBC_t"):
        for name, node in children(group, "BC_t"):
            with as_faults(faults, name, name):
                yield name, node, *patch_name(base, name, node, always)


@contextmanager
def as_faults(faults: list[Fault], name: str, patch: str, of_family: bool = False) -> Iterator[None]:
    """Append errors of a boundary condition to `faults` instead of raising them."""
    try:
        yield
    except NoFacesError as error:
        faults.append(Fault("", False, f"boundary condition {name}: {error}"))
    except MeshFileError as error:
        faults.append(Fault(patch, of_family, f"boundary condition {name}: {error}"))


def place_of(node: Any) -> str:
    """Return the name, from `PLACES`, of the node with a condition's points or faces; MeshFileError without one."""
    for place in PLACES:
        if has(node, place):
            return place
    raise MeshFileError("it does not say where it is")


def check_range(begin: Sequence[int], end: Sequence[int], most: Sequence[int]) -> None:
    """Raise NoFacesError for an empty range, which ends right before it begins, outside 1 to `most`."""
    for a, b, n in zip(begin, end, most, strict=True):
        if a - b == 1 and not 1 <= b < a <= n:
            raise NoFacesError(f"its range {_list_of(begin)} to {_list_of(end)} holds nothing")


def without(patches: Sequence[Patch], absent: Container[str]) -> tuple[Patch, ...]:
    """Return the patches joined by name; patches that lack faces are renamed."""
    faces: dict[str, list[Any]] = {}
    named = [replace(patch, name=PART.format(patch.name)) if patch.name in absent else patch for patch in patches]
    for patch in named:
        faces.setdefault(patch.name, []).extend(patch.faces)
    constraints = common_constraints((patch.name, patch.constraint) for patch in named)
    return tuple(Patch(name, tuple(patch_faces), constraint=constraints[name]) for name, patch_faces in faces.items())


def notes_of(faults: Mapping[str, Sequence[Fault]]) -> tuple[str, ...]:
    """Return a sentence for each absent patch and for all else that could not be read; zones are named."""
    absent: dict[str, list[str]] = {}
    notes = []
    for zone, zone_faults in faults.items():
        for fault in zone_faults:
            reason = sentence(f"zone {zone}: {fault.reason}")
            if fault.patch:
                name = fault.patch if fault.of_family or len(faults) == 1 else f"{zone}/{fault.patch}"
                absent.setdefault(name, []).append(reason)
            else:
                notes.append(reason)
    for name, reasons in absent.items():
        more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
        notes.insert(0, ABSENT.format(sentence(name)) + reasons[0] + more)
    left = len(notes) - SHOWN
    return (*notes[:SHOWN], *([f"{left} more conditions and interfaces could not be read"] if left > 0 else []))


def location(node: Any) -> str:
    """Return where on the mesh a condition or an interface is: ``"Vertex"`` unless it says so."""
    return text(child(node, "GridLocation")) if has(node, "GridLocation") else "Vertex"


def patch_name(base: Any, name: str, node: Any, always: bool = False) -> tuple[str, bool]:
    """Return the patch that a boundary condition belongs to, and whether that is its family.

    The family counts if the condition is specified by it; with `always` it is enough that the condition names it.
    """
    if not has(node, "FamilyName") or not (always or text(node) == "FamilySpecified"):
        return name, False
    family = text(child(node, "FamilyName"))
    nested = [named for _, named in children(child(base, family), "FamilyName_t")] if has(base, family) else []
    return (text(nested[0]) if nested else family), True


def constraint(base: Any, node: Any) -> Constraint:
    """Return the constraint of a boundary condition, which may be that of its family."""
    try:
        kind = text(node)
        if kind == "FamilySpecified":
            family = child(base, text(child(node, "FamilyName")))
            kind = next((text(named) for _, named in children(family, "FamilyBC_t")), "")
    except MeshFileError:  # it has no kind that can be read
        return ""
    return "symmetry" if kind == "BCSymmetryPlane" else ""


def _numbers(node: Any, place: str, where: str, last: int, points: int, dimension: int) -> tuple[bool, IntArray]:
    """Return whether a condition is given by points, and the numbers (K,) of these or of its elements."""
    numbers = integers(child(node, place))
    if (where == "EdgeCenter" and dimension > 2) or not len(numbers):
        return False, numbers[:0]
    by_points = where not in (*ON_FACES, "EdgeCenter") and place.startswith("Point")
    counted, most = ("points", points) if by_points else ("elements", last)
    if place.endswith("Range"):
        if len(numbers) != 2:
            raise MeshFileError(f"its range has {len(numbers)} numbers, expected 2")
        check_range(numbers[:1].tolist(), numbers[1:].tolist(), [most])
    if numbers.min() < 1 or numbers.max() > most:
        raise MeshFileError(
            f"it is on {counted} {numbers.min()} to {numbers.max()}, but they are numbered from 1 to {most}"
        )
    if place.endswith("Range"):
        if numbers[1] < numbers[0]:
            raise MeshFileError(f"it has the range {numbers.tolist()}, which ends before it begins")
        numbers = np.arange(numbers[0], numbers[1] + 1)
    return by_points, numbers


def _by_number(condition: BoundaryCondition, faces: Sequence[NumberedFaces], last: int) -> list[BoolArray]:
    rows = [np.isin(part.numbers, condition.numbers) for part in faces]
    missing = len(condition.numbers) - sum(int(row.sum()) for row in rows)
    of_cells_or_edges = missing == len(condition.numbers) and condition.numbers[-1] <= last
    if missing and not of_cells_or_edges:
        raise MeshFileError(f"{missing} of its {len(condition.numbers)} elements are no faces")
    return rows


def _on_points(
    condition: BoundaryCondition, faces: Sequence[NumberedFaces], free: Sequence[BoolArray]
) -> list[BoolArray]:
    last = max([int(condition.numbers[-1]), *(int(part.faces.nodes.max(initial=0)) + 1 for part in faces)])
    marked = np.zeros(1 + last, dtype=np.bool_)
    marked[condition.numbers] = True
    rows = []
    for part, left in zip(faces, free, strict=True):
        whole = all_of(marked[1:], part.faces)
        rows.append(whole & left & part.outer)
    if not any(row.any() for row in rows):
        raise MeshFileError(
            "it is given by points, and no face of the file has all its corners among them; write the boundary's faces "
            "as elements"
        )
    return rows


def _list_of(indices: Sequence[int]) -> str:
    return f"({', '.join(map(str, indices))})" if len(indices) > 1 else str(indices[0])

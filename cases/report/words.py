"""What the names in a report mean."""

from dataclasses import fields, is_dataclass
from typing import Any

from sdm_deflect.cases.case import Case

CHECKS = {
    "outside_moved": "largest displacement outside the hexahedra",
    "inverted_cells": "cells turned inside out",
    "fixed_surfaces_moved": "largest displacement of a surface that must not move",
    "quality_min": "worst cell of the deflected mesh, by mean ratio (1 is regular)",
    "planarity": "nodes of planar CAD faces from their best plane",
    "surface_to_cad": "moved nodes from the deflected CAD",
    "trailing_edge_angle": "trailing edge from the angle that was asked",
    "hinge_offset": "blended wedge from the known offset to the rigid one at the hinge",
    "cylindricity": "nodes of the fuselage panel from the cylinder",
    "root_on_cylinder": "root line from cylinder and tail",
    "chimera_face_in_plane": "nodes of the Chimera face from its plane",
    "orphans": "nodes of the overset meshes without a donor cell",
}
STATES = {
    "before": "undeflected",
    "after": "deflected",
    "after_pinned": "deflected, Chimera face pinned instead of sliding",
}

Rows = list[tuple[str, str, str, str]]
"""Name, value, unit and meaning of parameters."""


def meaning(check: str) -> str:
    """Return what a check measures, empty for one that is not known."""
    return CHECKS.get(check.partition(":")[0], "")


def parameter_tables(case: Case) -> dict[str, Rows]:
    """Return every parameter of a case, by table as in case.toml."""
    tables: dict[str, Rows] = {"case": []}
    for name, value in _values(case):
        if name == "fighter":
            tables |= {part: _rows(component) for part, component in _values(value) if is_dataclass(component)}
        elif is_dataclass(value):
            tables[name] = _rows(value)
        else:
            tables["case"].append((name, _shown(value), *_declared(case, name)))
    return tables


def _rows(table: Any) -> Rows:
    return [(name, _shown(value), *_declared(table, name)) for name, value in _values(table)]


def _values(table: Any) -> list[tuple[str, Any]]:
    return [(one.name, getattr(table, one.name)) for one in fields(table)]


def _declared(table: Any, name: str) -> tuple[str, str]:
    """Return unit and meaning of a field that is a quantity."""
    metadata = next(one.metadata for one in fields(table) if one.name == name)
    return str(metadata.get("unit", "")).removeprefix("-"), str(metadata.get("doc", ""))


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return ", ".join(_shown(one) for one in value) or "none"
    if is_dataclass(value):
        return " ".join(_shown(one) for _, one in _values(value))
    return str(value)

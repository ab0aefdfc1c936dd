"""Variations of a case from the command line and from TOML: nested values replaced all at once."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from tomllib import TOMLDecodeError, loads
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import tomli_w

from sdm_deflect.cases.case import Case

T = TypeVar("T")
Nested = dict[str, Any]


def parse_assignments(assignments: Sequence[str]) -> Nested:
    """Turn ["wing.half_span=0.3", ...] into nested tables.

    Raises
    ------
    ValueError
        If an assignment is not of the form key=value.
    """
    nested: Nested = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ValueError(f"--set {text!r} is not of the form key=value, such as wing.half_span=0.3")
        *path, last = key.strip().split(".")
        table = nested
        for name in path:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise ValueError(f"--set {text!r}: {name} is set twice, as a value and as a table")
        table[last] = value.strip()
    return nested


def with_overrides(case: Case, nested: Nested) -> Case:
    """Return the case with values replaced; components of the aircraft may stand at the top level."""
    components = {f.name for f in fields(case.fighter)}
    top = {k: v for k, v in nested.items() if k not in components}
    aircraft = {k: v for k, v in nested.items() if k in components}
    if aircraft:
        top["fighter"] = {**top.get("fighter", {}), **aircraft}
    return _replaced(case, top, "")


def to_toml(case: Case) -> str:
    """Every parameter of the case as TOML."""
    tables = asdict(case)
    tables.update(tables.pop("fighter"))
    return tomli_w.dumps(tables)


def read_toml(path: Path) -> Nested:
    """Read the tables of a configuration file; ValueError names the file if it is none."""
    try:
        return loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, TOMLDecodeError) as error:
        raise ValueError(f"configuration {path}: {error}") from None


def _replaced(value: T, nested: Mapping[str, Any], prefix: str) -> T:
    """Return the dataclass instance with the named fields replaced, recursively."""
    hints = get_type_hints(type(value))
    known = {f.name for f in fields(value)}  # type: ignore[arg-type]
    changes: Nested = {}
    for name, new in nested.items():
        if name not in known:
            raise ValueError(_unknown(prefix + name, name, known))
        old = getattr(value, name)
        if is_dataclass(old):
            if not isinstance(new, Mapping):
                raise ValueError(f"{prefix}{name} is a table; set one of its values, such as {prefix}{name}.…")
            changes[name] = _replaced(old, new, f"{prefix}{name}.")
        else:
            changes[name] = _converted(new, hints[name], prefix + name)
    return replace(value, **changes)  # type: ignore[type-var]


def _converted(new: object, kind: Any, name: str) -> object:
    """Convert text or a TOML value to the type of the field."""
    if get_origin(kind) is tuple:
        return _listed(new, get_args(kind)[0], name)
    if isinstance(new, Mapping | list):
        raise ValueError(f"{name} is a single value, not a table")
    if kind is bool:
        if str(new).lower() not in ("true", "false"):
            raise ValueError(f"{name} = {new} is neither true nor false")
        return str(new).lower() == "true"
    if kind not in (int, float):
        return str(new)
    try:
        return kind(str(new))
    except ValueError:
        wanted = "a whole number" if kind is int else "a number"
        raise ValueError(f"{name} = {new} is not {wanted}") from None


def _listed(new: object, kind: Any, name: str) -> object:
    """Convert a TOML list, or its text, to a tuple of dataclasses or of tuples of numbers."""
    try:
        items: Any = loads(f"items = {new}")["items"] if isinstance(new, str) else new
        if is_dataclass(kind):
            return tuple(kind(**item) for item in items)  # type: ignore[operator]
        return tuple(tuple(float(number) for number in item) for item in items)
    except (TOMLDecodeError, TypeError, ValueError) as error:
        raise ValueError(f"{name} is not a list as in case.toml: {error}") from None


def _unknown(path: str, name: str, known: set[str]) -> str:
    close = get_close_matches(name, sorted(known), n=1)
    hint = f"; did you mean {close[0]}?" if close else f"; known: {', '.join(sorted(known))}"
    return f"unknown parameter {path}{hint}"

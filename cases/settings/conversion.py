"""Conversion of TOML tables, ``key=value`` texts and keywords to frozen dataclasses, whose fields are the schema.

A mistake is reported in one sentence that names the setting as the user would type it, such as ``wing.half_span``.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from itertools import repeat
from math import isfinite
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from tomllib import TOMLDecodeError, loads
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import tomli_w

from sdm_deflect.base.errors import InputError, nearest, shortened
from sdm_deflect.base.schema import Setting, inline_in, settings_in

T = TypeVar("T")
Nested = dict[str, Any]
# Converts a value to a type; the text names its place in messages.
Reader = Callable[[Any, Any, str], Any]
# Largest size of a settings file: it may list all nodes of a large surface.
MOST_BYTES = 10**7
# Whole numbers lie below.
LARGEST = 2**31


def structure(table: Any, kind: type[T], place: str = "") -> T:
    """Return the dataclass of a table; InputError, of one sentence, for the first setting that is wrong.

    `place` is the path of the table within other tables.
    """
    if isinstance(table, kind):
        return table
    if not isinstance(table, Mapping):
        example = fields(kind)[0].name  # type: ignore[arg-type]
        raise InputError(f"{place} = {shortened(table)} is no table; set one of its values, such as {example}")
    rest = {str(name): value for name, value in table.items()}
    values: Nested = {}
    for name, of in inline_in(kind).items():
        values |= _inline(rest, name, of, place)
    direct = {name: setting for name, setting in settings_in(kind).items() if len(setting.path) == 1}
    _check_names(rest, settings_in(kind), direct, place)
    for name, value in rest.items():
        setting, where = direct[name], _within(place, name)
        values[setting.path[0]] = _of_kind(parse_spelling(value, setting, where), setting.kind, where)
    try:
        return kind(**values)
    except ValueError as error:
        text = str(error)
        raise InputError(_within(place, text) if text.partition(" ")[0] in direct else text) from None


def _check_names(given: Nested, known: Mapping[str, Setting], direct: Mapping[str, Setting], place: str) -> None:
    if unknown := next((name for name in given if name not in known), None):
        raise InputError(f"unknown setting {_within(place, unknown)}; {_meant(unknown, known)}")
    if missing := next((name for name in direct if direct[name].default is MISSING and name not in given), None):
        raise InputError(f"{_within(place, missing)} is missing")


def table_of(value: Any, kind: Any = None) -> Nested:
    """Convert a dataclass to nested tables (the inverse of `structure`), optionally only the fields of `kind`."""
    items = {name: setting.of(value) for name, setting in settings_in(kind or type(value)).items()}
    return {name: _plainly(item) for name, item in items.items() if item is not None}


def with_values(value: T, changes: Mapping[str, Any]) -> T:
    """Return a dataclass with some values replaced by those of a nested table; InputError as `structure`."""
    return structure(merge(table_of(value), changes), type(value))


def to_toml(value: Any) -> str:
    """Convert a dataclass to TOML; InputError for an object that TOML cannot hold."""
    try:
        return tomli_w.dumps(table_of(value))
    except TypeError as error:
        raise InputError(f"these settings hold an object of Python that no file can hold: {error}") from None


def read_toml(path: Path) -> Nested:
    """Return the tables of a file; InputError names it if it cannot be read."""
    try:
        if path.exists() and not path.is_file():
            raise ValueError("is not a regular file")
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"is larger than {MOST_BYTES / 1e6:g} MB")
        return loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"configuration {path}: {error}") from None


def parse_assignments(assignments: Sequence[str]) -> Nested:
    """Return tables from ["wing.half_span=0.3", ...], values as TOML or text; InputError if one is not key=value."""
    nested: Nested = {}
    for text in assignments:
        key, equals, value = (part.strip() for part in text.partition("="))
        *path, last = key.split(".")
        if not equals or not all((*path, last)):
            raise InputError(f"{text!r} is not of the form key=value, such as wing.half_span=0.3")
        table = nested
        for name in path:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError(f"{text!r}: {name} is set twice, as a value and as a table")
        table[last] = _value(value)
    return nested


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Nested:
    """Return nested tables with some values replaced by others."""
    out = dict(base)
    for name, new in changes.items():
        old = out.get(name)
        out[name] = merge(old, new) if isinstance(old, Mapping) and isinstance(new, Mapping) else new
    return out


def _value(text: str) -> Any:
    """Return the value of a text in TOML, or else the text."""
    with suppress(TOMLDecodeError, RecursionError):
        table = loads(f"value = {text}")
        if len(table) == 1:
            return table["value"]
    with suppress(ValueError):
        return float(text)
    return text


def _within(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


def _plainly(item: Any) -> Any:
    if is_dataclass(item) and settings_in(type(item)):
        return table_of(item)
    return [_plainly(part) for part in item] if isinstance(item, tuple) else item


def _inline(rest: Nested, name: str, kind: Any, place: str) -> Nested:
    """Remove the settings of an inline dataclass from those around it, or from its table, and return them."""
    known = settings_in(kind)
    of_group = name not in known or isinstance(rest.get(name), Mapping | kind)
    given = rest.pop(name, {}) if of_group else {}
    inner_values = {inner: rest.pop(inner) for inner in known if inner in rest}
    if inner_values and isinstance(given, kind):
        given = table_of(given)
    if inner_values and isinstance(given, Mapping):
        return {name: structure(merge(inner_values, given), kind, place)}
    return {} if given == {} else {name: structure(given, kind, name)}


def _meant(name: str, known: Mapping[str, Setting]) -> str:
    """Return what an unknown name may mean: the same name in an inner table, or a similar name."""
    tables = {table: settings_in(s.kind) for table, s in known.items() if is_dataclass(s.kind)}
    same = [f"{table}.{name}" for table, inner in tables.items() if name in inner]
    return f"did you mean {', '.join(same)}?" if same else nearest(name, known)


def parse_spelling(value: Any, setting: Setting, place: str) -> Any:
    """Return the value of a setting that users may write in another way; InputError names it."""
    try:
        return setting.spelling.read(value) if setting.spelling.read else value
    except InputError as error:
        text = str(error).removeprefix(f"{place.rpartition('.')[2]}: ")
        raise InputError(f"{place} = {text}") from None


def _of_kind(value: Any, kind: Any, place: str) -> Any:
    if is_dataclass(kind):
        return structure(value, kind, place)  # type: ignore[arg-type]
    return READERS[get_origin(kind) or kind](value, kind, place)


def _wrong(place: str, value: object, fault: str) -> InputError:
    return InputError(f"{place} = {shortened(value)} {fault}")


def _number(value: Any, _: Any, place: str) -> float:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _wrong(place, value, "is not a number")
    with suppress(OverflowError):
        if isfinite(value):
            return float(value)
    raise _wrong(place, value, "is not a finite number")


def _whole(value: Any, _: Any, place: str) -> int:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise _wrong(place, value, "is not a whole number")
    if abs(int(value)) >= LARGEST:
        raise _wrong(place, value, f"is out of range: below {LARGEST:g}")
    return int(value)


def _truth(value: Any, _: Any, place: str) -> bool:
    if not isinstance(value, bool):
        raise _wrong(place, value, "is neither true nor false")
    return value


def _text(value: Any, _: Any, place: str) -> str:
    if not isinstance(value, str | PathLike):
        raise _wrong(place, value, "is not text")
    if not str(value).strip():
        raise _wrong(place, value, "is empty")
    if "\0" in str(value):
        raise _wrong(place, value, "holds a null character")
    return str(value)


def _choice(value: Any, kind: Any, place: str) -> Any:
    possible, value = get_args(kind), _plain(value)
    if value not in possible:
        raise _wrong(place, value, f"is not one of {', '.join(map(str, possible))}")
    return value


def _names(value: Any, kind: Any, place: str) -> tuple[str | int, ...]:
    """Return names from a list, or from text with commas; also numbers, if the type allows them."""
    rows = [str(value)] if isinstance(value, str | PathLike) else _plain(value)
    if not isinstance(rows, list | tuple):
        raise _wrong(place, value, "is no list of names")
    out: list[str | int] = []
    for row in rows:
        if isinstance(row, str):
            out += [_text(name, str, place).strip() for name in row.split(",")]
        else:
            out.append(_text(row, str, place) if kind == tuple[str, ...] else _whole(row, int, place))
    return tuple(out)


def _either(value: Any, kind: Any, place: str) -> Any:
    """Return text as the first type of a union, other values as the last; objects of a protocol stay as they are."""
    value, kinds = _plain(value), [part for part in get_args(kind) if part is not NoneType]
    if value is None and NoneType in get_args(kind):
        return None
    protocols = [part for part in kinds if getattr(part, "_is_protocol", False)]
    if not isinstance(value, type) and isinstance(value, tuple(protocols)):
        return value
    kinds = [part for part in kinds if part not in protocols]
    return _of_kind(value, kinds[0] if isinstance(value, str | PathLike) else kinds[-1], place)


def _mapping(value: Any, kind: Any, place: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(place, value, "is no table, such as { name = value }")
    return {str(key): _of_kind(item, get_args(kind)[1], f"{place}.{key}") for key, item in value.items()}


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def _items(value: Any, kind: Any, place: str) -> tuple[Any, ...]:
    kinds, value = get_args(kind), _plain(value)
    if str in kinds or str | int in kinds:
        return _names(value, kind, place)
    if not isinstance(value, list | tuple):
        raise _wrong(place, value, "is not a list")
    if kinds[-1] is not Ellipsis and len(value) != len(kinds):
        raise _wrong(place, value, f"must hold {len(kinds)} values")
    each = repeat(kinds[0]) if kinds[-1] is Ellipsis else kinds
    return tuple(_of_kind(item, of, f"{place}[{i}]") for i, (item, of) in enumerate(zip(value, each, strict=False)))


# Converters by the type of a setting, or a base of that type.
READERS: dict[Any, Reader] = {
    float: _number, int: _whole, bool: _truth, str: _text, Literal: _choice, tuple: _items, dict: _mapping,
    Union: _either, UnionType: _either,
}  # fmt: skip

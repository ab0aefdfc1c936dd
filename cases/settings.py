"""One schema for all settings: TOML tables, ``key=value`` texts and keywords become frozen dataclasses.

A dataclass is its own schema: the names, types and ranges of its fields. A mistake becomes one sentence that names the
setting as the user would type it, such as ``wing.half_span``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from functools import cache, partial
from itertools import repeat
from math import isfinite
from pathlib import Path
from tomllib import TOMLDecodeError, loads
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import tomli_w
from cattrs import Converter
from cattrs.errors import (
    AttributeValidationNote,
    BaseValidationError,
    ForbiddenExtraKeysError,
    IterableValidationNote,
)
from cattrs.gen import make_dict_structure_fn

from sdm_deflect.deform.errors import InputError, nearest

if TYPE_CHECKING:
    from sdm_deflect.cases.case import Case

T = TypeVar("T")
Nested = dict[str, Any]
INLINE = ("fighter", "fitting")
"""Tables whose values stand one level higher in files and assignments."""
LONGEST = 80
NOTES = (AttributeValidationNote, IterableValidationNote)


class _UnfitError(ValueError):
    """A value that does not fit its setting: the value, and the end of a sentence about it."""

    def __init__(self, value: object, fault: str) -> None:
        super().__init__(f"{shortened(value)} {fault}")


def structured(table: Mapping[str, Any], kind: type[T]) -> T:
    """Return the dataclass that a nested table describes; what it leaves out has the default.

    Raises
    ------
    InputError
        One sentence on the first setting that is unknown, of another type, or out of range.
    """
    try:
        return _converter().structure(_deepened(table, kind), kind)
    except BaseValidationError as errors:
        raise InputError(next(_sentences(errors, ()))) from None


def changed(value: T, changes: Mapping[str, Any]) -> T:
    """Return a dataclass with the values of a nested table in place of its own; InputError as `structured`."""
    return structured(_merged(_flattened(asdict(value)), changes), type(value))  # type: ignore[call-overload]


def to_toml(value: Any) -> str:
    """Return every value of a dataclass as TOML, from which `structured` makes the same again."""
    return tomli_w.dumps(_flattened(asdict(value)))


def names_of(kind: type[Any]) -> list[str]:
    """Return the names of the settings of a dataclass."""
    hints = get_type_hints(kind)
    inner = [name for inline in INLINE if inline in hints for name in names_of(hints[inline])]
    return [*(one.name for one in fields(kind) if one.name not in INLINE), *inner]


def shortened(value: object) -> str:
    """Return a value as Python writes it, at most a line of it."""
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def read_toml(path: Path) -> Nested:
    """Return the tables of a file; InputError names it if it cannot be read."""
    try:
        return loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, TOMLDecodeError, RecursionError) as error:
        raise InputError(f"configuration {path}: {error}") from None


def assigned(assignments: Sequence[str]) -> Nested:
    """Turn ["wing.half_span=0.3", ...] into nested tables; values are written as in TOML, texts also without quotes.

    Raises
    ------
    InputError
        If an assignment is not of the form key=value, or contradicts another.
    """
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


def resolve(
    name: str,
    scale: str | None = None,
    angle: float | None = None,
    strategy: str | None = None,
    assignments: Sequence[str] = (),
    config: Path | None = None,
) -> "Case":
    """Return the case: registered defaults, then the configuration file, then options, then assignments.

    Raises
    ------
    InputError
        One sentence: what is wrong, which value, what would be right.
    """
    from sdm_deflect.cases.registry import case_named

    tables, changes = read_toml(config) if config else {}, assigned(assignments)
    options = {"angle": angle, "strategy": strategy}
    changes = _merged({key: value for key, value in options.items() if value is not None}, changes)
    name = name or str(tables.get("name", ""))
    if not name:
        raise InputError("no case given; name one (see sdm list), or give the case.toml of a run")
    if changes.get("name", name) != name:
        raise InputError(f"name = {changes['name']!r}: a case keeps its name, {name}")
    size = changes.get("scale", scale)
    if size not in (None, tables.get("scale", size)):
        raise InputError(f"scale = {size!r}: {config} holds the sizes of {tables['scale']}; leave one of them out")
    case = case_named(name, str(size or tables.get("scale", "small")))
    case = changed(case, _merged(tables, changes))

    from sdm_deflect.cases.confine import hexahedron_of
    from sdm_deflect.cases.zero_sites import block_stations

    try:
        for one in case.deflections:
            block_stations(case, one.surface)
            hexahedron_of(case, one.surface)
    except ValueError as error:
        raise InputError(str(error)) from error
    return case


def _value(text: str) -> Any:
    """Return the value that a text stands for in TOML, else the text."""
    try:
        return loads(f"value = {text}")["value"]
    except (TOMLDecodeError, RecursionError):
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Nested:
    """Return nested tables with other values in place of their own."""
    out = dict(base)
    for name, new in changes.items():
        old = out.get(name)
        out[name] = _merged(old, new) if isinstance(old, Mapping) and isinstance(new, Mapping) else new
    return out


def _flattened(table: Nested) -> Nested:
    """Raise the values of inline tables by one level."""
    inner = {name: value for inline in INLINE for name, value in table.get(inline, {}).items()}
    return {**{name: value for name, value in table.items() if name not in INLINE}, **inner}


def _deepened(table: Mapping[str, Any], kind: type[Any]) -> Nested:
    """Put values back into the inline tables of a dataclass."""
    out, hints = dict(table), get_type_hints(kind)
    for inline in INLINE:
        if inline in hints:
            out[inline] = {name: out.pop(name) for name in names_of(hints[inline]) if name in out}
    return out


@cache
def _converter() -> Converter:
    """Return what makes dataclasses of tables, strict about types."""
    converter = Converter(detailed_validation=True, forbid_extra_keys=True)
    for kind, of_kind in HOOKS.items():
        converter.register_structure_hook(kind, of_kind)
    for origin, of_origin in ((Literal, _choice), (tuple, _items)):
        converter.register_structure_hook_func(partial(_comes_of, origin), of_origin)
    converter.register_structure_hook_func(lambda kind: kind == tuple[str, ...], _names)
    converter.register_structure_hook_factory(is_dataclass, _table)
    return converter


def _comes_of(origin: Any, kind: Any) -> bool:
    return get_origin(kind) is origin


def _table(kind: type[Any]) -> Callable[[Any, Any], Any]:
    """Return the hook of a dataclass."""
    make = make_dict_structure_fn(kind, _converter(), _cattrs_forbid_extra_keys=True)

    def hook(value: Any, _: Any) -> Any:
        if not isinstance(value, Mapping):
            raise _UnfitError(value, f"is no table; set one of its values, such as {fields(kind)[0].name}")
        return make(dict(value), kind)

    return hook


def _number(value: Any, _: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _UnfitError(value, "is not a number")
    if not isfinite(value):
        raise _UnfitError(value, "is not a finite number")
    return float(value)


def _whole(value: Any, _: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise _UnfitError(value, "is not a whole number")
    return value


def _truth(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise _UnfitError(value, "is neither true nor false")
    return value


def _text(value: Any, _: Any) -> str:
    if not isinstance(value, str):
        raise _UnfitError(value, "is not text")
    if not value.strip():
        raise _UnfitError(value, "is empty")
    return value


def _name(value: Any, _: Any) -> str | int:
    return _whole(value, _) if isinstance(value, int) else _text(value, _)


HOOKS: dict[Any, Callable[[Any, Any], Any]] = {
    float: _number,
    int: _whole,
    bool: _truth,
    str: _text,
    str | int: _name,
}


def _choice(value: Any, kind: Any) -> Any:
    possible = get_args(kind)
    if value not in possible:
        raise _UnfitError(value, f"is not one of {', '.join(map(str, possible))}")
    return value


def _names(value: Any, _: Any) -> tuple[str, ...]:
    """Take a list of names, or names with commas between them."""
    rows = [value] if isinstance(value, str) else value
    if not isinstance(rows, list | tuple) or not all(isinstance(row, str) for row in rows):
        raise _UnfitError(value, "must be names")
    found = tuple(name.strip() for row in rows for name in row.split(","))
    if not all(found):
        raise _UnfitError(value, "holds an empty name")
    return found


def _items(value: Any, kind: Any) -> tuple[Any, ...]:
    kinds = get_args(kind)
    if not isinstance(value, list | tuple):
        raise _UnfitError(value, "is not a list")
    if kinds[-1] is not Ellipsis and len(value) != len(kinds):
        raise _UnfitError(value, f"must hold {len(kinds)} values")
    each = repeat(kinds[0]) if kinds[-1] is Ellipsis else kinds
    return tuple(_item(i, item, one) for i, (item, one) in enumerate(zip(value, each, strict=False)))


def _item(i: int, value: Any, kind: Any) -> Any:
    try:
        return _converter().structure(value, kind)
    except (ValueError, ExceptionGroup) as error:
        error.__notes__ = [*getattr(error, "__notes__", ()), IterableValidationNote(f"item {i}", i, kind)]
        raise


def _sentences(error: BaseException, path: tuple[str | int, ...]) -> Iterator[str]:
    """Yield a sentence for each mistake below a place in the tables."""
    notes = [note for note in getattr(error, "__notes__", ()) if isinstance(note, NOTES)]
    path += tuple(note.name if isinstance(note, AttributeValidationNote) else note.index for note in reversed(notes))
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from _sentences(inner, path)
    elif isinstance(error, ForbiddenExtraKeysError):
        name = min(error.extra_fields)
        yield f"unknown setting {_dotted((*path, name))}; {nearest(name, names_of(error.cl))}"
    elif isinstance(error, KeyError):
        yield f"{_dotted(path)} is missing"
    elif isinstance(error, _UnfitError):
        yield f"{_dotted(path)} = {error}"
    elif isinstance(error, ValueError):
        yield str(error)
    else:
        raise error


def _dotted(path: tuple[str | int, ...]) -> str:
    """Return a place in the tables as the user would type it."""
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path if step not in INLINE)
    return "".join(steps).removeprefix(".")

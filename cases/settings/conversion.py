"""TOML tables, ``key=value`` texts and keywords become frozen dataclasses, whose fields are the schema of all settings.

A mistake becomes one sentence that names the setting as the user would type it, such as ``wing.half_span``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields, is_dataclass
from functools import cache, partial
from itertools import repeat
from math import isfinite
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from tomllib import TOMLDecodeError, loads
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import tomli_w
from cattrs import Converter
from cattrs.errors import AttributeValidationNote, BaseValidationError, ForbiddenExtraKeysError, IterableValidationNote
from cattrs.gen import make_dict_structure_fn

from sdm_deflect.deform.base.errors import InputError, nearest, shortened

T = TypeVar("T")
Nested = dict[str, Any]
Hook = Callable[[Any, Any], Any]
INLINE = ("fighter", "fitting")
"""Tables whose values stand one level higher in files and assignments."""
UNKNOWN = "unknown setting"
MOST_BYTES = 10**7
"""Of a file of settings: all nodes of a large surface by number."""
LARGEST = 2**31
"""Whole numbers lie below."""
NOTES = (AttributeValidationNote, IterableValidationNote)


class _UnfitError(ValueError):
    """A value that does not fit its setting: the value, and the end of a sentence about it."""

    def __init__(self, value: object, fault: str) -> None:
        super().__init__(f"{shortened(value)} {fault}")


def structured(table: Mapping[str, Any], kind: type[T]) -> T:
    """Return the dataclass that a table describes, or InputError: a sentence on the first setting that is wrong."""
    try:
        return _converter().structure(_deepened(table, kind), kind)
    except BaseValidationError as errors:
        found = list(_sentences(errors, (), kind))
        raise InputError(min(found, key=lambda sentence: not sentence.startswith(UNKNOWN))) from None


def changed(value: T, changes: Mapping[str, Any]) -> T:
    """Return a dataclass with the values of a nested table in place of its own; InputError as `structured`."""
    return structured(merged(_flattened(asdict(value)), changes), type(value))  # type: ignore[call-overload]


def to_toml(value: Any) -> str:
    """Return TOML from which `structured` makes the same again; InputError for an object that TOML has no form for."""
    try:
        return tomli_w.dumps(_flattened(asdict(value, dict_factory=lambda pairs: _given(dict(pairs)))))
    except TypeError as error:
        raise InputError(f"these settings hold an object of Python that no file can hold: {error}") from None


def names_of(kind: Any) -> list[str]:
    """Return the names of the settings of a dataclass."""
    hints = get_type_hints(kind)
    inner = [name for inline in INLINE if inline in hints for name in names_of(hints[inline])]
    return [*(one.name for one in fields(kind) if one.name not in INLINE), *inner]


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


def assigned(assignments: Sequence[str]) -> Nested:
    """Turn ["wing.half_span=0.3", ...] into tables, values as in TOML or text; InputError if one is not key=value."""
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


def _given(table: Nested) -> Nested:
    return {name: value for name, value in table.items() if value is not None}


def _value(text: str) -> Any:
    """Return the value that a text stands for in TOML, else the text."""
    with suppress(TOMLDecodeError, RecursionError):
        found = loads(f"value = {text}")
        if len(found) == 1:
            return found["value"]
    with suppress(ValueError):
        return float(text)
    return text


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> Nested:
    """Return nested tables with other values in place of their own."""
    out = dict(base)
    for name, new in changes.items():
        old = out.get(name)
        out[name] = merged(old, new) if isinstance(old, Mapping) and isinstance(new, Mapping) else new
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
            own = {name: out.pop(name) for name in names_of(hints[inline]) if name in out}
            given = out.get(inline, {})
            if isinstance(given, hints[inline]):
                out[inline] = merged(asdict(given), own)
            elif isinstance(given, Mapping):
                out[inline] = merged(own, given)
    return out


@cache
def _converter() -> Converter:
    """Return what makes dataclasses of tables, strict about types."""
    converter = Converter(detailed_validation=True, forbid_extra_keys=True)
    for kind, of_kind in HOOKS.items():
        converter.register_structure_hook(kind, of_kind)
    for origin, of_origin in ORIGINS.items():
        is_of = partial(lambda wanted, kind: get_origin(kind) is wanted, origin)
        converter.register_structure_hook_func(is_of, of_origin)
    converter.register_structure_hook_func(lambda kind: kind in NAMES, _names)
    converter.register_structure_hook_factory(is_dataclass, _table)
    return converter


def _table(kind: type[Any]) -> Hook:
    """Return the hook of a dataclass."""
    make = make_dict_structure_fn(kind, _converter(), _cattrs_forbid_extra_keys=True)

    def hook(value: Any, _: Any) -> Any:
        if not isinstance(value, Mapping):
            raise _UnfitError(value, f"is no table; set one of its values, such as {fields(kind)[0].name}")
        return make({str(name): item for name, item in value.items()}, kind)

    return hook


def _number(value: Any, _: Any) -> float:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _UnfitError(value, "is not a number")
    with suppress(OverflowError):
        if isfinite(value):
            return float(value)
    raise _UnfitError(value, "is not a finite number")


def _whole(value: Any, _: Any) -> int:
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise _UnfitError(value, "is not a whole number")
    if abs(int(value)) >= LARGEST:
        raise _UnfitError(value, f"is out of range: below {LARGEST:g}")
    return int(value)


def _truth(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise _UnfitError(value, "is neither true nor false")
    return value


def _text(value: Any, _: Any) -> str:
    if not isinstance(value, str | PathLike):
        raise _UnfitError(value, "is not text")
    if not str(value).strip():
        raise _UnfitError(value, "is empty")
    if "\0" in str(value):
        raise _UnfitError(value, "holds a null character")
    return str(value)


HOOKS: dict[Any, Hook] = {float: _number, int: _whole, bool: _truth, str: _text}
NAMES = (tuple[str, ...], tuple[str | int, ...])


def _choice(value: Any, kind: Any) -> Any:
    possible, value = get_args(kind), _plain(value)
    if value not in possible:
        raise _UnfitError(value, f"is not one of {', '.join(map(str, possible))}")
    return value


def _names(value: Any, kind: Any) -> tuple[str | int, ...]:
    """Take a list of names, or names with commas between them; numbers too, where the kind has them."""
    rows = [str(value)] if isinstance(value, str | PathLike) else _plain(value)
    if not isinstance(rows, list | tuple):
        raise _UnfitError(value, "is no list of names")
    found: list[str | int] = []
    for row in rows:
        if not isinstance(row, str):
            found.append(_whole(row, int) if kind == NAMES[1] else _text(row, str))
        else:
            found += [_text(name, str).strip() for name in row.split(",")]
    return tuple(found)


def _either(value: Any, kind: Any) -> Any:
    """Take text as the first kind of a union and anything else as the last; objects of a protocol as they are."""
    value, kinds = _plain(value), [one for one in get_args(kind) if one is not NoneType]
    if value is None and len(kinds) < len(get_args(kind)):
        return None
    protocols = [one for one in kinds if getattr(one, "_is_protocol", False)]
    fits = any(all(hasattr(value, name) for name in vars(one) if name[0] != "_") for one in protocols)
    if fits and not isinstance(value, type):
        return value
    others = [one for one in kinds if one not in protocols]
    return _converter().structure(value, others[0] if isinstance(value, str | PathLike) else others[-1])


def _mapping(value: Any, kind: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise _UnfitError(value, "is no table, such as { name = value }")
    return {str(key): _item(str(key), item, get_args(kind)[1]) for key, item in value.items()}


def _plain(value: Any) -> Any:
    """Return the list of an array."""
    return value.tolist() if hasattr(value, "tolist") else value


def _items(value: Any, kind: Any) -> tuple[Any, ...]:
    kinds, value = get_args(kind), _plain(value)
    if not isinstance(value, list | tuple):
        raise _UnfitError(value, "is not a list")
    if kinds[-1] is not Ellipsis and len(value) != len(kinds):
        raise _UnfitError(value, f"must hold {len(kinds)} values")
    each = repeat(kinds[0]) if kinds[-1] is Ellipsis else kinds
    return tuple(_item(i, item, one) for i, (item, one) in enumerate(zip(value, each, strict=False)))


def _item(place: str | int, value: Any, kind: Any) -> Any:
    try:
        return _converter().structure(value, kind)
    except (ValueError, ExceptionGroup) as error:
        error.__notes__ = [*getattr(error, "__notes__", ()), IterableValidationNote("", place, kind)]
        raise


ORIGINS: dict[Any, Hook] = {Literal: _choice, tuple: _items, dict: _mapping, Union: _either, UnionType: _either}


def _sentences(error: BaseException, path: tuple[str | int, ...], kind: Any) -> Iterator[str]:
    """Yield a sentence for each mistake below a place in the tables."""
    notes = [note for note in getattr(error, "__notes__", ()) if isinstance(note, NOTES)]
    path += tuple(note.name if isinstance(note, AttributeValidationNote) else note.index for note in reversed(notes))
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from _sentences(inner, path, notes[0].type if notes else kind)
    elif isinstance(error, ForbiddenExtraKeysError):
        name = min(error.extra_fields)
        yield f"{UNKNOWN} {_dotted((*path, name))}; {_meant(name, error.cl)}"
    elif isinstance(error, KeyError):
        yield f"{_dotted(path)} is missing"
    elif isinstance(error, _UnfitError):
        yield f"{_dotted(path)} = {error}"
    elif isinstance(error, ValueError):
        yield _placed(str(error), path, kind)
    else:
        raise error


def _meant(name: str, kind: type[Any]) -> str:
    """Return what an unknown name may mean: the same name in a table within, or a name that comes near it."""
    tables = get_type_hints(kind)
    for inline in INLINE:
        tables |= get_type_hints(tables.pop(inline)) if inline in tables else {}
    found = [f"{table}.{name}" for table, own in tables.items() if is_dataclass(own) and name in names_of(own)]
    return f"did you mean {', '.join(found)}?" if found else nearest(name, names_of(kind))


def _placed(sentence: str, path: tuple[str | int, ...], kind: Any) -> str:
    """Return what a dataclass says of one of its values with the place of the dataclass before it."""
    outer = not path or path[-1] in INLINE or not is_dataclass(kind)
    return sentence if outer or sentence.partition(" ")[0] not in names_of(kind) else f"{_dotted(path)}.{sentence}"


def _dotted(path: tuple[str | int, ...]) -> str:
    """Return a place in the tables as the user would type it."""
    steps = [*(step for step in path[:-1] if step not in INLINE), *path[-1:]]
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).removeprefix(".")

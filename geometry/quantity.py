"""Numbers with a unit and a range, declared once as dataclass fields and checked at construction."""

import re
from dataclasses import Field, field, fields
from math import isfinite
from numbers import Integral, Real
from typing import Any


def quantity(default: float, unit: str, low: float, high: float, doc: str) -> Any:
    """Declare a dataclass field that holds a number.

    Parameters
    ----------
    default : float
        An integer default makes the field accept integers only.
    unit : str
        The unit that error messages show; empty for pure numbers.
    low, high : float
        The closed range of allowed values.
    doc : str
        One line on what the number means.
    """
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "doc": doc})


def check_quantities(instance: Any, prefix: str) -> None:
    """Check every declared quantity of a dataclass instance, for its ``__post_init__``.

    ValueError names the first value that is not a finite number inside its range.
    """
    for declared in fields(instance):
        if "unit" in declared.metadata:
            _check(f"{prefix}.{declared.name}", getattr(instance, declared.name), declared)


class Checked:
    """Base of dataclasses whose quantities are checked; messages call them by the class name's first word."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_quantities(self, re.findall("[A-Z][a-z]*", type(self).__name__)[0].lower())


def _check(name: str, value: object, declared: Field[Any]) -> None:
    unit, low, high = (declared.metadata[key] for key in ("unit", "low", "high"))
    suffix = f" {unit}" if unit else ""
    expected = f"{low:g} ... {high:g}{suffix}"
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} = {value!r} is not a number; it must be {expected}")
    if isinstance(declared.default, int) and not isinstance(value, Integral):
        raise ValueError(f"{name} = {value!r} is not a whole number; it must be {expected}")
    number = float(value)
    if not isfinite(number) or not low <= number <= high:
        raise ValueError(f"{name} = {number:g}{suffix} is outside {expected}")


class CadError(RuntimeError):
    """The CAD kernel gave no usable solid, or the solid cannot be meshed; the message names the place."""

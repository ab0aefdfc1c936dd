"""Parameters of the aircraft with unit, range and meaning, as annotations in a field's metadata."""

from dataclasses import field
from typing import Any

from sdm_deflect.base.schema import Doc, Range, check_settings


def quantity(default: float, unit: str, low: float, high: float, doc: str) -> Any:
    """Declare a dataclass field for a number from `low` to `high` with a unit; `doc` is its meaning."""
    return field(default=default, metadata={"notes": (Range(low, high, unit=unit), Doc("", doc))})


class Checked:
    """Base class of dataclasses that check their settings at construction."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check_settings(self)


class CadError(RuntimeError):
    """The CAD kernel gave no usable solid, or the solid cannot be meshed; the message names the place."""

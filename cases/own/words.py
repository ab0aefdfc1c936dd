"""Values from text and from TOML, with errors that name what was meant."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.rbf.kernels import FloatArray


def points(value: Any, count: int, what: str) -> FloatArray:
    """Return points (count, 3) from lists of numbers, or from texts such as ``0,1.5,0``."""
    try:
        rows = [[float(x) for x in (row.split(",") if isinstance(row, str) else row)] for row in value]
        found = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != (count, 3):
        raise InputError(f"{what} {' '.join(str(row) for row in value)}: must be {count} points x,y,z")
    return found


def texts(value: Any, what: str) -> Sequence[str]:
    """Return names from a list, or from text with commas."""
    if isinstance(value, str):
        value = [value]
    if not all(isinstance(item, str) for item in value):
        raise InputError(f"{what} = {value!r} must be names")
    names = [name.strip() for item in value for name in item.split(",")]
    return [name for name in names if name]


def number(value: Any, what: str) -> float:
    """Return a number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{what} = {value!r} is not a number") from None


def check_keys(table: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    """Raise for a key that is not known, with the nearest one that is."""
    for key in table:
        if key not in known:
            close = get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"
            raise InputError(f"{where}: unknown key {key!r}; {hint}")

"""What is chosen of patches, as users write it: ``flap=wall#2 box:0.6,-1,-1,1,1,1``."""

import re
import shlex
from math import isnan

import numpy as np

from sdm_deflect.cases.settings.job_settings import SELECTION
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError, shortened
from sdm_deflect.deform.mesh.selection import Before, Component, Condition, Selection, Within

Point = tuple[float, float, float]
SHARP = "sharp"
NUMBERS = {"box": "two opposite corners, box:x,y,z,x,y,z", "side": "a point and a normal, side:x,y,z,nx,ny,nz"}


def selection(name: str, text: str) -> Selection:
    """Return the selection that a name and an expression describe; InputError if it is of another form."""
    if not re.fullmatch(r"[\w.+-]+", name):
        raise InputError(f"select = {shortened(name)}: a new patch is named by letters, digits and . _ + - alone")
    try:
        words = [word for word in shlex.split(text) if word != "and"]
    except ValueError:
        raise InputError(f"select.{name} = {text}: a quotation mark is not closed") from None
    if not words:
        raise InputError(f"select.{name} is empty; it must be {SELECTION}")
    sharp = _degrees(name, words.pop()) if words[-1].startswith(f"{SHARP}:") and len(words) > 1 else None
    return Selection(name, words[0], tuple(_condition(name, word) for word in words[1:]), sharp, text)


def _condition(name: str, word: str) -> Condition:
    kind, _, rest = word.partition(":")
    if word[0] == "#" and word[1:].isascii() and word[1:].isdigit():
        return Component(int(word[1:]))
    if kind not in NUMBERS:
        last = f"; {SHARP}: must come last" if kind == SHARP else ""
        raise InputError(f"select.{name}: {shortened(word)} is unknown{last}; it must be {SELECTION}")
    numbers = _numbers(rest)
    if len(numbers) not in (4, 6):
        raise InputError(f"select.{name}: {word} must be {NUMBERS[kind]}; of a plane mesh without z")
    one, other = np.array(numbers).reshape(2, -1)
    if kind == "box":
        return Within(_point(np.minimum(one, other), -np.inf), _point(np.maximum(one, other), np.inf))
    if not other.any() or not np.isfinite(numbers).all():
        raise InputError(f"select.{name}: {word}: point and normal must be finite, and the normal not zero")
    return Before(_point(one, 0.0), _point(other, 0.0))


def _point(of: FloatArray, z: float) -> Point:
    """Return a point; of two numbers with that z."""
    x, y, *rest = of.tolist()
    return x, y, rest[0] if rest else z


def _degrees(name: str, word: str) -> float:
    numbers = _numbers(word.partition(":")[2])
    if len(numbers) != 1 or not 0.0 < numbers[0] < 180.0:
        raise InputError(f"select.{name}: {word} must be degrees between 0 and 180, such as {SHARP}:40")
    return numbers[0]


def _numbers(text: str) -> list[float]:
    """Return numbers with commas between them; none if one is no number."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return [] if any(map(isnan, found)) else found

"""What the CAD kernel raises, told as one sentence."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from types import ModuleType

import numpy as np
from OCP import Standard, StdFail

from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.parameters import Fighter


def _exceptions(module: ModuleType) -> tuple[type[Exception], ...]:
    return tuple(one for one in vars(module).values() if isinstance(one, type) and issubclass(one, Exception))


KERNEL: tuple[type[Exception], ...] = (*_exceptions(Standard), *_exceptions(StdFail), ValueError, ArithmeticError)
"""The kernel's exceptions have no common base; CadQuery and NumPy raise the last two for shapes without extent."""


@contextmanager
def told(fighter: Fighter) -> Iterator[None]:
    """Raise CadError that names the parameters which differ from the defaults, where the kernel raises its own."""
    try:
        with np.errstate(all="raise", under="ignore"):
            yield
    except KERNEL as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CadError(f"the CAD kernel builds no aircraft with {differences(fighter)} ({what})") from error


def differences(fighter: Fighter) -> str:
    """Return the parameters that differ from the defaults, with their values."""
    usual, found = Fighter(), []
    for component in fields(Fighter):
        one, other = getattr(fighter, component.name), getattr(usual, component.name)
        found += [
            f"{component.name}.{each.name} = {getattr(one, each.name):g}"
            for each in fields(one)
            if getattr(one, each.name) != getattr(other, each.name)
        ]
    return ", ".join(found) or "the default parameters"

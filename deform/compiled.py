"""How this package compiles its loops."""

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile `function` at its first call and keep the machine code on disk.

    Reassociation (`fastmath`) lets LLVM vectorise reductions, the NumPy error model removes the branch of a
    division by zero that would stop it, and without the interpreter lock threads run side by side.

    Machine code on disk is renewed when the *file of the function* changes, not when a function that it
    calls changes in another file: after editing `kernels.py` touch the modules with loops as well.
    """
    return cast(Function, njit(cache=True, fastmath=True, error_model="numpy", nogil=True)(function))

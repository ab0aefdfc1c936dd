"""How this package compiles its loops."""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

from numba import njit, types
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., object])

OPTIONS = {"fastmath": True, "error_model": "numpy", "nogil": True}
PACKAGE = __name__.partition(".")[0]


def compiled(function: Function) -> Function:
    """Compile `function` at its first call and keep the machine code on disk.

    Reassociation (`fastmath`) lets LLVM vectorise reductions, the NumPy error model removes the branch of a
    division by zero that would stop it, and without the interpreter lock threads run side by side.

    Machine code on disk is renewed when the *file of the function* changes, not when a function that it
    calls changes in another file: after editing `kernels.py` touch the modules with loops as well.
    """
    return cast(Function, njit(cache=True, **OPTIONS)(function))


def compiled_exactly(function: Function) -> Function:
    """Compile `function` like `compiled`, but as it is written: infinities are allowed, sums keep their order."""
    return cast(Function, njit(cache=True, **{**OPTIONS, "fastmath": False})(function))


def for_code(loop: Function, code: object) -> Function:
    """Return the compiled `loop` for the kernel that `code` selects; its machine code is on disk if the kernel is ours.

    The index of machine code on disk names the type of `code` by its module, and it is read whole: a kernel of
    another package would stop every process that cannot import that package. Nor would its machine code be renewed
    when its formula changes.
    """
    ours = type(code).__module__.partition(".")[0] == PACKAGE
    return loop if ours else cast(Function, _in_memory(loop))


@cache
def _in_memory(loop: Any) -> Any:
    """Return the twin of a compiled loop that keeps its machine code in this process alone."""
    return njit(**OPTIONS)(loop.py_func)


def _prefer_wide_vectors(context: Any) -> tuple[Any, Callable[..., Any]]:  # pragma: no cover - compiling
    """Let the enclosing compiled function use the machine's widest vectors.

    LLVM keeps to 256 bits on processors that have 512, for fear of a lower clock. Loops of nothing but
    arithmetic gain a fifth by the full width.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # pragma: no cover - compiling
        # `add` of this set knows no attributes with values; LLVM does.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), generate


prefer_wide_vectors: Callable[[], None] = intrinsic(_prefer_wide_vectors)

"""How this package compiles its loops."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config, njit, types
from numba.core.caching import FunctionCache
from numba.extending import intrinsic

from sdm_deflect.deform.base.cache_folder import code_complaint, code_folder

Function = TypeVar("Function", bound=Callable[..., object])

OPTIONS = {"fastmath": True, "error_model": "numpy", "nogil": True}
PACKAGE = __name__.partition(".")[0]
MARK = b"base.compiled import"
"""What stands in every source whose functions are compiled, and here."""


def compiled(function: Function) -> Function:
    """Compile `function` at its first call and keep the machine code on disk.

    Reassociation (`fastmath`) lets LLVM vectorise reductions, the NumPy error model removes the branch of a
    division by zero that would stop it, and without the interpreter lock threads run side by side.
    """
    return cast(Function, _kept(njit(**OPTIONS)(function)))


def compiled_exactly(function: Function) -> Function:
    """Compile `function` like `compiled`, but as it is written: infinities are allowed, sums keep their order."""
    return cast(Function, _kept(njit(**{**OPTIONS, "fastmath": False})(function)))


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


class _OnDisk(FunctionCache):  # type: ignore[misc]
    """Machine code on disk; what a full disk does not take stays in this process alone."""

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def _kept(loop: Any) -> Any:
    """Keep the machine code of a compiled loop in the folder of compiled code, if that can be written.

    Numba's own choice is the folder of the package, where pip neither expects nor removes it. What it reads from the
    environment is for all functions of this process, ours and others'.
    """
    if folder := _folder():
        elsewhere, config.CACHE_DIR = config.CACHE_DIR, folder
        try:
            loop._cache = _OnDisk(loop.py_func)
        finally:
            config.CACHE_DIR = elsewhere
    return loop


@cache
def _folder() -> str:
    """Return the folder for the sources as they are now, or nothing if none can be written.

    Numba compares the file of a function with that from which it was compiled, but not those of the functions called.
    """
    if code_complaint():
        return ""
    texts = (path.read_bytes() for path in sorted(Path(__file__).parents[1].rglob("*.py")))
    state = hashlib.sha256(b"".join(text for text in texts if MARK in text))
    return str(code_folder() / state.hexdigest()[:16])


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

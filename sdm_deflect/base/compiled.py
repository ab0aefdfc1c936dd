"""Compilation of loops, and the folder of compiled code.

What Numba keeps private is used in this file alone, each part with its reason and its price. `.ci/versions` tries the
oldest and the newest Numba that pyproject.toml allows.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar, cast

import platformdirs
from numba import config, njit, types
from numba.core.caching import FunctionCache

# Private. Reason: the sums of a point stay in registers. Price: a Numba without it needs one loop for each width, and
# the bits of sums change by 5e-16. Imported by deform/rbf/kernels.py.
from numba.cpython.unsafe.tuple import tuple_setitem as tuple_setitem
from numba.extending import intrinsic

FOLDER_VARIABLE, CODE_VARIABLE = "SDM_DEFLECT_CACHE", "NUMBA_CACHE_DIR"
# Bits of permission by which others may write.
WRITABLE_BY_OTHERS = 0o022
Function = TypeVar("Function", bound=Callable[..., object])
OPTIONS = {"fastmath": True, "error_model": "numpy", "nogil": True}
PACKAGE = __name__.partition(".")[0]
# Packages with compiled functions.
ROOMS = ("base", "meshing", "deform")
# Text in every source with compiled functions, and in this file.
MARK = b"@compiled"


def default_folder() -> Path:
    """Return the folder of the environment variable SDM_DEFLECT_CACHE, or the user's cache folder."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else Path(platformdirs.user_cache_dir("sdm-deflect", appauthor=False))


def code_folder() -> Path:
    """Return the folder of compiled code: Numba's variable NUMBA_CACHE_DIR, or `numba` in the cache folder."""
    named = os.environ.get(CODE_VARIABLE)
    return Path(named) if named else default_folder() / "numba"


def code_complaint() -> str:
    """Make the folder of compiled code; return why no code can be stored there, or an empty text.

    Anybody who can write to the folder can make this program run code, so the default folder must be private.
    """
    folder = code_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
        status = folder.stat()
    except OSError as error:
        return error.strerror or str(error)
    private = not hasattr(os, "geteuid") or (status.st_uid == os.geteuid() and not status.st_mode & WRITABLE_BY_OTHERS)
    return "" if private or os.environ.get(CODE_VARIABLE) else "other users can write there"


def code_files() -> list[Path]:
    """Return the files of compiled code in the cache folder; none if NUMBA_CACHE_DIR is set, a shared folder."""
    return sorted((default_folder() / "numba").glob("*/*/*.nb[ci]"))


def compiled(function: Function) -> Function:
    """Compile `function` at its first call, and keep the machine code on disk.

    Reassociation (`fastmath`) lets LLVM vectorise sums. The NumPy error model removes the branch for a division by zero
    that would prevent it. Without the interpreter lock threads run side by side.
    """
    return cast(Function, _cache_code(njit(**OPTIONS)(function)))


def compiled_exactly(function: Function) -> Function:
    """Compile `function` without reassociation: infinities are allowed, and sums keep their order."""
    return cast(Function, _cache_code(njit(**{**OPTIONS, "fastmath": False})(function)))


def for_code(loop: Function, code: object) -> Function:
    """Return `loop` compiled for the kernel that `code` selects; stored on disk if the kernel is of this package.

    Numba's index on disk names the type of `code` by its module and is read completely. A kernel of another package
    would stop every process that cannot import that package, and its machine code would not follow edits of its
    formula.
    """
    ours = type(code).__module__.partition(".")[0] == PACKAGE
    return loop if ours else cast(Function, _in_memory(loop))


@cache
def _in_memory(loop: Any) -> Any:
    """Return a copy of a compiled loop whose machine code stays in this process."""
    return njit(**OPTIONS)(loop.py_func)


class _OnDisk(FunctionCache):  # type: ignore[misc]
    """Storage of machine code on disk; if the disk is full, the code stays in this process.

    The class and the attribute `_cache` are private. Reason: Numba's own folder is the package's, and its error on a
    full disk ends the command. Price: a Numba without them compiles in each process, for 6 to 9 s.
    """

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


def _cache_code(loop: Any) -> Any:
    """Store the machine code of a compiled loop in the folder of compiled code, if possible.

    Numba's default is the folder of the package, where pip neither expects nor removes it. Numba's environment variable
    would affect all functions of the process, not this package's alone.
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
    """Return the folder for the present sources; empty if no folder can be written.

    Numba notices a change of a function's own source, but not of the functions that it calls.
    """
    if code_complaint():
        return ""
    state = hashlib.sha256(b"".join(text for text in _sources() if MARK in text))
    return str(code_folder() / state.hexdigest()[:16])


def _sources() -> Iterator[bytes]:
    """Yield the text of every source in the rooms with compiled functions.

    Packages are found like their imports: `rglob` from one folder would not follow the links of a clone.
    """
    for room in ROOMS:
        spec = find_spec(f"{PACKAGE}.{room}")
        for folder in (spec and spec.submodule_search_locations) or ():
            yield from (path.read_bytes() for path in sorted(Path(folder).rglob("*.py")))


def _prefer_wide_vectors(context: Any) -> tuple[Any, Callable[..., Any]]:  # pragma: no cover - compiling
    """Let the enclosing compiled function use the machine's widest vectors.

    LLVM uses 256 bits on processors that have 512, to avoid a lower clock rate. Loops of pure arithmetic gain a fifth
    by the full width. Private is the set of attributes. Price: a Numba without it gives narrower loops, a fifth slower.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # pragma: no cover - compiling
        # the `add` of this set takes no attributes with values; LLVM's does
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), generate


prefer_wide_vectors: Callable[[], None] = intrinsic(_prefer_wide_vectors)

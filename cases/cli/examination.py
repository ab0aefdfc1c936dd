"""Examination of this machine for `sdm doctor`, with advice, and removal of killed commands' leftovers."""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from time import time

from sdm_deflect.base.compiled import CODE_VARIABLE, FOLDER_VARIABLE, code_complaint, code_folder, default_folder
from sdm_deflect.base.errors import MeshFileError, short_list
from sdm_deflect.base.files import END, LOCK, NAME, NOTE, OLD, UNLOCKED
from sdm_deflect.cases.run.output import EXTRAS, LIBRARIES, lacks, usable_cores, versions
from sdm_deflect.meshing.cache import MeshCache

PACKAGES = "libgl1 libegl1 libopengl0 libgomp1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libxrender1"
INSTALL = f"on Debian or Ubuntu: apt-get install -y --no-install-recommends {PACKAGES}"
# Libraries with compiled parts that need others of the system, by the names under which they are imported.
COMPILED = ("cadquery", "gmsh", "pymeshlab", "pytetwild", "pyvista", "numba")
# An import that takes longer has failed.
SECONDS = 120.0
# Seconds within which a command locks the folder that it has made, and bytes of a note in it, at most.
YOUNG, LONGEST = 60.0, 1 << 16


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one examination, and advice if it is bad."""

    name: str
    well: bool
    text: str
    remedy: str = ""


def libraries() -> Finding:
    """Examine whether all libraries that every command needs are installed."""
    installed = versions(LIBRARIES)
    missing = [name for name, version in installed.items() if not version]
    text = ", ".join(f"{name} {version or 'missing'}" for name, version in installed.items())
    return Finding("libraries", not missing, text, f"pip install {' '.join(missing)}" if missing else "")


def extras() -> Finding:
    """Report which extras are installed; none is required."""
    lacking = {extra: text for extra in EXTRAS if (text := lacks(extra))}
    ready = [extra for extra in EXTRAS if extra not in lacking]
    return Finding("extras", True, "; ".join([", ".join(ready) or "none is installed", *lacking.values()]))


def compiled_libraries() -> Finding:
    """Load each installed compiled library in a separate process, which may crash."""
    present = [name for name in COMPILED if find_spec(name)]
    with ThreadPoolExecutor(usable_cores()) as pool:
        complaints = dict(zip(present, pool.map(import_complaint, present), strict=True))
    failed = [f"{name}: {complaint}" for name, complaint in complaints.items() if complaint]
    text = "; ".join(failed) or f"{', '.join(present)} can be loaded"
    return Finding("system libraries", not failed, text, INSTALL if failed else "")


def import_complaint(module: str) -> str:
    """Return why a module cannot be imported in a separate process; empty if it can."""
    bound = f"from sdm_deflect.meshing.child import end_with; end_with({os.getpid()})"
    command = [sys.executable, "-c", f"{bound}; import {module}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"import took more than {SECONDS:g} s"
    lines = done.stderr.strip().splitlines() or [f"ended with code {done.returncode}"]
    return lines[-1] if done.returncode else ""


def cache() -> Finding:
    """Examine whether the cache can be written, and whether the meshes in it are undamaged."""
    store = MeshCache(default_folder())
    try:
        store.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=store.folder):
            pass
    except OSError as error:
        remedy = f"set the environment variable {FOLDER_VARIABLE} to a folder that can be written"
        return Finding("cache", False, f"{store.folder}: {error.strerror}", remedy)
    sizes = store.entries()
    damaged = [key for key in sizes if not _loads(store, key)]
    text = f"{store.folder}: {len(sizes)} meshes, {sum(sizes.values()) / 1e6:.1f} MB"
    if not damaged:
        return Finding("cache", True, text)
    names = " ".join(str(store.folder / f"{key}.npz") for key in damaged)
    return Finding("cache", False, f"{text}, {len(damaged)} damaged", f"rm {names} (or sdm cache --clear)")


def compiled_code() -> Finding:
    """Examine whether compiled code can be stored."""
    if complaint := code_complaint():
        text = f"{code_folder()}: {complaint}; functions are compiled in each process, for about 10 s"
        remedy = f"set the environment variable {CODE_VARIABLE} to a folder that you alone can write"
        return Finding("compiled code", False, text, remedy)
    return Finding("compiled code", True, f"kept in {code_folder()}")


def _loads(store: MeshCache, key: str) -> bool:
    try:
        return store.read(key) is not None
    except MeshFileError:
        return False


def leftovers(folder: Path) -> Finding:
    """Remove killed commands' leftovers in a folder and the system's temporary one; put back what they moved."""
    if not hasattr(os, "O_DIRECTORY"):
        return Finding("leftovers", True, "not looked for on this system")
    homes = dict.fromkeys(Path(os.path.realpath(one)) for one in (folder, tempfile.gettempdir()))
    done = [text for home in homes for place in _hidden(home) for text in _tidy(place)]
    kept = short_list(place for home in homes for place in _hidden(home))
    texts = [*done, *([f"in use, or not ours: {kept}"] if kept else [])]
    return Finding("leftovers", True, "; ".join(texts) or "none")


def _hidden(home: Path) -> list[Path]:
    return sorted(home.glob(f"{NAME}????????{END}"))


def _tidy(place: Path) -> Iterator[str]:
    """Remove a hidden folder of this user whose process has ended, and say so.

    The opened and locked folder is removed, even if its path has changed meanwhile.
    """
    with ExitStack() as stack, suppress(OSError):
        handle = _open_own(stack, place, os.O_RDONLY | os.O_DIRECTORY)
        names = _names(handle)
        if LOCK in names:
            import fcntl

            lock = _open_own(stack, LOCK, os.O_RDWR | os.O_NONBLOCK, handle)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif not {*names} <= {UNLOCKED} or time() - os.fstat(handle).st_mtime < YOUNG:
            return  # a user's folder of such a name, or one that a command is about to lock
        yield from _put_back(place, handle)
        _remove(place, handle)
        yield f"removed {place}"


def _put_back(place: Path, handle: int) -> Iterator[str]:
    """Give a run folder that was moved its old name again, or remove it if another folder has that name."""
    with ExitStack() as stack, suppress(OSError, ValueError, TypeError):
        note = _open_own(stack, NOTE, os.O_RDONLY | os.O_NONBLOCK, handle)
        number, aside, name = json.loads(os.read(note, LONGEST))
        if Path(name).name != name or not re.fullmatch(rf"{re.escape(name)}({re.escape(OLD)})+", aside):
            return
        old, target = place.with_name(aside), place.with_name(name)
        folder = _open_own(stack, old, os.O_RDONLY | os.O_DIRECTORY)
        if os.fstat(folder).st_ino != number:
            return
        if os.path.lexists(target):
            _remove(old, folder)
            yield f"removed {old}, which {target} has replaced"
        else:
            old.rename(target)
            yield f"put {old} back as {target}"


def _open_own(stack: ExitStack, path: Path | str, flags: int, folder: int | None = None) -> int:
    """Open a file or folder, not through a link; PermissionError if it is another user's, or a pipe."""
    handle = os.open(path, flags | os.O_NOFOLLOW, dir_fd=folder)
    stack.callback(os.close, handle)
    status = os.fstat(handle)
    if status.st_uid != os.geteuid() or not (stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)):
        raise PermissionError
    return handle


def _names(handle: int) -> dict[str, bool]:
    with os.scandir(handle) as entries:
        return {entry.name: entry.is_dir(follow_symlinks=False) for entry in entries}


def _remove(place: Path, handle: int) -> None:
    """Remove the content of an open folder, its lock last, and then the folder at the path if it is empty."""
    for name, is_folder in sorted(_names(handle).items(), key=lambda entry: entry[0] == LOCK):
        (shutil.rmtree if is_folder else os.unlink)(name, dir_fd=handle)
    place.rmdir()


# Everything that is looked at, in order.
EXAMINATIONS: tuple[Callable[[], Finding], ...] = (libraries, extras, compiled_libraries, cache, compiled_code)

"""Temporary folders, and the register by which the next command knows those of a command that was killed.

The register is a private folder of the user's with a file for each temporary folder, locked while its process lives.
Nothing follows from the name of a folder: one that came from elsewhere is in no register, and so never touched.
"""

import fcntl
import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from errno import ENOENT, EPERM
from pathlib import Path

import platformdirs

BESIDE, SCRATCH = ".sdm-", "sdm-deflect-"
"""Beginnings of the names of temporary folders: beside a target, and in the system's folder for such."""
_own: set[Path] = set()


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Give a temporary folder in `folder` that is removed at the end; what killed commands left there goes first."""
    clear(folder)
    with _made(unused(folder)) as name:
        yield name


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a folder among the system's temporary ones that is removed at the end."""
    with _made(unused(Path(tempfile.gettempdir()), SCRATCH)) as name:
        yield name


@contextmanager
def _made(path: Path) -> Iterator[Path]:
    with registered(path) as note:
        path.mkdir(mode=0o700)
        _own.add(path)
        try:
            note(path.stat().st_ino)
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)
            _own.discard(path)


def unused(folder: Path, begin: str = BESIDE) -> Path:
    """Return a random name in a folder."""
    return Path(os.path.realpath(folder)) / f"{begin}{secrets.token_hex(8)}"


def is_temporary(path: Path) -> bool:
    """Whether a path lies in a temporary folder of this process."""
    return not _own.isdisjoint(path.absolute().parents)


@contextmanager
def registered(path: Path, inode: int | None = None, **moved: str | int) -> Iterator[Callable[[int], None]]:
    """Keep a temporary path in the register while it is there; without a register nobody will clear it.

    Gives what notes its inode once it is made. A folder that is put aside comes with the `target` that it was, and the
    inode of the `new` folder that will be there.
    """
    entry = opened = None

    def note(inode: int | None) -> None:
        row = {"machine": os.uname().nodename, "path": str(path), "inode": inode, **moved}
        if entry:
            with suppress(OSError):
                entry.write(json.dumps(row).encode() + b"\n")
                if moved:
                    os.fsync(entry)

    with ExitStack() as stack:
        with suppress(OSError), _register() as folder:
            opened = stack.enter_context(tempfile.NamedTemporaryFile(dir=folder, buffering=0, delete=False))
            fcntl.flock(opened, fcntl.LOCK_EX)  # which some file systems cannot
            entry = opened
            note(inode)
        try:
            yield note
        finally:
            if opened and not (entry and os.path.lexists(path)):
                Path(opened.name).unlink(missing_ok=True)


def clear(folder: Path) -> None:
    """Remove what killed commands left in a folder and in the system's for temporary files; put a folder aside back."""
    places = {os.path.realpath(folder), os.path.realpath(tempfile.gettempdir())}
    with suppress(OSError):
        with _register() as register:
            entries = list(register.iterdir())
            for entry in entries:
                with suppress(FileNotFoundError):
                    if not entry.stat().st_size:  # nobody is making one while this process holds the lock
                        entry.unlink()
        for entry in entries:
            with suppress(OSError, ValueError, LookupError), entry.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused while its process lives
                row = json.loads(file.read().splitlines()[-1])
                path = Path(row["path"])
                if row["machine"] == os.uname().nodename and str(path.parent) in places:
                    if os.path.lexists(path):
                        _clear(path, row["inode"], row.get("target"), row.get("new"))
                    if not os.path.lexists(path):
                        entry.unlink()


def _clear(path: Path, inode: int | None, target: str | None, new: int | None) -> None:
    """Remove a temporary folder, or put it back if it is a `target` that nothing new has replaced."""
    if inode is None:  # its process was killed as it made the folder
        path.rmdir()
    elif path.lstat().st_ino == inode:
        if target and not os.path.lexists(target):
            path.rename(target)
        elif not target or Path(target).stat().st_ino == new:
            shutil.rmtree(path)


@contextmanager
def _register() -> Iterator[Path]:
    """Give the private folder of the register, to this process alone; OSError if there is none."""
    folder = Path(platformdirs.user_state_dir("sdm-deflect", appauthor=False)) / "temporary"
    if not folder.is_absolute():
        raise FileNotFoundError(ENOENT, "this user has no home", str(folder))
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        found = os.fstat(handle)
        if found.st_uid != os.geteuid() or found.st_mode & 0o077:
            raise PermissionError(EPERM, os.strerror(EPERM), str(folder))
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield folder
    finally:
        os.close(handle)

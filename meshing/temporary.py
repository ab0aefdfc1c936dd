"""Temporary folders: named after their process, so that those of processes that are gone are known and cleared."""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from zlib import crc32

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.replacement import JOURNAL, finish

BESIDE, SCRATCH = ".sdm-", "sdm-deflect-"
"""Beginnings of the names of temporary folders: beside a target, and in the system's folder for such."""
MARKED = re.compile(r"(?:\.sdm|sdm-deflect)-([0-9a-f]{8})-(\d+)-(\d+)-\w+")
"""Machine, process and its start in the name of a temporary folder."""


@contextmanager
def staging(folder: Path, begin: str = BESIDE) -> Iterator[Path]:
    """Give a temporary folder in `folder` that is removed at the end, after those of processes that are gone.

    It stays only if it holds the journal of what could not be finished.
    """
    settle_in(folder)
    name = Path(tempfile.mkdtemp(prefix=f"{begin}{_machine()}-{os.getpid()}-{_start(os.getpid()) or 0}-", dir=folder))
    try:
        yield name
    finally:
        if not (name / JOURNAL).exists():
            shutil.rmtree(name, ignore_errors=True)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a folder among the system's temporary ones that is removed at the end, after those of processes gone."""
    with staging(Path(tempfile.gettempdir()), SCRATCH) as folder:
        yield folder


def settle(folder: Path) -> None:
    """Finish what a process that is gone was about to replace in a folder, and remove what else it left there.

    MeshFileError if a replacement is unfinished and cannot be finished.
    """
    place = Path(os.path.realpath(folder))
    settle_in(place)
    settle_in(place.parent)


def settle_in(folder: Path) -> None:
    """As `settle`, of what lies in this folder alone."""
    with suppress(OSError), os.scandir(folder) as entries:
        names = [entry.name for entry in entries if MARKED.fullmatch(entry.name)]
        for left in (folder / name for name in names):
            if _is_left(left):
                _settled(left)


def _settled(left: Path) -> None:
    try:
        finish(left)
    except OSError as error:
        why = f"{error.filename}: {error.strerror}"
        raise MeshFileError(f"{left.parent}: an earlier replacement cannot be finished: {why}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise MeshFileError(f"{left / JOURNAL}: is damaged; delete the folder {left.name}") from error
    shutil.rmtree(left, ignore_errors=True)


def _is_left(path: Path) -> bool:
    """Whether a temporary folder is ours, and its process gone."""
    found = MARKED.fullmatch(path.name)
    with suppress(FileNotFoundError):
        status = path.lstat()
        own = path.is_dir() and not path.is_symlink() and status.st_uid == os.geteuid()
        return bool(own and found and found[1] == _machine() and _start(int(found[2])) != int(found[3]))
    return False


def is_temporary(path: Path) -> bool:
    """Whether a path lies in a temporary folder of this process."""
    own = f"{_machine()}-{os.getpid()}-"
    return any(MARKED.fullmatch(part) and own in part for part in path.absolute().parent.parts)


def _machine() -> str:
    """Digest of the machine's name and of the space in which its processes have their numbers."""
    space = ""
    with suppress(OSError):
        space = str(Path("/proc/self/ns/pid").readlink())
    return f"{crc32(f'{os.uname().nodename} {space}'.encode()):08x}"


def _start(process: int) -> int | None:
    """When a process started, in the system's own unit (0 where that is not told); None if it is gone."""
    try:
        state, *rest = Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(") ")[2].split()
        return None if state in "ZX" else int(rest[18])
    except FileNotFoundError:
        if Path("/proc/self/stat").exists():
            return None
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        pass
    return 0

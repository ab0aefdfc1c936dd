"""States of files, which show whether a file has changed since it was read."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from .errors import InputError

# Size in bytes, time of the last change in nanoseconds, inode, device.
State = tuple[int, int, int, int]
# States by path; None for a missing file.
States = Mapping[str, State | None]
# Largest number of open files; a process may open only some hundreds.
HELD = 64


def states_of(paths: Iterable[Path]) -> dict[str, State | None]:
    """Return the present states of files."""
    return {str(path.absolute()): _state(str(path)) for path in paths}


def check_unchanged(files: States, elsewhere: bool = False) -> None:
    """Raise InputError if a file has changed; `elsewhere` allows other inodes, as seen from another machine."""
    for path, state in files.items():
        now = _state(path)
        if now != state and not (elsewhere and now and state and now[:2] == state[:2]):
            raise InputError(f"{path}: was changed or replaced while it was in use; run the command again")


@contextmanager
def hold_open(paths: Iterable[Path]) -> Iterator[None]:
    """Hold files open during the block, so that no new file reuses an inode."""
    with ExitStack() as stack:
        for path in list(paths)[:HELD]:
            with suppress(OSError):  # reading the file reports the error
                stack.enter_context(path.open("rb"))
        yield


def _state(path: str) -> State | None:
    try:
        state = Path(path).stat()
    except OSError:
        return None
    return state.st_size, state.st_mtime_ns, state.st_ino, state.st_dev

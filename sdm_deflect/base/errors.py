"""Errors that a user sees as one sentence instead of a traceback."""

import errno
import signal
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

# Signals that ask a command to end; Windows knows no SIGHUP.
REQUESTS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# Errors of writing alone: no space, a quota, a limit of the size.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# Largest number of letters of a value and of a message, and of names in a list: damaged files may hold anything.
LONGEST, MOST, FEW = 80, 900, 5


def printable(text: str) -> str:
    """Return text with control characters escaped: names in files may hold any."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def sentence(text: str) -> str:
    """Return a message for printing; a very long one loses its middle."""
    shown = printable(text)
    return shown if len(shown) <= MOST else f"{shown[: MOST // 2]} ... {shown[-MOST // 3 :]}"


class InputError(ValueError):
    """An input cannot be used; the message names the value and what would be right."""

    def __init__(self, message: str) -> None:
        super().__init__(sentence(message))


class MeshFileError(RuntimeError):
    """A mesh file is damaged, or has unsupported content; the message names the file and the fault."""

    def __init__(self, message: str) -> None:
        super().__init__(sentence(message))


class WriteError(MeshFileError):
    """A file cannot be written; the message names it."""


class LostError(RuntimeError):
    """Something that a run needs was lost; the same command may succeed again."""


def shortened(value: object) -> str:
    """Return `repr(value)`, shortened to a line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def short_list(names: Iterable[object]) -> str:
    """Return names with commas; a long list is cut and ends with the number of further names."""
    texts = [str(name) for name in names]
    return ", ".join(texts[:FEW]) + (f" and {len(texts) - FEW} more" if len(texts) > FEW else "")


def nearest(name: str, known: Collection[str], noun: str = "known are") -> str:
    """Return the end of a sentence about an unknown name: the most similar known ones, or all."""
    close = get_close_matches(name, list(known), n=3)
    return f"did you mean {', '.join(close)}?" if close else f"{noun} {short_list(known) or 'none'}"


@contextmanager
def write_errors(out: Path) -> Iterator[None]:
    """Turn an OSError of writing `out` into a WriteError: ``"out: cannot be written: why"``."""
    try:
        yield
    except OSError as error:
        raise WriteError(f"{out}: cannot be written: {error.strerror or error}") from error


@contextmanager
def errors_for(beside: Path, out: Path) -> Iterator[None]:
    """Name `out` in errors that would name the temporary file `beside`, which takes its place."""
    try:
        yield
    except MeshFileError as error:
        raise MeshFileError(str(error).replace(str(beside), str(out))) from error

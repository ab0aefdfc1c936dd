"""What a user is told in one sentence instead of a traceback."""

import signal
from collections.abc import Collection
from difflib import get_close_matches

REQUESTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a command to end."""


def printable(text: str) -> str:
    """Return text in which characters that command a terminal are shown as escapes: names in files may hold any."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


LONGEST, MOST = 80, 900
"""Letters of a value that a message shows, and of a message: damaged files hold names and numbers of any length."""


def sentence(text: str) -> str:
    """Return a message as it may be printed; of a very long one its beginning and its end."""
    shown = printable(text)
    return shown if len(shown) <= MOST else f"{shown[: MOST // 2]} ... {shown[-MOST // 3 :]}"


class InputError(ValueError):
    """A mesh, a name or a value that was given cannot be used; the message says which and what would be right."""

    def __init__(self, message: str) -> None:
        super().__init__(sentence(message))


class LostError(RuntimeError):
    """What a run needs was lost under way; its input may be right, and the same command may succeed."""


def shortened(value: object) -> str:
    """Return a value as Python writes it, at most a line of it."""
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def nearest(name: str, known: Collection[str], noun: str = "known are") -> str:
    """Return the end of a sentence about a name that is not known: those that come near it, else all."""
    close = get_close_matches(name, list(known), n=3)
    return f"did you mean {', '.join(close)}?" if close else f"{noun} {', '.join(known) or 'none'}"

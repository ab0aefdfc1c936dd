"""What a user is told in one sentence instead of a traceback."""

from collections.abc import Collection
from difflib import get_close_matches


class InputError(ValueError):
    """A mesh, a name or a value that was given cannot be used; the message says which and what would be right."""


def nearest(name: str, known: Collection[str], noun: str = "known are") -> str:
    """Return the end of a sentence about a name that is not known: those that come near it, else all."""
    close = get_close_matches(name, list(known), n=3)
    return f"did you mean {', '.join(close)}?" if close else f"{noun} {', '.join(known) or 'none'}"

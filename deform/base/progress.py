"""Progress of long operations: a callback that does nothing unless one is handed in."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with a short text and the fraction done (0 to 1, or nan when unknown)."""


def silent(text: str, fraction: float) -> None:
    """Report nothing."""

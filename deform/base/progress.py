"""Progress of long operations: a callback that does nothing unless one is handed in."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

Progress = Callable[[str, float], None]
"""Called with a short text and the fraction done (0 to 1, or nan when unknown)."""


Stage = Callable[[str], AbstractContextManager[Progress]]
"""Shows a stage of a run while its context lasts, which gives what takes the stage's progress."""


def unseen(_: str) -> AbstractContextManager[Progress]:
    """Show nothing."""
    return nullcontext(silent)


def silent(text: str, fraction: float) -> None:
    """Report nothing."""

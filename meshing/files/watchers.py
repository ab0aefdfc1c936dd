"""Who is told when a result is replaced; imports nothing, so that a command can listen before it loads anything."""

from collections.abc import Callable
from pathlib import Path

watchers: list[Callable[[Path, bool], None]] = []
"""Called with the target: False when its replacement begins, True when it is whole; not for the mesh cache."""

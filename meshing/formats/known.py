"""Which formats there are: each is a class in a file of this folder, and `registered` above it says its name.

The files are searched for that line and not loaded, so a command on one file loads its own format alone.
"""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

REGISTERED = re.compile(r"^@registered\(([^)]*)\)\nclass (\w+)", re.MULTILINE)
WORD = re.compile(r'"([^"]+)"')
Kind = TypeVar("Kind", bound=type[Any])


class Registration(NamedTuple):
    """A format that may not be loaded yet: its module, its class there, its suffixes; whether any mesh can be written.

    Of the others, files are only rewritten.
    """

    module: str
    kind: str
    suffixes: tuple[str, ...]
    written: bool


def registered(name: str, *suffixes: str, written: bool = True) -> Callable[[Kind], Kind]:
    """Make a class known as a format: its name, the suffixes of its files, whether meshes from elsewhere are written.

    In a file of this folder the arguments must be words in quotes, because they are read before the file is loaded.
    """

    def keep(kind: Kind) -> Kind:
        kind.name, kind.suffixes, kind.written = name, suffixes, written
        entries()[name] = Registration(kind.__module__, kind.__name__, suffixes, written)
        return kind

    return keep


@cache
def entries() -> dict[str, Registration]:
    """Return every format by its name."""
    return in_folder(Path(__file__).parent, __package__ or "")


def in_folder(folder: Path, package: str) -> dict[str, Registration]:
    """Return the formats of the files in a folder, which are the modules of a package."""
    found: dict[str, Registration] = {}
    for file in sorted(folder.glob("*.py")):
        for words, kind in REGISTERED.findall(file.read_text("utf-8")):
            name, *suffixes = WORD.findall(words)
            found[name] = Registration(f"{package}.{file.stem}", kind, tuple(suffixes), "written=False" not in words)
    return found


def writable() -> tuple[str, ...]:
    """Return the formats in which meshes from elsewhere can be written."""
    return tuple(name for name, entry in entries().items() if entry.written)

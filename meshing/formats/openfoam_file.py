"""OpenFOAM's own files: the header, and what follows."""

from __future__ import annotations

import gzip
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sdm_deflect.meshing.formats.format import MeshFileError

HEADER = re.compile(rb"FoamFile\s*\{([^}]*)\}")
ENTRY = re.compile(rb"(\w+)\s+(\"[^\"]*\"|[^;]*);")
COMMENT = re.compile(rb"//[^\n]*|/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True, slots=True, eq=False)
class FoamFile:
    """The bytes of a file, unpacked, and what its header says.

    Parameters
    ----------
    data
        All bytes, header included.
    start
        Where the content begins, after the header.
    entries
        The header's entries, such as ``{"format": "binary", "class": "labelList"}``.
    """

    data: bytes = field(repr=False)
    start: int
    entries: dict[str, str]

    @property
    def binary(self) -> bool:
        """Whether lists are binary."""
        return self.entries.get("format", "ascii") == "binary"

    def kind(self, what: str) -> np.dtype[np.generic]:
        """Type of a binary ``label`` or ``scalar`` of this file; 32 and 64 bits unless its `arch` says otherwise."""
        arch = self.entries.get("arch", "")
        found = re.search(rf"{what}=(\d+)", arch)
        bits = int(found[1]) if found else {"label": 32, "scalar": 64}[what]
        order = ">" if "MSB" in arch else "<"
        return np.dtype(f"{order}{'i' if what == 'label' else 'f'}{bits // 8}")

    def text(self) -> bytes:
        """The content with blanks in place of comments, so that every other byte stays where it was."""
        return COMMENT.sub(lambda comment: b" " * len(comment[0]), self.data[self.start :])


def open_foam(folder: Path, name: str) -> FoamFile:
    """Read ``folder/name`` or ``folder/name.gz``.

    Raises
    ------
    MeshFileError
        If neither is there, or it has no header.
    """
    packed = folder / f"{name}.gz"
    try:
        plain = (folder / name).is_file() or not packed.is_file()
        data = (folder / name).read_bytes() if plain else gzip.decompress(packed.read_bytes())
    except (OSError, EOFError, zlib.error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "is truncated or damaged"
        raise MeshFileError(f"{name}: {reason}") from error
    header = HEADER.search(data)
    if not header:
        raise MeshFileError(f"{name}: has no FoamFile header; it is truncated, or not a file of OpenFOAM")
    entries = {key.decode(): value.decode("utf-8", "replace").strip('"') for key, value in ENTRY.findall(header[1])}
    return FoamFile(data, header.end(), entries)

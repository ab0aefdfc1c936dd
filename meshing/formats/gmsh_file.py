"""Gmsh's own files: their version and their sections."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.gmsh_cursor import ByteCursor, Cursor, TextCursor

NAME = re.compile(rb"\s*\$(\w+)[ \t\r]*\n")
VERSIONS = {"2": 22, "2.0": 22, "2.1": 22, "2.2": 22, "4.1": 41}


@dataclass(frozen=True, slots=True, eq=False)
class GmshFile:
    """The bytes of a file and where its sections are.

    Parameters
    ----------
    data
        All bytes.
    version
        22 or 41.
    order
        ``"<"`` or ``">"`` for binary files, empty for text.
    sections
        First and last byte (exclusive) of the content of each section, by name.
    """

    data: bytes = field(repr=False)
    version: int
    order: str
    sections: dict[str, tuple[int, int]]

    def content(self, name: str) -> bytes:
        """Return the bytes of a section; MeshFileError if it is not there."""
        if name not in self.sections:
            raise MeshFileError(f"there is no section ${name}; the file is truncated or holds no mesh")
        begin, end = self.sections[name]
        return self.data[begin:end]

    def cursor(self, name: str) -> Cursor:
        """Read the numbers of a section one after another."""
        content, (begin, _) = self.content(name), self.sections[name]
        return ByteCursor(content, begin, name, self.order) if self.order else TextCursor(content, begin, name)


def opened(data: bytes) -> GmshFile:
    """Find the sections of a file.

    Raises
    ------
    MeshFileError
        If it is not of Gmsh, of a version that is not read, or truncated.
    """
    if not NAME.match(data):
        hint = "; it looks like Fluent's: convert it with fluentMeshToFoam" if data.lstrip()[:2] == b"(0" else ""
        raise MeshFileError(f"is not a mesh of Gmsh: it does not begin with $MeshFormat{hint}")
    sections = _sections(data)
    if "MeshFormat" not in sections:
        raise MeshFileError("has no section $MeshFormat; Gmsh's versions before 2 are not read")
    begin, end = sections["MeshFormat"]
    head, _, one = data[begin:end].partition(b"\n")
    words = head.decode("ascii", "replace").split()
    if len(words) < 3 or words[0] not in VERSIONS:
        raise MeshFileError(
            f"is of version {' '.join(words[:1])}; 2.2 and 4.1 are read: convert it with gmsh -save -format msh41"
        )
    if words[2] != "8":
        raise MeshFileError(f"numbers of {words[2]} bytes are not read, only those of 8")
    order = "" if words[1] == "0" else "<" if one[:4] == b"\1\0\0\0" else ">"
    return GmshFile(data, VERSIONS[words[0]], order, sections)


def _sections(data: bytes) -> dict[str, tuple[int, int]]:
    found: dict[str, tuple[int, int]] = {}
    at = 0
    while header := NAME.match(data, at):
        name = header[1].decode("ascii", "replace")
        end = data.find(b"$End" + header[1], header.end())
        if end < 0:
            raise MeshFileError(f"section ${name} does not end; the file is truncated")
        found.setdefault(name, (header.end(), end))
        at = end + len(name) + 4
    if data[at:].strip():
        raise MeshFileError(f"{data[at : at + 20].strip()!r} stands between sections; the file is damaged")
    return found

"""The dictionary `boundary` of an OpenFOAM mesh: names, types and faces of its patches."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sdm_deflect.meshing.formats.format import MeshFileError

WORD = re.compile(rb"\"[^\"]*\"|[{}();]|[^\s{}();\"]+")
SYMMETRY = ("symmetry", "sym")
OPEN = ("far", "inlet", "outlet", "inflow", "outflow", "freestream", "chimera", "overset", "interface", "volume")


@dataclass(frozen=True, slots=True)
class FoamPatch:
    """A patch: faces start to start + count - 1."""

    name: str
    type: str
    count: int
    start: int


def parse(text: bytes) -> list[FoamPatch]:
    """Read the patches of a `boundary` file without its header and comments.

    Raises
    ------
    MeshFileError
        If an entry is missing, or another number of patches follows than is announced.
    """
    words = iter(WORD.findall(text))
    patches = []
    try:
        count, _ = int(next(words)), next(words)
        for word in words:
            if word == b")":
                break
            _ = next(words)
            patches.append(_patch(word.decode("utf-8", "replace").strip('"'), _entries(words)))
    except (StopIteration, ValueError):
        raise MeshFileError("the list of patches is truncated or damaged") from None
    if len(patches) != count:
        raise MeshFileError(f"{len(patches)} patches follow where there should be {count}; the file is damaged")
    return patches


def _entries(words: Iterator[bytes]) -> dict[str, str]:
    """Entries of one level up to its closing brace; dictionaries inside it are passed over."""
    found: dict[str, str] = {}
    key: list[bytes] = []
    while (word := next(words)) != b"}":
        if word == b"{":
            _entries(words)
            key = []
        elif word == b";":
            if key:
                found[key[0].decode()] = b" ".join(key[1:]).decode("utf-8", "replace")
            key = []
        else:
            key.append(word)
    return found


def _patch(name: str, entries: dict[str, str]) -> FoamPatch:
    missing = {"type", "nFaces", "startFace"} - entries.keys()
    if missing:
        raise MeshFileError(f"patch {name} has no {', '.join(sorted(missing))}")
    return FoamPatch(name, entries["type"], int(entries["nFaces"]), int(entries["startFace"]))


def written(patches: Sequence[FoamPatch]) -> str:
    """Return the content of a `boundary` file."""
    lines = [f"{len(patches)}", "("]
    for patch in patches:
        group = "    inGroups 1(wall);\n" if patch.type == "wall" else ""
        lines.append(
            f"{patch.name}\n{{\n    type {patch.type};\n{group}    nFaces {patch.count};\n"
            f"    startFace {patch.start};\n}}"
        )
    return "\n".join([*lines, ")", ""])


def kind_of(name: str, planar: bool) -> str:
    """Return the type of a patch that has but a name: what it says, a wall if nothing.

    A plane of symmetry that is curved is a ``symmetry``: OpenFOAM takes ``symmetryPlane`` for planes alone.
    """
    low = name.lower()
    if any(low.startswith(word) for word in SYMMETRY):
        return "symmetryPlane" if planar else "symmetry"
    return "patch" if any(word in low for word in OPEN) else "wall"


def words(names: Sequence[str]) -> dict[str, str]:
    """Word for each patch: its name where OpenFOAM can read it, else one that is not taken."""
    found: dict[str, str] = {}
    for name in names:
        word = re.sub(r"[\s\"'/;{}()\[\]$#\\]", "_", name) or "_"
        while word != name and (word in names or word in found.values()):
            word += "_"
        found[name] = word
    return found

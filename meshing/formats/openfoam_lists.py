"""Lists of labels, vectors and faces in OpenFOAM's files, in text or binary."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.mesh import Polygons
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.openfoam_file import FoamFile
from sdm_deflect.meshing.formats.polygons import polygons
from sdm_deflect.meshing.formats.su2_text import numbers
from sdm_deflect.meshing.mesh import FloatArray, IntArray

BLANK = re.compile(rb"(?:\s|//[^\n]*(?:\n|$)|/\*.*?\*/)*", re.DOTALL)
COUNT = re.compile(rb"(\d+)\s*([({])")
FLAT = bytes.maketrans(b"(){}", b"    ")


def labels(file: FoamFile) -> IntArray:
    """Return a list (K,) of labels, such as `owner`; ``5{0}`` is five zeros."""
    if file.binary:
        return _binary(file, file.start, "label", 1)[0][:, 0].astype(np.intp)
    text = file.text()
    count, uniform, begin = _count(text, 0)
    values = numbers(text[begin:].translate(FLAT), np.int64).values.astype(np.intp)
    _check(len(values), 1 if uniform else count)
    return np.repeat(values, count) if uniform else values


@dataclass(frozen=True, slots=True, eq=False)
class Vectors:
    """Coordinates (N, 3) and the bytes ``begin`` to ``end - 1`` (each (N, 3)) of the file that hold them."""

    values: FloatArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)


def vectors(file: FoamFile) -> Vectors:
    """Return the list of vectors in `points`, and where in the file they are."""
    if file.binary:
        values, first = _binary(file, file.start, "scalar", 3)
        size = file.kind("scalar").itemsize
        begin = first + size * np.arange(values.size).reshape(-1, 3)
        return Vectors(values.astype(np.float64), begin, begin + size)
    text = file.text()
    count, _, start = _count(text, 0)
    words = numbers(text[start:].translate(FLAT), np.float64)
    _check(len(words.values), 3 * count)
    offset = file.start + start
    begin, end = (offset + at.reshape(-1, 3) for at in (words.begin, words.end))
    return Vectors(words.values.astype(np.float64).reshape(-1, 3), begin, end)


def faces(file: FoamFile) -> Polygons:
    """Return a list of faces: ``4(0 1 2 3)`` each in text, offsets and nodes in binary."""
    if file.binary:
        if file.entries.get("class") != "faceCompactList":
            raise MeshFileError(f"a binary {file.entries.get('class')} cannot be read; run foamFormatConvert")
        offsets, first = _binary(file, file.start, "label", 1)
        after = first + offsets.nbytes + 1
        nodes, _ = _binary(file, after, "label", 1)
        return Polygons(nodes[:, 0].astype(np.intp), offsets[:, 0].astype(np.intp))
    text = file.text()
    count, _, start = _count(text, 0)
    body = text[start:]
    words = numbers(body.translate(FLAT), np.int64)
    opening = np.flatnonzero(np.frombuffer(body, dtype=np.uint8) == ord("("))
    heads = np.searchsorted(words.begin, opening) - 1
    _check(len(heads), count)
    if np.any(heads < 0):
        raise MeshFileError("a face has no number of corners; the file is damaged")
    sizes = words.values[heads].astype(np.intp)
    nodes = np.delete(words.values, heads).astype(np.intp)
    _check(len(nodes), int(sizes.sum()))
    return polygons(nodes, sizes)


def _count(text: bytes, at: int) -> tuple[int, bool, int]:
    """Length of the list that begins at or after `at`, whether it is uniform, and where its content begins."""
    blank = BLANK.match(text, at)
    found = COUNT.match(text, blank.end() if blank else at)
    if not found:
        raise MeshFileError("no list follows the header; the file is truncated or damaged")
    return int(found[1]), found[2] == b"{", found.end()


def _binary(file: FoamFile, at: int, what: str, columns: int) -> tuple[FloatArray | IntArray, int]:
    """Rows (K, columns) of a binary list, and the byte where they begin."""
    kind = file.kind(what)
    blank = BLANK.match(file.data, at)
    found = re.compile(rb"(\d+)\s*").match(file.data, blank.end() if blank else at)
    if found and int(found[1]) == 0:
        return np.empty((0, columns), kind), found.end()
    if not found:
        raise MeshFileError("no list follows the header; the file is truncated or damaged")
    count, begin = int(found[1]), found.end() + 1
    end = begin + count * columns * kind.itemsize
    bracket = file.data[found.end() : begin]
    if bracket == b"{":
        end = begin + columns * kind.itemsize
    if end >= len(file.data) or file.data[end : end + 1] not in b")}":
        raise MeshFileError(f"{count} values should follow, but the file ends before or goes on; it is damaged")
    rows = np.frombuffer(file.data[begin:end], kind).reshape(-1, columns)
    return (np.repeat(rows, count, axis=0) if bracket == b"{" else rows), begin


def _check(found: int, expected: int) -> None:
    if found != expected:
        cause = "truncated or damaged" if found < expected else "damaged"
        raise MeshFileError(f"holds {found} numbers or faces where {expected} should be; the file is {cause}")

"""Nodes of Gmsh's files, versions 2.2 and 4.1."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.gmsh_cursor import Cursor, Reals, TextCursor
from sdm_deflect.meshing.formats.gmsh_file import GmshFile
from sdm_deflect.meshing.mesh import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Numbers (N,) of the nodes, coordinates (N, 3), and the bytes begin to end - 1 (both (N, 3)) that hold them."""

    tags: IntArray = field(repr=False)
    points: FloatArray = field(repr=False)
    begin: IntArray = field(repr=False)
    end: IntArray = field(repr=False)


def nodes(file: GmshFile) -> Nodes:
    """Return the nodes in the file's order.

    Raises
    ------
    MeshFileError
        If they are truncated, or two have the same number.
    """
    cursor = file.cursor("Nodes")
    found = _nodes22(cursor) if file.version == 22 else _nodes41(cursor)
    twice = len(found.tags) - len(np.unique(found.tags))
    if twice:
        raise MeshFileError(f"{twice} of {len(found.tags)} nodes have the number of another")
    return found


def _nodes22(cursor: Cursor) -> Nodes:
    if isinstance(cursor, TextCursor):
        count = int(cursor.ints(1)[0])
        table = cursor.reals(4 * count)
        own = _columns(table, 4, slice(1, 4))
        return Nodes(table.values[::4].astype(np.intp), own.values, own.begin, own.end)
    count = cursor.line()
    first = cursor.offset + cursor.at + 4
    records = cursor.raw(count, "i4,3f8")
    begin = first + 28 * np.arange(count)[:, None] + 8 * np.arange(3)
    return Nodes(records["f0"].astype(np.intp), records["f1"].astype(np.float64), begin, begin + 8)


def _nodes41(cursor: Cursor) -> Nodes:
    blocks = int(cursor.sizes(4)[0])
    tags, found = [np.empty(0, dtype=np.intp)], []
    for _ in range(blocks):
        dimension, _, parametric = cursor.ints(3).tolist()
        count = int(cursor.sizes(1)[0])
        tags.append(cursor.sizes(count))
        width = 3 + (dimension if parametric else 0)
        found.append(_columns(cursor.reals(width * count), width, slice(3)))
    none = np.empty((0, 3), dtype=np.intp)
    begin, end = (np.concatenate([none, *(getattr(own, name) for own in found)]) for name in ("begin", "end"))
    points = np.concatenate([np.empty((0, 3)), *(own.values for own in found)])
    return Nodes(np.concatenate(tags), points, begin, end)


def _columns(table: Reals, width: int, chosen: slice) -> Reals:
    """Columns of a table of `width`: coordinates have a node's number before them, or parameters after them."""
    begin, end = (places.reshape(-1, width)[:, chosen] for places in (table.begin, table.end))
    return Reals(table.values.reshape(-1, width)[:, chosen], begin, end)

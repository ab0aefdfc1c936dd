"""Copies made range by range: in any order, twice, and with rows that lie across the ends of ranges."""

import errno
import os

import numpy as np
import pytest

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats import tables
from sdm_deflect.meshing.formats.rewriting import Change, copy_range, item_of
from sdm_deflect.meshing.formats.table_pieces import PointRange, TablePieces
from sdm_deflect.meshing.formats.tables import FileTable

SIZE = 4_000


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "source"
    path.write_bytes(np.random.default_rng(0).bytes(SIZE))
    return path


@pytest.fixture(params=["copied", "otherwise", "without"])
def system(request, monkeypatch):
    """A system that copies from file to file, one that cannot for these files, and one that knows no such thing."""

    def refuse(*_):
        raise OSError(errno.EXDEV, "refused")

    if request.param == "otherwise":
        monkeypatch.setattr(os, "copy_file_range", refuse)
    elif request.param == "without":
        monkeypatch.delattr(os, "copy_file_range")


def changes(source):
    """Changes of three tables that lie in one another's gaps, and the bytes that they come to."""
    rng, expected = np.random.default_rng(1), bytearray(source.read_bytes())
    found = []
    for begin, kind, width in ((101, "<f8", 2), (101 + 16, ">f4", 1), (101 + 20, "<f8", 1)):
        table = FileTable(source, begin, kind, 100, width, 31)
        rows = np.sort(rng.choice(100, 40, replace=False))
        found.append(Change(table, rows, rng.random((40, width))))
        size = np.dtype(kind).itemsize * width
        for row, values in zip(rows, found[-1].values, strict=True):
            expected[begin + 31 * row : begin + 31 * row + size] = values.astype(kind).tobytes()
    return tuple(found), bytes(expected)


@pytest.mark.parametrize("length", [7, 64, 1_000, SIZE])
def test_ranges_in_any_order_and_twice_make_the_whole(length, source, system, tmp_path):
    out = tmp_path / "out"
    out.write_bytes(b"")
    os.truncate(out, SIZE)
    own, expected = changes(source)
    items = [item_of(own, start, min(start + length, SIZE)) for start in range(0, SIZE, length)]
    order = np.random.default_rng(2).permutation(np.repeat(np.arange(len(items)), 2))
    for i in order:
        copy_range((source, out), items[i])
    assert out.read_bytes() == expected != source.read_bytes()


def test_an_item_has_no_more_than_the_rows_of_its_range(source):
    own, _ = changes(source)
    _, _, parts = item_of(own, 1_000, 1_100)
    assert sum(len(part.rows) for part in parts) <= 3 * 5
    assert item_of(own, 0, 101) == (0, 101, ())


def test_coordinates_that_did_not_change_keep_their_bytes(source, tmp_path):
    table = FileTable(source, 0, "<f4", 6, 3)
    values = np.array([[-0.0, 1.0, 2.0]] * 6)
    with source.open("r+b") as file:
        file.write(values.astype("<f4").tobytes())
    pieces = TablePieces(str(source), 6, (PointRange(0, 6, table),), ())
    pieces.rewrite(np.arange(6), np.abs(values), tmp_path / "out")
    assert (tmp_path / "out").read_bytes() == source.read_bytes()


@pytest.mark.parametrize("changed", [True, False])
def test_a_file_that_became_shorter(changed, source, system, tmp_path):
    out = tmp_path / "out"
    out.write_bytes(bytes(SIZE))
    own, _ = changes(source)
    os.truncate(source, 2_000)
    with pytest.raises(MeshFileError, match=rf"^{source}: {tables.SHORTER}$"):
        copy_range((source, out), item_of(own if changed else (), 1_500, 2_500))


def test_a_copy_that_is_not_where_a_worker_looks(source, tmp_path):
    with pytest.raises(MeshFileError, match=r"source: out is not there for the worker that is to write it: write to a"):
        copy_range((source, tmp_path / "out"), item_of((), 0, SIZE))

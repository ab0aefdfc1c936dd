"""Compiled judgement of very many cells: the bits of the other way."""

import numpy as np
import pytest

from sdm_deflect.deform.mesh import quality
from sdm_deflect.deform.mesh.mesh import VOLUMES, Cells
from tests.deform.test_quality import distorted


def cells_of(shape, dtype):
    """Good, bad and left-handed cells, some without size, with edges of no length or flat, some of any nodes."""
    rng = np.random.default_rng(2)
    points, cells = distorted(shape, 0.25, 20_000)
    nodes = cells.nodes.copy()
    some = nodes[1000:1500]
    points[some] *= [1.0, 1.0, -1.0]
    points[nodes[1500:1600]] *= [1.0, 1.0, 0.0]
    nodes[1600:1700, 0] = nodes[1600:1700, 1]
    nodes[1700:1800, -1] = nodes[1700:1800, 0]
    nodes[1800:1900] = nodes[1800:1900, :1]
    nodes[2000:] = rng.integers(0, len(points), nodes[2000:].shape)
    return points, Cells(shape, nodes.astype(dtype))


def both(monkeypatch, *parameters):
    """Quality and inversion, and inversion alone, by NumPy and by compiled code."""
    found = []
    for many in (1 << 62, 0):
        monkeypatch.setattr(quality, "MANY", many)
        found.append((*quality.judged(*parameters), quality.inverted_of(*parameters)))
    return found


def same_bits(one, other):
    """True if all bits are the same, but that a zero may have either sign: the smaller of 0 and -0 is any."""
    return (one + 0.0).tobytes() == (other + 0.0).tobytes()


@pytest.mark.parametrize("shape", VOLUMES)
@pytest.mark.parametrize("dtype", [np.int32, np.int64])
@pytest.mark.parametrize("orientation", [1.0, -1.0])
@pytest.mark.parametrize("some", [False, True])
def test_many_cells_have_the_same_bits_as_few(shape, dtype, orientation, some, monkeypatch):
    points, block = cells_of(shape, dtype)
    rows = np.random.default_rng(3).permutation(len(block))[:9001] if some else None
    (values, inverted, alone), (again, other, other_alone) = both(monkeypatch, points, block, rows, orientation)
    assert 0 < inverted.sum() < len(inverted)
    assert len(np.unique(values)) > 100
    assert same_bits(again, values)
    assert np.array_equal(other, inverted)
    assert np.array_equal(other_alone, alone)


@pytest.mark.parametrize("shape", VOLUMES)
def test_what_is_no_number_stays_none(shape, monkeypatch):
    """A cell with a node at nan is not inverted, whichever of its corners that node is, and has no quality."""
    points, block = cells_of(shape, np.int64)
    for corner in range(block.nodes.shape[1]):
        points[block.nodes[corner, corner]] = np.nan
    with np.errstate(invalid="ignore"):
        (values, inverted, alone), (again, other, other_alone) = both(monkeypatch, points, block, None, 1.0)
    assert not alone[: block.nodes.shape[1]].any()
    assert np.array_equal(np.isnan(again), np.isnan(values))
    assert same_bits(np.nan_to_num(again), np.nan_to_num(values))
    assert np.array_equal(other, inverted)
    assert np.array_equal(other_alone, alone)


@pytest.mark.parametrize("shape", VOLUMES)
def test_no_rows_are_no_cells(shape, monkeypatch):
    points, block = cells_of(shape, np.int64)
    monkeypatch.setattr(quality, "MANY", -1)
    values, inverted = quality.judged(points, block, np.empty(0, dtype=np.intp))
    assert len(values) == len(inverted) == len(quality.inverted_of(points, block, np.empty(0, dtype=np.intp))) == 0

"""Numbers read by compiled code: the bits of Python's own, and None where `numbers` must judge."""

import random
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.formats import numbers as module
from sdm_deflect.meshing.formats import numbers as words
from sdm_deflect.meshing.formats import su2
from sdm_deflect.meshing.formats.numbers import ahead, many_numbers, numbers, plain_numbers
from sdm_deflect.meshing.formats.su2 import Su2
from tests.meshing.formats.alike import content
from tests.meshing.formats.examples import hybrid

KINDS = (np.float64, np.int64)
LONGER = (" ", "\t", "\n", "\r\n", "0.", "1e-7", "123456789012345678", "%", "x", "nan", "\0", "\x1c")
PARTS = st.sampled_from([*"0123456789" * 2, *"+-.eE", *LONGER])
WORDS = st.from_regex(r"[+-]?([0-9]{0,25}\.[0-9]{1,25}|[0-9]{1,25}\.?)([eE][+-]?[0-9]{1,3})?", fullmatch=True)


def same(found, expected):
    for name in ("values", "first", "begin", "end"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes(), name


def bits(words):
    """What the words are read as, beside what Python's float makes of them, as whole numbers of 64 bits."""
    lines = plain_numbers("\n".join(words).encode(), np.float64)
    return lines.values.view(np.int64).tolist(), np.array([float(word) for word in words]).view(np.int64).tolist()


@given(st.lists(PARTS, max_size=40).map("".join), st.sampled_from(KINDS))
def test_what_is_plain_is_what_numbers_reads(text, kind):
    found = plain_numbers(text.encode(), kind)
    if found is not None:
        same(found, numbers(text.encode(), kind))


@given(st.lists(WORDS, min_size=1, max_size=30))
def test_decimals_are_rounded_as_python_rounds_them(words):
    found, expected = bits(words)
    assert found == expected


def test_decimals_of_every_length_and_size_are_rounded_as_python_rounds_them():
    rng = random.Random(4)
    words = [f"{rng.getrandbits(64)}"[: rng.randint(1, 19)] + f"e{rng.randint(-70, 70)}" for _ in range(80_000)]
    words += [repr(rng.uniform(-1, 1) * 10.0 ** rng.randint(-25, 25)) for _ in range(30_000)]
    words += [f"{rng.gauss(0, 1):.18e}" for _ in range(30_000)]
    found, expected = bits(words)
    assert found == expected


def test_numbers_in_the_middle_between_two_are_rounded_to_even():
    rng = np.random.default_rng(5)
    low = rng.integers(2**52, 2**53, 2000).astype(float) * 2.0 ** rng.integers(0, 9, 2000)
    words = [
        str((int(a) + int(b)) // 2 + more)
        for a, b in zip(low, np.nextafter(low, np.inf), strict=True)
        for more in (-1, 0, 1)
    ]
    words += [f"{float(a)!r}5" for a, _ in pairwise(rng.random(2000))]
    found, expected = bits(words)
    assert found == expected


def test_few_numbers_are_left_to_python(monkeypatch):
    rng = np.random.default_rng(6)
    text = "\n".join(map(repr, (rng.normal(size=50_000) * 10.0 ** rng.integers(-20, 10, 50_000)).tolist())).encode()
    left = []
    monkeypatch.setattr(module, "float", lambda word: left.append(word) or float(word), raising=False)
    same(plain_numbers(text, np.float64), numbers(text, np.float64))
    assert len(left) < 50


def test_powers_of_ten_have_more_than_a_hundred_bits():
    for power, (high, low) in zip(range(-64, 65), module.POWERS.tolist(), strict=True):
        assert abs(Fraction(high) + Fraction(low) - Fraction(10) ** power) <= Fraction(10) ** power / 2**106


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (kind, text)
        for kind in KINDS
        for text in ("1 % 2", "1 2\n3 x", "1 \x1f 2", "nan", "1e", "1e+", "+", "1-2", "1..2", "0x10", "1_0", "é", "1,2")
    ]
    + [
        (np.int64, "-1"),
        (np.int64, "1.0"),
        (np.int64, "1234567890123456789"),
        (np.float64, "."),
        (np.float64, "1e99999"),
    ],
)
def test_what_is_not_plain_is_left_to_numbers(kind, text):
    assert plain_numbers(text.encode(), kind) is None


def test_what_is_not_plain_is_read_or_refused_as_before():
    text = b"1 -2 % three\n\n4 inf\n"
    same(many_numbers(text, np.float64), numbers(text, np.float64))
    with pytest.raises(MeshFileError, match="'3x' is not a number"):
        many_numbers(b"1 2 3x", np.int64)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("text", ["", "\n", " \r\n\t\n", "7", "7 8\n\n 9\r\n"])
def test_blank_lines_are_left_out(text, kind):
    same(plain_numbers(text.encode(), kind), numbers(text.encode(), kind))


def test_results_come_in_order_and_an_error_in_its_place():
    def work(text):
        if text == b"30":
            raise MeshFileError("no")
        return int(text)

    results = ahead(work, (b"%d" % i for i in range(100)))
    assert [next(results) for _ in range(30)] == list(range(30))
    with pytest.raises(MeshFileError, match="no"):
        next(results)


@pytest.mark.parametrize("chunk", [40, 1 << 20])
def test_large_files_are_read_and_rewritten_as_small_ones(chunk, tmp_path, monkeypatch):
    mesh = hybrid(2)
    Su2().write(mesh, tmp_path / "mesh.su2")
    text = (tmp_path / "mesh.su2").read_text().replace("NPOIN= 14\n", "NPOIN= 14\n% points\n", 1)
    (tmp_path / "mesh.su2").write_text(text)
    moved = mesh.points + np.sin(100.0 * mesh.points)
    whole = Su2().read(tmp_path / "mesh.su2")
    Su2().rewrite(tmp_path / "mesh.su2", moved, tmp_path / "moved.su2")
    plain = []
    monkeypatch.setattr(module, "plain_numbers", lambda *given: plain.append(plain_numbers(*given)) or plain[-1])
    monkeypatch.setattr(su2, "LARGE", 0)
    monkeypatch.setattr(words, "CHUNK", chunk)
    again = Su2().read(tmp_path / "mesh.su2")
    assert content(again) == content(whole)
    assert again.points.tobytes() == whole.points.tobytes()
    assert sum(lines is None for lines in plain) == 1 < len(plain)
    Su2().rewrite(tmp_path / "mesh.su2", moved, tmp_path / "again.su2")
    assert (tmp_path / "again.su2").read_bytes() == (tmp_path / "moved.su2").read_bytes()

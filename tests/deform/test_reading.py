"""How much memory a file may take, and archives of arrays that nobody vouches for."""

import io
import warnings
import zipfile

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.unpacking import ALWAYS, RATIO_VARIABLE, check_unpacked, read_arrays, unpack_limit


def test_data_of_a_file_may_take_so_much_memory_and_more_if_the_user_says_so(monkeypatch):
    monkeypatch.delenv(RATIO_VARIABLE, raising=False)
    assert unpack_limit(1000) == ALWAYS
    assert unpack_limit(10**7) == 10**9
    check_unpacked(10**9, 10**7, "points")
    with pytest.raises(InputError, match=rf"points would take 4e\+03 MB .* file of 10 MB.*set {RATIO_VARIABLE} to"):
        check_unpacked(4 * 10**9, 10**7, "points")
    monkeypatch.setenv(RATIO_VARIABLE, "1e3")
    check_unpacked(4 * 10**9, 10**7, "points")
    monkeypatch.setenv(RATIO_VARIABLE, "much")
    with pytest.raises(InputError, match=f"{RATIO_VARIABLE} is 'much', expected a number"):
        unpack_limit(1000)


@pytest.fixture(params=[np.savez, np.savez_compressed])
def archive(request, tmp_path):
    request.param(tmp_path / "good.npz", points=np.sin(np.arange(90.0)).reshape(30, 3), unit=np.array("deg"))
    return (tmp_path / "good.npz").read_bytes()


def test_arrays_come_as_they_were_stored(archive, tmp_path):
    found = read_arrays(tmp_path / "good.npz")
    np.testing.assert_array_equal(found["points"], np.sin(np.arange(90.0)).reshape(30, 3))
    assert str(found["unit"]) == "deg"
    np.savez(tmp_path / "columns.npz", points=np.asfortranarray(np.arange(12).reshape(4, 3)))
    np.testing.assert_array_equal(read_arrays(tmp_path / "columns.npz")["points"], np.arange(12).reshape(4, 3))


def test_any_damage_is_one_sentence_or_without_effect(archive, tmp_path):
    random, path = np.random.default_rng(4), tmp_path / "bad.npz"
    complaints = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(600):
            data = bytearray(archive)
            if number % 3:
                data[random.integers(len(data))] ^= 1 << random.integers(8)
            else:
                del data[random.integers(len(data)) :]
            path.write_bytes(data)
            try:
                read_arrays(path)
            except InputError as error:
                complaints.append(str(error))
    assert len(complaints) > 400
    assert all(said.startswith(f"{path}: ") and "\n" not in said for said in complaints)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda header: header.replace(b"(9, 3)", b"(9000000000000, 3)"), "no archive of arrays"),
        (lambda header: header.replace(b"(9, 3)", b"(-9, -3)"), "no archive of arrays"),
        (lambda header: header.replace(b"<f8", b"|O8"), "no archive of arrays"),
        (lambda header: header.replace(b"(9, 3)", b"(" * 3000 + b")"), "no archive"),
    ],
)
def test_a_header_is_compared_with_what_follows(change, said, tmp_path):
    file = io.BytesIO()
    np.save(file, np.zeros((9, 3)))
    data = change(file.getvalue())
    data = data[:8] + (len(data) - 10 - 216).to_bytes(2, "little") + data[10:]
    with zipfile.ZipFile(tmp_path / "bad.npz", "w") as packed:
        packed.writestr("points.npy", data)
    with pytest.raises(InputError, match=said):
        read_arrays(tmp_path / "bad.npz")


def test_what_unpacks_to_far_more_than_the_file_is_refused_before(tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", points=np.zeros((ALWAYS // 24 + 1, 3)))
    with pytest.raises(InputError, match=rf"bomb\.npz: what is packed in it would take .* set {RATIO_VARIABLE}"):
        read_arrays(tmp_path / "bomb.npz")

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.compiled import FOLDER_VARIABLE, default_folder
from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.meshing.cache import MeshCache, cache_key
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.calls import files_of_at_most


@dataclass(frozen=True)
class Sizes:
    wing: float = 0.015


def test_the_key_depends_on_content_and_not_on_order() -> None:
    key = cache_key({"sizes": Sizes(), "angle": 3.0})
    assert key == cache_key({"angle": 3.0, "sizes": Sizes()})
    assert key != cache_key({"angle": 3.0, "sizes": Sizes(wing=np.nextafter(0.015, 1.0))})


def test_a_key_needs_plain_finite_values() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        cache_key({"angle": float("nan")})
    with pytest.raises(TypeError, match="canonical"):
        cache_key({"angle": object()})


def test_a_kept_mesh_comes_back_bit_for_bit(cube: Mesh, tmp_path: Path) -> None:
    cache = MeshCache(tmp_path / "new")
    assert cache.load("k") is None
    cache.store("k", cube, {"attempts": 2})
    found = cache.load("k")
    assert found is not None
    mesh, note = found
    assert note == {"attempts": 2}
    assert mesh.names == cube.names
    for read, given in zip(*((one.points, tets_of(one), *skin(one)) for one in (mesh, cube)), strict=True):
        assert np.array_equal(read, given)


def test_no_damage_gives_another_mesh(cube: Mesh, tmp_path: Path) -> None:
    cache, random = MeshCache(tmp_path), np.random.default_rng(0)
    cache.store("k", cube, {})
    path = tmp_path / "k.npz"
    whole = path.read_bytes()
    damaged = []
    for place in random.integers(0, len(whole), 60).tolist():
        damaged.append(whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :])
    damaged += [whole[:size] for size in range(0, len(whole), 400)]
    damaged += [whole + b"\0", b"\0" + whole, whole[:100] + whole[101:], whole[:300] + whole[200:], bytes(len(whole))]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(MeshFileError, match=r"k\.npz: is damaged, or of an earlier version"):
            cache.load("k")
    path.write_bytes(whole)
    assert cache.load("k") is not None


def test_neither_a_file_of_another_key_nor_one_without_checksum_is_taken(cube: Mesh, tmp_path: Path) -> None:
    cache = MeshCache(tmp_path)
    cache.store("a", cube, {})
    (tmp_path / "a.npz").rename(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", points=cube.points)
    for key in "bc":
        with pytest.raises(MeshFileError, match="is damaged, or of an earlier version"):
            cache.load(key)


def test_a_folder_that_is_full_or_cannot_be_used_is_named(cube: Mesh, tmp_path: Path) -> None:
    with files_of_at_most(1000), pytest.raises(MeshFileError, match=r"k\.npz: cannot be written: File too large"):
        MeshCache(tmp_path / "full").store("k", cube, {})
    assert list((tmp_path / "full").iterdir()) == []
    (tmp_path / "file").touch()
    assert MeshCache(tmp_path / "file").load("k") is None
    with pytest.raises(MeshFileError, match=r"k\.npz: cannot be written"):
        MeshCache(tmp_path / "file").store("k", cube, {})
    (tmp_path / "other" / "k.npz").mkdir(parents=True)
    with pytest.raises(MeshFileError, match=r"k\.npz: Is a directory"):
        MeshCache(tmp_path / "other").load("k")
    with pytest.raises(MeshFileError, match=r"other: cannot be written"):
        MeshCache(tmp_path / "other").clear()


def test_sizes_and_clearing(cube: Mesh, tmp_path: Path) -> None:
    cache = MeshCache(tmp_path)
    cache.store("a", cube, {})
    cache.store("b", cube, {})
    assert list(cache.entries()) == ["a", "b"]
    assert cache.clear() > 2 * cube.points.nbytes
    assert not cache.entries()
    assert cache.load("a") is None


def test_the_folder_can_be_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert default_folder() == tmp_path
    monkeypatch.delenv(FOLDER_VARIABLE)
    assert default_folder().name == "sdm-deflect"

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.meshing.cache import FOLDER_VARIABLE, MeshCache, cache_key, default_folder
from sdm_deflect.meshing.mesh import TetMesh


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


def test_a_kept_mesh_comes_back_bit_for_bit(cube: TetMesh, tmp_path: Path) -> None:
    cache = MeshCache(tmp_path / "new")
    assert cache.load("k") is None
    cache.store("k", cube, {"attempts": 2})
    found = cache.load("k")
    assert found is not None
    mesh, note = found
    assert note == {"attempts": 2}
    assert mesh.names == cube.names
    for name in ("points", "tets", "triangles", "patch", "face"):
        assert np.array_equal(getattr(mesh, name), getattr(cube, name))


@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
def test_damage_is_noticed(cube: TetMesh, tmp_path: Path, place: float) -> None:
    cache = MeshCache(tmp_path)
    cache.store("k", cube, {})
    path = tmp_path / "k.npz"
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 0xFF
    path.write_bytes(content)
    assert cache.load("k") is None
    path.write_bytes(content[: int(place * len(content))])
    assert cache.load("k") is None


def test_sizes_and_clearing(cube: TetMesh, tmp_path: Path) -> None:
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

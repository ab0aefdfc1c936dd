"""Meshes kept by the content of the parameters they were made from."""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.compiled import code_files, default_folder
from sdm_deflect.base.errors import MeshFileError, write_errors
from sdm_deflect.base.files import replacing
from sdm_deflect.meshing.mesh.labelled import VOLUME, Skin, skin, tetrahedral, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .errors import about

# Raised whenever the same parameters give another mesh than before: kept meshes then no longer match.
RECIPE = 3

_MAKERS = ("cadquery-ocp", "gmsh", "pytetwild")
_ARRAYS = ("points", "tets", "triangles", "patch", "face")
# Bytes of a SHA-256.
_CHECKSUM = 32


def cache_key(parameters: Mapping[str, object]) -> str:
    """Return the hexadecimal digest of parameters, recipe and the mesh generators' versions.

    The parameters are everything the mesh depends on: numbers, texts, frozen dataclasses, lists and mappings of them,
    whose order does not matter. ValueError for a number that is not finite, TypeError for a value that has no
    canonical text.
    """
    content = {"recipe": RECIPE, "makers": {name: version(name) for name in _MAKERS}, "parameters": dict(parameters)}
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def code_bytes() -> int:
    """Size in bytes of the compiled code in the cache folder."""
    return sum(path.stat().st_size for path in code_files())


def clear_code() -> int:
    """Remove the compiled code in the cache folder, as `MeshCache.clear` does meshes."""
    freed = code_bytes()
    with write_errors(default_folder()):
        for path in code_files():
            path.unlink(missing_ok=True)
    return freed


@dataclass(frozen=True, slots=True)
class ArrayCache:
    """A folder of arrays.

    A file is what `numpy.savez` writes, and after it the SHA-256 of the key and of all bytes before.
    """

    folder: Path

    def read(self, key: str) -> dict[str, Any] | None:
        """The arrays stored under a key; None if there are none.

        Raises MeshFileError if the file is not what was stored under this key, or cannot be read.
        """
        path = self._path(key)
        with about(path):
            if not path.exists():
                return None
            data = memoryview(path.read_bytes())
            content, checksum = data[:-_CHECKSUM], data[-_CHECKSUM:]
            if checksum != _checksum(key, content):
                raise MeshFileError("is damaged, or of an earlier version")
            with np.load(io.BytesIO(content), allow_pickle=False) as stored:
                return dict(stored)

    def write(self, key: str, arrays: Mapping[str, Any]) -> None:
        """Store arrays, completely or not at all; MeshFileError where the folder cannot be written."""
        content = io.BytesIO()
        np.savez(content, **arrays)
        content.write(_checksum(key, content.getbuffer()))
        with write_errors(self._path(key)), replacing(self._path(key)) as beside:
            beside.write_bytes(content.getbuffer())

    def entries(self) -> dict[str, int]:
        """Size in bytes of each entry by its key."""
        return {path.stem: path.stat().st_size for path in sorted(self.folder.glob("*.npz"))}

    def clear(self) -> int:
        """Remove all entries; returns how many bytes that freed. MeshFileError where that cannot be done."""
        freed = sum(self.entries().values())
        with write_errors(self.folder):
            for path in self.folder.glob("*.npz"):
                path.unlink(missing_ok=True)
        return freed

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


class MeshCache(ArrayCache):
    """A cache of meshes, each with a note of plain JSON values on how it was made."""

    def load(self, key: str) -> tuple[Mesh, dict[str, object]] | None:
        """The mesh and note stored under a key, as `read` does."""
        stored = self.read(key)
        if stored is None:
            return None
        arrays = {name: stored[name] for name in _ARRAYS}
        text = json.loads(str(stored["text"]))
        points = arrays["points"].astype(np.float64, copy=False)
        tets, triangles, patch, face = (arrays[name].astype(np.intp) for name in _ARRAYS[1:])
        return tetrahedral(points, tets, Skin(triangles, patch - 1, face), text["names"][1:]), dict(text["note"])

    def store(self, key: str, mesh: Mesh, note: Mapping[str, object]) -> None:
        """Store a mesh and its note, completely or not at all; MeshFileError where the folder cannot be written."""
        text = json.dumps({"names": (VOLUME, *mesh.names), "note": dict(note)}, sort_keys=True)
        triangles, patch, face = skin(mesh)
        arrays = zip(_ARRAYS[1:], (tets_of(mesh), triangles, patch + 1, face), strict=True)
        indices = {name: values.astype(np.int32) for name, values in arrays}
        self.write(key, {"points": mesh.points, "text": np.array(text), **indices})


def _checksum(key: str, content: memoryview) -> bytes:
    hashed = hashlib.sha256(key.encode())
    hashed.update(content)
    return hashed.digest()


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{value!r} has no canonical text to make a cache key from")

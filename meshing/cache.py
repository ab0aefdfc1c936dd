"""Meshes kept by the content of the parameters they were made from."""

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import platformdirs

from sdm_deflect.meshing.files import replacing
from sdm_deflect.meshing.mesh import TetMesh

# Raised whenever the same parameters give another mesh than before: kept meshes then no longer match.
RECIPE = 1
FOLDER_VARIABLE = "SDM_DEFLECT_CACHE"

_MAKERS = ("cadquery-ocp", "gmsh", "pytetwild")
_ARRAYS = ("points", "tets", "triangles", "patch", "face")


def cache_key(parameters: Mapping[str, object]) -> str:
    """Digest (hexadecimal) of parameters, recipe and mesh generators' versions.

    The parameters are everything the mesh depends on: numbers, texts, frozen dataclasses, lists and mappings of them,
    whose order does not matter. ValueError for a number that is not finite, TypeError for a value that has no
    canonical text.
    """
    content = {"recipe": RECIPE, "makers": {name: version(name) for name in _MAKERS}, "parameters": dict(parameters)}
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def default_folder() -> Path:
    """The folder named by the environment variable SDM_DEFLECT_CACHE, or the user's cache folder."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else Path(platformdirs.user_cache_dir("sdm-deflect", appauthor=False))


@dataclass(frozen=True, slots=True)
class MeshCache:
    """A folder of meshes, each with a note of plain JSON values on how it was made."""

    folder: Path

    def load(self, key: str) -> tuple[TetMesh, dict[str, object]] | None:
        """The mesh and note stored under a key; None if there is none or the file is damaged."""
        try:
            # Every member's checksum is verified by the zip reader, shapes and indices by TetMesh.
            with self._path(key).open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in _ARRAYS}
                text = json.loads(str(stored["text"]))
            mesh = TetMesh(
                points=arrays["points"].astype(np.float64, copy=False),
                names=tuple(text["names"]),
                **{name: arrays[name].astype(np.intp) for name in _ARRAYS[1:]},
            )
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None
        return mesh, dict(text["note"])

    def store(self, key: str, mesh: TetMesh, note: Mapping[str, object]) -> None:
        """Keep a mesh and its note, whole or not at all; OSError where the folder cannot be written."""
        text = json.dumps({"names": mesh.names, "note": dict(note)}, sort_keys=True)
        indices = {name: getattr(mesh, name).astype(np.int32) for name in _ARRAYS[1:]}
        with replacing(self._path(key)) as beside:
            np.savez(beside, points=mesh.points, text=np.array(text), **indices)

    def entries(self) -> dict[str, int]:
        """Size in bytes of each kept mesh by its key."""
        return {path.stem: path.stat().st_size for path in sorted(self.folder.glob("*.npz"))}

    def clear(self) -> int:
        """Remove all kept meshes; returns how many bytes that freed."""
        freed = sum(self.entries().values())
        for path in self.folder.glob("*.npz"):
            path.unlink()
        return freed

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{value!r} has no canonical text to make a cache key from")

"""Real meshes that tests use in place of the mesher: the small aircraft and its Chimera block.

python -m tests.kept_meshes FOLDER

writes them again, from a cache folder that holds them: after a change of the geometry or of the mesher's settings.
"""

import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from sdm_deflect.cases.aircraft.pipeline import mesh_parameters
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.meshing.files.cache import RECIPE, MeshCache, cache_key
from sdm_deflect.meshing.mesh import TetMesh

FOLDER = Path(__file__).parent / "kept"
CASES = ("aileron", "aileron-chimera")
ARRAYS = {"points": "f8", "tets": "i4", "triangles": "i4", "patch": "i1", "face": "i2"}


def digest(name: str) -> str:
    """Return what stands for the parameters of a case's mesh, whatever the versions of the mesh generators."""
    parts = {"recipe": RECIPE, **mesh_parameters(case_named(name))}
    return hashlib.sha256(json.dumps(parts, default=asdict, sort_keys=True).encode()).hexdigest()


def keep(cache: Path) -> None:
    """Write the kept meshes from those of a cache folder."""
    for name in CASES:
        mesh, note = MeshCache(cache).load(cache_key(mesh_parameters(case_named(name))))
        text = json.dumps({"names": mesh.names, "note": note, "digest": digest(name)})
        arrays = {key: getattr(mesh, key).astype(kind) for key, kind in ARRAYS.items()}
        np.savez_compressed(FOLDER / f"{name}.npz", text=np.array(text), **arrays)


def put(cache: Path) -> None:
    """Store the kept meshes in a cache folder; one whose parameters have changed is left to the mesher."""
    for name in CASES:
        with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as kept:
            text = json.loads(str(kept["text"]))
            if text["digest"] == digest(name):
                arrays = {key: kept[key].astype("f8" if key == "points" else np.intp) for key in ARRAYS}
                mesh = TetMesh(names=tuple(text["names"]), **arrays)
                MeshCache(cache).store(cache_key(mesh_parameters(case_named(name))), mesh, text["note"])


if __name__ == "__main__":
    keep(Path(sys.argv[1]))

"""Real meshes that tests use in place of the mesher: the small aircraft, its Chimera block and what surrounds that.

python -m tests.kept_meshes FOLDER

writes them again, from a cache folder that holds them: after a change of the geometry or of the mesher's settings.
"""

import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from sdm_deflect.cases.aircraft.pipeline import background_parameters, mesh_parameters
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.meshing.cache import RECIPE, MeshCache, cache_key
from sdm_deflect.meshing.mesh import VOLUME, Skin, skin, tetrahedral, tets_of

FOLDER = Path(__file__).parent / "kept"
NAMES = ("aileron", "aileron-free", "aileron-chimera", "background")
ARRAYS = {"points": "f8", "tets": "i4", "triangles": "i4", "patch": "i1", "face": "i2"}


def parameters(name: str) -> dict[str, object]:
    """Return everything that a kept mesh depends on, but for the versions of the mesh generators."""
    return (
        background_parameters(case_named("aileron-chimera"))
        if name == "background"
        else mesh_parameters(case_named(name))
    )


def digest(name: str) -> str:
    """Return what stands for the parameters of a kept mesh."""
    parts = {"recipe": RECIPE, **parameters(name)}
    return hashlib.sha256(json.dumps(parts, default=asdict, sort_keys=True).encode()).hexdigest()


def keep(cache: Path) -> None:
    """Write the kept meshes from those of a cache folder."""
    for name in NAMES:
        mesh, note = MeshCache(cache).load(cache_key(parameters(name)))
        text = json.dumps({"names": (VOLUME, *mesh.names), "note": note, "digest": digest(name)})
        triangles, patch, face = skin(mesh)
        values = zip(ARRAYS.items(), (mesh.points, tets_of(mesh), triangles, patch + 1, face), strict=True)
        arrays = {key: own.astype(kind) for (key, kind), own in values}
        np.savez_compressed(FOLDER / f"{name}.npz", text=np.array(text), **arrays)


def put(cache: Path) -> None:
    """Store the kept meshes in a cache folder; one whose parameters have changed is left to the mesher."""
    for name in NAMES:
        with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as kept:
            text = json.loads(str(kept["text"]))
            if text["digest"] == digest(name):
                tets, triangles, patch, face = (kept[key].astype(np.intp) for key in list(ARRAYS)[1:])
                skin_of_file = Skin(triangles, patch - 1, face)
                mesh = tetrahedral(kept["points"].astype("f8"), tets, skin_of_file, text["names"][1:])
                MeshCache(cache).store(cache_key(parameters(name)), mesh, text["note"])


if __name__ == "__main__":
    keep(Path(sys.argv[1]))

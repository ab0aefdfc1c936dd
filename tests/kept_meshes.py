"""Real meshes that tests use in place of the mesher: the small aircraft, its Chimera block and what surrounds that.

python -m tests.kept_meshes FOLDER

writes them again, from a cache folder that holds them: after a change of the geometry or of the mesher's settings. The
aircraft of case `aileron` is the fighter of `sdm example --fighter`; beside it are kept the CAD faces of its triangles.
"""

import hashlib
import json
import lzma
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sdm_deflect.cases.aircraft.case import mesh_parameters
from sdm_deflect.cases.aircraft.pipeline import background_parameters
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.meshing.cache import RECIPE, MeshCache, cache_key
from sdm_deflect.meshing.formats.registry import FORMATS
from sdm_deflect.meshing.mesh.labelled import CAD_FACE, ROW, VOLUME, Skin, skin, tetrahedral, tets_of, triangles_of
from sdm_deflect.meshing.mesh.mesh import Mesh

FOLDER = Path(__file__).parent / "kept"
NAMES = ("aileron", "aileron-free", "aileron-chimera", "background")
# The kept mesh that users get as well, and where.
FIGHTER, EXAMPLE = "aileron", Path(__file__).parents[1] / "cases" / "fighter.su2.xz"
LABELS = {CAD_FACE: "i2", ROW: "i4"}
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
        text = np.array(json.dumps({"names": (VOLUME, *mesh.names), "note": note, "digest": digest(name)}))
        if name == FIGHTER:
            with TemporaryDirectory() as folder:
                FORMATS["su2"].write(mesh, Path(folder, "fighter.su2"))
                packed = lzma.compress(Path(folder, "fighter.su2").read_bytes(), preset=9 | lzma.PRESET_EXTREME)
            EXAMPLE.write_bytes(packed)
            arrays = {label: np.concatenate([one.labels[label] for one in mesh.patches]) for label in LABELS}
            arrays = {label: own.astype(LABELS[label]) for label, own in arrays.items()}
        else:
            triangles, patch, face = skin(mesh)
            values = zip(ARRAYS.items(), (mesh.points, tets_of(mesh), triangles, patch + 1, face), strict=True)
            arrays = {key: own.astype(kind) for (key, kind), own in values}
        np.savez_compressed(FOLDER / f"{name}.npz", text=text, **arrays)


def fighter(labels: dict[str, np.ndarray], names: list[str]) -> Mesh:
    """Return the mesh of the example with the CAD faces of its triangles, in the order in which they were made."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "fighter.su2")
        path.write_bytes(lzma.decompress(EXAMPLE.read_bytes()))
        mesh = FORMATS["su2"].read(path)
    triangles = [triangles_of(mesh, name) for name in names]
    patch = np.repeat(np.arange(len(names)), list(map(len, triangles)))
    order = np.argsort(labels[ROW])
    own = Skin(np.concatenate(triangles)[order], patch[order], labels[CAD_FACE][order].astype(np.intp))
    return tetrahedral(mesh.points, tets_of(mesh), own, names)


def put(cache: Path) -> None:
    """Store the kept meshes in a cache folder; one whose parameters have changed is left to the mesher."""
    for name in NAMES:
        with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as kept:
            text = json.loads(str(kept["text"]))
            if text["digest"] == digest(name):
                if name == FIGHTER:
                    mesh = fighter({label: kept[label] for label in LABELS}, text["names"][1:])
                else:
                    tets, triangles, patch, face = (kept[key].astype(np.intp) for key in list(ARRAYS)[1:])
                    own = Skin(triangles, patch - 1, face)
                    mesh = tetrahedral(kept["points"].astype("f8"), tets, own, text["names"][1:])
                MeshCache(cache).store(cache_key(parameters(name)), mesh, text["note"])


if __name__ == "__main__":
    keep(Path(sys.argv[1]))

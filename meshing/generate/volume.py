"""The mesh generators: gmsh for a conforming surface mesh of the CAD faces, pytetwild for the volume around it."""

import itertools
import os
from dataclasses import dataclass

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import write_errors
from sdm_deflect.base.files import hidden_folder
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.mesh.quality import signed_volumes

from .parameters import MeshParameters
from .sizing import SizeField, background, seeds

# Longest time of gmsh in seconds, in which it meshes the finest scale several times.
SECONDS = 600.0
# Nodes of a CAD face's mesh further off that face (metres) show that faces were mixed up.
ASTRAY = 1e-5
# fTetWild gains nothing from more.
MOST_THREADS = 8
# The background mesh must cover the box that the mesher puts around its input.
PADDING = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class InputSurface:
    """Triangles of the CAD model's exterior faces, and of the internal sheets that the mesher needs too.

    Attributes
    ----------
    points : (N, 3) in metres
    outer : (T, 3) triangles of the exterior faces, oriented out of the solid
    face : (T,) CAD face of each of them
    inner : (S, 3) triangles of the sheets
    """

    points: FloatArray
    outer: IntArray
    face: IntArray
    inner: IntArray

    @property
    def triangles(self) -> IntArray:
        """All triangles (T + S, 3)."""
        return np.concatenate([self.outer, self.inner])


def mesh_surface(model: CadModel, background: tuple[FloatArray, IntArray, FloatArray]) -> InputSurface:
    """Mesh all faces with sizes from a background mesh: points (N, 3), tetrahedra (M, 4), target edge lengths (N,).

    MeshingError if gmsh fails on a face or the result does not match the CAD.
    """
    points, tets, lengths = background
    with hidden_folder() as folder:
        brep = folder / "faces.brep"
        with write_errors(brep):
            model.write_faces(brep)
        question = {"brep": np.array(str(brep)), "points": points, "tets": tets, "lengths": lengths}
        answer = child.call("sdm_deflect.meshing.generate.gmsh_worker", question, SECONDS)
    nodes = answer["points"].astype(np.float64)
    triangles, face = answer["triangles"].astype(np.intp), answer["face"].astype(np.intp)
    expected = len(model.faces) + len(model.sheets)
    if len(answer["areas"]) != expected:
        raise MeshingError(f"gmsh found {len(answer['areas'])} faces in a CAD model of {expected}")
    exterior = face < len(model.faces)
    outer = _outward(model, nodes, triangles[exterior], face[exterior])
    return InputSurface(nodes, outer, face[exterior], triangles[~exterior])


def _outward(model: CadModel, points: FloatArray, triangles: IntArray, face: IntArray) -> IntArray:
    """Return triangles (T, 3) oriented out of the solid; those of a face (T,) have one orientation already."""
    turned = triangles.copy()
    for index, cad in enumerate(model.faces):
        rows = np.flatnonzero(face == index)
        corners = points[triangles[rows]]
        astray = np.abs(cad.project(corners[:, 0]) - corners[:, 0]).max()
        if astray > ASTRAY:
            raise MeshingError(f"gmsh's face {index} lies {astray:.1e} m off the CAD face on {cad.patch}")
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if np.einsum("ij,ij->", normals, cad.normal_at(corners.mean(axis=1))) < 0.0:
            turned[rows] = triangles[rows][:, ::-1]
    return turned


@dataclass(frozen=True, slots=True, eq=False)
class Filling:
    """Tetrahedra (M, 4) on points (N, 3) that fill a box; the mesher's peak memory (bytes) and processor time (s).

    `unseeded` is the reason why the seed had no effect; "" if it had one.
    """

    points: FloatArray
    tets: IntArray
    peak_bytes: int
    processor_seconds: float
    unseeded: str


def fill(
    surface: InputSurface, field: SizeField, box: tuple[FloatArray, FloatArray], parameters: MeshParameters
) -> Filling:
    """Fill the box from `low` (3,) to `high` (3,) with tetrahedra that respect the surface.

    Equal input and an equal seed give equal bits, unless the result says why not. MeshingError if the mesher crashes
    or returns an inverted cell; LateError if it takes too long.
    """
    low, high = box
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    spots = [surface.points, surface.points[surface.triangles].mean(axis=1)]  # about half an edge apart
    cloud = seeds(field, low, high, np.concatenate(spots))
    points, tets, lengths = background(field, low - PADDING * (high - low), high + PADDING * (high - low))
    question = {
        "points": np.concatenate([surface.points, corners, cloud]),
        "triangles": surface.triangles,
        "background_points": points,
        "background_tets": tets,
        "background_lengths": lengths,
        "envelope": np.array(parameters.envelope),
        "energy": np.array(3.0 / parameters.aim),
        "threads": np.array(min(MOST_THREADS, os.cpu_count() or 1)),
        "seed": np.array(parameters.seed),
    }
    answer = child.call("sdm_deflect.meshing.generate.volume_worker", question, parameters.max_seconds)
    nodes, cells = answer["points"].astype(np.float64), answer["tets"].astype(np.intp)
    if signed_volumes(nodes, cells).min(initial=0.0) < 0.0:
        raise MeshingError("the volume mesher returned an inverted cell")
    used = int(answer["peak_bytes"]), float(answer["processor_seconds"])
    return Filling(nodes, cells, *used, str(answer["unseeded"]))

"""The only call of the volume mesher (pytetwild)."""

import itertools
import os
from dataclasses import dataclass

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.mesh.quality import signed_volumes
from sdm_deflect.meshing import child
from sdm_deflect.meshing.errors import MeshingError
from sdm_deflect.meshing.generate.parameters import MeshParameters
from sdm_deflect.meshing.generate.sizing import SizeField, background, seeds
from sdm_deflect.meshing.generate.surface import InputSurface

# fTetWild gains nothing from more.
MOST_THREADS = 8
# The background mesh must cover the box that the mesher puts around its input.
PADDING = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Filling:
    """Tetrahedra (M, 4) on points (N, 3) that fill a box; the mesher's peak memory (bytes) and processor time (s)."""

    points: FloatArray
    tets: IntArray
    peak_bytes: int
    processor_seconds: float


def fill(
    surface: InputSurface, field: SizeField, box: tuple[FloatArray, FloatArray], parameters: MeshParameters
) -> Filling:
    """Fill the box from `low` (3,) to `high` (3,) with tetrahedra that respect the surface.

    The result differs from run to run: the mesher seeds itself from the system. MeshingError where it crashes, takes
    too long or returns an inverted cell.
    """
    low, high = box
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    cloud = seeds(field, low, high, surface.spots())
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
    }
    answer = child.call("sdm_deflect.meshing.generate.volume_worker", question, parameters.max_seconds)
    nodes, cells = answer["points"].astype(np.float64), answer["tets"].astype(np.intp)
    if signed_volumes(nodes, cells).min(initial=0.0) < 0.0:
        raise MeshingError("the volume mesher returned an inverted cell")
    return Filling(nodes, cells, int(answer["peak_bytes"]), float(answer["processor_seconds"]))

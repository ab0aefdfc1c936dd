"""The child process that runs fTetWild: triangles, seed points and a size field in, tetrahedra out."""

import numpy as np
import pytetwild

from sdm_deflect.meshing.child import Arrays, serve

# Below the smallest target length, so that the surface is never coarsened before the sizes apply.
IDEAL_EDGE = 0.7


def tetrahedralise(question: Arrays) -> Arrays:
    """Fill space around and inside triangles with tetrahedra.

    The question holds ``points`` (N, 3), of which unreferenced ones are seeds and domain corners; ``triangles``
    (T, 3); ``background_points``, ``background_tets``, ``background_lengths``: target edge lengths; ``envelope`` in
    metres; ``energy``: AMIPS energy 3 / Q at which a cell is left alone; ``threads``. The answer is ``points`` and
    ``tets``, positively oriented.
    """
    points, lengths = question["points"], question["background_lengths"]
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    # With no ordinary passes only the bounded loop that applies the size field optimises; the ordinary
    # passes would use one size everywhere and refine without end.
    nodes, tets = pytetwild.tetrahedralize(
        points,
        question["triangles"].astype(np.int32),
        edge_length_abs=IDEAL_EDGE * float(lengths.min()),
        epsilon=float(question["envelope"]) / float(diagonal),
        stop_energy=float(question["energy"]),
        num_opt_iter=0,
        num_threads=int(question["threads"]),
        simplify=False,
        disable_filtering=True,
        vtk_ordering=True,
        bg_vertices=question["background_points"],
        bg_tets=question["background_tets"].astype(np.int32),
        bg_values=lengths,
        loglevel=6,
        quiet=True,
    )
    return {"points": nodes, "tets": tets}


if __name__ == "__main__":
    serve(tetrahedralise)

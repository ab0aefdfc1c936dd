"""Read a mesh file with PyVista or meshio, in a process of its own: on damaged files, VTK crashes or takes all memory.

Run as ``python -m sdm_deflect.cases.run.vtk_worker``, by `sdm_deflect.meshing.files.child.call`.
"""

import logging
import resource
import sys
import warnings
from pathlib import Path
from typing import Any

import meshio  # noqa: F401  # before the limit, as all that is loaded
import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import vtkLogger

from sdm_deflect.deform.mesh.mesh import VOLUMES
from sdm_deflect.meshing.files.child import Arrays, serve


def work(question: Arrays) -> Arrays:
    """Return `points` (N, 3) and, by shape, the nodes of cells of the file `path`, with `bytes` of memory for it."""
    _limit(int(question["bytes"]))
    logging.disable()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pv.VtkErrorCatcher() as said:
            found: Any = pv.read(Path(str(question["path"])))
    errors = [" ".join(one.alert.split()) for one in said.events if one.kind == "ERROR" or "rror" in one.alert]
    if errors:  # VTK goes on with what it has
        raise ValueError(errors[0])
    grid = (found.combine() if isinstance(found, pv.MultiBlock) else found).cast_to_unstructured_grid()
    nodes = grid.cells_dict
    kinds = {shape: pv.CellType[shape.upper()] for shape in VOLUMES}
    return {"points": np.asarray(grid.points), **{shape: nodes[kind] for shape, kind in kinds.items() if kind in nodes}}


def _limit(more: int) -> None:
    """Let this process take `more` bytes, beside what it has; only Linux knows how."""
    if sys.platform != "linux":
        return
    lines = Path("/proc/self/status").read_text().splitlines()
    now = 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmData:")))
    resource.setrlimit(resource.RLIMIT_DATA, (now + more, now + more))


if __name__ == "__main__":
    serve(work)

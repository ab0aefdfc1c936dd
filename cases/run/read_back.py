"""What was written is read back from the disk before it takes its place: its points must be those that were judged."""

from pathlib import Path

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.volume.excerpt import gathered
from sdm_deflect.meshing.formats.format import MeshFileError
from sdm_deflect.meshing.formats.registry import format_of, in_pieces

DIFFERS = "{}: what was written does not read back as what was judged, and is discarded: {}"


def check_written(mesh: Mesh, points: FloatArray, staged: Path, out: Path) -> None:
    """Read a file that was written for a mesh with its nodes at `points` (N, 3), and compare these, to the bit.

    Raises MeshFileError, which names the file `out` that is to be, if they are others or it cannot be read.
    """
    if text := difference(mesh, points, staged):
        raise MeshFileError(DIFFERS.format(out, text.replace(str(staged), out.name)))


def difference(mesh: Mesh, points: FloatArray, path: Path) -> str:
    """Return how the points of a file differ from those of a mesh, of one in pieces from the excerpt's."""
    try:
        found = _stored(mesh, path)
    except (MeshFileError, InputError) as error:
        return str(error)
    if len(points) != len(found):
        return f"it has {len(found)} points, not {len(points)}"
    axes = 2 if mesh.plane else 3
    same = (points[:, :axes] == found[:, :axes]).all(axis=1)
    if same.all():
        return ""
    row = int(np.argmin(same))
    x, y = (" ".join(f"{value:.17g}" for value in places[row]) for places in (found, points))
    return f"{np.count_nonzero(~same)} points are elsewhere, the first at {x}, not {y}"


def _stored(mesh: Mesh, path: Path) -> FloatArray:
    form, source = format_of(path), Path(mesh.source)
    if not mesh.whole:
        return form.read_copy(path, source).points
    found = form.points_of_copy(path, source)
    if found is not None:
        return found[mesh.whole.nodes] if len(found) == mesh.point_count else found
    with in_pieces(path) as back:
        if back is None or back.pieces.blocks != mesh.whole.pieces.blocks or back.pieces.points != mesh.point_count:
            raise MeshFileError("it has other points or cells")
        return gathered(back.pieces, mesh.whole.nodes)

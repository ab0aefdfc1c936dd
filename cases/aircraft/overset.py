"""A Chimera block over its background: the hole in the background, and donor cells for all nodes that need one."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.geometry.confinement import gap_faces
from sdm_deflect.geometry.datum import ends, ribs
from sdm_deflect.meshing.mesh.labelled import tets_of, touching
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case
from .job import BLOCK, block_stations

# A node within this distance (m) of a plane is in it: boundary nodes are on the CAD to that.
ON_FACE = 1e-7
# Cells handled at a time: temporaries of millions of cells in little memory.
ROWS = 1 << 16
# Half height of the hole, in longest chords: an aileron turned by up to 36 deg stays inside.
ROOM = 0.6
# Reach of the hole beyond trailing edge and tip, in longest chords.
BEYOND = 0.15
# Cells of the background between the hole and the block's face in a gap: the hole's fringe lies there.
CELLS_TO_BLOCK_FACE = 2.5


def orphans(block: Mesh, background: Mesh, low: FloatArray, high: FloatArray) -> Check:
    """Check that every node that needs a donor cell in the other mesh finds one.

    Nodes on the block's outer faces seek it in the background, nodes of the background next to the hole in the block.

    Parameters
    ----------
    low, high : (3,) corners of the hole, the box around the control surface that is cut out of the background.
        It must lie well inside the (deflected) block.
    """
    outer = block.on(BLOCK)
    off = np.flatnonzero(np.all((background.points > low) & (background.points < high), axis=1))
    fringe = np.setdiff1d(distinct(tets_of(background)[touching(background, off)]), off, assume_unique=True)
    donors = np.concatenate([has_donor(block.points[outer], background), has_donor(background.points[fringe], block)])
    where = (
        f"{len(outer)} nodes of the block's faces in the background, {len(fringe)} of the background around its "
        f"hole of {len(off)} nodes in the block"
    )
    return Check("orphans", float(np.count_nonzero(~donors)), 0.0, "nodes", where)


def hole(case: Case) -> tuple[FloatArray, FloatArray]:
    """Return the corners (3,) of the box cut out of the background; in a gap it ends with the aileron."""
    surface = case.deflections[0].surface
    wedges = ends(case.fighter, surface)[:, 2:5]  # hinge above, trailing edge, hinge below
    low, high = wedges.min(axis=(0, 1)), wedges.max(axis=(0, 1))
    chord = float(np.ptp(wedges[:, :, 0], axis=1).max())
    height = chord * max(ROOM, np.sin(np.radians(abs(case.angle))) + 0.1)
    low += np.array([0.0, -BEYOND * chord, -height])
    high += np.array([BEYOND * chord, BEYOND * chord, height])
    for station in ribs(case.fighter, surface):
        nearer = high if abs(station - high[1]) < abs(station - low[1]) else low
        nearer[1] = station
    return low, high


def finer_background(case: Case) -> tuple[FloatArray, FloatArray]:
    """Return points (S, 3) on the hole's ends in the gaps, and the background's edge lengths (S,) there, in metres."""
    surface, (low, high) = case.deflections[0].surface, hole(case)
    points, lengths = [], []
    stations = gap_faces(case.fighter, case.block, surface)
    for end, face in zip(ribs(case.fighter, surface), stations, strict=True):
        length = abs(face - end) / CELLS_TO_BLOCK_FACE
        x, z = (np.linspace(low[i], high[i], 2 + int((high[i] - low[i]) / length)) for i in (0, 2))
        grid = np.stack(np.meshgrid(x, [0.5 * (end + face)], z, indexing="ij"), axis=-1).reshape(-1, 3)
        points.append(grid)
        lengths.append(np.full(len(grid), length))
    return np.vstack(points), np.concatenate(lengths)


def overset_checks(case: Case, mesh: Mesh, deflected: Mesh, background: Mesh) -> Iterator[Check]:
    """Return the checks of a Chimera block: its faces in the gaps stay planar, and both blocks find their donors."""
    surface = case.deflections[0].surface
    nodes = mesh.on(BLOCK)
    off_plane = np.abs(mesh.points[nodes, 1, None] - block_stations(case, surface)).min(axis=1)
    face = nodes[off_plane <= ON_FACE]
    off = np.abs(deflected.points[face, 1] - mesh.points[face, 1])
    yield Check("chimera_face_in_plane", float(off.max()), 0.0, "m", worst(off, mesh.points[face]))
    yield orphans(deflected, background, *hole(case))


def has_donor(points: FloatArray, mesh: Mesh) -> BoolArray:
    """Return which of points (N, 3) lie in a cell of the mesh."""
    import pyvista as pv  # a second, for Chimera blocks only
    from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator

    tets = cells_near(points, mesh)
    if not len(tets):
        return np.zeros(len(points), dtype=bool)
    used, local_tets = np.unique(tets, return_inverse=True)
    locator = vtkStaticCellLocator()
    locator.SetDataSet(pv.UnstructuredGrid({pv.CellType.TETRA: local_tets.reshape(-1, 4)}, mesh.points[used]))
    locator.BuildLocator()
    cell, weights, local = vtkGenericCell(), [0.0] * 4, [0.0] * 3
    inside = [locator.FindCell(p, 0.0, cell, local, weights) >= 0 for p in points.tolist()]
    return np.array(inside, dtype=bool)


def cells_near(points: FloatArray, mesh: Mesh) -> IntArray:
    """Return the cells (C, 4) of the mesh whose bounding ball contains one of points (N, 3).

    All other cells are no donors. The locator sorts cells into boxes of one size; for a whole graded mesh a box next to
    a surface would hold thousands.
    """
    if not len(points):
        return np.empty((0, 4), dtype=np.intp)
    tree, low, high, near = cKDTree(points), points.min(axis=0), points.max(axis=0), []
    cells = tets_of(mesh)
    for start in range(0, len(cells), ROWS):
        tets = cells[start : start + ROWS]
        corners = mesh.points[tets]
        centre = corners.mean(axis=1)
        reach = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1, keepdims=True) * (1.0 + 1e-9)
        boxed = np.flatnonzero(np.all((centre + reach >= low) & (centre - reach <= high), axis=1))
        count = tree.query_ball_point(centre[boxed], reach[boxed, 0], return_length=True)
        near.append(tets[boxed[count > 0]])
    return np.vstack(near)

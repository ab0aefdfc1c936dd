"""A Chimera block over its background: the hole cut out of it, its cells there, and a donor for every node in need."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, vtkPoints
from vtkmodules.vtkCommonDataModel import (
    VTK_TETRA,
    vtkCellArray,
    vtkGenericCell,
    vtkStaticCellLocator,
    vtkUnstructuredGrid,
)

from sdm_deflect.cases.sdm.case import Case
from sdm_deflect.cases.sdm.job import BLOCK, block_stations
from sdm_deflect.deform.checks import Check, worst
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.geometry.confinement import gap_faces
from sdm_deflect.geometry.datum import ends, ribs
from sdm_deflect.meshing.mesh import TetMesh

ON_FACE = 1e-7
"""A node within this distance (m) of a plane is in it: boundary nodes are on the CAD to that."""
ROWS = 1 << 16
"""Cells handled at a time: temporaries of millions of cells in little memory."""
ROOM = 0.6
"""Half height of the hole by the longest chord: an aileron turned by up to 36 deg stays inside."""
BEYOND = 0.15
"""How far the hole reaches beyond trailing edge and tip, by the longest chord."""
CELLS_TO_BLOCK_FACE = 2.5
"""Cells of the background between the hole and the block's face in a gap: the hole's fringe lies there."""


@dataclass(frozen=True, slots=True)
class Overlap:
    """Nodes that need a donor and nodes that found none (orphans), for both directions.

    Attributes
    ----------
    outer, outer_orphans : nodes on the block's outer faces, donors sought in the background.
    fringe, fringe_orphans : background nodes next to the hole, donors sought in the block.
    hole : background nodes that are switched off around the control surface.
    """

    outer: int
    outer_orphans: int
    fringe: int
    fringe_orphans: int
    hole: int

    @property
    def orphans(self) -> int:
        """All nodes without a donor."""
        return self.outer_orphans + self.fringe_orphans


def overlap(block: TetMesh, background: TetMesh, low: FloatArray, high: FloatArray) -> Overlap:
    """Count orphans between a (deflected) block and the background.

    Parameters
    ----------
    low, high : (3,) corners of the hole, the box around the control surface that is cut out of the background.
        It must lie well inside the block.
    """
    outer = block.on(BLOCK)
    off = np.all((background.points > low) & (background.points < high), axis=1)
    fringe = fringe_nodes(background.tets, off)
    return Overlap(
        outer=len(outer),
        outer_orphans=int(np.count_nonzero(~has_donor(block.points[outer], background))),
        fringe=len(fringe),
        fringe_orphans=int(np.count_nonzero(~has_donor(background.points[fringe], block))),
        hole=int(np.count_nonzero(off)),
    )


def hole(case: Case) -> tuple[FloatArray, FloatArray]:
    """Corners (3,) of the box cut out of the background; in a gap it ends with the aileron."""
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
    """Points (S, 3) on the hole's ends in the gaps, and the background's edge lengths (S,) there, metres."""
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


def overset_checks(case: Case, mesh: TetMesh, deflected: TetMesh, background: TetMesh) -> Iterator[Check]:
    """Checks of a Chimera block: its faces in the gaps stay planar, and both blocks find their donors."""
    surface = case.deflections[0].surface
    nodes = mesh.on(BLOCK)
    off_plane = np.abs(mesh.points[nodes, 1, None] - block_stations(case, surface)).min(axis=1)
    face = nodes[off_plane <= ON_FACE]
    off = np.abs(deflected.points[face, 1] - mesh.points[face, 1])
    yield Check("chimera_face_in_plane", float(off.max()), 0.0, "m", worst(off, mesh.points[face]))
    found = overlap(deflected, background, *hole(case))
    where = (
        f"{found.outer} nodes of the block's faces in the background, {found.fringe} of the background around its "
        f"hole of {found.hole} nodes in the block"
    )
    yield Check("orphans", float(found.orphans), 0.0, "nodes", where)


def fringe_nodes(tets: IntArray, hole: BoolArray) -> IntArray:
    """Nodes outside the hole that share a cell with a node inside it."""
    cut = tets[hole[tets].any(axis=1)]
    nodes = np.unique(cut)
    return nodes[~hole[nodes]]


def has_donor(points: FloatArray, mesh: TetMesh) -> BoolArray:
    """True for each of points (N, 3) that lies in a cell of the mesh."""
    tets = cells_near(points, mesh)
    if not len(tets):
        return np.zeros(len(points), dtype=bool)
    used, local_tets = np.unique(tets, return_inverse=True)
    locator = vtkStaticCellLocator()
    locator.SetDataSet(_grid(mesh.points[used], local_tets.reshape(-1, 4)))
    locator.BuildLocator()
    cell, weights, local = vtkGenericCell(), [0.0] * 4, [0.0] * 3
    found = [locator.FindCell(p, 0.0, cell, local, weights) >= 0 for p in points.tolist()]
    return np.array(found, dtype=bool)


def cells_near(points: FloatArray, mesh: TetMesh) -> IntArray:
    """Cells (C, 4) of the mesh with any of points (N, 3) in the ball around their centroid that holds them.

    All others are no donors. The locator sorts cells into boxes of one size: among those of a whole graded mesh
    a box next to a surface holds thousands.
    """
    if not len(points):
        return np.empty((0, 4), dtype=np.intp)
    tree, low, high, near = cKDTree(points), points.min(axis=0), points.max(axis=0), []
    for start in range(0, len(mesh.tets), ROWS):
        tets = mesh.tets[start : start + ROWS]
        corners = mesh.points[tets]
        centre = corners.mean(axis=1)
        radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1) * (1.0 + 1e-9)
        reach = radius[:, None]
        boxed = np.flatnonzero(np.all((centre + reach >= low) & (centre - reach <= high), axis=1))
        count = tree.query_ball_point(centre[boxed], radius[boxed], return_length=True)
        near.append(tets[boxed[count > 0]])
    return np.vstack(near)


def _grid(nodes: FloatArray, tets: IntArray) -> vtkUnstructuredGrid:
    points, cells, grid = vtkPoints(), vtkCellArray(), vtkUnstructuredGrid()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(nodes), True))
    offsets = 4 * np.arange(len(tets) + 1)
    cells.SetData(numpy_to_vtk(offsets, True, VTK_ID_TYPE), numpy_to_vtk(tets.ravel(), True, VTK_ID_TYPE))
    grid.SetPoints(points)
    grid.SetCells(VTK_TETRA, cells)
    return grid

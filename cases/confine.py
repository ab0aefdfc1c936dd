"""The confinement of one control surface: its hexahedron, the nodes inside and the zero sites (section 3)."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree

from cases.case import Confinement, Strategy
from cases.motion import FloatArray, IndexArray, SurfaceMotion
from deform.hexahedron import Hexahedron
from deform.sites import DataSites, joined, pinned, split
from geometry import datum
from geometry.parameters import Fighter
from meshing.mesh import TetMesh

DIRECTIONS = ("x", "y", "z")
ON_FACE = 1e-9
"""A node within this distance (m) of a face of the hexahedron counts as on it."""


class ConfinementError(ValueError):
    """The hexahedron does not suit the mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The hexahedron around one control surface.

    Attributes
    ----------
    surface : name of the control surface.
    hexahedron : where the displacement may differ from zero.
    inside : (M,) indices of the mesh nodes inside.
    held : (B,) those of them on patches that do not move: they lie on a face of the hexahedron and stay.
    pinned : for x, y, z: (P, 3) zero sites on its faces, free of duplicates with the surface.
    spacing : distance between those sites, metres.
    filter_seconds : time taken to find `inside`.
    """

    surface: str
    hexahedron: Hexahedron
    inside: IndexArray
    held: IndexArray
    pinned: tuple[FloatArray, FloatArray, FloatArray]
    spacing: float
    filter_seconds: float

    def groups(self, points: FloatArray, displacements: FloatArray, strategy: Strategy) -> tuple[DataSites, ...]:
        """Return the data sites in groups that share their centres.

        Parameters
        ----------
        points, displacements : (K, 3) the surface nodes and how they move.
        strategy : "squv" gives three groups of one column, "mv" one group of three.
        """
        moving = DataSites(points, displacements, (0, 1, 2))
        if strategy == "squv":
            columns = zip(split(moving), self.pinned, strict=True)
            return tuple(joined(column, pinned(zero, column.components)) for column, zero in columns)
        if any(zero is not self.pinned[0] for zero in self.pinned):
            raise ConfinementError(
                "strategy mv needs the same sites in every direction, but the sliding face has sites for its "
                "normal direction only; use squv"
            )
        return (joined(moving, pinned(self.pinned[0], moving.components)),)


def confine(mesh: TetMesh, fighter: Fighter, motion: SurfaceMotion, settings: Confinement) -> Region:
    """Build the hexahedron of a control surface, find the nodes inside and place the zero sites.

    Raises
    ------
    ConfinementError
        If a moving node lies outside, or a node of another patch inside.
    """
    surface = motion.patches[0]
    margins = datum.Margins(aft=settings.aft, outboard=settings.outboard, normal=settings.normal)
    hexahedron = Hexahedron(datum.hexahedron_corners(fighter, surface, margins))
    start = perf_counter()
    inside = np.flatnonzero(hexahedron.contains(mesh.points))
    seconds = perf_counter() - start
    _check_surface(mesh, hexahedron, motion)
    boundary = mesh.on(*mesh.names[1:])
    held = np.setdiff1d(np.intersect1d(boundary, inside, assume_unique=True), motion.nodes, assume_unique=True)
    spacing = settings.spacing or settings.spacing_edges * median_edge(mesh, surface)
    sites = hexahedron.face_sites(spacing, skip=datum.open_faces(surface))
    sites = apart_from(sites, mesh.points[motion.nodes], 0.5 * spacing)
    return Region(surface, hexahedron, inside, held, (sites, sites, sites), spacing, seconds)


def median_edge(mesh: TetMesh, patch: str) -> float:
    """Median edge length (m) of the triangles of a patch."""
    corners = mesh.points[mesh.triangles_of(patch)]
    edges = corners - np.roll(corners, 1, axis=1)
    return float(np.median(np.linalg.norm(edges, axis=2)))


def apart_from(sites: FloatArray, points: FloatArray, distance: float) -> FloatArray:
    """Return the sites (P, 3) that keep at least this distance from all points (K, 3)."""
    nearest, _ = cKDTree(points).query(sites)
    return np.ascontiguousarray(sites[nearest >= distance])


def _check_surface(mesh: TetMesh, hexahedron: Hexahedron, motion: SurfaceMotion) -> None:
    """Nothing but the moving patches may lie inside, and nothing that moves outside."""
    moves = np.any(motion.displacements != 0.0, axis=1)
    before = mesh.points[motion.nodes[moves]]
    out = ~(hexahedron.contains(before) & hexahedron.contains(before + motion.displacements[moves]))
    if out.any():
        raise ConfinementError(
            f"{np.count_nonzero(out)} of {len(before)} moving nodes of {motion.patches[0]} leave its hexahedron; "
            "enlarge confinement.normal, confinement.aft or confinement.outboard"
        )
    for name in mesh.names[1:]:
        if name in motion.patches:
            continue
        others = np.setdiff1d(mesh.on(name), motion.nodes, assume_unique=True)
        crossing = np.count_nonzero(hexahedron.contains(mesh.points[others], tol=-ON_FACE))
        if crossing:
            raise ConfinementError(
                f"the hexahedron of {motion.patches[0]} contains {crossing} nodes of {name}, which must not move; "
                "reduce confinement.normal, confinement.aft or confinement.outboard"
            )

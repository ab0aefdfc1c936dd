"""What the page shows of a run, as plain arrays: no graphics library is needed to compose or to test it."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.scene3d import quality_rgb
from sdm_deflect.cases.sdm.job import BLOCK
from sdm_deflect.cases.view.live import Frame, Live
from sdm_deflect.cases.view.section import Plane, Section
from sdm_deflect.deform.mesh import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.quality import mean_ratio
from sdm_deflect.meshing.mesh import TetMesh

Colours = NDArray[np.uint8]

RED = np.array([213, 0, 0])
BODY, SURFACE, PANEL = (206, 208, 211), (86, 180, 233), (176, 205, 222)
TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
BOX_EDGES = np.array([[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit])
AROUND = 0.35
"""The section reaches beyond the hexahedra by this share of their size."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Dots, lines or polygons.

    Attributes
    ----------
    points : (P, 3), metres.
    cells : node indices, arrays of (n, 1), (n, 2) or (n, 3) and (n, 4).
    rgb : (cells, 3) their colours, in that order; None for the one of the actor.
    """

    points: FloatArray
    cells: tuple[IntArray, ...]
    rgb: Colours | None = None

    @property
    def empty(self) -> bool:
        """True if there is nothing to show."""
        return not any(len(one) for one in self.cells)


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Triangles of walls: nodes (n,) of the mesh, triangles (F, 3) among them, centroids (F, 3), colours (F, 3)."""

    nodes: IntArray
    triangles: IntArray
    centroids: FloatArray
    rgb: Colours

    @classmethod
    def of(cls, mesh: TetMesh, colours: dict[str, tuple[int, int, int]]) -> Self:
        """Extract the patches that have a colour."""
        parts = [mesh.triangles_of(name) for name in colours]
        triangles = np.vstack([np.empty((0, 3), dtype=np.intp), *parts])
        rgb = np.repeat(np.array([*colours.values()], dtype=np.uint8).reshape(-1, 3), [len(p) for p in parts], axis=0)
        nodes = np.unique(triangles)
        return cls(nodes, np.searchsorted(nodes, triangles), mesh.points[triangles].mean(axis=1), rgb)

    def piece(self, points: FloatArray, plane: Plane | None, side: float) -> Piece:
        """Return the triangles on points (N, 3); with a plane only those whose undeflected middle is not cut away."""
        keep = slice(None) if plane is None else side * plane.beyond(self.centroids) <= 0.0
        return Piece(points[self.nodes], (self.triangles[keep],), self.rgb[keep])


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """A run cut up once into what moves and what does not.

    Attributes
    ----------
    body, surface : walls that stay, and that move.
    around : (n, 4) cells near the hexahedra that never move, and `around_rgb` (n, 3) their colours.
    """

    live: Live
    body: Skin
    surface: Skin
    around: IntArray
    around_rgb: Colours

    @classmethod
    def of(cls, live: Live) -> Self:
        """Extract the surfaces and the cells near the hexahedra."""
        mesh, moving = live.mesh, {name for part in live.parts for name in part.plan.patches}
        still = [name for name in mesh.names[1:] if name not in moving | {"far_field", BLOCK}]
        colours = {name: SURFACE for part in live.parts for name in part.plan.patches[:1]}
        colours |= {name: PANEL for part in live.parts for name in part.plan.patches[1:]}
        around = live.outer[near(live, mesh.points[live.outer].mean(axis=1))]
        rgb = quality_rgb(mean_ratio(mesh.points, around)).astype(np.uint8)
        return cls(live, Skin.of(mesh, dict.fromkeys(still, BODY)), Skin.of(mesh, colours), around, rgb)

    def standing(self, plane: Plane | None, cut: Plane | None) -> dict[str, Piece]:
        """Return what does not depend on the angle: the body, and the section of the cells that never move."""
        points = self.live.mesh.points
        pieces = {"body": self.body.piece(points, cut, self.side(cut))}
        if plane is not None:
            section = Section.of(points, self.around, plane)
            pieces["around"] = polygons(section, self.around_rgb[section.cells])
        return pieces

    def moving(self, frame: Frame, plane: Plane | None, cut: Plane | None) -> dict[str, Piece]:
        """Return what follows the angle: surface, section by quality, inverted cells."""
        pieces = {"surface": self.surface.piece(frame.points, cut, self.side(cut))}
        if plane is not None:
            section = Section.of(frame.points, self.live.cells, plane)
            quality = frame.quality[section.cells]
            rgb = np.where((quality <= 0.0)[:, None], RED, quality_rgb(quality)).astype(np.uint8)
            pieces["section"] = polygons(section, rgb)
        inverted = self.live.cells[frame.inverted]
        middles = frame.points[inverted].mean(axis=1)  # a flat cell is hardly seen, a dot is
        pieces["marks"] = Piece(middles, (np.arange(len(middles))[:, None],))
        faces = inverted[:, TET_FACES].reshape(-1, 3)
        pieces["inverted"] = Piece(frame.points[faces.ravel()], (np.arange(faces.size).reshape(-1, 3),))
        return pieces

    def side(self, plane: Plane | None) -> float:
        """Return on which side of a plane the walls are cut away: outboard, aft or above."""
        return outboard(self.live) if plane is not None and plane.axis == 1 else 1.0


def polygons(section: Section, rgb: Colours) -> Piece:
    """Return a section with the colours (A + B, 3) of its polygons."""
    count = 3 * len(section.triangles)
    threes, fours = np.arange(count), np.arange(count, len(section.points))
    return Piece(section.points, (threes.reshape(-1, 3), fours.reshape(-1, 4)), rgb)


def boxes(live: Live) -> Piece:
    """Return the edges of all hexahedra."""
    corners = [part.plan.region.hexahedron.corners for part in live.parts]
    edges = [8 * i + BOX_EDGES for i in range(len(corners))]
    return Piece(np.vstack(corners), (np.vstack(edges),))


def outline(live: Live) -> Piece:
    """Return the edges of the CAD faces of the undeflected control surfaces."""
    mesh = live.mesh
    own = np.isin(mesh.patch, [mesh.names.index(part.surface) for part in live.parts])
    triangles, face = mesh.triangles[own], mesh.face[own]
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    distinct, where, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    label = np.repeat(face, 3)
    low, high = np.full(len(distinct), np.iinfo(np.intp).max), np.full(len(distinct), -1)
    np.minimum.at(low, where.ravel(), label)
    np.maximum.at(high, where.ravel(), label)
    nodes, lines = np.unique(distinct[(count == 1) | (low != high)], return_inverse=True)
    return Piece(mesh.points[nodes], (lines.reshape(-1, 2),))


def near(live: Live, points: FloatArray) -> BoolArray:
    """True for points (n, 3) close enough to a hexahedron to be of interest."""
    close = np.zeros(len(points), dtype=bool)
    for part in live.parts:
        corners = part.plan.region.hexahedron.corners
        low, high = corners.min(axis=0), corners.max(axis=0)
        reach = AROUND * (high - low).max()
        close |= ((points > low - reach) & (points < high + reach)).all(axis=1)
    return close


def bounds(live: Live) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest coordinates (3,) of all hexahedra."""
    corners = np.vstack([part.plan.region.hexahedron.corners for part in live.parts])
    return corners.min(axis=0), corners.max(axis=0)


def outboard(live: Live) -> float:
    """Return the sign of y outboard: -1 for a surface on the port side or across the middle, else 1."""
    low, high = bounds(live)
    return 1.0 if low[1] + high[1] > 1e-6 else -1.0

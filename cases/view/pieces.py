"""What the page shows of a run, as plain arrays: no graphics library is needed to compose or to test it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.report.data import drawn_quality
from sdm_deflect.cases.report.scene3d import BOX_EDGES, change_rgb, moved_rgb, quality_rgb
from sdm_deflect.cases.report.slices import cell_edges, section, with_node
from sdm_deflect.cases.view.run import DeflectedMesh, InteractiveRun
from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.sets import union
from sdm_deflect.deform.mesh.edges import are_lines, polygons_of, rim, sharp_edges
from sdm_deflect.deform.mesh.faces import FACE_SHAPES, FACES
from sdm_deflect.deform.mesh.mesh import PLANE, Cells, Faces, Mesh, Polygons, Volume
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.meshing.formats.shapes import chosen

Colours = NDArray[np.uint8]

RED = np.array([213, 0, 0])
BODY, SURFACE, PANEL = (206, 208, 211), (204, 102, 119), (224, 176, 184)
SHARP = 30.0
"""Degrees by which faces of the outline turn at an edge, at least."""
AROUND = 0.35
"""The section reaches beyond the hexahedra by this share of their size."""


@dataclass(frozen=True, slots=True)
class ClipPlane:
    """All points whose coordinate `axis` (0, 1, 2) is `position`."""

    axis: int
    position: float

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return how far points (..., 3) lie on the positive side."""
        return np.asarray(points[..., self.axis] - self.position)


@dataclass(frozen=True, slots=True, eq=False)
class ViewPiece:
    """Dots, lines or polygons.

    Attributes
    ----------
    points : (P, 3), in the mesh's unit of length.
    nodes, sizes : (K,) rows of the points, cell by cell, and how many each cell (F,) has: 1, 2, or 3 and more.
    rgb : (F, 3) colours of the cells; None for the one of the actor.
    """

    points: FloatArray
    nodes: IntArray
    sizes: IntArray
    rgb: Colours | None = None

    @classmethod
    def alike(cls, points: FloatArray, cells: IntArray) -> "ViewPiece":
        """Return cells (F, k) that all have k nodes."""
        return cls(points, cells.ravel(), np.full(len(cells), cells.shape[1]))

    @classmethod
    def dots(cls, points: FloatArray) -> "ViewPiece":
        """Return points (P, 3) as dots."""
        return cls.alike(points, np.arange(len(points))[:, None])

    @property
    def empty(self) -> bool:
        """True if there is nothing to show."""
        return not len(self.sizes)


@dataclass(frozen=True, slots=True, eq=False)
class OuterFaces:
    """Faces of walls.

    Attributes
    ----------
    nodes : (n,) nodes of the mesh.
    faces : (F,) faces among them.
    middles, rgb : (F, 3) of each face, undeflected.
    """

    nodes: IntArray
    faces: Polygons
    middles: FloatArray
    rgb: Colours

    @classmethod
    def of(cls, mesh: Mesh, colours: dict[str, tuple[int, int, int]]) -> "OuterFaces":
        """Extract the patches that have a colour."""
        every = polygons_of(mesh.faces_of(tuple(colours)))
        rgb = np.array([*colours.values()], dtype=np.uint8).reshape(-1, 3)
        nodes, place = np.unique(every.nodes, return_inverse=True)
        middles = _sums(mesh.points[every.nodes], every) / np.diff(every.offsets)[:, None]
        faces = Polygons(place.astype(np.intp), every.offsets)
        return cls(nodes, faces, middles, np.repeat(rgb, [len(mesh.patch(name)) for name in colours], axis=0))

    def piece(self, points: FloatArray, plane: ClipPlane | None, side: float, rgb: IntArray | None = None) -> ViewPiece:
        """Return the faces on points (N, 3); with a plane only those whose undeflected middle is not cut away.

        Their colours are rgb (F, 3), or their own.
        """
        sizes = np.diff(self.faces.offsets)
        keep = np.ones(len(sizes), dtype=bool) if plane is None else side * plane.beyond(self.middles) <= 0.0
        colours = self.rgb if rgb is None else rgb.astype(np.uint8)
        return ViewPiece(points[self.nodes], self.faces.nodes[np.repeat(keep, sizes)], sizes[keep], colours[keep])

    def lengths(self, moved: FloatArray) -> FloatArray:
        """Return the mean of displacements (N, 3) over the nodes of each face (F,)."""
        length = np.linalg.norm(moved, axis=1)[self.nodes[self.faces.nodes]]
        return np.asarray(np.add.reduceat(length, self.faces.offsets[:-1]) / np.diff(self.faces.offsets))


@dataclass(frozen=True, slots=True, eq=False)
class Solids:
    """Cells of any type, by their edges.

    Attributes
    ----------
    blocks : the mesh's blocks of cells, each with those of its rows that are meant.
    cell, edges : (E,) and (E, 2), every edge of every cell; cells are counted from 0 through all blocks.
    """

    blocks: tuple[tuple[Volume, IntArray], ...] = field(repr=False)
    cell: IntArray = field(repr=False)
    edges: IntArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, rows: Sequence[IntArray]) -> "Solids":
        """Take some rows of each block of a mesh."""
        blocks = tuple(zip(mesh.cells, rows, strict=True))
        starts = np.cumsum([0, *(len(own) for own in rows)])
        parts = [cell_edges(block, own) for block, own in blocks]
        cell = [start + own for start, (own, _) in zip(starts, parts, strict=False)]
        none = np.empty(0, dtype=np.intp)
        edges = np.vstack([np.empty((0, 2), dtype=np.intp), *(own for _, own in parts)])
        return cls(blocks, np.concatenate([none, *cell]), edges)

    def cut(self, points: FloatArray, plane: ClipPlane, rgb: IntArray) -> ViewPiece:
        """Return the section by a plane, with the nodes at points (N, 3), in the colours of the cells (M, 3).

        The cells of a plane mesh are seen whole from in front.
        """
        if plane.axis == 2 and self.flat:
            cells = polygons_of([chosen(block, own) for block, own in self.blocks if isinstance(block, Cells)])
            return ViewPiece(points, cells.nodes, np.diff(cells.offsets), rgb.astype(np.uint8))
        places, cell = section(points, self.cell, self.edges, plane.axis, plane.position)
        own, sizes = np.unique(cell, return_counts=True)
        return ViewPiece(places, np.arange(len(places)), sizes, rgb[own].astype(np.uint8))

    @property
    def flat(self) -> bool:
        """True for the cells of a plane mesh."""
        return any(isinstance(block, Cells) and block.shape in PLANE for block, _ in self.blocks)

    def middles(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return the middles (R, 3) of the edges of some cells, with the nodes at points (N, 3)."""
        some = np.isin(self.cell, rows)
        place = np.searchsorted(rows, self.cell[some])
        middles = points[self.edges[some]].mean(axis=1)
        sums = [np.bincount(place, middles[:, i], minlength=len(rows)) for i in range(3)]
        return np.column_stack(sums) / np.maximum(np.bincount(place, minlength=len(rows)), 1)[:, None]

    def faces(self, rows: IntArray) -> Polygons:
        """Return all faces of some cells (R,), in ascending order."""
        parts: list[Faces] = []
        start = 0
        for block, own in self.blocks:
            within = rows[(rows >= start) & (rows < start + len(own))] - start
            parts += _faces(block, own[within]) if len(within) else []
            start += len(own)
        return polygons_of(parts)


@dataclass(frozen=True, slots=True, eq=False)
class ViewPieces:
    """A run cut up once into what moves and what does not.

    Attributes
    ----------
    body, surface : walls that stay, and that move.
    loose : nodes of the moving patches that belong to no face.
    cells, around : the cells that touch a hexahedron, and those near by that never move, with their colours.
    before : (L,) quality of the cells that touch a hexahedron, undeflected.
    """

    run: InteractiveRun
    body: OuterFaces
    surface: OuterFaces
    loose: IntArray
    cells: Solids
    around: Solids
    around_rgb: IntArray
    before: FloatArray

    @classmethod
    def of(cls, run: InteractiveRun) -> "ViewPieces":
        """Extract the surfaces and the cells near the hexahedra."""
        mesh, moving = run.mesh, {name for one in run.surfaces for name in (*one.patches, *one.following)}
        still = [name for name in mesh.names if name not in moving and name not in run.display.hidden]
        colours = {name: SURFACE for one in run.surfaces for name in one.patches}
        colours |= {name: PANEL for one in run.surfaces for name in one.following}
        rows = _around(run)
        return cls(
            run,
            OuterFaces.of(mesh, dict.fromkeys(still, BODY)),
            OuterFaces.of(mesh, colours),
            union(*(mesh.patch(name).loose for name in moving)),
            Solids.of(mesh, run.touched.rows),
            Solids.of(mesh, rows),
            quality_rgb(_undeflected_quality(run, rows)),
            run.at(0.0).quality,
        )

    def standing(self, plane: ClipPlane | None, cut: ClipPlane | None, colour: str = "quality") -> dict[str, ViewPiece]:
        """Return what does not depend on the angle: the body, and the section of the cells that never move."""
        points = self.run.mesh.points
        pieces = {"body": self.body.piece(points, cut, self.side(cut))}
        if plane is not None:
            still = {"change": change_rgb, "displacement": moved_rgb}
            none = np.zeros(len(self.around_rgb))
            rgb = still[colour](none) if colour in still else self.around_rgb
            pieces["around"] = self.around.cut(points, plane, rgb)
        return pieces

    def moving(
        self, frame: DeflectedMesh, plane: ClipPlane | None, cut: ClipPlane | None, colour: str = "quality"
    ) -> dict[str, ViewPiece]:
        """Return what follows the angle: surface, section in the colours that are wanted, inverted cells."""
        pieces = {
            "surface": self.surface.piece(frame.points, cut, self.side(cut), self._surface_rgb(frame, colour)),
            "loose": ViewPiece.dots(frame.points[self.loose]),
            "marks": ViewPiece.dots(self.cells.middles(frame.points, frame.inverted)),  # a flat cell is hardly seen
        }
        if plane is not None:
            rgb = self._rgb(frame, colour)
            rgb[frame.inverted] = RED
            pieces["section"] = self.cells.cut(frame.points, plane, rgb)
        faces = self.cells.faces(frame.inverted)
        pieces["inverted"] = ViewPiece(frame.points[faces.nodes], np.arange(len(faces.nodes)), np.diff(faces.offsets))
        return pieces

    def farthest(self, frame: DeflectedMesh) -> float:
        """Return the largest displacement of a node."""
        return float(np.linalg.norm(frame.points - self.run.mesh.points, axis=1).max())

    def _rgb(self, frame: DeflectedMesh, colour: str) -> IntArray:
        """Return the colours (L, 3) of the cells that touch a hexahedron."""
        if colour == "change":
            return change_rgb(self.run.weights * (frame.quality - self.before))
        if colour == "displacement":
            moved = self.cells.middles(frame.points - self.run.mesh.points, np.arange(len(frame.quality)))
            return moved_rgb(np.linalg.norm(moved, axis=1) / (self.farthest(frame) or 1.0))
        return quality_rgb(self.run.weights * frame.quality)

    def _surface_rgb(self, frame: DeflectedMesh, colour: str) -> IntArray | None:
        """Return the colours (F, 3) of the faces that move, None for their own."""
        if colour != "displacement":
            return None
        lengths = self.surface.lengths(frame.points - self.run.mesh.points)
        return moved_rgb(lengths / (self.farthest(frame) or 1.0))

    def side(self, plane: ClipPlane | None) -> float:
        """Return on which side of a plane the walls are cut away: outboard, aft or above."""
        return outboard(self.run) if plane is not None and plane.axis == 1 else 1.0

    def worst(self, frame: DeflectedMesh) -> FloatArray:
        """Return the middle (3,) of the cell of lowest quality."""
        lowest = int(np.argmin(self.run.weights * frame.quality))
        return np.asarray(self.cells.middles(frame.points, np.array([lowest]))[0])


def boxes(run: InteractiveRun) -> ViewPiece:
    """Return the edges of all hexahedra."""
    corners = [box.plan.region.hexahedron.corners for box in run.boxes]
    return ViewPiece.alike(np.vstack(corners), np.vstack([8 * i + BOX_EDGES for i in range(len(corners))]))


def outline(run: InteractiveRun) -> ViewPiece:
    """Return the borders and the sharp edges of the undeflected surfaces."""
    mesh, found = run.mesh, []
    for one in run.surfaces:
        faces = polygons_of(mesh.faces_of(one.patches))
        if are_lines(faces):
            found.append(faces.nodes.reshape(-1, 2))
        else:
            found += [rim(faces), sharp_edges(mesh.points, faces, SHARP)]
    nodes, lines = np.unique(np.vstack(found), return_inverse=True)
    return ViewPiece.alike(mesh.points[nodes], lines.reshape(-1, 2))


def bounds(run: InteractiveRun) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest coordinates (3,) of all hexahedra."""
    corners = np.vstack([box.plan.region.hexahedron.corners for box in run.boxes])
    return corners.min(axis=0), corners.max(axis=0)


def outboard(run: InteractiveRun) -> float:
    """Return the sign of y outboard: -1 for a surface on the port side or across the middle, else 1."""
    low, high = bounds(run)
    return 1.0 if low[1] + high[1] > 1e-6 * (high[1] - low[1]) else -1.0


def _around(run: InteractiveRun) -> list[IntArray]:
    """Return the rows of each block of cells that never move and are close enough to a hexahedron to be of interest."""
    close = np.zeros(len(run.mesh.points), dtype=bool)
    for box in run.boxes:
        corners = box.plan.region.hexahedron.corners
        low, high = corners.min(axis=0), corners.max(axis=0)
        reach = AROUND * (high - low).max()
        close |= ((run.mesh.points > low - reach) & (run.mesh.points < high + reach)).all(axis=1)
    return [
        np.setdiff1d(np.flatnonzero(with_node(block, close)), rows, assume_unique=True)
        for block, rows in zip(run.mesh.cells, run.touched.rows, strict=True)
    ]


def _undeflected_quality(run: InteractiveRun, rows: list[IntArray]) -> FloatArray:
    """Return the quality of some cells of each block, as it is drawn."""
    parts = zip(run.mesh.cells, rows, run.touched.orientation, strict=True)
    return np.concatenate([np.empty(0), *(drawn_quality(run.mesh.points, *part) for part in parts if len(part[1]))])


def _faces(block: Volume, rows: IntArray) -> list[Faces]:
    """Return the faces of some cells of a block; a face between two of them once or twice."""
    if isinstance(block, Cells):
        corners = block.nodes[rows]
        if block.shape in PLANE:
            return [Cells(block.shape, corners)]
        return [Cells(FACE_SHAPES[len(face)], corners[:, face]) for face in FACES[block.shape]]
    mine: BoolArray = np.isin(block.owner, rows)
    mine[: len(block.neighbour)] |= np.isin(block.neighbour, rows)
    return [taken(block.faces, np.flatnonzero(mine))]


def _sums(values: FloatArray, faces: Polygons) -> FloatArray:
    """Add up values (K, 3) of the corners of each face."""
    return np.add.reduceat(values, faces.offsets[:-1], axis=0) if len(faces) else np.empty((0, 3))

"""Non-orthogonality and skewness of polyhedra's faces, as OpenFOAM's checkMesh measures them.

After a deflection only the faces of affected cells are measured again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.threads import in_chunks

from .affected import AffectedCells
from .cells import Periodic, Polygons, Polyhedra
from .edges import rows_of
from .faces import face_keys, node_keys
from .mesh import Mesh
from .polyhedra import PARTS, ROWS, WEIGHT, judge_faces, measured_cells, spans_of
from .quality import SEVERE, SKEW, find_orientation

# checkMesh reports an error for a face if the cosine of its non-orthogonality is not larger.
ERROR = 1e-15
# Degrees of non-orthogonality up to which a deflected mesh passes, unless it exceeded them before.
LARGEST_ANGLE = 85.0


@dataclass(frozen=True, slots=True)
class FaceQuality:
    """Figures of faces, as checkMesh measures them.

    Attributes
    ----------
    faces : number of faces between two cells.
    least, total : smallest cosine of these faces' non-orthogonality, and the sum of all cosines.
    skewness_max : largest skewness of any face, boundary faces included.
    severe, skew : numbers of faces with a non-orthogonality above 70 degrees, and with a skewness above 4.
    """

    faces: int = 0
    least: float = 1.0
    total: float = 0.0
    skewness_max: float = 0.0
    severe: int = 0
    skew: int = 0

    def __add__(self, other: FaceQuality) -> FaceQuality:
        return FaceQuality(
            self.faces + other.faces,
            min(self.least, other.least),
            self.total + other.total,
            max(self.skewness_max, other.skewness_max),
            self.severe + other.severe,
            self.skew + other.skew,
        )

    @property
    def non_orthogonality_max(self) -> float:
        """Largest non-orthogonality, degrees."""
        return float(_degrees(np.array(self.least)))

    @property
    def non_orthogonality_mean(self) -> float:
        """Angle of the mean cosine in degrees, like checkMesh's average."""
        return float(_degrees(np.array(self.total / max(self.faces, 1))))

    def as_dict(self) -> dict[str, float | int]:
        """Return the figures for JSON."""
        return {
            "faces": self.faces,
            "non_orthogonality_max": self.non_orthogonality_max,
            "non_orthogonality_mean": self.non_orthogonality_mean,
            "severely_non_orthogonal": self.severe,
            "skewness_max": self.skewness_max,
            "highly_skew": self.skew,
        }


class State(NamedTuple):
    """Measures of some faces.

    Attributes
    ----------
    inner : (F,) whether a face is between two cells; of a periodic pair only the first face.
    second : (F,) whether a face is the second of a periodic pair.
    cosines, skewness : (F,) measures of the faces.
    places : (F, 3) centres of faces.
    """

    inner: BoolArray
    second: BoolArray
    cosines: FloatArray
    skewness: FloatArray
    places: FloatArray

    def quality(self, faces: BoolArray | slice = slice(None)) -> FaceQuality:
        """Return the figures of all faces, or of those in a mask (F,)."""
        cosines, skewness = self.cosines[faces], self.skewness[faces]
        between = cosines[self.inner[faces]]
        return FaceQuality(
            len(between),
            float(between.min(initial=1.0)),
            float(between.sum()),
            float(skewness.max(initial=0.0)),
            int(np.count_nonzero(cosines < np.cos(np.radians(SEVERE)))),
            int(np.count_nonzero((skewness > SKEW) & ~self.second[faces])),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Couples:
    """Faces of periodic pairs; the cell ahead of a face is that of its partner, moved by the pair's motion.

    Attributes
    ----------
    faces, partners : (K,) faces, and their partners.
    rotations, shifts : (K, 3, 3), (K, 3) motion from the partner to the face.
    second : (K,) whether a face is the image.
    """

    faces: IntArray = field(repr=False)
    partners: IntArray = field(repr=False)
    rotations: FloatArray = field(repr=False)
    shifts: FloatArray = field(repr=False)
    second: BoolArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, cells: Polyhedra) -> Couples:
        """Find the faces of a block of cells in the periodic pairs of a mesh; pairs of a submesh may be incomplete."""
        parts = [(np.empty((0, 2), dtype=np.intp), np.empty((0, 3, 3)), np.empty((0, 3)))]
        inner = len(cells.neighbour)
        if mesh.periodic and not mesh.is_part:
            coupled = [pair for pair in mesh.periodic if len(pair.nodes) and not pair.thin]
            parts += [_coupled_faces(pair, cells.faces.rows(inner, len(cells.faces)), mesh) for pair in coupled]
        pairs, rotations, shifts = (np.concatenate(part) for part in zip(*parts, strict=True))
        pairs += inner
        back = rotations.transpose(0, 2, 1)
        return cls(
            np.concatenate([pairs[:, 0], pairs[:, 1]]),
            np.concatenate([pairs[:, 1], pairs[:, 0]]),
            np.concatenate([back, rotations]),
            np.concatenate([-np.einsum("kij,kj->ki", back, shifts), shifts]),
            np.repeat([False, True], len(pairs)),
        )

    def among(self, wanted: BoolArray) -> Couples:
        """Return the faces in a mask."""
        rows = wanted[self.faces]
        return Couples(
            self.faces[rows], self.partners[rows], self.rotations[rows], self.shifts[rows], self.second[rows]
        )  # fmt: skip


def _coupled_faces(pair: Periodic, faces: Polygons, mesh: Mesh) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the boundary faces (F,) that a pair couples, as (K, 2), and the motion of each to its image."""
    keys, image = node_keys(len(mesh.points)), np.full(len(mesh.points), -1, dtype=np.intp)
    image[pair.nodes[:, 0]] = pair.nodes[:, 1]
    moved = np.logical_and.reduceat(image[faces.nodes] >= 0, faces.offsets[:-1])
    moving, key = np.flatnonzero(moved), face_keys(faces, keys)
    order = np.argsort(key)
    wanted = face_keys(faces, keys[image])[moving]
    place = order[np.minimum(np.searchsorted(key, wanted, sorter=order), len(key) - 1)]
    there = (key[place] == wanted) & (place != moving)
    pairs = np.column_stack([moving[there], place[there]])
    return pairs, np.tile(pair.rotation, (len(pairs), 1, 1)), np.tile(pair.shift, (len(pairs), 1))


@dataclass(frozen=True, slots=True, eq=False)
class Ring:
    """The faces of some cells, and all cells whose centres their measures need.

    Attributes
    ----------
    nodes, spans : nodes of faces, and (K, 2) begin and end, among these, of each face of all the cells.
    owner, neighbour : (K,), (I,) cells of these faces, counted from 0; -1 for cells farther out.
    count : number of cells.
    sides : (F, 3) row of each measured face, the cell behind it, and the cell ahead or -1. Images of coupled cells
        have numbers after those of the cells.
    numbers : (F,) indices of the faces in the mesh.
    sign : -1 if normals point into the owners, else 1.
    couples : coupled faces, as rows of the measured ones; partners are cells.
    """

    nodes: IntArray = field(repr=False)
    spans: IntArray = field(repr=False)
    owner: IntArray = field(repr=False)
    neighbour: IntArray = field(repr=False)
    count: int
    sides: IntArray = field(repr=False)
    numbers: IntArray = field(repr=False)
    sign: float
    couples: Couples

    @classmethod
    def of(cls, cells: Polyhedra, rows: IntArray, sign: float, couples: Couples) -> Ring:
        """Collect the faces of rows (C,) of cells, and the faces coupled to them."""
        meant = np.zeros(len(cells), dtype=np.bool_)
        meant[rows] = True
        wanted = _faces_of(cells, meant)
        wanted[couples.partners[wanted[couples.faces]]] = True
        couples = couples.among(wanted)
        near = meant.copy()
        near[cells.owner[wanted]] = near[cells.neighbour[wanted[: len(cells.neighbour)]]] = True
        needed, count = _faces_of(cells, near), int(np.count_nonzero(near))
        place = np.where(near, np.cumsum(near) - 1, -1)
        owner, neighbour = place[cells.owner[needed]], place[cells.neighbour[needed[: len(cells.neighbour)]]]
        spans = spans_of(cells.faces, needed)
        faces, numbers = np.flatnonzero(wanted[needed]), np.flatnonzero(wanted)
        ahead, inner = np.full(len(faces), -1), np.searchsorted(faces, len(neighbour))
        ahead[:inner] = neighbour[faces[:inner]]
        own = replace(
            couples, faces=np.searchsorted(numbers, couples.faces), partners=place[cells.owner[couples.partners]]
        )
        ahead[own.faces] = count + np.arange(len(own.faces))
        sides = np.column_stack([faces, owner[faces], ahead])
        return cls(cells.faces.nodes, spans, owner, neighbour, count, sides, numbers, sign, own)

    def measure(self, points: FloatArray) -> State:
        """Measure the faces with the nodes at points (N, 3)."""
        pairs, judged = self.couples, np.empty((len(self.sides), 2))
        count = self.count + len(pairs.faces)
        faces, cells = measured_cells(points, self.nodes, self.spans, self.owner, self.neighbour, self.sign, count)

        def judge(low: int, high: int) -> None:
            judge_faces(points, self.nodes, self.spans, faces, cells, self.sides[low:high], judged[low:high])

        centres = cells[pairs.partners, :3]
        cells[self.count :, :3] = np.einsum("kij,kj->ki", pairs.rotations, centres) + pairs.shifts
        in_chunks(judge, len(self.sides), WEIGHT)
        inner, second = self.sides[:, 2] >= 0, np.zeros(len(judged), dtype=np.bool_)
        inner[pairs.faces], second[pairs.faces] = ~pairs.second, pairs.second
        return State(inner, second, judged[:, 0], judged[:, 1], faces[self.sides[:, 0], :3])


@dataclass(frozen=True, eq=False)
class AffectedFaces:
    """The faces of affected cells.

    Attributes
    ----------
    rings : one for each block of polyhedra.
    before : measures of the undeflected mesh.
    """

    rings: tuple[Ring, ...] = field(repr=False)
    before: State = field(repr=False)

    @classmethod
    def of(cls, affected: AffectedCells) -> AffectedFaces | None:
        """Measure the undeflected mesh; None without affected polyhedra."""
        mesh = affected.mesh
        rings = tuple(
            Ring.of(block, rows, sign, Couples.of(mesh, block))
            for block, rows, sign in zip(mesh.cells, affected.rows, affected.orientation, strict=True)
            if isinstance(block, Polyhedra) and len(rows)
        )
        return cls(rings, _measure(rings, mesh.points)) if rings else None

    def at(self, points: FloatArray) -> State:
        """Measure the faces with the nodes at points (N, 3)."""
        return _measure(self.rings, points)

    def verdicts(self, after: State) -> Iterator[tuple[str, float, float, str, str]]:
        """Yield name, value, limit, unit and place of each requirement on the faces.

        For a face that exceeded a limit before, only a new error of checkMesh counts.
        """
        inner = after.inner
        old, new = self.before.cosines[inner], after.cosines[inner]
        errs = (new <= ERROR) & (old > ERROR)
        old, new = _degrees(old), _degrees(new)
        where = _where(old, new, SEVERE, LARGEST_ANGLE, "faces between two cells", after.places[inner])
        yield "non_orthogonality_max", _largest(new, (old <= LARGEST_ANGLE) | errs), LARGEST_ANGLE, "deg", where
        old, new = self.before.skewness, after.skewness
        yield "skewness_max", _largest(new, old <= SKEW), SKEW, "", _where(old, new, SKEW, SKEW, "faces", after.places)


def face_quality(mesh: Mesh) -> FaceQuality | None:
    """Return the figures of all faces of a mesh, as checkMesh has them; None without polyhedra."""
    figures, blocks = FaceQuality(), [block for block in mesh.cells if isinstance(block, Polyhedra)]
    for block in blocks:
        sign, couples, rows = find_orientation(mesh.points, block)[0], Couples.of(mesh, block), np.arange(len(block))
        for part in rows_of(len(block), max(ROWS, -(-len(block) // PARTS))):
            ring = Ring.of(block, rows[part], sign, couples)
            owner = block.owner[ring.numbers]
            owned = (owner >= part.start) & (owner < part.stop)
            figures += ring.measure(mesh.points).quality(owned)
    return figures if blocks else None


def _measure(rings: tuple[Ring, ...], points: FloatArray) -> State:
    return State(*map(np.concatenate, zip(*(ring.measure(points) for ring in rings), strict=True)))


def _where(old: FloatArray, new: FloatArray, counted: float, limit: float, what: str, places: FloatArray) -> str:
    """Return a text: the number of measured faces (F,), of those newly above a value, and the place of the worst.

    `places` (F, 3) are the faces' centres.
    """
    text = f"{len(new)} {what}, {_newly(old, new, counted)} newly above {counted:g}; {_largest(old):.4g} before"
    if not _newly(old, new, limit):
        return text
    worst = places[np.argmax(np.where(old <= limit, new, 0.0))]
    return f"{text}; the worst at ({', '.join(f'{x:.4g}' for x in worst)})"


def _largest(values: FloatArray, some: BoolArray | slice = slice(None)) -> float:
    """Return the largest of values (K,), or of those in a mask (K,); 0 without any."""
    return float(values[some].max(initial=0.0))


def _newly(before: FloatArray, after: FloatArray, limit: float) -> int:
    """Return how many values (K,) are newly above a limit."""
    return int(np.count_nonzero((after > limit) & (before <= limit)))


def _degrees(cosines: FloatArray) -> FloatArray:
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


def _faces_of(cells: Polyhedra, some: BoolArray) -> BoolArray:
    rows = some[cells.owner]
    rows[: len(cells.neighbour)] |= some[cells.neighbour]
    return rows

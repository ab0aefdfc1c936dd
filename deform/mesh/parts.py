"""Some faces of a patch: how they hang together, and where sharp edges divide them."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.mesh.cells import Patch, Polygons, taken
from sdm_deflect.deform.mesh.edges import Joints, polygons_of
from sdm_deflect.deform.mesh.mesh import Mesh

MARK, REGION = "#", "~"
"""Between the name of a patch and the number of its component, and between that of a selection and its region."""
LISTED = 6
"""Parts that a message lists."""
MOST = 1000
"""Components of a wildcard, and regions of a selection."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Some faces of a patch.

    Attributes
    ----------
    name : of the part.
    points : (N, 3) of the mesh.
    faces : (F,) the faces.
    rows : (F,) which they are, counted through the blocks of the patch.
    """

    name: str
    points: FloatArray = field(repr=False)
    faces: Polygons = field(repr=False)
    rows: IntArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, patch: Patch) -> "Part":
        """Return all faces of a patch."""
        faces = polygons_of(patch.faces)
        return cls(patch.name, mesh.points, faces, np.arange(len(faces)))

    def __len__(self) -> int:
        return len(self.rows)

    def some(self, chosen: IntArray, name: str = "") -> "Part":
        """Return some of the faces (R,), counted within the part."""
        return Part(name or self.name, self.points, taken(self.faces, chosen), self.rows[chosen])

    @property
    def centres(self) -> FloatArray:
        """Mean (F, 3) of each face's nodes."""
        sums = np.add.reduceat(self.points[self.faces.nodes], self.faces.offsets[:-1], axis=0)
        return np.asarray(sums / np.diff(self.faces.offsets)[:, None])

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Least and largest coordinates (3,) of the nodes."""
        own = self.points[self._nodes[0]]
        return own.min(axis=0), own.max(axis=0)

    @property
    def text(self) -> str:
        """Name, number of faces and extent, for messages."""
        low, high = map(placed, self.extent)
        return f"{self.name} {len(self)} faces from {low} to {high}"

    def components(self) -> IntArray:
        """Return the connected component (F,) of each face, by shared nodes; 0 has most faces, or the first of them."""
        if not len(self):
            return np.empty(0, dtype=np.intp)
        nodes, place = self._nodes
        return _ranked(_joined(place, self.faces.offsets, len(nodes))[place[self.faces.offsets[:-1]]])

    def regions(self, degrees: float) -> IntArray:
        """Return the region (F,) of each face between edges that turn by more than some degrees; 0 is the largest."""
        joints = Joints.of(self.faces)
        smooth = ~(joints.cosines(self.points, self.faces) < np.cos(np.radians(degrees)))
        pairs = np.column_stack([joints.first[smooth], joints.second[smooth]])
        return _ranked(_joined(pairs.ravel(), np.arange(0, pairs.size + 1, 2), len(self)))

    @property
    def _nodes(self) -> tuple[IntArray, IntArray]:
        """The distinct nodes (N,), sorted, and the place (K,) among them of each node of the faces."""
        low = self.faces.nodes.min()
        used = np.zeros(self.faces.nodes.max() - low + 1, dtype=np.bool_)
        used[self.faces.nodes - low] = True
        return np.flatnonzero(used) + low, (np.cumsum(used) - 1)[self.faces.nodes - low]

    def cut(self, labels: IntArray, mark: str, most: int = MOST) -> list["Part"]:
        """Return the parts of equal labels (F,), the first so many of them, numbered from 1 after a mark."""
        order, ends = np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:most]
        groups = np.split(order[: ends[-1]], ends[:-1]) if len(ends) else []
        return [self.some(rows, f"{self.name}{mark}{number}") for number, rows in enumerate(groups, 1)]


def listed(part: Part, labels: IntArray) -> str:
    """Return the first of the connected components (F,) of a part, for messages."""
    rest = labels.max(initial=-1) + 1 - LISTED
    return "; ".join(one.text for one in part.cut(labels, MARK, LISTED)) + (f"; and {rest} more" if rest > 0 else "")


def placed(point: Iterable[float]) -> str:
    """Return a point for messages."""
    return f"({', '.join(f'{x:.4g}' for x in point)})"


def _joined(members: IntArray, offsets: IntArray, count: int) -> IntArray:
    """Return the component (count,) of things of which each group joins some, its members (K,) one after another."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    groups = len(offsets) - 1
    starts = np.concatenate([offsets, np.full(count, len(members))])  # a graph of the groups, and then of the things
    links = csr_array((np.ones(len(members)), members + groups, starts), shape=(groups + count, groups + count))
    return np.asarray(connected_components(links, directed=False)[1][groups:], dtype=np.intp)


def _ranked(labels: IntArray) -> IntArray:
    """Return labels (F,) counted anew: 0 is the most frequent, of equally frequent ones that which comes first."""
    count = np.bincount(labels)
    first = np.zeros(len(count), dtype=np.intp)
    first[labels[::-1]] = np.arange(len(labels))[::-1]  # of a label that comes again the last one stays
    rank = np.empty(len(count), dtype=np.intp)
    rank[np.lexsort((first, -count))] = np.arange(len(count))
    return np.asarray(rank[labels])

"""Selections: parts of patches that become patches.

A part is a connected component, the faces in a box or before a plane, or a region between sharp edges. A selection
begins with the faces of a patch, and each condition keeps some of them. In a plane mesh faces are lines, which meet in
nodes instead of edges.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import InputError, short_list

from .cells import Cells, Faces, Patch, Polygons, take_faces
from .edges import Joints, polygons_of
from .mesh import MARK, REGION, Mesh, meant

# Largest number of parts listed in a message.
LISTED = 6
# Largest number of components of a wildcard, and of regions of a selection.
MOST_PARTS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Some faces of a patch.

    Attributes
    ----------
    name : name of the part.
    points : (N, 3) points of the mesh.
    faces : (F,) the faces.
    rows : (F,) rows of the faces, counted over the blocks of the patch.
    """

    name: str
    points: FloatArray = field(repr=False)
    faces: Polygons = field(repr=False)
    rows: IntArray = field(repr=False)

    @classmethod
    def of(cls, mesh: Mesh, patch: Patch) -> "Part":
        """Return all faces of a patch as a part."""
        faces = polygons_of(patch.faces)
        return cls(patch.name, mesh.points, faces, np.arange(len(faces)))

    def __len__(self) -> int:
        return len(self.rows)

    def some(self, chosen: IntArray, name: str = "") -> "Part":
        """Return the faces of some rows (R,) of the part."""
        return Part(name or self.name, self.points, take_faces(self.faces, chosen), self.rows[chosen])

    @property
    def centres(self) -> FloatArray:
        """Mean (F, 3) of the nodes of each face."""
        sums = np.add.reduceat(self.points[self.faces.nodes], self.faces.offsets[:-1], axis=0)
        return np.asarray(sums / np.diff(self.faces.offsets)[:, None])

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Least and largest coordinates (3,) of the nodes."""
        places = self.points[self._nodes[0]]
        return places.min(axis=0), places.max(axis=0)

    @property
    def text(self) -> str:
        """Name, number of faces, and extent, for messages."""
        low, high = map(point_text, self.extent)
        return f"{self.name} {len(self)} faces from {low} to {high}"

    def components(self) -> IntArray:
        """Return the component (F,) of each face, connected by nodes; 0 has the most faces, or comes first."""
        if not len(self):
            return np.empty(0, dtype=np.intp)
        nodes, place = self._nodes
        return _ranks(_components(place, self.faces.offsets, len(nodes))[place[self.faces.offsets[:-1]]])

    def regions(self, degrees: float) -> IntArray:
        """Return the region (F,) of each face between edges that turn by more than `degrees`; 0 has the most faces."""
        joints = Joints.of(self.faces)
        smooth = ~(joints.cosines(self.points, self.faces) < np.cos(np.radians(degrees)))
        pairs = np.column_stack([joints.first[smooth], joints.second[smooth]])
        return _ranks(_components(pairs.ravel(), np.arange(0, pairs.size + 1, 2), len(self)))

    @property
    def _nodes(self) -> tuple[IntArray, IntArray]:
        """Sorted distinct nodes (N,), and the place (K,) of each node of the faces among them."""
        low = self.faces.nodes.min()
        used = np.zeros(self.faces.nodes.max() - low + 1, dtype=np.bool_)
        used[self.faces.nodes - low] = True
        return np.flatnonzero(used) + low, (np.cumsum(used) - 1)[self.faces.nodes - low]

    def cut(self, labels: IntArray, mark: str, most: int = MOST_PARTS) -> list["Part"]:
        """Return the parts of equal labels (F,), at most `most`; their names end in a mark and a number from 1."""
        order, ends = np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:most]
        groups = np.split(order[: ends[-1]], ends[:-1]) if len(ends) else []
        return [self.some(rows, f"{self.name}{mark}{number}") for number, rows in enumerate(groups, 1)]


def list_components(part: Part, labels: IntArray) -> str:
    """Return a text, for messages, on the first components (F,) of a part."""
    rest = labels.max(initial=-1) + 1 - LISTED
    return "; ".join(component.text for component in part.cut(labels, MARK, LISTED)) + (
        f"; and {rest} more" if rest > 0 else ""
    )


def point_text(point: Iterable[float]) -> str:
    """Return a point as text."""
    return f"({', '.join(f'{x:.4g}' for x in point)})"


def _components(members: IntArray, offsets: IntArray, count: int) -> IntArray:
    """Return the component (count,) of each item; each group of `members` (K,) connects its items."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components  # loading takes a while

    groups = len(offsets) - 1
    starts = np.concatenate([offsets, np.full(count, len(members))])  # a graph of the groups, then of the items
    links = csr_array((np.ones(len(members)), members + groups, starts), shape=(groups + count, groups + count))
    return np.asarray(connected_components(links, directed=False)[1][groups:], dtype=np.intp)


def _ranks(labels: IntArray) -> IntArray:
    """Return labels (F,) by rank: 0 is the most frequent; ties by first occurrence."""
    count = np.bincount(labels)
    first = np.zeros(len(count), dtype=np.intp)
    first[labels[::-1]] = np.arange(len(labels))[::-1]  # the last assignment stays, which is the first occurrence
    rank = np.empty(len(count), dtype=np.intp)
    rank[np.lexsort((first, -count))] = np.arange(len(count))
    return np.asarray(rank[labels])


class Condition(Protocol):
    """Keeps some faces of a part."""

    def of(self, part: Part) -> BoolArray:
        """Return which faces (F,) of a part the condition keeps."""
        ...


@dataclass(frozen=True, slots=True)
class Component:
    """The faces of one connected component.

    Attributes
    ----------
    number : number of the component from 1, largest first.
    """

    number: int

    def __str__(self) -> str:
        return f"component {self.number}"

    def of(self, part: Part) -> BoolArray:
        """Return which faces (F,) are in the component; InputError without such a component."""
        labels = part.components()
        if not 1 <= self.number <= labels.max(initial=-1) + 1:
            raise InputError(f"there is no component {self.number}; there are {list_components(part, labels)}")
        return np.asarray(labels == self.number - 1)


@dataclass(frozen=True, slots=True)
class Within:
    """The faces with their centre in an axis-aligned box, border included.

    Attributes
    ----------
    low, high : opposite corners.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __str__(self) -> str:
        return f"the box from {point_text(self.low)} to {point_text(self.high)}"

    def of(self, part: Part) -> BoolArray:
        centres = part.centres
        return np.asarray(((centres >= self.low) & (centres <= self.high)).all(axis=1))


@dataclass(frozen=True, slots=True)
class Before:
    """The faces with their centre in front of a plane, where its normal points.

    Attributes
    ----------
    point, normal : point and normal of the plane.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def __str__(self) -> str:
        return f"the side of the plane through {point_text(self.point)} to which {point_text(self.normal)} points"

    def of(self, part: Part) -> BoolArray:
        return np.asarray((part.centres - self.point) @ np.array(self.normal) > 0.0)


@dataclass(frozen=True, slots=True)
class Selection:
    """Faces of a patch that become one patch or several.

    Attributes
    ----------
    name : name of the new patch; several are ``name~1``, ``name~2``, largest first.
    patch : patch of the faces; ``patch#2`` is its second connected component.
    conditions : each keeps some of the faces that are left.
    sharp : angle in degrees at edges between the new patches; None for a single patch.
    text : the user's text.
    """

    name: str
    patch: str
    conditions: tuple[Condition, ...] = ()
    sharp: float | None = None
    text: str = field(default="", compare=False)

    def parts(self, mesh: Mesh) -> tuple[str, list[Part]]:
        """Return the patch's name and the new patches; InputError if one is empty or the whole patch."""
        place = f"select {self.name} = {self.text}:" if self.text else f"{self.name}:"
        what, (patch, conditions) = f"{mesh.name}: {place}", self._resolve(mesh, place)
        whole = part = Part.of(mesh, mesh.patch(patch))
        if not len(whole):
            raise InputError(f"{what} patch {patch} has no faces to choose from")
        if any(patch in pair.patches for pair in mesh.periodic):
            raise InputError(f"{what} patch {patch} is one side of a pair, whose nodes move as their images do")
        for condition in conditions:
            try:
                left = part.some(np.flatnonzero(condition.of(part)))
            except InputError as error:
                raise InputError(f"{what} {error}") from None
            if not len(left):
                raise InputError(f"{what} {condition} leaves nothing of {part.text}")
            part = left
        part = replace(part, name=self.name)
        pieces = [part] if self.sharp is None else self._regions(part, what)
        if len(pieces) == 1 and len(part) == len(whole):
            raise InputError(f"{what} these are all {len(whole)} faces of {patch}; name {patch} itself")
        return patch, pieces

    def _resolve(self, mesh: Mesh, place: str) -> tuple[str, tuple[Condition, ...]]:
        base, mark, number = self.patch.rpartition(MARK)
        numbered = self.patch not in mesh.names and mark and number.isascii() and number.isdigit()
        names = mesh.expand([base if numbered else self.patch], place)
        if len(names) > 1:
            several = f"{self.patch} stands for several patches, {short_list(names)}; name one of them"
            raise InputError(f"{mesh.name}: {place} {several}")
        return names[0], ((Component(int(number)), *self.conditions) if numbered else self.conditions)

    def _regions(self, part: Part, what: str) -> list[Part]:
        degrees = self.sharp or 0.0
        labels = part.regions(degrees)
        if (count := labels.max() + 1) > MOST_PARTS:
            raise InputError(f"{what} {degrees:g} deg cuts {part.text} into {count} regions; choose a larger angle")
        return part.cut(labels, REGION)


def with_selections(mesh: Mesh, selections: Sequence[Selection], names: Iterable[str] = ()) -> Mesh:
    """Return a mesh with its selections as patches; the rest of a patch keeps its name.

    Parameters
    ----------
    mesh : The mesh as it was read; selections refer to its patches.
    selections : The selections.
    names : Names and wildcards of patches; ``wall#2`` becomes a patch without a selection, and ``wall#*`` means the
        components without a selected face.

    Raises InputError if a selection is empty or a whole patch, shares a face or a name, or if a name means no patch.
    """
    selected: dict[str, list[Part]] = {}
    for selection in selections:
        _add(mesh, selected, *selection.parts(mesh))
    for text in dict.fromkeys(names):
        known = text in (*mesh.names, *_names(selected)) or any(meant(text, name) for name in mesh.names)
        if MARK in text and not known:
            for patch, parts in _components_of(mesh, selected, text):
                _add(mesh, selected, patch, parts)
    return with_parts(mesh, selected)


def with_parts(mesh: Mesh, selected: Mapping[str, Sequence[Part]]) -> Mesh:
    """Return a mesh with parts of patches, by the patches' names, as patches; the rest of a patch keeps its name."""
    if not selected:
        return mesh
    patches = [piece for patch in mesh.patches for piece in _divide(patch, selected.get(patch.name, ()))]
    return replace(mesh, patches=tuple(patches))


def _components_of(mesh: Mesh, selected: dict[str, list[Part]], text: str) -> Iterator[tuple[str, list[Part]]]:
    """Yield the components that ``patch#number`` or ``patch#*`` means, but none that share a face with other parts."""
    base, _, which = text.rpartition(MARK)
    if which.isascii() and which.isdigit():
        yield Selection(text, text).parts(mesh)
        return
    for name in mesh.expand([base], f"{text}:"):
        part = Part.of(mesh, mesh.patch(name))
        labels, free = part.components(), np.ones(len(part), dtype=np.bool_)
        if (count := labels.max(initial=-1) + 1) > MOST_PARTS:
            raise InputError(f"{mesh.name}: {text} stands for {count} components; name those that are meant")
        for earlier in selected.get(name, []):
            free[earlier.rows] = False
        parts = part.cut(labels, MARK) if count > 1 else []
        yield name, [part for part in parts if meant(text, part.name) and free[part.rows].all()]


def _add(mesh: Mesh, selected: dict[str, list[Part]], patch: str, parts: list[Part]) -> None:
    """Add the parts of a patch; InputError if they share a face with earlier ones, or a name with any patch."""
    taken, earlier = np.zeros(len(mesh.patch(patch)), dtype=np.bool_), tuple(selected.get(patch, ()))
    for new in parts:
        if new.name in (*mesh.names, *_names(selected)):
            raise InputError(f"{mesh.name}: {new.name} is the name of two patches; choose another one")
        for old in earlier:
            taken[old.rows] = True
            if both := np.count_nonzero(taken[new.rows]):
                raise InputError(f"{mesh.name}: {old.name} and {new.name} overlap: {both} faces of {patch} are in both")
            taken[old.rows] = False
        selected.setdefault(patch, []).append(new)


def _names(selected: dict[str, list[Part]]) -> list[str]:
    return [part.name for parts in selected.values() for part in parts]


def _divide(patch: Patch, parts: Sequence[Part]) -> Iterator[Patch]:
    rest = np.ones(len(patch), dtype=np.bool_)
    for part in parts:
        rest[part.rows] = False
    if not parts:
        yield patch
    elif rest.any() or len(patch.loose):
        yield replace(patch, faces=tuple(_some(patch.faces, np.flatnonzero(rest))), labels={})
    for part in parts:
        yield Patch(part.name, tuple(_some(patch.faces, part.rows)), constraint=patch.constraint)


def _some(blocks: Sequence[Faces], rows: IntArray) -> Iterator[Faces]:
    """Yield the faces of rows (R,), rising and counted over all blocks, block by block."""
    starts = np.cumsum([0, *map(len, blocks)])
    groups = np.split(rows, np.searchsorted(rows, starts[1:-1]))
    for start, block, group in zip(starts, blocks, groups, strict=False):
        within = group - start
        if len(within):
            yield Cells(block.shape, block.nodes[within]) if isinstance(block, Cells) else take_faces(block, within)

"""A mesh: points, cells of any shape, named boundary patches, zones."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.base.arrays import FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError, nearest, short_list
from sdm_deflect.base.states import States

from .cells import LARGEST, PLANE, Cells, Faces, Patch, Periodic, Polyhedra, Volume, Zone, real, several, whole
from .pieces import FullMesh

# Separates the name of a patch from the number of its component.
MARK = "#"
# Separates the name of a selection from the number of its region, and that of a panel from its tail's.
REGION = "~"
CUT = "; the setting select makes a patch of a part of one, and device a flap of a part of a wing"
# Note on patches inside the flow.
FOLLOWS = "{}: faces between cells, which follow the mesh"
# Beginning of a note on a patch of the file that cannot be read.
ABSENT = "patch {} is absent: "


class Warned(str):
    """A note that is shown as a warning, because the result is probably not what the user wants."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Points, cells and named boundary patches.

    A plane mesh has cells of the shapes `PLANE`, patches of lines, and points that share one coordinate.

    Parameters
    ----------
    points : (N, 3) node coordinates in the mesh's own unit of length.
    cells : Blocks of one shape, or polyhedra, in the file's order; volume cells or plane cells. There may be none.
    patches : Named parts of the boundary; names are distinct.
    zones : Parts with their own points, which cover all points in order; one unless the file says otherwise.
    name : The file or kind of mesh, for messages.
    source : File that it was read from; empty for none.
    notes : Sentences on what may surprise a user; those of type `Warned` are shown as warnings.
    whole : The mesh that this is a submesh of; None if it is complete.
    periodic : Pairs of patches whose nodes are images of each other.
    files : Files that it was read from, with their states at that time (`check_unchanged`).
    across : Axis, 0, 1 or 2, along which all points of a plane mesh have one coordinate.
    inner : Patches whose faces lie between cells, such as wake lines; their nodes follow the mesh.

    Raises InputError for coordinates not finite or beyond `LARGEST`, indices out of range, and repeated names.
    """

    points: FloatArray = field(repr=False)
    cells: tuple[Volume, ...]
    patches: tuple[Patch, ...]
    zones: tuple[Zone, ...] = ()
    name: str = "mesh"
    source: str = ""
    notes: tuple[str, ...] = ()
    whole: FullMesh | None = None
    periodic: tuple[Periodic, ...] = ()
    files: States = field(default_factory=dict, repr=False)
    across: int = 2
    inner: tuple[Patch, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", real(self.points, "points"))
        parts = (
            ("cells", (Cells, Polyhedra)), ("patches", (Patch,)), ("inner", (Patch,)), ("zones", (Zone,)),
            ("periodic", (Periodic,)),
        )  # fmt: skip
        for name, kinds in parts:
            object.__setattr__(self, name, several(getattr(self, name), kinds, name))
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError(f"points {self.points.shape} must be (N, 3)")
        if not (self.points.min(initial=0.0) > -LARGEST and self.points.max(initial=0.0) < LARGEST):
            bad = ~(np.abs(self.points) < LARGEST).all(axis=1)
            what = f"beyond {LARGEST:g}" if np.isfinite(self.points).all() else "not finite"
            raise InputError(f"{int(bad.sum())} points are {what}, the first is point {int(np.argmax(bad))}")
        names = [patch.name for patch in (*self.patches, *self.inner)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"patch names must be distinct; given twice: {short_list(twice)}")
        self._check_nodes()
        self._check_sides()
        self._check_plane()
        if not self.zones:
            object.__setattr__(self, "zones", (Zone("", 0, len(self.points)),))

    def _check_nodes(self) -> None:
        for nodes, what in self._indices():
            if len(nodes) and (nodes.min() < 0 or nodes.max() >= len(self.points)):
                raise InputError(
                    f"{what}: nodes {nodes.min()} to {nodes.max()}, but there are {len(self.points)} points"
                )

    def _check_sides(self) -> None:
        """Raise InputError for faces of polyhedra between cells that cannot be."""
        for block in (block for block in self.cells if isinstance(block, Polyhedra)):
            sides = whole(block.owner, "owners"), whole(block.neighbour, "neighbours")
            low, count = min(int(cells.min(initial=0)) for cells in sides), sum(map(len, sides))
            if low < 0 or len(block) > count:
                raise InputError(
                    f"owners and neighbours of faces: cells {low} to {len(block) - 1}; they count from 0, and "
                    f"{count} sides of faces bound at most as many cells"
                )

    def _check_plane(self) -> None:
        if not self.plane:
            return
        solid = [block for block in self.cells if isinstance(block, Polyhedra) or block.shape not in PLANE]
        if solid:
            raise InputError(f"{self.name}: cells are triangles and quads, or volume cells, not both")
        stations = self.points[:, self.across]
        low, high = stations.min(initial=np.inf), stations.max(initial=-np.inf)
        if low < high:
            raise InputError(
                f"{self.name}: its cells are triangles and quads, so all points must have one z, but they lie between "
                f"{low:g} and {high:g}; a surface needs volume cells around it"
            )

    @property
    def plane(self) -> bool:
        """True for a two-dimensional mesh: triangles and quads, in a plane."""
        return any(isinstance(block, Cells) and block.shape in PLANE for block in self.cells)

    @property
    def normal(self) -> FloatArray | None:
        """Unit normal (3,) of a plane mesh; None for others."""
        return np.eye(3)[self.across] if self.plane else None

    def _indices(self) -> list[tuple[NDArray[np.intp], str]]:
        indices = []
        for block in self.cells:
            nodes = block.faces.nodes if isinstance(block, Polyhedra) else block.nodes
            indices.append((nodes, "polyhedra" if isinstance(block, Polyhedra) else block.shape))
        patches = (*self.patches, *self.inner)
        indices += [(faces.nodes, f"patch {patch.name}") for patch in patches for faces in patch.faces]
        indices += [(patch.loose, f"patch {patch.name}") for patch in patches]
        indices += [(pair.nodes, f"periodic pair {pair.name}") for pair in self.periodic]
        return indices

    @property
    def is_part(self) -> bool:
        """True if the file has cells that are not in memory."""
        return self.whole is not None

    @property
    def point_count(self) -> int:
        """Number of points; a submesh counts those of the whole mesh."""
        return self.whole.pieces.points if self.whole else len(self.points)

    @property
    def cell_counts(self) -> tuple[int, ...]:
        """Number of cells of each block; a submesh counts those of the whole mesh."""
        blocks = self.whole.pieces.blocks if self.whole else ()
        return tuple(count for _, count in blocks) or tuple(map(len, self.cells))

    def numbers(self, nodes: IntArray) -> IntArray:
        """Return the indices in the file of nodes (K,)."""
        return np.asarray(self.whole.nodes[nodes] if self.whole else nodes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the patches."""
        return tuple(patch.name for patch in self.patches)

    def patch(self, name: str) -> Patch:
        """Return the patch of that name; KeyError for an unknown name."""
        for patch in self.patches:
            if patch.name == name:
                return patch
        raise KeyError(name)

    def on(self, *names: str) -> IntArray:
        """Return the sorted distinct indices (K,) of the nodes on the named patches."""
        return union(*(self.patch(name).nodes for name in names))

    def faces_of(self, names: Sequence[str]) -> tuple[Faces, ...]:
        """Return the faces of the named patches."""
        return tuple(faces for name in names for faces in self.patch(name).faces)

    def expand(self, wanted: Sequence[str], what: str) -> tuple[str, ...]:
        """Return the patches that names and wildcards (``wing*``, in any zone) mean.

        Raises InputError for a name of no patch, with the most similar names, or of a patch that could not be read,
        with the reason.
        """
        names: list[str] = []
        for text in wanted:
            some = [text] if text in self.names else [name for name in self.names if meant(text, name)]
            if (note := self._absent(text)) and len(some) < len(self.names):
                raise InputError(f"{self.name}: {what} {text!r} cannot be taken: {note}")
            if not some:
                hint = nearest(text, self.names, "the patches are")
                cut = CUT * (what == "the surface" and not hint.startswith("did you mean"))
                raise InputError(f"{self.name}: {what} {text!r} is no patch; {hint}{cut}")
            names += [name for name in some if name not in names]
        return tuple(names)

    def _absent(self, text: str) -> str:
        """Return the note on an unreadable patch that a name or wildcard means; empty without one."""
        begin, end = ABSENT.split("{}")
        for note in self.notes:
            name, separator, _ = note.removeprefix(begin).partition(end)
            if note.startswith(begin) and separator and (meant(text, name) or text == name.rpartition("/")[2]):
                return note
        return ""

    def without(self, names: Collection[str]) -> Mesh:
        """Return the mesh with some patches moved to `inner`, where they follow the mesh; a note says so."""
        if not names:
            return self
        inner = tuple(patch for patch in self.patches if patch.name in names)
        rest = tuple(patch for patch in self.patches if patch.name not in names)
        notes = (*self.notes, FOLLOWS.format(short_list(names)))
        return replace(self, patches=rest, inner=(*self.inner, *inner), notes=notes)

    def for_file(self) -> Mesh:
        """Return the mesh with the patches of its file: inner patches among the others, parts within their patches."""
        parts = [patch for patch in self.patches if patch.part_of]
        if not parts and not self.inner:
            return self
        whole = []
        for patch in (patch for patch in self.patches if not patch.part_of):
            joined = [piece for piece in (patch, *parts) if piece.part_of in ("", patch.name)]
            faces = tuple(faces for piece in joined for faces in piece.faces)
            loose = union(*(piece.loose for piece in joined))
            whole.append(replace(patch, faces=faces, loose=loose, labels={}) if joined[1:] else patch)
        return replace(self, patches=(*whole, *self.inner), inner=())

    def with_points(self, points: FloatArray) -> Mesh:
        """Return the mesh with other points (N, 3)."""
        moved = real(points, "points")
        if moved.shape != self.points.shape:
            raise InputError(f"{self.name}: points {moved.shape} must be {self.points.shape}")
        return replace(self, points=moved)


def meant(wildcard: str, patch: str) -> bool:
    """Return whether a wildcard means the patch, its name without the zone, or all its components."""
    name = patch.rpartition("/")[2]
    whole = wildcard != name and (fnmatchcase(name, wildcard) or name.startswith(f"{wildcard}{MARK}"))
    return fnmatchcase(patch, wildcard) or whole

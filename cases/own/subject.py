"""What the deformation needs of a mesh, whatever it came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from fnmatch import fnmatchcase

import numpy as np

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.duplicates import IndexArray
from sdm_deflect.deform.kernels import FloatArray
from sdm_deflect.meshing.formats.flow import Cells, FlowMesh, Polygons, Polyhedra, Zone

Volume = Cells | Polyhedra
Faces = Cells | Polygons


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """Points, named patches and, where there are any, cells.

    Attributes
    ----------
    points : (N, 3) coordinates in the mesh's own unit of length.
    nodes : sorted, distinct node indices of each patch.
    faces : the faces of each patch; empty for a patch that is given by its nodes alone.
    cells : volume cells; may be empty.
    zones : consecutive parts of the points that only their own cells use.
    name : file or kind of mesh, for messages.
    """

    points: FloatArray = field(repr=False)
    nodes: Mapping[str, IndexArray] = field(repr=False)
    faces: Mapping[str, tuple[Faces, ...]] = field(repr=False)
    cells: tuple[Volume, ...]
    zones: tuple[Zone, ...]
    name: str

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError(f"{self.name}: points {self.points.shape} must be (N, 3)")
        bad = ~np.isfinite(self.points).all(axis=1)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(f"{self.name}: {int(bad.sum())} points are not finite, the first is point {row}")
        for name, nodes in self.nodes.items():
            if len(nodes) and (nodes[0] < 0 or nodes[-1] >= len(self.points)):
                raise InputError(
                    f"{self.name}: patch {name} names nodes {nodes[0]} to {nodes[-1]} of {len(self.points)} points"
                )

    def named(self, wanted: Sequence[str], what: str) -> tuple[str, ...]:
        """Return the patches that names and wildcards (``wing*``, in any zone) stand for.

        Raises
        ------
        InputError
            If a name stands for no patch; the message suggests the nearest ones.
        """
        found: list[str] = []
        for text in wanted:
            some = [text] if text in self.nodes else [name for name in self.nodes if meant(text, name)]
            if not some:
                raise InputError(f"{self.name}: {what} {text!r} is no patch; {self._nearest(text)}")
            found += [name for name in some if name not in found]
        return tuple(found)

    def on(self, names: Sequence[str]) -> IndexArray:
        """Sorted, distinct indices (K,) of the nodes on the union of patches."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(self.nodes[name] for name in names)]))

    def faces_of(self, names: Sequence[str]) -> tuple[Faces, ...]:
        """Return the faces on the union of patches."""
        return tuple(faces for name in names for faces in self.faces.get(name, ()))

    def _nearest(self, text: str) -> str:
        close = get_close_matches(text, self.nodes, n=3, cutoff=0.5)
        if close:
            return f"did you mean {', '.join(close)}?"
        return f"the patches are {', '.join(self.nodes) or 'none'}"


def meant(wildcard: str, patch: str) -> bool:
    """True if the wildcard stands for the patch, or for its name without that of its zone."""
    own = patch.rpartition("/")[2]
    return fnmatchcase(patch, wildcard) or (wildcard != own and fnmatchcase(own, wildcard))


def subject_of(mesh: FlowMesh, name: str = "mesh") -> Subject:
    """Return a mesh as the deformation sees it; arrays are shared, not copied."""
    nodes = {patch.name: patch.nodes for patch in mesh.patches}
    faces = {patch.name: patch.faces for patch in mesh.patches}
    return Subject(mesh.points, nodes, faces, mesh.cells, mesh.zones, name)

"""A moving surface, and rules that select its nodes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from numbers import Real
from pathlib import Path
from typing import Protocol

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.unpacking import damaged
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import whole
from sdm_deflect.meshing.mesh.edges import polygons_of, sharp_edges
from sdm_deflect.meshing.mesh.mesh import REGION, Mesh

# Sharp edges farther from the hinge than this share of the largest distance are on the trailing edge.
FAR = 0.5
# Cosine between an edge and the hinge, above which the edge runs along it.
ALONG = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The nodes of some patches.

    Attributes
    ----------
    patches : their names.
    nodes : (K,) sorted node indices.
    mesh : the whole mesh.
    number : 2 for the second moving surface of the same patches, and so on.
    """

    patches: tuple[str, ...]
    nodes: IntArray = field(repr=False)
    mesh: Mesh = field(repr=False)
    number: int = 1

    @classmethod
    def of(cls, mesh: Mesh, names: Sequence[str]) -> "Surface":
        """Collect the nodes of patches; InputError for an unknown patch, or if there are no nodes."""
        patches = mesh.expand(names, "the surface")
        nodes = mesh.on(*patches)
        if not len(nodes):
            raise InputError(f"{mesh.name}: {', '.join(patches)} has no nodes")
        return cls(patches, nodes, mesh)

    @property
    def points(self) -> FloatArray:
        """Undeflected coordinates (K, 3)."""
        return self.mesh.points[self.nodes]

    @property
    def plain_names(self) -> tuple[str, ...]:
        """Names of the patches without panels such as ``body~tail``."""
        return tuple(
            name for name in self.patches if not any(name.endswith(f"{REGION}{patch}") for patch in self.patches)
        )

    @property
    def label(self) -> str:
        """Names of the patches, for messages."""
        return ", ".join(self.plain_names) + self.suffix

    @property
    def suffix(self) -> str:
        """What tells the surface from others of the same patches: nothing, then `` (2)``, `` (3)``."""
        return f" ({self.number})" if self.number > 1 else ""

    def on(self, names: Sequence[str]) -> BoolArray:
        """Return which of the nodes (K,) are also on the named patches."""
        return np.isin(self.nodes, self.mesh.on(*names), assume_unique=True)

    @property
    def neighbours(self) -> tuple[str, ...]:
        """Other patches that share nodes with the surface, except symmetry planes and periodic patches."""
        bound = {name for pair in self.mesh.periodic for name in pair.patches}
        bound |= {patch.name for patch in self.mesh.patches if patch.constraint}
        others = [name for name in self.mesh.names if name not in (*self.patches, *bound)]
        return tuple(name for name in others if self.on([name]).any())


class NodeSet(Protocol):
    """A rule that selects nodes of a surface."""

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return the selected nodes as a mask (K,)."""
        ...


@dataclass(frozen=True, slots=True)
class OnPatches:
    """Nodes that are also on these patches; without names, on any neighbouring patch.

    A wildcard stands for neighbours only; patches of the surface itself must be named in full.

    Parameters
    ----------
    names : One name or wildcard, or several.
    """

    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.names, str):
            object.__setattr__(self, "names", (self.names,))

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return the nodes on the patches, or on any patch beside the surface, as a mask (K,)."""
        del hinge
        if not self.names:
            return surface.on(surface.neighbours)
        names = surface.mesh.expand(self.names, "a node set")
        return surface.on([name for name in names if name in self.names or name not in surface.patches])


@dataclass(frozen=True, slots=True)
class TrailingEdge:
    """Sharp edges along the hinge and far from it; in a plane mesh the nodes where lines turn sharply.

    Parameters
    ----------
    dihedral : Least angle between the faces at the edge: degrees between 0 and 180.

    Raises InputError for any other number.
    """

    dihedral: float = 40.0

    def __post_init__(self) -> None:
        if not isinstance(self.dihedral, Real) or not 0.0 < self.dihedral < 180.0:
            raise InputError(f"dihedral = {shortened(self.dihedral)} must be degrees between 0 and 180")

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return the nodes on edges along the hinge that are sharper than the dihedral angle, as a mask (K,)."""
        points, faces = surface.mesh.points, surface.mesh.faces_of(surface.patches)
        edges = sharp_edges(points, polygons_of(faces), self.dihedral)
        vectors = points[edges[:, 1]] - points[edges[:, 0]]
        along = np.abs(vectors @ hinge.direction) > ALONG * np.linalg.norm(vectors, axis=1)
        along |= edges[:, 0] == edges[:, 1]  # in a plane mesh an edge is one node
        reach = np.linalg.norm(hinge.radial(surface.points), axis=1)
        far = surface.nodes[reach > FAR * reach.max()]
        return np.isin(surface.nodes, np.intersect1d(distinct(edges[along]), far, True), assume_unique=True)


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """Nodes given by their indices in the mesh.

    Parameters
    ----------
    nodes : (K,) indices, counted from 0.

    Raises InputError if they are not whole numbers.
    """

    nodes: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", whole(self.nodes, "node indices").ravel())

    @classmethod
    def read(cls, path: Path) -> "Listed":
        """Read node indices, counted from 0, from a text file; InputError for any other content."""
        with damaged(path, "list of node indices"), path.open(encoding="utf-8") as text:
            return cls(np.loadtxt(text, dtype=np.intp, ndmin=1))

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return the listed nodes as a mask (K,)."""
        del hinge
        return np.isin(surface.mesh.numbers(surface.nodes), self.nodes)


def name_of(patches: Sequence[str]) -> str:
    """Return a name for several patches: the only name, or the common beginning."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*patches, strict=False))
    start = "".join(letters[0] for letters in alike).rstrip("_-. /")
    return patches[0] if len(patches) == 1 else start if len(start) > 2 else f"{patches[0]} and {len(patches) - 1} more"

"""A surface that moves, and ways to say which of its nodes are meant."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sdm_deflect.cases.errors import InputError
from sdm_deflect.deform.edges import polygons_of, sharp_edges
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.surface.axis import Axis

BoolArray = NDArray[np.bool_]
FAR = 0.5  # of the largest distance from the hinge: sharp edges beyond are the trailing edge
ALONG = 0.5  # cosine between an edge and the hinge above which the edge runs along it


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The nodes of some patches.

    Attributes
    ----------
    patches : their names.
    nodes : (K,) sorted node indices.
    subject : the whole mesh.
    """

    patches: tuple[str, ...]
    nodes: IndexArray = field(repr=False)
    subject: Mesh = field(repr=False)

    @classmethod
    def of(cls, subject: Mesh, names: Sequence[str]) -> "Surface":
        """Collect the nodes of patches; InputError for a name that is none, and where there are no nodes."""
        patches = subject.named(names, "the surface")
        nodes = subject.on(*patches)
        if not len(nodes):
            raise InputError(f"{subject.name}: {', '.join(patches)} has no nodes")
        return cls(patches, nodes, subject)

    @property
    def points(self) -> FloatArray:
        """Undeflected coordinates (K, 3)."""
        return self.subject.points[self.nodes]

    def on(self, names: Sequence[str]) -> BoolArray:
        """Return which of the nodes (K,) also lie on the named patches."""
        return np.isin(self.nodes, self.subject.on(*names), assume_unique=True)

    @property
    def neighbours(self) -> tuple[str, ...]:
        """Other patches that share nodes with it."""
        others = [name for name in self.subject.names if name not in self.patches]
        return tuple(name for name in others if self.on([name]).any())


class NodeSet(Protocol):
    """Says which nodes of a surface are meant."""

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return a mask (K,) over the surface's nodes."""
        ...


@dataclass(frozen=True, slots=True)
class OnPatches:
    """Nodes that also lie on these patches: neighbours, or some of the surface's own; none named: any neighbour."""

    names: tuple[str, ...] = ()

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return a mask (K,) over the surface's nodes."""
        del hinge
        names = surface.subject.named(self.names, "a node set") if self.names else surface.neighbours
        return surface.on(names)


@dataclass(frozen=True, slots=True)
class TrailingEdge:
    """Sharp edges that run along the hinge, far from it.

    Parameters
    ----------
    dihedral
        Degrees by which the faces turn at the edge, at least.
    """

    dihedral: float = 40.0

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return a mask (K,) over the surface's nodes."""
        points, faces = surface.subject.points, surface.subject.faces_of(surface.patches)
        edges = sharp_edges(points, polygons_of(faces), self.dihedral)
        vectors = points[edges[:, 1]] - points[edges[:, 0]]
        along = np.abs(vectors @ hinge.direction) > ALONG * np.linalg.norm(vectors, axis=1)
        reach = np.linalg.norm(hinge.radial(surface.points), axis=1)
        far = surface.nodes[reach > FAR * reach.max()]
        return np.isin(surface.nodes, np.intersect1d(edges[along], far), assume_unique=True)


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """Nodes given by their indices in the mesh, counted from 0."""

    nodes: IndexArray

    @classmethod
    def read(cls, path: Path) -> "Listed":
        """Read node indices, counted from 0, from a text file."""
        try:
            return cls(np.loadtxt(path, dtype=np.intp, ndmin=1))
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: no list of node indices: {error}") from None

    def of(self, surface: Surface, hinge: Axis) -> BoolArray:
        """Return a mask (K,) over the surface's nodes."""
        del hinge
        return np.isin(surface.nodes, self.nodes)

"""The interface between the paper's method and its modifiers.

A step interpolates the displacement of the *free* nodes. *Bound* nodes slide on a shape or move like their image: their
displacement is known only after a first fit without them. If there are any, a step has two passes: one for the bound
nodes, then one for the free nodes.
"""

from collections.abc import Sequence
from typing import NamedTuple

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.meshing.mesh.sliding import SlidingSurface


class Linearized:
    """The derivative of a modifier's correction at one motion of the boundary. By default that of no correction."""

    __slots__ = ()

    def sites(self, known: FloatArray) -> Sequence[DataSites]:
        """Return the modifier's data sites in its pass, with rates as values.

        Parameters
        ----------
        known : (B, 3) rates of the known nodes' displacements.
        """
        del known
        return ()

    def sites_reverse(self, gradient: FloatArray) -> FloatArray:
        """Return the gradient (B, 3) by the known nodes, given that (S, 3) by the values at the modifier's sites."""
        raise NotImplementedError

    def forward(self, rate: FloatArray, known: FloatArray) -> FloatArray:
        """Return the rates (M, 3) of the corrected displacements, given those before the correction."""
        del known
        return rate

    def reverse(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray | float]:
        """Convert the gradient (M, 3) by the corrected displacements.

        Returns the gradient (M, 3) by the displacements before the correction, and that (B, 3) by the known nodes'.
        """
        return gradient, 0.0


class ModifierAtStep:
    """A modifier in one step. By default it changes nothing."""

    __slots__ = ()

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return further data sites.

        Parameters
        ----------
        known : Displacements (B, 3) of the known nodes; those of bound nodes are zero in the first of two passes.
        last : Whether the pass is for the free nodes.
        """
        del known, last
        return ()

    def correct(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Return the corrected displacements u (M, 3): of the free nodes in the last pass, else of the bound nodes."""
        del known, last
        return u

    def linearized(self, u: FloatArray, known: FloatArray, last: bool) -> Linearized:
        """Return the derivative of `correct` at its arguments; in the last pass it does not depend on `u`."""
        del u, known, last
        return Linearized()


class NodesOnShape(NamedTuple):
    """Nodes that stay on a shape. A repair keeps them there, and a check measures it.

    Attributes
    ----------
    name : their patch, or what they have in common.
    nodes : (K,) sorted indices.
    shape : the shape, or ``"plane"``: each plane face of the patch, wherever it is.
    of_patch : whether `name` is a patch, all of whose nodes are kept; if not, the nodes are inside the flow.
    """

    name: str
    nodes: IntArray
    shape: SlidingSurface | str
    of_patch: bool = False


class Modifier:
    """A modifier of the paper's method, for all steps in one box."""

    __slots__ = ()

    @property
    def held(self) -> set[int]:
        """Directions of the first pass that nodes of this modifier hold without zero sites; by default none."""
        return set()

    def on_box(self, hexahedron: Hexahedron, sites: FloatArray, spacing: float) -> FloatArray:
        """Return the zero sites (P, 3) on the faces, given those at the usual spacing."""
        del hexahedron, spacing
        return sites

    def shapes(self) -> Sequence[NodesOnShape]:
        """Return the nodes that stay on shapes."""
        return ()

    def at(self, points: FloatArray, free: IntArray) -> ModifierAtStep:
        """Return the modifier in a step that starts with the mesh at points (N, 3); `free` (Q,) are the free nodes."""
        raise NotImplementedError

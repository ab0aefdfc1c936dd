"""The seam between the paper's method and what is added to it.

A step solves for the free nodes. *Bound* nodes slide, or are images of others: their displacement is known only after a
first fit without them. Where there are any, a step has two passes: for the bound nodes, and then for the free ones.
"""

from collections.abc import Sequence
from typing import NamedTuple

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.mesh.sliding import SlidingSurface
from sdm_deflect.deform.rbf.problem import DataSites


class Acting:
    """An addition in one step: what it has no word for, it leaves as it is."""

    __slots__ = ()

    def sites(self, known: FloatArray, last: bool) -> Sequence[DataSites]:
        """Return further data sites.

        Parameters
        ----------
        known : Displacements (B, 3) of the known nodes; before the last pass those of bound nodes are zero.
        last : Whether the pass is for the free nodes; the one before is for the bound nodes.
        """
        del known, last
        return ()

    def corrected(self, u: FloatArray, known: FloatArray, last: bool) -> FloatArray:
        """Return what becomes of displacements u (M, 3) of the free nodes or, before the last pass, the bound ones."""
        del known, last
        return u


class Kept(NamedTuple):
    """Nodes that stay on a shape, which a repair keeps and a check measures.

    Attributes
    ----------
    name : of their patch, or of what they have in common.
    nodes : (K,) sorted indices.
    shape : the shape; ``"plane"`` for each plane face of the patch, wherever that is.
    of_patch : whether `name` is a patch, all of whose nodes are kept; else the nodes are within the flow.
    """

    name: str
    nodes: IntArray
    shape: SlidingSurface | str
    of_patch: bool = False


class Addition:
    """Something that is added to the paper's method, for all steps in one box."""

    __slots__ = ()

    def on_box(self, hexahedron: Hexahedron, sites: FloatArray, spacing: float) -> FloatArray:
        """Return the points (P, 3) on the faces that become zero sites, given those at the usual spacing."""
        del hexahedron, spacing
        return sites

    def shapes(self) -> Sequence[Kept]:
        """Return which nodes stay on which shapes."""
        return ()

    def at(self, points: FloatArray, free: IntArray) -> Acting:
        """Return what acts in a step that starts with the mesh at points (N, 3), of whose nodes (Q,) are free."""
        raise NotImplementedError

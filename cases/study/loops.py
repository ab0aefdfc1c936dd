"""The greedy loops that the studies time against each other."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from sdm_deflect.deform.rbf.bases import Resolved
from sdm_deflect.deform.rbf.factor import Grown
from sdm_deflect.deform.rbf.greedy import Basis
from sdm_deflect.deform.rbf.interpolant import krylov
from sdm_deflect.deform.rbf.points import IndexArray
from sdm_deflect.deform.rbf.problem import Problem
from sdm_deflect.deform.rbf.selection import Rule, Separated, Worst


@dataclass(frozen=True, slots=True)
class Loop:
    """How the centres are chosen and how their coefficients are found.

    Attributes
    ----------
    name : short, for files and legends.
    meaning : one phrase.
    """

    name: str
    meaning: str
    rule: Rule
    basis: Callable[[Problem, IndexArray], Basis]

    @property
    def chooses_as_paper(self) -> bool:
        """True if the centres are those of the paper's rule, whatever the time they take."""
        return isinstance(self.rule, Worst)


GROWN = Loop(
    "grown", "the paper's rule, with one factor for all directions that grows with the centres", Worst(), Grown.of
)
LAPACK = Loop(
    "lapack",
    "the paper's rule, factorised again in every iteration by LAPACK, once for all directions",
    Worst(look_ahead=1),
    Resolved.of,
)
GMRES = Loop(
    "gmres",
    "the paper's loop: its rule, solved again in every iteration by GMRES, for each direction anew",
    Worst(look_ahead=1),
    partial(Resolved.of, solve=krylov()),
)
DEFAULT = Loop("default", "what `sdm run` does: blocks of separated sites, growing factor", Separated(), Grown.of)

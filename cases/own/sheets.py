"""Sliding patches, and which part a patch may play."""

from dataclasses import dataclass, field

from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.own.walls import Wall, fitted
from sdm_deflect.deform.mesh import Mesh
from sdm_deflect.deform.rbf.points import IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A sliding patch: its shape, and all its nodes."""

    patch: str
    wall: Wall
    nodes: IndexArray = field(repr=False)


def sheet_of(subject: Mesh, name: str, shape: str) -> Sheet:
    """Fit a shape to a patch; InputError if it has another."""
    nodes = subject.patch(name).nodes
    return Sheet(name, fitted(shape, subject.points[nodes], name), nodes)


def check_parts(subject: Mesh, moves: list[str], fixed: tuple[str, ...], sliding: dict[str, str]) -> None:
    """Raise if a patch is given two parts."""
    for one, other, what in (
        (moves, fixed, "moving and fixed"),
        (moves, sliding, "moving and sliding"),
        (fixed, sliding, "fixed and sliding"),
    ):
        both = sorted(set(one) & set(other))
        if both:
            raise InputError(f"{subject.name}: patch {both[0]} cannot be {what} at once")
    twice = sorted({name for name in moves if moves.count(name) > 1})
    if twice:
        raise InputError(f"{subject.name}: patch {twice[0]} belongs to two moving surfaces")

"""Periodic pairs of nodes, as files list them, as pairs of patches."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray, union
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.cells import Patch, Periodic
from sdm_deflect.deform.mesh.images import fitted, is_thin, tolerance
from sdm_deflect.deform.mesh.mesh import Mesh

Listed = tuple[str, IntArray]
"""What messages call a pair, and its nodes (K, 2): a node, and its image."""
Places = Callable[[IntArray], FloatArray]
"""Returns the coordinates (K, 3) of nodes (K,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """The periodic pairs of a file.

    Attributes
    ----------
    periodic : the pairs.
    patches : the patches; after them, for pairs whose nodes are on no patch, patches of nodes alone.
    notes : a sentence for each pair that cannot be used.
    """

    periodic: tuple[Periodic, ...]
    patches: tuple[Patch, ...] = field(repr=False)
    notes: tuple[str, ...] = ()


def with_pairs(mesh: Mesh, listed: Iterable[Listed], notes: tuple[str, ...] = ()) -> Mesh:
    """Return the mesh with the pairs that its file lists; `notes` are sentences on others."""
    found = pairs_of(mesh.patches, listed, lambda nodes: mesh.points[nodes])
    notes = (*mesh.notes, *notes, *found.notes)
    return replace(mesh, patches=found.patches, periodic=found.periodic, notes=notes)


def written_pairs(mesh: Mesh) -> list[Periodic]:
    """Return the pairs that a format with periodic sides can hold: of nodes, and not those of a case one cell thick."""
    return [pair for pair in mesh.periodic if len(pair.nodes) and not is_thin(mesh, pair)]


def unwritten(pairs: Iterable[Periodic]) -> tuple[str, ...]:
    """Return a sentence for each pair that a file does not hold."""
    return tuple(f"{' and '.join(pair.patches)} are periodic, which the file does not say" for pair in pairs)


def pairs_of(patches: Sequence[Patch], listed: Iterable[Listed], places: Places) -> Pairs:
    """Return pairs of patches: one for each two patches, and each motion between them, named by the first patch.

    Parameters
    ----------
    patches : those of the mesh.
    listed : what the file lists; a pair may be there in several parts, and once more the other way round.
    places : where the nodes are.
    """
    every, notes, found = list(patches), [], list[Periodic]()
    for name, nodes in listed:
        try:
            new = _fitted(name, ("", ""), nodes, places)
            one, other = (_holder(every, f"{name}~{i}", side) for i, side in enumerate(new.nodes.T, 1))
            every += [patch for patch in dict.fromkeys((one, other)) if patch not in every]
            _enter(found, replace(new, patches=(one.name, other.name)), places)
        except InputError as error:
            notes.append(f"{error}; the pair is left out")
    return Pairs(tuple(found), tuple(every), tuple(notes))


def _fitted(name: str, patches: tuple[str, str], nodes: IntArray, places: Places) -> Periodic:
    """Return a pair with the motion that fits its nodes, each of which is there once."""
    rows = np.unique(nodes, axis=0)
    numbers = union(rows)
    return replace(fitted(places(numbers), name, patches, np.searchsorted(numbers, rows)), nodes=rows)


def _holder(patches: Sequence[Patch], name: str, nodes: IntArray) -> Patch:
    """Return the smallest patch that has all these nodes; a new one of nodes alone if none has."""
    holding = [patch for patch in patches if len(patch.nodes) and _has(patch.nodes, nodes)]
    if holding:
        return min(holding, key=lambda patch: len(patch.nodes))
    names = {patch.name for patch in patches}
    while name in names:
        name += "~"
    return Patch(name, (), nodes)


def _has(known: IntArray, nodes: IntArray) -> bool:
    """Whether all nodes are among known ones, which rise."""
    for own in (nodes[:1], nodes):  # most patches have not even the first
        at = np.minimum(np.searchsorted(known, own), len(known) - 1)
        if not np.array_equal(known[at], own):
            return False
    return True


def _enter(found: list[Periodic], new: Periodic, places: Places) -> None:
    """Add a pair to those found, or its nodes to the one of the same patches and motion."""
    for i, old in enumerate(found):
        for nodes in (new.nodes, new.nodes[:, ::-1]) if set(old.patches) == set(new.patches) else ():
            here, there = places(nodes[:, 0]), places(nodes[:, 1])
            allowed = tolerance(np.concatenate([here, there]), np.arange(2 * len(here)))
            if np.abs(old.image(here) - there).max() <= allowed:
                found[i] = _fitted(old.name, old.patches, np.concatenate([old.nodes, nodes]), places)
                return
    same = sum(pair.patches[0] == new.patches[0] for pair in found)
    found.append(replace(new, name=f"{new.patches[0]}~{same + 1}" if same else new.patches[0]))

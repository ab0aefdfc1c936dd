"""How large a mesh, or a part of it, may be before it is treated in another way; results do not depend on it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SizeLimits:
    """What is held in memory, sent to workers or shown at a time.

    Attributes
    ----------
    file : Bytes of a mesh file from which on it is read in pieces.
    held : Points up to so many are held in memory while cells are read, by a runner that shares it.
    points, cells : Points and cells of a piece.
    sent, sent_pairs : Points sent at a time to be evaluated elsewhere, and pairs with centres from which on they are.
    matrix : Entries of the evaluation matrix of a view, 256 MB; beyond, sums are computed at every angle.
    shown : Cells of the largest mesh that a report's file holds whole.
    """

    file: int = 1 << 25
    held: int = 1 << 23
    points: int = 1 << 20
    cells: int = 1 << 19
    sent: int = 1 << 18
    sent_pairs: int = 1 << 28
    matrix: int = 1 << 25
    shown: int = 100_000


LIMITS = SizeLimits()
"""Those of this process."""

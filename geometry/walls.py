"""The faces of fused cells: which are skin, which lie between two cells."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from cadquery import Face
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.fuse import Cell
from sdm_deflect.geometry.model import CadFace

# Decimals of a metre to which positions are rounded where they order faces: far finer than any two are apart.
ORDER_DECIMALS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A face and the one or two cells it bounds; `shape` is oriented out of the first of them."""

    shape: Face
    cells: tuple[Cell, ...]

    def seen_from(self, cell: Cell) -> Face:
        """The face, oriented out of one of its cells."""
        return self.shape if cell is self.cells[0] else Face(self.shape.wrapped.Reversed())


def walls(cells: Sequence[Cell]) -> list[Wall]:
    """Every face of the cells, once."""
    index = TopTools_IndexedMapOfShape()
    shapes: list[Face] = []
    sides: list[list[Cell]] = []
    for cell in cells:
        for face in cell.solid.Faces():
            position = index.FindIndex(face.wrapped) - 1
            if position < 0:
                index.Add(face.wrapped)
                shapes.append(face)
                sides.append([cell])
            else:
                sides[position].append(cell)
    return [Wall(shape, tuple(side)) for shape, side in zip(shapes, sides, strict=True)]


def skin(
    all_walls: Sequence[Wall], inside: Callable[[Cell], bool], patch: Callable[[Cell, Cell | None], str]
) -> list[CadFace]:
    """The faces between what counts as inside and what does not, oriented outwards.

    Parameters
    ----------
    patch : callable
        Names a face from its inner cell and its outer cell, which is None where there is none.
    """
    faces = []
    for wall in all_walls:
        inner = [cell for cell in wall.cells if inside(cell)]
        outer = [cell for cell in wall.cells if not inside(cell)]
        if len(inner) == 1:
            faces.append(CadFace(wall.seen_from(inner[0]), patch(inner[0], next(iter(outer), None))))
    return ordered(faces)


def partitions(all_walls: Sequence[Wall], inside: Callable[[Cell], bool]) -> list[CadFace]:
    """The other faces, between cells of different parts on the same side of the skin."""
    faces = [
        CadFace(wall.shape, wall.cells[0].patch)
        for wall in all_walls
        if len(wall.cells) == 2
        and inside(wall.cells[0]) == inside(wall.cells[1])
        and wall.cells[0].owner != wall.cells[1].owner
    ]
    return ordered(faces)


def ordered(faces: Sequence[CadFace]) -> list[CadFace]:
    """Faces sorted by patch and centre, so that their order does not depend on the kernel's."""

    def key(face: CadFace) -> tuple[str, list[float]]:
        centre = np.round(face.shape.Center().toTuple(), ORDER_DECIMALS) + 0.0
        return face.patch, centre.tolist()

    return sorted(faces, key=key)

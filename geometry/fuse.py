"""From overlapping parts to disjoint cells that share their faces, and to the faces that are skin."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from cadquery import Face, Shape, Shell, Solid, Vector, Wire
from OCP.BOPAlgo import BOPAlgo_Builder
from OCP.TopoDS import TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.model import CadFace
from sdm_deflect.geometry.polyhedra import Loops
from sdm_deflect.geometry.sections import MIRROR, FloatArray

# Decimals of a metre to which positions are rounded where they order faces: far finer than any two are apart.
ORDER_DECIMALS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A solid and its patch name; where parts overlap, the earlier one in the list owns the volume."""

    patch: str
    solid: Solid


def solid(loops: Sequence[FloatArray]) -> Solid:
    """The solid inside planar polygons (n, 3) that close a volume, in any orientation."""
    faces = [Face.makeFromWires(Wire.makePolygon([Vector(*p) for p in loop], close=True)) for loop in loops]
    closed = Solid.makeSolid(Shell.makeShell(faces))
    return closed if closed.Volume() > 0.0 else Solid(closed.wrapped.Reversed())


def both_sides(name: str, polyhedra: Iterable[Loops]) -> list[Part]:
    """The starboard polyhedra as ``name_right``, and their exact mirror images as ``name_left``."""
    starboard = list(polyhedra)
    return one_side(f"{name}_right", starboard) + one_side(f"{name}_left", starboard)


def one_side(patch: str, starboard: Iterable[Loops]) -> list[Part]:
    """Polyhedra given for the starboard side, on the side that the patch name ends with."""
    factor = MIRROR if patch.endswith("_left") else MIRROR**2
    return [Part(patch, solid([loop * factor for loop in loops])) for loops in starboard]


def centred(name: str, polyhedra: Iterable[Loops]) -> list[Part]:
    """Polyhedra across the plane of symmetry."""
    return [Part(name, solid(loops)) for loops in polyhedra]


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A piece of the fused volume; `owner` is the position of the first part that contains it."""

    solid: Solid
    owner: int
    patch: str


def general_fuse(parts: Sequence[Part]) -> list[Cell]:
    """Cut all parts at each other's faces, without merging anything.

    Raises
    ------
    CadError
        Where the kernel reports a failure or loses a part.
    """
    builder = BOPAlgo_Builder()
    builder.SetRunParallel(False)
    builder.SetUseOBB(True)  # the same pieces, found in two thirds of the time
    for part in parts:
        builder.AddArgument(part.solid.wrapped)
    builder.Perform()
    if builder.HasErrors():
        raise CadError("the CAD kernel could not fuse the parts; move parts whose edges nearly touch")
    pieces = TopTools_IndexedMapOfShape()
    owners: list[int] = []
    for i, part in enumerate(parts):
        for piece in _images(builder, part.solid.wrapped):
            if pieces.FindIndex(piece) == 0:
                pieces.Add(piece)
                owners.append(i)
    found = [Shape.cast(pieces.FindKey(i + 1)) for i in range(len(owners))]
    return [Cell(solid, owner, parts[owner].patch) for solid, owner in zip(found, owners, strict=True)]


def _images(builder: BOPAlgo_Builder, original: TopoDS_Shape) -> list[TopoDS_Shape]:
    images = builder.Images()
    return list(images.Find(original)) if images.IsBound(original) else [original]


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

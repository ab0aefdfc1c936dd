"""From overlapping parts to disjoint cells that share their faces, and to the faces that are skin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cadquery import Edge, Face, Shape, Shell, Solid, Vector, Wire
from OCP.BOPAlgo import BOPAlgo_Builder
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.model import CadFace
from sdm_deflect.geometry.parameters import MIRROR, FloatArray
from sdm_deflect.geometry.polyhedra import Loops

# Decimals of a metre to which positions are rounded where they order faces: far finer than any two are apart.
ORDER_DECIMALS = 7

# A quadrilateral is skew if the volume that its corners span exceeds this share of that of its sides as a box.
RULED, SKEW = 4, 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class NamedSolid:
    """A solid and its patch name; where parts overlap, the earlier one in the list owns the volume."""

    patch: str
    solid: Solid


def solid(loops: Sequence[FloatArray]) -> Solid:
    """The solid inside polygons (n, 3) that close a volume, in any orientation; skew quadrilaterals are ruled."""
    faces = [_face(loop) for loop in loops]
    closed = Solid.makeSolid(Shell.makeShell(faces))
    return closed if closed.Volume() > 0.0 else Solid(closed.wrapped.Reversed())


def _face(loop: FloatArray) -> Face:
    """A planar face within a loop (n, 3), or the ruled one between two opposite sides of a skew one (4, 3)."""
    corners = [Vector(*corner) for corner in loop]
    sides = loop[1:] - loop[0]
    if len(loop) == RULED and abs(np.linalg.det(sides)) > SKEW * np.linalg.norm(sides, axis=1).prod():
        return Face.makeRuledSurface(Edge.makeLine(*corners[:2]), Edge.makeLine(corners[3], corners[2]))
    return Face.makeFromWires(Wire.makePolygon(corners, close=True))


def both_sides(name: str, starboard: Sequence[Loops]) -> list[NamedSolid]:
    """The starboard polyhedra as ``name_right``, and their exact mirror images as ``name_left``."""
    return one_side(f"{name}_right", starboard) + one_side(f"{name}_left", starboard)


def one_side(patch: str, starboard: Sequence[Loops]) -> list[NamedSolid]:
    """Polyhedra as they are, or mirrored for a patch whose name ends in ``_left``."""
    factor = MIRROR if patch.endswith("_left") else MIRROR**2
    return [NamedSolid(patch, solid([loop * factor for loop in loops])) for loops in starboard]


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A piece of the fused volume; `owner` is the position of the first part that contains it."""

    solid: Solid
    owner: int
    patch: str


def general_fuse(parts: Sequence[NamedSolid]) -> list[Cell]:
    """Cut all parts at each other's faces, without merging anything; CadError where the kernel fails."""
    builder = BOPAlgo_Builder()
    builder.SetRunParallel(False)
    builder.SetUseOBB(True)  # the same pieces, found in two thirds of the time
    for part in parts:
        builder.AddArgument(part.solid.wrapped)
    builder.Perform()
    if builder.HasErrors():
        raise CadError("the CAD kernel could not fuse the parts; move parts whose edges nearly touch")
    pieces, images = TopTools_IndexedMapOfShape(), builder.Images()
    owners: list[int] = []
    for i, part in enumerate(parts):
        whole = part.solid.wrapped
        for piece in images.Find(whole) if images.IsBound(whole) else [whole]:
            if pieces.FindIndex(piece) == 0:
                pieces.Add(piece)
                owners.append(i)
    found = [Shape.cast(pieces.FindKey(i + 1)) for i in range(len(owners))]
    return [Cell(solid, owner, parts[owner].patch) for solid, owner in zip(found, owners, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A face and the one or two cells it bounds; `shape` is oriented out of the first of them."""

    shape: Face
    cells: tuple[Cell, ...]


def walls(cells: Sequence[Cell]) -> list[Wall]:
    """Every face of the cells, once."""
    index = TopTools_IndexedMapOfShape()
    sides: list[tuple[Face, list[Cell]]] = []
    for cell in cells:
        for face in cell.solid.Faces():
            if index.FindIndex(face.wrapped) == 0:
                index.Add(face.wrapped)
                sides.append((face, []))
            sides[index.FindIndex(face.wrapped) - 1][1].append(cell)
    return [Wall(shape, tuple(side)) for shape, side in sides]


def skin(all_walls: Sequence[Wall], flow: str | None = None) -> list[CadFace]:
    """The faces around the cells of patch `flow`, or around all cells, oriented outwards.

    A face takes the patch of the cell outside, or where there is none, of the one inside.
    """
    faces = []
    for wall in all_walls:
        inner = [cell for cell in wall.cells if flow in (None, cell.patch)]
        outer = [cell for cell in wall.cells if cell not in inner]
        if len(inner) == 1:
            shape = wall.shape if inner[0] is wall.cells[0] else Face(wall.shape.wrapped.Reversed())
            faces.append(CadFace(shape, (outer or inner)[0].patch))
    return ordered(faces)


def partitions(all_walls: Sequence[Wall], flow: str | None = None) -> list[CadFace]:
    """The other faces, between cells of different parts on the same side of the skin."""
    pairs = [(wall, *wall.cells) for wall in all_walls if len(wall.cells) == 2]
    faces = [
        CadFace(wall.shape, first.patch)
        for wall, first, second in pairs
        if first.owner != second.owner and (flow is None or (first.patch == flow) == (second.patch == flow))
    ]
    return ordered(faces)


def ordered(faces: Sequence[CadFace]) -> list[CadFace]:
    """Faces sorted by patch and centre, so that their order does not depend on the kernel's."""

    def key(face: CadFace) -> tuple[str, list[float]]:
        centre = np.round(face.shape.Center().toTuple(), ORDER_DECIMALS) + 0.0
        return face.patch, centre.tolist()

    return sorted(faces, key=key)

"""Fusion of overlapping parts into disjoint cells that share faces, and the faces of the skin.

Also the parts of fuselage, canopy and inlet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, radians, sin

import cadquery as cq
import numpy as np
from cadquery import Edge, Face, Shape, Shell, Solid, Vector, Wire
from OCP.BOPAlgo import BOPAlgo_Builder
from OCP.TopTools import TopTools_IndexedMapOfShape

from .model import CadFace
from .parameters import MIRROR, Canopy, FloatArray, Fuselage, Inlet
from .polyhedra import Loops
from .quantity import CadError

# Decimals of a metre to which positions are rounded where they order faces: far finer than any two are apart.
ORDER_DECIMALS = 7

# A quadrilateral is skew if the volume that its corners span exceeds this share of that of its sides as a box.
RULED, SKEW = 4, 1e-9
_ORIGIN = cq.Vector(0, 0, 0)
_AXIS = cq.Vector(1, 0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class NamedSolid:
    """A solid and its patch name; a common volume of parts belongs to the earlier one in the list."""

    patch: str
    solid: Solid


def solid(loops: Sequence[FloatArray]) -> Solid:
    """Return the solid inside closed polygons (n, 3), in any orientation; skew quadrilaterals are ruled."""
    faces = [_face(loop) for loop in loops]
    closed = Solid.makeSolid(Shell.makeShell(faces))
    return closed if closed.Volume() > 0.0 else Solid(closed.wrapped.Reversed())


def _face(loop: FloatArray) -> Face:
    """Return a planar face within a loop (n, 3), or the ruled one between two opposite sides of a skew one (4, 3)."""
    corners = [Vector(*corner) for corner in loop]
    sides = loop[1:] - loop[0]
    if len(loop) == RULED and abs(np.linalg.det(sides)) > SKEW * np.linalg.norm(sides, axis=1).prod():
        return Face.makeRuledSurface(Edge.makeLine(*corners[:2]), Edge.makeLine(corners[3], corners[2]))
    return Face.makeFromWires(Wire.makePolygon(corners, close=True))


def both_sides(name: str, starboard: Sequence[Loops]) -> list[NamedSolid]:
    """Return the starboard polyhedra as ``name_right``, and their exact mirror images as ``name_left``."""
    return one_side(f"{name}_right", starboard) + one_side(f"{name}_left", starboard)


def one_side(patch: str, starboard: Sequence[Loops]) -> list[NamedSolid]:
    """Return polyhedra as they are, or mirrored for a patch whose name ends in ``_left``."""
    factor = MIRROR if patch.endswith("_left") else MIRROR**2
    return [NamedSolid(patch, solid([loop * factor for loop in loops])) for loops in starboard]


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """A piece of the fused volume; `owner` is the position of the first part that contains it."""

    solid: Solid
    owner: int
    patch: str


def general_fuse(parts: Sequence[NamedSolid]) -> list[Cell]:
    """Cut all parts at each other's faces, without merging anything; CadError if the kernel fails."""
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
    solids = [Shape.cast(pieces.FindKey(i + 1)) for i in range(len(owners))]
    return [Cell(solid, owner, parts[owner].patch) for solid, owner in zip(solids, owners, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A face and the one or two cells it bounds; `shape` is oriented out of the first of them."""

    shape: Face
    cells: tuple[Cell, ...]


def walls(cells: Sequence[Cell]) -> list[Wall]:
    """Return every face of the cells, once."""
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
    """Return the faces around the cells of patch `flow`, or around all cells, oriented outwards.

    A face has the patch of the cell outside, or else of the cell inside.
    """
    faces = []
    for wall in all_walls:
        inner = [cell for cell in wall.cells if flow in (None, cell.patch)]
        outer = [cell for cell in wall.cells if cell not in inner]
        if len(inner) == 1:
            shape = wall.shape if inner[0] is wall.cells[0] else Face(wall.shape.wrapped.Reversed())
            faces.append(CadFace(shape, (outer or inner)[0].patch))
    return sort_faces(faces)


def partitions(all_walls: Sequence[Wall], flow: str | None = None) -> list[CadFace]:
    """Return the other faces, between cells of different parts on the same side of the skin."""
    pairs = [(wall, *wall.cells) for wall in all_walls if len(wall.cells) == 2]
    faces = [
        CadFace(wall.shape, first.patch)
        for wall, first, second in pairs
        if first.owner != second.owner and (flow is None or (first.patch == flow) == (second.patch == flow))
    ]
    return sort_faces(faces)


def sort_faces(faces: Sequence[CadFace]) -> list[CadFace]:
    """Return faces sorted by patch and centre, so that their order does not depend on the kernel's."""

    def key(face: CadFace) -> tuple[str, list[float]]:
        centre = np.round(face.shape.Center().toTuple(), ORDER_DECIMALS) + 0.0
        return face.patch, centre.tolist()

    return sorted(faces, key=key)


def fuselage_parts(fuselage: Fuselage) -> list[NamedSolid]:
    """Return nose, cylinder and base as sectors of revolution about x.

    Every border of a patch, and every place where the surface is nearly smooth (nose to cylinder, plane of symmetry),
    separates two solids: a mesher finds such a border only if a face stands behind it.
    """
    f, angle = fuselage, fuselage.panel_angle
    parts = []
    for start, side in ((-90.0, "right"), (90.0, "left")):
        lower, upper = 90.0 + start - angle, 90.0 + start + angle
        parts += [
            NamedSolid("fuselage", _sector(_ogive(f, start), 180.0)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.nose_length, f.panel_front, start), 180.0)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.panel_front, f.panel_rear, start), lower - start)),
            NamedSolid(f"fuselage_panel_{side}", _sector(_rectangle(f, f.panel_front, f.panel_rear, lower), 2 * angle)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.panel_front, f.panel_rear, upper), lower - start)),
            NamedSolid("fuselage_rear", _sector(_rectangle(f, f.panel_rear, f.length, start), 180.0)),
        ]
    return parts


def _at(x: float, r: float, polar: float) -> cq.Vector:
    """Return the point at distance `r` from the axis, `polar` degrees above the starboard horizontal."""
    return cq.Vector(x, r * cos(radians(polar)), r * sin(radians(polar)))


def _rectangle(f: Fuselage, front: float, rear: float, polar: float) -> cq.Wire:
    corners = [_at(x, r, polar) for x, r in ((front, 0.0), (front, f.radius), (rear, f.radius), (rear, 0.0))]
    if front == f.nose_length:
        corners[1] = _nose(f, polar).endPoint()
    return cq.Wire.makePolygon(corners, close=True)


def _ogive(f: Fuselage, polar: float) -> cq.Wire:
    apex, foot, arc = _at(0.0, 0.0, polar), _at(f.nose_length, 0.0, polar), _nose(f, polar)
    return cq.Wire.assembleEdges([arc, cq.Edge.makeLine(arc.endPoint(), foot), cq.Edge.makeLine(foot, apex)])


def _nose(f: Fuselage, polar: float) -> cq.Edge:
    """Return the arc from the apex to the shoulder.

    The kernel's arc ends a rounding error beside the given point. At a common end of edges the kernel keeps either
    point, at random. So lines begin at the arc's actual end, and the CAD is always the same.
    """
    apex, shoulder = _at(0.0, 0.0, polar), _at(f.nose_length, f.radius, polar)
    arc_radius = (f.radius**2 + f.nose_length**2) / (2.0 * f.radius)
    middle = 0.5 * f.nose_length
    height = (arc_radius**2 - (f.nose_length - middle) ** 2) ** 0.5 + f.radius - arc_radius
    return cq.Edge.makeThreePointArc(apex, _at(middle, height, polar), shoulder)


def _sector(outline: cq.Wire, degrees: float) -> cq.Solid:
    return cq.Solid.revolve(outline, [], degrees, _ORIGIN, _AXIS)


def canopy_parts(canopy: Canopy) -> list[NamedSolid]:
    """Return an ellipsoid with its poles and its seam inside the fuselage."""
    sphere = cq.Solid.makeSphere(1.0, _ORIGIN, _AXIS, -90, 90, 360).rotate(_ORIGIN, _AXIS, 180.0)
    c = canopy
    scale = [[c.semi_length, 0, 0, c.x], [0, c.semi_width, 0, 0], [0, 0, c.semi_height, c.z]]
    return [NamedSolid("canopy", sphere.transformGeometry(cq.Matrix(scale)))]


def inlet_parts(inlet: Inlet) -> list[NamedSolid]:
    """Return ruled lofts between neighbouring stations."""
    outlines = [_inlet_outline(*station) for station in inlet.stations()]
    lofts = [cq.Solid.makeLoft([a, b], True) for a, b in pairwise(outlines)]
    return [NamedSolid("inlet", loft) for loft in lofts]


def _inlet_outline(x: float, half_width: float, side: float, bottom: float) -> cq.Wire:
    # The top lies well inside the fuselage at every station.
    top = 0.4 * side
    around = ((-half_width, side), (-half_width, top), (half_width, top), (half_width, side))
    corners = [cq.Vector(x, y, z) for y, z in around]
    arc = cq.Edge.makeThreePointArc(corners[-1], cq.Vector(x, 0, bottom), corners[0])
    corners[0], corners[-1] = arc.endPoint(), arc.startPoint()  # for the reason in `_nose`
    return cq.Wire.assembleEdges([*(cq.Edge.makeLine(a, b) for a, b in pairwise(corners)), arc])

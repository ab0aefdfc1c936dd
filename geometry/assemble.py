"""From the skin's faces to the model: sheets behind weak creases, edges, vertices, one solid."""

from collections.abc import Sequence

import numpy as np
from cadquery import Edge, Shape, Solid, Vertex
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Shell
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.curves import curve_of
from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.model import CadEdge, CadFace, CadModel
from sdm_deflect.geometry.surfaces import FloatArray

# Degrees. Flatter creases need an internal face behind them, or the volume mesher rounds them off.
WEAK_CREASE = 6.0

# Where along an edge (by its parameter) the crease is measured.
SAMPLES = np.linspace(0.02, 0.98, 7)


def assemble(skin: Sequence[CadFace], partitions: Sequence[CadFace], fluid_inside: bool) -> CadModel:
    """Build the model from its exterior faces and the internal faces that may have to back their creases.

    Raises
    ------
    CadError
        Where the skin is not closed, comes in several pieces, or is not a valid solid.
    """
    index, owners = _edge_owners(skin)
    vertices = TopTools_IndexedMapOfShape()
    edges = tuple(_edge(Edge(index.FindKey(i + 1)), faces, skin, vertices) for i, faces in enumerate(owners))
    weak = {i for i, edge in enumerate(edges) if edge.crease < WEAK_CREASE}
    sheets = tuple(face for face in partitions if not weak.isdisjoint(_edge_numbers(face, index)))
    vertex_faces: list[set[int]] = [set() for _ in range(vertices.Extent())]
    for edge in edges:
        for vertex in edge.vertices:
            vertex_faces[vertex].update(edge.faces)
    _check_connected(len(skin), edges)
    return CadModel(
        solid=_solid(skin),
        faces=tuple(skin),
        sheets=sheets,
        edges=edges,
        vertices=_positions(vertices),
        vertex_faces=tuple(frozenset(found) for found in vertex_faces),
        fluid_inside=fluid_inside,
    )


def _edge_owners(skin: Sequence[CadFace]) -> tuple[TopTools_IndexedMapOfShape, list[tuple[int, int]]]:
    """All edges of the skin and the two faces of each."""
    index = TopTools_IndexedMapOfShape()
    owners: list[list[int]] = []
    for number, face in enumerate(skin):
        for edge in face.shape.Edges():
            if BRep_Tool.Degenerated_s(edge.wrapped):
                continue
            if index.FindIndex(edge.wrapped) == 0:
                index.Add(edge.wrapped)
                owners.append([])
            owners[index.FindIndex(edge.wrapped) - 1].append(number)
    pairs = []
    for i, faces in enumerate(owners):
        if len(set(faces)) != 2 or len(faces) != 2:
            place = _place(Edge(index.FindKey(i + 1)))
            patches = ", ".join(skin[face].patch for face in faces)
            raise CadError(f"the edge at {place} is shared by {len(faces)} faces ({patches}), expected 2")
        pairs.append((faces[0], faces[1]))
    return index, pairs


def _edge_numbers(face: CadFace, index: TopTools_IndexedMapOfShape) -> set[int]:
    return {index.FindIndex(edge.wrapped) - 1 for edge in face.shape.Edges()}


def _edge(
    shape: Edge, faces: tuple[int, int], skin: Sequence[CadFace], vertices: TopTools_IndexedMapOfShape
) -> CadEdge:
    forward = Edge(shape.wrapped.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    ends = (TopExp.FirstVertex_s(forward.wrapped), TopExp.LastVertex_s(forward.wrapped))
    first, last = (vertices.Add(end) - 1 for end in ends)
    samples = curve_of(forward).at(SAMPLES)
    one, other = (skin[face].normal_at(samples) for face in faces)
    sines = np.linalg.norm(np.cross(one, other), axis=1)
    cosines = np.sum(one * other, axis=1)
    crease = float(np.degrees(np.arctan2(sines, cosines)).min())
    return CadEdge(forward, faces, (first, last), crease)


def _positions(vertices: TopTools_IndexedMapOfShape) -> FloatArray:
    points = [BRep_Tool.Pnt_s(Vertex(vertices.FindKey(i + 1)).wrapped) for i in range(vertices.Extent())]
    return np.array([[p.X(), p.Y(), p.Z()] for p in points]).reshape(-1, 3)


def _check_connected(count: int, edges: Sequence[CadEdge]) -> None:
    reached, frontier = {0}, {0}
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for edge in edges:
        a, b = edge.faces
        neighbours[a].add(b)
        neighbours[b].add(a)
    while frontier:
        frontier = {other for face in frontier for other in neighbours[face]} - reached
        reached |= frontier
    if len(reached) != count:
        raise CadError(f"the skin comes in separate pieces: {len(reached)} of {count} faces hang together")


def _solid(skin: Sequence[CadFace]) -> Solid:
    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    for face in skin:
        builder.Add(shell, face.shape.wrapped)
    shell.Closed(True)
    solid = Shape.cast(BRepBuilderAPI_MakeSolid(shell).Solid())
    if not isinstance(solid, Solid) or not BRepCheck_Analyzer(solid.wrapped).IsValid():
        raise CadError("the CAD kernel's check finds the fused solid invalid")
    if solid.Volume() <= 0.0:
        raise CadError("the fused solid is inside out")
    return solid


def _place(edge: Edge) -> str:
    x, y, z = edge.Center().toTuple()
    return f"({x:.4f}, {y:.4f}, {z:.4f})"

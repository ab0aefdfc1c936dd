"""Assembly of the model from the skin's faces, and a search for places that a volume mesher cannot resolve."""

from collections.abc import Iterator, Sequence

import numpy as np
from cadquery import Compound, Edge, Shape, Solid, Vertex
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Shell
from OCP.TopTools import TopTools_IndexedMapOfShape
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .model import CadEdge, CadFace, CadModel
from .parameters import MIN_FEATURE, FloatArray
from .projection import coordinates, curve_of
from .quantity import CadError

# Degrees. Flatter creases need an internal face behind them, or the volume mesher rounds them off.
WEAK_CREASE = 6.0

# Where along an edge (by its parameter) the crease is measured.
SAMPLES = np.linspace(0.02, 0.98, 7)

# Degrees. Sharper corners of faces are needles.
MIN_CORNER = 15.0

# So many places are named in a message.
SHOWN = 3

# Two lengths count as equal within this (metres): a gap of exactly the smallest feature is fine.
ROUNDING = 1e-9


def assemble(skin: Sequence[CadFace], partitions: Sequence[CadFace], fluid_inside: bool, loose: int = 0) -> CadModel:
    """Build the model from its exterior faces, and internal faces, some of which stand behind its creases.

    CadError if the skin is open, has other than `loose` pieces besides the main one, or a piece is no valid solid.
    """
    index, owners = _edge_owners(skin)
    vertices = TopTools_IndexedMapOfShape()
    edges = tuple(_edge(Edge(index.FindKey(i + 1)), faces, skin, vertices) for i, faces in enumerate(owners))
    weak = {i for i, edge in enumerate(edges, 1) if edge.crease < WEAK_CREASE}
    sheets = tuple(
        face for face in partitions if any(index.FindIndex(edge.wrapped) in weak for edge in face.shape.Edges())
    )
    return CadModel(
        solid=_solids(skin, edges, loose),
        faces=tuple(skin),
        sheets=sheets,
        edges=edges,
        vertices=coordinates(
            BRep_Tool.Pnt_s(Vertex(vertices.FindKey(i + 1)).wrapped) for i in range(vertices.Extent())
        ),
        vertex_faces=_vertex_faces(edges, vertices.Extent()),
        fluid_inside=fluid_inside,
    )


def _vertex_faces(edges: Sequence[CadEdge], count: int) -> tuple[frozenset[int], ...]:
    faces: list[set[int]] = [set() for _ in range(count)]
    for edge in edges:
        for vertex in edge.vertices:
            faces[vertex].update(edge.faces)
    return tuple(map(frozenset, faces))


def _edge_owners(skin: Sequence[CadFace]) -> tuple[TopTools_IndexedMapOfShape, list[tuple[int, int]]]:
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
            x, y, z = Edge(index.FindKey(i + 1)).Center().toTuple()
            patches = ", ".join(skin[face].patch for face in faces)
            place = f"({x:.4f}, {y:.4f}, {z:.4f})"
            raise CadError(f"the edge at {place} is shared by {len(faces)} faces ({patches}), expected 2")
        pairs.append((faces[0], faces[1]))
    return index, pairs


def _edge(
    shape: Edge, faces: tuple[int, int], skin: Sequence[CadFace], vertices: TopTools_IndexedMapOfShape
) -> CadEdge:
    forward = Edge(shape.wrapped.Oriented(TopAbs_Orientation.TopAbs_FORWARD))
    ends = (TopExp.FirstVertex_s(forward.wrapped), TopExp.LastVertex_s(forward.wrapped))
    first, last = (vertices.Add(end) - 1 for end in ends)
    samples = curve_of(forward).at(SAMPLES)
    left, right = (skin[face].normal_at(samples) for face in faces)
    sines = np.linalg.norm(np.cross(left, right), axis=1)
    cosines = np.sum(left * right, axis=1)
    crease = float(np.degrees(np.arctan2(sines, cosines)).min())
    return CadEdge(forward, faces, (first, last), crease)


def _solids(skin: Sequence[CadFace], edges: Sequence[CadEdge], loose: int) -> Solid | Compound:
    """Return a solid of connected faces, or a compound of several solids if some are `loose`."""
    faces = np.array([edge.faces for edge in edges], dtype=np.intp).reshape(-1, 2)
    links = coo_array((np.ones(len(faces), dtype=bool), tuple(faces.T)), shape=(len(skin), len(skin)))
    count, piece = connected_components(links, directed=False)
    if count != 1 + loose:
        raise CadError(f"the skin comes in {count} separate pieces instead of {1 + loose}")
    solids = [_solid([skin[i] for i in np.flatnonzero(piece == number).tolist()]) for number in range(count)]
    return Compound.makeCompound(solids) if loose else solids[0]


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


def preflight(model: CadModel, min_edge: float = MIN_FEATURE) -> None:
    """Check that edges are at least `min_edge` metres long, corners are wide enough, and weak creases have a sheet.

    CadError names the first places that a mesher would fail at, with the patches that meet there.
    """
    findings = [*_short_edges(model, min_edge), *_sharp_corners(model), *_unbacked_creases(model)]
    if findings:
        others = f"; and {len(findings) - SHOWN} more" if len(findings) > SHOWN else ""
        raise CadError(f"the geometry cannot be meshed: {'; '.join(findings[:SHOWN])}{others}")


def _short_edges(model: CadModel, min_edge: float) -> Iterator[str]:
    for edge in model.edges:
        if edge.length < min_edge - ROUNDING:
            yield f"an edge {1e3 * edge.length:.2g} mm short {_place(model, edge)}"


def _sharp_corners(model: CadModel) -> Iterator[str]:
    for (face, vertex), directions in _corners(model).items():
        if len(directions) != 2:
            continue
        angle = float(np.degrees(np.arccos(np.clip(directions[0] @ directions[1], -1.0, 1.0))))
        if angle < MIN_CORNER:
            x, y, z = model.vertices[vertex]
            patch = model.faces[face].patch
            yield f"a face corner of {angle:.3g} deg on {patch} at ({x:.4f}, {y:.4f}, {z:.4f})"


def _corners(model: CadModel) -> dict[tuple[int, int], list[FloatArray]]:
    """Return, for each (face, vertex), the unit directions (3,) of the face's edges there.

    They are chords over the smallest feature: an intersection curve's tangent can be off at its very end.
    """
    corners: dict[tuple[int, int], list[FloatArray]] = {}
    for edge in model.edges:
        share = min(MIN_FEATURE / edge.length, 0.4)
        near = edge.at(np.array([0.0, share, 1.0 - share, 1.0]))
        for vertex, chord in zip(edge.vertices, (near[1] - near[0], near[2] - near[3]), strict=True):
            for face in edge.faces:
                corners.setdefault((face, vertex), []).append(chord / np.linalg.norm(chord))
    return corners


def _unbacked_creases(model: CadModel) -> Iterator[str]:
    backed = TopTools_IndexedMapOfShape()
    for sheet in model.sheets:
        for edge in sheet.shape.Edges():
            backed.Add(edge.wrapped)
    for cad_edge in model.edges:
        if cad_edge.crease < WEAK_CREASE and not backed.Contains(cad_edge.shape.wrapped):
            yield f"a crease of {cad_edge.crease:.3g} deg with no face behind it {_place(model, cad_edge)}"


def _place(model: CadModel, edge: CadEdge) -> str:
    x, y, z = edge.at(np.array([0.5]))[0]
    first, second = (model.faces[face].patch for face in edge.faces)
    return f"between {first} and {second} at ({x:.4f}, {y:.4f}, {z:.4f})"

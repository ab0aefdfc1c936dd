"""What a volume mesher cannot resolve, found in the CAD before any mesh is made."""

from collections.abc import Iterator

import numpy as np
from OCP.TopTools import TopTools_IndexedMapOfShape

from sdm_deflect.geometry.assemble import WEAK_CREASE
from sdm_deflect.geometry.errors import CadError
from sdm_deflect.geometry.layout import MIN_FEATURE
from sdm_deflect.geometry.model import CadEdge, CadModel
from sdm_deflect.geometry.surfaces import FloatArray

# Degrees. Sharper corners of faces are needles.
MIN_CORNER = 15.0

# So many places are named in a message.
SHOWN = 3

# Two lengths count as equal within this (metres): a gap of exactly the smallest feature is fine.
ROUNDING = 1e-9


def preflight(model: CadModel, min_edge: float = MIN_FEATURE) -> None:
    """Check that edges have at least `min_edge` metres, face corners their angle, weak creases their sheet.

    Raises
    ------
    CadError
        Naming the first places that a mesher would fail at, with the patches that meet there.
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
    """For each (face, vertex), the unit directions of the face's edges there.

    Chords over the smallest feature count, not tangents: at its very end an intersection curve's can be off.
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

"""Checks of a mesh's boundary by MeshLab: closed, oriented, without intersections, near the CAD faces."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.meshing import child
from sdm_deflect.meshing.child import MeshingError
from sdm_deflect.meshing.mesh.labelled import skin, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import signed_volumes

if TYPE_CHECKING:
    from sdm_deflect.geometry.model import CadModel

# Longest time of MeshLab in seconds: a boundary that makes no sense may never end.
SECONDS = 600.0
# Chord error (m) of the triangles that stand for the CAD's curved faces; on planes they are exact.
DEFLECTION = 1e-4
# Largest distance (m) of a CAD face's boundary nodes from its triangles: measured, at most 0.97 chord errors.
OFF_CAD = 2.0 * DEFLECTION
# Largest distance of a CAD face from its boundary triangles, by their longest edge: measured, at most 0.08.
OFF_MESH = 0.25
# Largest share by which the boundary may enclose another volume than the cells fill: measured, 2e-15.
ENCLOSED = 1e-9

Triangulation = tuple[FloatArray, IntArray, IntArray]


def meshlab_failures(mesh: Mesh, model: "CadModel") -> list[str]:
    """Return a sentence for each fault of the boundary that MeshLab finds; none for a usable boundary.

    MeshLab works in a separate process. If a bad boundary makes it crash or hang, a sentence says so.
    """
    points, triangles, face = triangulate(model)
    boundary = skin(mesh)
    question = {
        "points": mesh.points,
        "triangles": boundary.triangles,
        "face": boundary.face,
        "cad_points": points,
        "cad_triangles": triangles,
        "cad_face": face,
    }
    try:
        answer = child.call("sdm_deflect.meshing.generate.meshlab_worker", question, SECONDS)
    except MeshingError as error:
        return [f"MeshLab cannot judge the boundary: {error}"]
    return [*surface_failures(mesh, answer), *cad_failures(mesh, model, answer)]


def triangulate(model: "CadModel") -> Triangulation:
    """Return points (N, 3), triangles (T, 3) of all CAD faces, without those of no area, and the face (T,) of each."""
    points, triangles, face, count = [], [], [], 0
    for index, cad in enumerate(model.faces):
        nodes, rows = cad.tessellation(DEFLECTION)
        corners = nodes[rows]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        rows = rows[doubled.any(axis=1)]
        points.append(nodes)
        triangles.append(rows + count)
        face.append(np.full(len(rows), index))
        count += len(nodes)
    return np.concatenate(points), np.concatenate(triangles), np.concatenate(face)


def surface_failures(mesh: Mesh, answer: child.Arrays) -> Iterator[str]:
    """Yield why the boundary is no closed surface around the cells, or intersects itself."""
    for name, text in (
        ("crowded", "{} boundary triangles are at edges that more than two share"),
        ("open", "the boundary is not closed: {} edges have one triangle"),
        ("pinched", "the boundary touches itself at {} nodes"),
    ):
        if answer[name]:
            yield text.format(answer[name])
    if "crossing" not in answer:
        return
    if answer["turned"]:
        yield "boundary triangles are turned against their neighbours"
    rows, filled = answer["crossing"], float(signed_volumes(mesh.points, tets_of(mesh)).sum())
    if len(rows):
        x, y, z = mesh.points[skin(mesh).triangles[rows[0]]].mean(axis=0)
        yield f"{len(rows)} boundary triangles cross others, the first at ({x:.4f}, {y:.4f}, {z:.4f}) m"
    if not abs(float(answer["volume"]) - filled) <= ENCLOSED * abs(filled):
        yield f"the boundary encloses {float(answer['volume']):.9g} m^3, the cells fill {filled:.9g} m^3"


def cad_failures(mesh: Mesh, model: "CadModel", answer: child.Arrays) -> Iterator[str]:
    """Yield a sentence for each CAD face whose boundary triangles are missing or elsewhere."""
    boundary = skin(mesh)
    for index in np.setdiff1d(np.arange(len(model.faces)), boundary.face):
        yield f"no boundary triangle is on {_name(model, index)}"
    measures = (answer[name] for name in ("faces", "folded", "off_cad", "off_mesh"))
    for index, folded, off_cad, off_mesh in zip(*measures, strict=True):
        corners = mesh.points[boundary.triangles[boundary.face == index]]
        longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
        if folded:
            yield f"{folded:g} boundary triangles on {_name(model, index)} are folded over others"
        if not off_cad <= OFF_CAD:
            yield f"boundary nodes are up to {off_cad:.1e} m off {_name(model, index)}, which they belong to"
        if not off_mesh <= max(OFF_MESH * longest, OFF_CAD):
            yield f"{_name(model, index)} is up to {off_mesh:.1e} m off its boundary triangles"


def _name(model: "CadModel", index: int) -> str:
    return f"CAD face {index} of {model.faces[index].patch}"

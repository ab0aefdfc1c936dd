"""Generation of a verified mesh from CAD, and uniform red refinement.

Refinement splits every tetrahedron into eight; new boundary nodes are moved onto the exact CAD.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.geometry.model import CadModel
from sdm_deflect.meshing.child import LateError, MeshingError
from sdm_deflect.meshing.mesh.labelled import Skin, skin, tetrahedral, tets_of
from sdm_deflect.meshing.mesh.mesh import Mesh

from .assembly import assemble
from .attachment import TET_EDGES, TRIANGLE_EDGES, attach, encode, snap
from .parameters import FAR_EDGE, MeshParameters
from .sizing import SizeField, background, size_field, sources
from .verify import Verification, verify
from .volume import PADDING, InputSurface, fill, mesh_surface

# Nodes 0 ... 3 are the parent's, 4 ... 9 the midpoints of TET_EDGES. Each child keeps the parent's orientation.
CORNER_CHILDREN = np.array([[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]])
DIAGONALS = np.array([[4, 9], [5, 8], [6, 7]])
RINGS = np.array([[5, 6, 8, 7], [4, 7, 9, 6], [4, 5, 9, 8]])
# Nodes 0 ... 2 are the parent's, 3 ... 5 the midpoints of TRIANGLE_EDGES.
TRIANGLE_CHILDREN = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
# By how much the mesher's aim is raised after a failure, and where that ends.
EFFORT = 0.05
HIGHEST_AIM = 0.5
# Low and high corner (3,); points (S, 3) and the edge lengths (S,) wanted there; metres.
Box = tuple[FloatArray, FloatArray]
Finer = tuple[FloatArray, FloatArray]
# Where the flow is inside the solid the mesher's box exceeds it by this share.
ALLOWANCE = 0.05
# And the far field is this share further away than asked for.
SLACK = 0.01


def split_cells(mesh: Mesh) -> Mesh:
    """Split every tetrahedron into eight and every boundary triangle into four, at the midpoints of all edges.

    The octahedron in the middle is cut along its shortest diagonal (Bey 1995 discusses the choice). Old nodes come
    first and keep their places, so meshes are nested; the children of a cell follow one another.
    """
    tets, boundary = tets_of(mesh), skin(mesh)
    codes, middle = np.unique(encode(_ends(tets, TET_EDGES)), return_inverse=True)
    count = len(mesh.points)
    points = np.concatenate([mesh.points, 0.5 * (mesh.points[codes >> 32] + mesh.points[codes & 0xFFFFFFFF])])
    parents = np.concatenate([tets, count + middle.reshape(-1, 6)], axis=1)
    sides = count + np.searchsorted(codes, encode(_ends(boundary.triangles, TRIANGLE_EDGES))).reshape(-1, 3)
    triangles = np.concatenate([boundary.triangles, sides], axis=1)[:, TRIANGLE_CHILDREN]
    finer = Skin(triangles.reshape(-1, 3), np.repeat(boundary.patch, 4), np.repeat(boundary.face, 4))
    return tetrahedral(points, _children(points, parents), finer, mesh.names, mesh.name)


def refine(mesh: Mesh, model: CadModel) -> Mesh:
    """Split a mesh, and move its new boundary nodes onto the CAD model that it was made from; old nodes stay."""
    finer = split_cells(mesh)
    triangles, _, face = skin(finer)
    attachment = attach(finer.points, triangles[face >= 0], face[face >= 0], model)
    points = snap(finer.points, attachment, model)
    points[: len(mesh.points)] = mesh.points
    return finer.with_points(points)


def _ends(cells: IntArray, edges: IntArray) -> IntArray:
    """Return the end nodes (K, 2), low first, of all edges of all cells."""
    return np.sort(cells[:, edges].reshape(-1, 2), axis=1)


def _children(points: FloatArray, parents: IntArray) -> IntArray:
    """Return eight tetrahedra (8 M, 4) for each parent (M, 10)."""
    ends = points[parents[:, DIAGONALS]]
    lengths = np.einsum("mdk,mdk->md", ends[:, :, 0] - ends[:, :, 1], ends[:, :, 0] - ends[:, :, 1])
    shortest = lengths.argmin(axis=1)
    children = np.empty((len(parents), 8, 4), dtype=np.intp)
    children[:, :4] = parents[:, CORNER_CHILDREN]
    rows = np.arange(len(parents))[:, None]
    diagonal, ring = parents[rows, DIAGONALS[shortest]], parents[rows, RINGS[shortest]]
    children[:, 4:, 0] = diagonal[:, :1]
    children[:, 4:, 1] = diagonal[:, 1:]
    children[:, 4:, 2] = ring
    children[:, 4:, 3] = np.roll(ring, -1, axis=1)
    return children.reshape(-1, 4)


@dataclass(frozen=True, slots=True)
class MeshReport:
    """Report on a generated mesh: figures, attempts, seconds, and the volume mesher's peak memory in bytes.

    `unseeded` is the reason why another run gives another mesh; "" if it gives the same.
    """

    verification: Verification
    attempts: int
    rejected: tuple[str, ...]
    seconds: float
    peak_bytes: int
    processor_seconds: float
    unseeded: str


@dataclass(frozen=True, slots=True, eq=False)
class Generated:
    """A mesh that passed verification, and its report."""

    mesh: Mesh
    report: MeshReport


def generate(
    model: CadModel, parameters: MeshParameters, progress: Progress = silent, finer: Finer | None = None
) -> Generated:
    """Mesh the flow around (or inside) a CAD model.

    Each attempt has another seed and gives another mesh; a mesh that fails verification is never returned.

    Parameters
    ----------
    progress : called with a stage and the fraction done, nan where that is unknown
    finer : further points (S, 3) where cells must be small, and edge lengths (S,)

    Raises MeshingError if no attempt passes; the message holds each attempt's failures. An attempt that takes too long
    ends the run with a LateError: with another attempt the mesh would depend on the clock.
    """
    start = time.perf_counter()
    progress("surface mesh", 0.0)
    field, box, surface = prepare(model, parameters, finer)
    rejected: list[str] = []
    for attempt in range(1, parameters.max_attempts + 1):
        progress(f"volume mesh, attempt {attempt}", float("nan"))
        try:
            filling = fill(surface, field, box, harder(parameters, attempt))
            progress(f"boundary, attempt {attempt}", 0.9)
            mesh = assemble(filling, surface, model, parameters.envelope)
            for _ in range(parameters.refinements):
                mesh = refine(mesh, model)
        except LateError as error:
            raise LateError(f"{error}: allow more by max_seconds, or give another seed") from None
        except MeshingError as error:
            rejected.append(str(error))
            continue
        verification = verify(mesh, model, parameters)
        if not verification.failures:
            seconds = time.perf_counter() - start
            used = (seconds, filling.peak_bytes, filling.processor_seconds, filling.unseeded)
            return Generated(mesh, MeshReport(verification, attempt, tuple(rejected), *used))
        rejected.append("; ".join(verification.failures))
    reasons = " | ".join(f"attempt {i}: {reason}" for i, reason in enumerate(rejected, 1))
    raise MeshingError(f"no usable mesh in {parameters.max_attempts} attempts: {reasons}")


def harder(parameters: MeshParameters, attempt: int) -> MeshParameters:
    """Return the parameters of a further attempt (1, 2, ...): another seed and a stricter goal for the mesher."""
    aim = min(parameters.aim + EFFORT * (attempt - 1), HIGHEST_AIM)
    return replace(parameters, aim=aim, seed=parameters.seed + attempt - 1)


def prepare(
    model: CadModel, parameters: MeshParameters, finer: Finer | None = None
) -> tuple[SizeField, Box, InputSurface]:
    """Return the target sizes, the box to fill and the surface mesh, which all attempts share.

    MeshingError if the surface cannot be meshed.
    """
    points, lengths = sources(model, parameters)
    known = np.concatenate([points, model.vertices])
    low, high = known.min(axis=0), known.max(axis=0)
    extent = float((high - low).max())
    distance = (ALLOWANCE if model.fluid_inside else parameters.far_field) * extent
    largest = FAR_EDGE * (extent if model.fluid_inside else distance)
    if finer is not None:
        points, lengths = np.concatenate([points, finer[0]]), np.concatenate([lengths, finer[1]])
    field = size_field(points, lengths, parameters.growth, largest)
    # Samples fall a little short of the body's ends.
    around = distance * (1.0 + SLACK) + SLACK * extent
    box = (low - around, high + around)
    padding = PADDING * (box[1] - box[0])
    surface = mesh_surface(model, background(field, box[0] - padding, box[1] + padding))
    return field, box, surface

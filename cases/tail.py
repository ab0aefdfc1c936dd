"""Case 5.3: the left tail turns on the cylindrical rear fuselage (appendix A)."""

import numpy as np

from sdm_deflect.cases.case import AdaptationSettings, Blending, Case, Confinement, Deflection
from sdm_deflect.cases.confine import ConfinementError, hexahedron_of
from sdm_deflect.cases.motion import BoolArray, FloatArray, IndexArray, SurfaceMotion, axis_of
from sdm_deflect.deform.rbf.kernels import Multiquadric
from sdm_deflect.deform.surface.appendix import elongate, slide_panel
from sdm_deflect.deform.surface.axis import Axis, Cylinder
from sdm_deflect.deform.volume.hexahedron import Hexahedron, box
from sdm_deflect.geometry import datum
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.mesh import TetMesh

TAIL = Case(
    name="tail",
    title="left horizontal tail on the fuselage cylinder (section 5.3)",
    deflections=(Deflection("tail_left"),),
    angle=12.0,
    confinement=Confinement(aft=0.080),
    adaptation=AdaptationSettings(initial_surface=100, initial_hexahedron=100, n_add=12, max_centers=2200),
)


def tail_motion(case: Case, mesh: TetMesh, surface: str, angle: float) -> SurfaceMotion:
    """Rotate the tail, extend its root onto the cylinder, and let the fuselage panel follow on the cylinder.

    Every plane of the tail contains the apex of its trapezoid, so a node that slides along its ray to the
    (rotated) apex stays on its planes: the root line slides until it meets the cylinder, and a multiquadric
    of that sliding distance extends the root region (the paper interpolates the displacement vector, which
    leaves the planes by what the blending is not affine). The panel follows by thin plate splines between
    root line and border, then radially back onto the cylinder.
    """
    panel, fighter = panel_of(surface), case.fighter
    nodes, cylinder = mesh.on(surface), fuselage_cylinder(fighter)
    root: BoolArray = np.isin(nodes, mesh.on(panel), assume_unique=True)
    axis = axis_of(fighter, surface)
    rotated = axis.rotated(mesh.points[nodes], angle)
    tip = axis.rotated(apex(datum.ends(fighter, surface))[None], angle)[0]
    slid = rotated + root_extension(rotated, root, tip, cylinder, case.blending)
    slides = slid - mesh.points[nodes]
    region = hexahedron_of(case, surface)
    on_panel, panel_slides = panel_motion(mesh, panel, region, cylinder, nodes[root], slides[root])
    every = np.union1d(nodes, on_panel)
    displacements = np.zeros((len(every), 3))
    displacements[np.searchsorted(every, on_panel)] = panel_slides
    displacements[np.searchsorted(every, nodes)] = slides
    return SurfaceMotion(every, displacements, np.isin(every, nodes), (surface, panel))


def panel_of(surface: str) -> str:
    """Return the fuselage panel on which a tail turns."""
    return f"fuselage_panel_{surface.removeprefix('tail_')}"


def apex(sections: FloatArray) -> FloatArray:
    """Return the point (3,) where the lines through corresponding vertices of two sections (2, k, 3) meet."""
    directions = sections[1] - sections[0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - np.einsum("ki,kj->kij", directions, directions)
    right = np.einsum("kij,kj->i", across, sections[0])
    return np.asarray(np.linalg.solve(across.sum(axis=0), right), dtype=np.float64)


def fuselage_cylinder(fighter: Fighter) -> Cylinder:
    """Return the cylinder of the rear fuselage."""
    point, direction, radius = datum.cylinder(fighter)
    return Cylinder(Axis(point, direction), radius)


def root_extension(
    rotated: FloatArray, root: BoolArray, apex: FloatArray, cylinder: Cylinder, blending: Blending
) -> FloatArray:
    """Displacement (K, 3) that extends the rotated tail (K, 3) onto the cylinder along the rays to its apex.

    The root nodes slide until they meet the cylinder. Nodes within `blending.root` outboard of them slide by a
    multiquadric of that distance, which is zero at the tip-facing end of the root region.
    """
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    try:
        onto = cylinder.projected_along(rotated[root], rays[root]) - rotated[root]
    except ValueError as error:
        raise ConfinementError(f"the tail turns so far that its root misses the fuselage: {error}") from None
    distances = np.einsum("ij,ij->i", onto, rays[root])[:, None]
    region, tip = root_region(rotated[root], blending.root)
    still = region.sites_on(tip, 0.25 * blending.root)
    kernel = Multiquadric(blending.epsilon)
    extension = elongate(rotated, region, rotated[root], distances, still, kernel) * rays
    extension[root] = onto
    return np.asarray(extension, dtype=np.float64)


def root_region(root: FloatArray, depth: float) -> tuple[Hexahedron, str]:
    """Return the box that encloses the root region and ends `depth` outboard of the root line (R, 3).

    The second value names its face towards the tip.
    """
    low, high = root.min(axis=0) - depth, root.max(axis=0) + depth
    return box(low, high), "y-" if root[:, 1].mean() < 0.0 else "y+"


def panel_motion(
    mesh: TetMesh, panel: str, region: Hexahedron, cylinder: Cylinder, root: IndexArray, root_moves: FloatArray
) -> tuple[IndexArray, FloatArray]:
    """Displacement of the fuselage panel's nodes: thin plate splines, then radially back onto the cylinder.

    Nodes on the panel's border and outside the hexahedron stay.

    Returns
    -------
    nodes : (P,) indices of the panel's nodes.
    displacements : (P, 3), exactly `root_moves` at the root line and zero on the border and outside.
    """
    nodes = mesh.on(panel)
    points = mesh.points[nodes]
    on_root = np.isin(nodes, root, assume_unique=True)
    others = [name for name in mesh.names[1:] if name != panel]
    border = (np.isin(nodes, mesh.on(*others), assume_unique=True) | ~region.contains(points)) & ~on_root
    moves = root_moves[np.searchsorted(root, nodes[on_root])]
    values = slide_panel(points, cylinder, points[on_root], moves, points[border])
    values[on_root], values[border] = moves, 0.0
    return nodes, values

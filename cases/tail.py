"""Case 5.3: the left tail turns on the cylindrical rear fuselage (appendix A)."""

import numpy as np

from cases.case import AdaptationSettings, Blending, Case, Deflection
from cases.motion import FloatArray, SurfaceMotion, axis_of
from deform.hexahedron import Hexahedron, box
from deform.kernels import Multiquadric
from deform.motion import Axis, Cylinder
from deform.surface import elongate, slide_panel
from geometry import datum
from geometry.parameters import Fighter
from meshing.mesh import TetMesh

TAIL = Case(
    name="tail",
    title="left horizontal tail on the fuselage cylinder (section 5.3)",
    deflections=(Deflection("tail_left"),),
    angle=12.0,
    adaptation=AdaptationSettings(initial_surface=100, initial_hexahedron=100, n_add=12, max_centers=2200),
)


def tail_motion(mesh: TetMesh, fighter: Fighter, surface: str, angle: float, blending: Blending) -> SurfaceMotion:
    """Rotate the tail, extend its root onto the cylinder, and let the fuselage panel follow on the cylinder.

    Every plane of the tail contains the apex of its trapezoid, so a node that slides along its ray to the
    (rotated) apex stays on its planes: the root line slides until it meets the cylinder, and a multiquadric
    of that sliding distance extends the root region (the paper interpolates the displacement vector, which
    leaves the planes by what the blending is not affine). The panel follows by thin plate splines between
    root line and border, then radially back onto the cylinder.
    """
    panel = f"fuselage_panel_{surface.removeprefix('tail_')}"
    nodes, cylinder = mesh.on(surface), fuselage_cylinder(fighter)
    root = np.isin(nodes, mesh.on(panel), assume_unique=True)
    rotated, axis = axis_of(fighter, surface).rotated(mesh.points[nodes], angle), axis_of(fighter, surface)
    apex = axis.rotated(datum.apex(fighter, surface)[None], angle)[0]
    slid = rotated + root_extension(rotated, root, apex, cylinder, blending)
    moved_root = nodes[root], slid[root] - mesh.points[nodes[root]]
    on_panel, panel_moves = panel_motion(mesh, panel, cylinder, *moved_root)
    every = np.union1d(nodes, on_panel)
    displacements = np.zeros((len(every), 3))
    displacements[np.searchsorted(every, on_panel)] = panel_moves
    displacements[np.searchsorted(every, nodes)] = slid - mesh.points[nodes]
    return SurfaceMotion(every, displacements, np.isin(every, nodes), (surface, panel))


def fuselage_cylinder(fighter: Fighter) -> Cylinder:
    """Return the cylinder of the rear fuselage."""
    point, direction, radius = datum.cylinder(fighter)
    return Cylinder(Axis(point, direction), radius)


def root_extension(
    rotated: FloatArray, root: FloatArray, apex: FloatArray, cylinder: Cylinder, blending: Blending
) -> FloatArray:
    """Displacement (K, 3) that extends the rotated tail (K, 3) onto the cylinder along the rays to its apex.

    The root nodes slide until they meet the cylinder. Nodes within `blending.root` outboard of them slide by a
    multiquadric of that distance, which is zero at the tip-facing end of the root region.
    """
    rays = (apex - rotated) / np.linalg.norm(apex - rotated, axis=1, keepdims=True)
    onto = cylinder.projected_along(rotated[root], rays[root]) - rotated[root]
    distances = np.einsum("ij,ij->i", onto, rays[root])[:, None]
    region, tip = root_region(rotated[root], blending.root)
    still = region.sites_on(tip, 0.25 * blending.root)
    kernel = Multiquadric(blending.epsilon)
    extension = elongate(rotated, region, rotated[root], distances, still, kernel) * rays
    extension[root] = onto
    return extension


def root_region(root: FloatArray, depth: float) -> tuple[Hexahedron, str]:
    """Return the box that encloses the root region and ends `depth` outboard of the root line (R, 3).

    The second value names its face towards the tip.
    """
    low, high = root.min(axis=0) - depth, root.max(axis=0) + depth
    return box(low, high), "y-" if root[:, 1].mean() < 0.0 else "y+"


def panel_motion(
    mesh: TetMesh, panel: str, cylinder: Cylinder, root: np.ndarray, root_moves: FloatArray
) -> tuple[np.ndarray, FloatArray]:
    """Displacement of the fuselage panel's nodes: thin plate splines, then radially back onto the cylinder.

    Returns
    -------
    nodes : (P,) indices of the panel's nodes.
    displacements : (P, 3), exactly `root_moves` at the root line and zero on the border.
    """
    nodes = mesh.on(panel)
    points = mesh.points[nodes]
    on_root = np.isin(nodes, root, assume_unique=True)
    others = [name for name in mesh.names[1:] if name != panel]
    border = np.isin(nodes, mesh.on(*others), assume_unique=True) & ~on_root
    moves = root_moves[np.searchsorted(root, nodes[on_root])]
    values = slide_panel(points, cylinder, points[on_root], moves, points[border])
    values[on_root], values[border] = moves, 0.0
    return nodes, values

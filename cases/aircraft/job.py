"""A case as jobs for the engine, one for each control surface (paper section 5 and appendix A)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.base.errors import InputError, nearest
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.deform.box.automatic import Given
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.options import Repair
from sdm_deflect.deform.surface.blended import Blended, Rib
from sdm_deflect.deform.surface.motions import Motion, Moving, Rotation
from sdm_deflect.deform.surface.surface import Listed
from sdm_deflect.deform.surface.tail_root import RootOnCylinder, root_on
from sdm_deflect.deform.volume.job import Job, Section, Sliding
from sdm_deflect.deform.volume.plan import Plan
from sdm_deflect.geometry import datum
from sdm_deflect.geometry.confinement import Margins, gap_faces, hexahedron_corners, inward_face, rib_faces
from sdm_deflect.geometry.datum import hinged
from sdm_deflect.geometry.parameters import Fighter
from sdm_deflect.meshing.mesh.axis import Axis, Cylinder
from sdm_deflect.meshing.mesh.edges import median_edge
from sdm_deflect.meshing.mesh.mesh import Mesh

from .case import Case, SurfaceTurn

# Patch of a Chimera block's outer faces.
BLOCK = "chimera"
# Settings of the size of a control surface's hexahedron.
CONFINEMENT = "confinement.up, down, aft, outboard, or corners"
# Nodes within this distance (m) of a datum line are on it: boundary nodes lie on the CAD to 1e-7 m.
ON_LINE = 1e-6


def plan_of(case: Case, mesh: Mesh, angles: Sequence[float] = (), progress: Progress = silent) -> Plan:
    """Plan the deflection of every control surface, each in a box of its own; angles are those of the case.

    Raises InputError if a surface leaves its box, something is in a box that must not move, or two boxes overlap.
    """
    jobs = [job_of(case, mesh, turn) for turn in case.deflections]
    poses = [tuple(turn.factor * angle for turn in case.deflections) for angle in angles]
    return Plan.of(mesh, jobs, poses, progress)


def job_of(case: Case, mesh: Mesh, turn: SurfaceTurn) -> Job:
    """Return the job of one control surface of a case on a mesh."""
    surface, hexahedron = turn.surface, hexahedron_of(case, turn.surface)
    patches = (surface, panel_of(surface)) if case.law(surface) == "rooted" else (surface,)
    for name in patches:
        if name not in mesh.names:
            raise InputError(f"{mesh.name}: the mesh has no patch {name}; {nearest(name, mesh.names, 'there are')}")
    spacing = case.adaptation.spacing or case.adaptation.spacing_edges * median_edge(
        mesh.points, mesh.faces_of([surface])
    )
    ends = (min(turned), max(turned)) if (turned := [turn.factor * end for end in case.range or ()]) else None
    return Job(
        surfaces=(Moving(patches, motion_of(case, mesh, surface, hexahedron), turn.factor * case.angle, ends),),
        fixed=tuple(name for name in mesh.names if name not in (*patches, BLOCK)),
        box=Given(hexahedron, open_faces(case, surface), CONFINEMENT),
        sections=tuple(sections_of(case, surface)),
        near_wall=hinged(surface) and case.confinement.ahead > 0.0,
        fitting=replace(case.adaptation, spacing=spacing),
        repair=Repair(case.repair, case.repair_share),
        repair_slides=repair_slides(case, mesh, surface),
    )


def repair_slides(case: Case, mesh: Mesh, surface: str) -> tuple[Sliding, ...]:
    """Return the patches whose nodes may slide in a repair.

    Nodes of a blended surface and its parents slide on faces and along straight edges; nodes of a tail slide on its
    plane faces, those of its panel on the cylinder. Nodes of a rigid surface do not slide.
    """
    law = case.law(surface)
    if law == "rigid":
        return ()
    if law == "rooted":
        return (Sliding(surface, "plane"), Sliding(panel_of(surface), "cylinder"))
    nodes = mesh.patch(surface).nodes
    others = [patch.name for patch in mesh.patches if patch.name not in (surface, BLOCK)]
    parents = [name for name in others if np.isin(mesh.patch(name).nodes, nodes, assume_unique=True).any()]
    return tuple(Sliding(name, "surface") for name in (surface, *parents))


def hexahedron_of(case: Case, surface: str) -> Hexahedron:
    """Return the hexahedron of a control surface."""
    settings = case.confinement
    if settings.corners:
        return Hexahedron(np.array(settings.corners, dtype=np.float64))
    margins = Margins(settings.aft, settings.outboard, settings.up, settings.down, settings.ahead)
    return Hexahedron(hexahedron_corners(case.fighter, surface, margins))


def open_faces(case: Case, surface: str) -> frozenset[str]:
    """Return the hexahedron's faces without zero sites: a tail's inward face, and faces beyond a Chimera block's."""
    if not hinged(surface):
        return frozenset({inward_face(surface)})
    return frozenset(rib_faces(case.fighter, surface)) if case.domain == "block" else frozenset()


def sections_of(case: Case, surface: str) -> Iterator[Section]:
    """Yield the Chimera block's faces in the gaps beside a control surface: nodes slide in their planes y = const."""
    for station in block_stations(case, surface):
        yield Section(BLOCK, np.array([0.0, station, 0.0]), 1, case.confinement.slide)


def block_stations(case: Case, surface: str) -> FloatArray:
    """Return stations y (k,) of the Chimera block's faces in the gaps; none without a block."""
    if case.domain != "block":
        return np.empty(0)
    return gap_faces(case.fighter, case.block, surface)


def check_case(case: Case) -> None:
    """Raise InputError if a control surface is unknown, has no hexahedron, or its root or block is impossible."""
    for turn in case.deflections:
        if turn.surface not in datum.SURFACES:
            hint = nearest(turn.surface, datum.SURFACES, "there are")
            raise InputError(f"deflections: unknown control surface {turn.surface!r}; {hint}")
    try:
        for turn in case.deflections:
            block_stations(case, turn.surface)
            hexahedron_of(case, turn.surface)
            if case.law(turn.surface) == "rooted":
                corners, axis = datum.ends(case.fighter, turn.surface), axis_of(case.fighter, turn.surface)
                inner, outer = (axis.rotated(end, turn.factor * case.angle) for end in corners)
                root_on(fuselage_cylinder(case.fighter), inner, outer - inner)
    except ValueError as error:
        raise InputError(str(error)) from error


def axis_of(fighter: Fighter, surface: str) -> Axis:
    """Return the axis of rotation of a control surface."""
    first, second = datum.hinge_line(fighter, surface)
    return Axis.through(first, second) if hinged(surface) else Axis(first, second - first)


def motion_of(case: Case, mesh: Mesh, surface: str, hexahedron: Hexahedron) -> Motion:
    """Return how a control surface moves (appendix A).

    Aileron and rudder: hinge edges fixed, trailing edge rotated, multiquadric in between. Nodes shared with another
    patch stay: the hinge edges, and the rib where no gap separates the surface from its parent. Beside such a closed
    rib a strip is blended spanwise; beyond it the faces stay planar. A tail turns on the fuselage cylinder. A surface
    that touches nothing turns rigidly.
    """
    fighter, blending, axis = case.fighter, case.blending, axis_of(case.fighter, surface)
    law = case.law(surface)
    if law == "rigid":
        return Rotation(axis)
    if law == "rooted":
        apex = apex_of(datum.ends(fighter, surface))
        cylinder = fuselage_cylinder(fighter)
        return RootOnCylinder(axis, cylinder, apex, (panel_of(surface),), hexahedron, blending.root, blending.epsilon)
    wedge = Wedge.of(mesh, fighter, surface)
    span = np.array([0.0, 0.0, 1.0]) if surface == "rudder" else np.array([0.0, 1.0, 0.0])
    rib = Rib(Listed(wedge.nodes[wedge.rib]), width=blending.strip, direction=span)
    held, driven, hinge = (Listed(wedge.nodes[mask]) for mask in (wedge.fixed, wedge.trailing, wedge.hinge))
    return Blended(Rotation(axis), held, driven, rib, hinge, blending.epsilon)


def panel_of(surface: str) -> str:
    """Return the fuselage panel on which a tail turns."""
    return f"fuselage_panel_{surface.removeprefix('tail_')}"


def fuselage_cylinder(fighter: Fighter) -> Cylinder:
    """Return the cylinder of the rear fuselage."""
    point, direction, radius = datum.cylinder(fighter)
    return Cylinder(Axis(point, direction), radius)


def apex_of(sections: FloatArray) -> FloatArray:
    """Return the point (3,) where the lines through corresponding vertices of two sections (2, k, 3) meet."""
    directions = sections[1] - sections[0]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - np.einsum("ki,kj->kij", directions, directions)
    right = np.einsum("kij,kj->i", across, sections[0])
    return np.asarray(np.linalg.solve(across.sum(axis=0), right), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Wedge:
    """The nodes of a hinged trailing-edge wedge, found by topology and by its datum lines.

    Attributes
    ----------
    nodes : (K,) node indices of the patch.
    fixed, hinge, trailing : (K,) masks: shared with another patch; on the hinge edges; on the trailing edge.
    rib : (K,) mask of the fixed nodes at the ends of the span that no gap separates from the parent.
    """

    nodes: IntArray
    fixed: BoolArray
    hinge: BoolArray
    trailing: BoolArray
    rib: BoolArray

    @classmethod
    def of(cls, mesh: Mesh, fighter: Fighter, surface: str) -> "Wedge":
        """Sort the nodes of a patch; KeyError if the mesh has none of that name."""
        nodes = mesh.patch(surface).nodes
        points = mesh.points[nodes]
        others = mesh.on(*(name for name in mesh.names if name != surface))
        fixed = np.isin(nodes, others, assume_unique=True)
        upper, lower = datum.hinge_edges(fighter, surface)
        hinge = (distance_to_line(points, upper) < ON_LINE) | (distance_to_line(points, lower) < ON_LINE)
        trailing = distance_to_line(points, datum.trailing_edge(fighter, surface)) < ON_LINE
        return cls(nodes, fixed, hinge, trailing, fixed & ~hinge & ~between_hinge_edges(points, upper, lower))


def distance_to_line(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return the distance (N,) of points (N, 3) from the infinite line through two points (2, 3)."""
    return np.asarray(np.linalg.norm(Axis.through(*line).radial(points), axis=1))


def between_hinge_edges(points: FloatArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
    """Return which points (N, 3) are in the plane of the two hinge edges, the hinge wall."""
    normal = np.cross(upper[1] - upper[0], lower[0] - upper[0])
    normal /= np.linalg.norm(normal)
    return np.asarray(np.abs((points - upper[0]) @ normal) < ON_LINE)

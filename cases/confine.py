"""The confinement of one control surface: its hexahedron, the nodes inside and the zero sites (section 3)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from sdm_deflect.cases.case import Case, Strategy
from sdm_deflect.cases.motion import BoolArray, IndexArray, SurfaceMotion
from sdm_deflect.cases.zero_sites import BLOCK, ON_FACE, on_gap_faces, zero_sites
from sdm_deflect.deform.edges import median_edge
from sdm_deflect.deform.mesh import Cells
from sdm_deflect.deform.rbf.sites import DataSites, multivariate, univariate
from sdm_deflect.deform.volume.hexahedron import Hexahedron
from sdm_deflect.geometry.confinement import Margins, hexahedron_corners
from sdm_deflect.meshing.mesh import TetMesh

DIRECTIONS = ("x", "y", "z")

Grouping = Callable[[Sequence[DataSites]], tuple[DataSites, ...]]
GROUPINGS: dict[Strategy, Grouping] = {"squv": univariate, "mv": multivariate}


class ConfinementError(ValueError):
    """The hexahedron does not suit the mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The hexahedron around one control surface.

    Attributes
    ----------
    surface : name of the control surface.
    hexahedron : where the displacement may differ from zero.
    inside : (M,) indices of the mesh nodes inside.
    held : (B,) those of them on patches that do not deflect.
    held_components : (B, 3) the components that stay: all where a patch merely touches a face of the
        hexahedron, the normal one where it slides in its plane.
    zero : data sites of zero displacement on its faces, and on the sliding face for its normal direction.
    spacing : distance between those sites, metres.
    filter_seconds : time taken to find `inside`.
    """

    surface: str
    hexahedron: Hexahedron
    inside: IndexArray
    held: IndexArray
    held_components: BoolArray
    zero: tuple[DataSites, ...]
    spacing: float
    filter_seconds: float

    def zero_sites(self, component: int) -> int:
        """Return the number of zero sites for one direction."""
        return sum(len(sites) for sites in self.zero if component in sites.components)


def confine(case: Case, mesh: TetMesh, motion: SurfaceMotion) -> Region:
    """Build the hexahedron of a control surface, find the nodes inside and place the zero sites.

    Raises
    ------
    ConfinementError
        If a moving node lies outside, or a node of a fixed patch inside.
    """
    surface = motion.patches[0]
    hexahedron = hexahedron_of(case, surface)
    hexahedron.contains(mesh.points[:1])  # loads the compiled test: not part of the filter's time
    start = perf_counter()
    inside = np.flatnonzero(hexahedron.contains(mesh.points))
    seconds = perf_counter() - start
    check_inside(mesh, hexahedron, motion)
    check_clear(case, mesh, hexahedron, motion)
    triangles = Cells("triangle", mesh.triangles_of(surface))
    spacing = case.confinement.spacing or case.confinement.spacing_edges * median_edge(mesh.points, [triangles])
    zero = zero_sites(case, surface, hexahedron, mesh.points[motion.nodes], spacing)
    held, components = held_nodes(case, mesh, inside, motion)
    return Region(surface, hexahedron, inside, held, components, zero, spacing, seconds)


def hexahedron_of(case: Case, surface: str) -> Hexahedron:
    """Return the hexahedron of a control surface."""
    settings = case.confinement
    if settings.corners:
        return Hexahedron(np.array(settings.corners, dtype=np.float64))
    margins = Margins(settings.aft, settings.outboard, settings.up, settings.down)
    return Hexahedron(hexahedron_corners(case.fighter, surface, margins))


def held_nodes(case: Case, mesh: TetMesh, inside: IndexArray, motion: SurfaceMotion) -> tuple[IndexArray, BoolArray]:
    """Boundary nodes (B,) inside that the surface motion does not decide, and which components (B, 3) stay.

    They lie on faces of the hexahedron and stay, but for those of a block's outer faces alone, which slide.
    """
    boundary = np.intersect1d(mesh.on(*mesh.names[1:]), inside, assume_unique=True)
    held = np.setdiff1d(boundary, motion.nodes, assume_unique=True)
    components = np.ones((len(held), 3), dtype=bool)
    if case.domain == "block" and case.confinement.slide:
        walls = mesh.on(*(name for name in mesh.names[1:] if name != BLOCK))
        components[~np.isin(held, walls, assume_unique=True)] = (False, True, False)
    return held, components


def check_inside(mesh: TetMesh, hexahedron: Hexahedron, motion: SurfaceMotion) -> None:
    """Raise ConfinementError if a node that moves starts or ends outside."""
    moves = np.any(motion.displacements != 0.0, axis=1)
    before = mesh.points[motion.nodes[moves]]
    after = before + motion.displacements[moves]
    out = ~(hexahedron.contains(before, ON_FACE) & hexahedron.contains(after, ON_FACE))
    if out.any():
        raise ConfinementError(
            f"{np.count_nonzero(out)} of {len(before)} moving nodes of {motion.patches[0]} leave its hexahedron; "
            "enlarge confinement.up, down, aft or outboard"
        )


def check_clear(case: Case, mesh: TetMesh, hexahedron: Hexahedron, motion: SurfaceMotion) -> None:
    """Raise ConfinementError if a node of a patch that must not move lies inside, off the faces."""
    for name in mesh.names[1:]:
        if name in motion.patches:
            continue
        others = np.setdiff1d(mesh.on(name), motion.nodes, assume_unique=True)
        if name == BLOCK:
            others = others[~on_gap_faces(case, motion.patches[0], mesh.points[others])]
        crossing = np.count_nonzero(hexahedron.contains(mesh.points[others], -ON_FACE))
        if crossing:
            raise ConfinementError(
                f"the hexahedron of {motion.patches[0]} contains {crossing} nodes of {name}, which must not move; "
                "reduce confinement.up, down, aft or outboard"
            )

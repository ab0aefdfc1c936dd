"""Where displacements are known: nodes of the boundary, and zero sites on the box."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, first_coincident, union
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.around.local_rotation import LocalRotation
from sdm_deflect.deform.around.modifier import Modifier, NodesOnShape
from sdm_deflect.deform.box.face_sites import border_sites, polygon_sites
from sdm_deflect.deform.box.hexahedron import FACES
from sdm_deflect.deform.confined import zero_sites
from sdm_deflect.deform.rbf.data_sites import DataSites, fixed_sites
from sdm_deflect.deform.rbf.fitting import KERNELS, Fitting
from sdm_deflect.deform.rbf.kernels import Kernel, kernel_of
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.meshing.mesh.edges import edges_of, median_edge, polygons_of
from sdm_deflect.meshing.mesh.images import PLANE_TOLERANCE
from sdm_deflect.meshing.mesh.sliding import Plane

from .boundary import TOLERANCE, ZERO_LENGTH, PrescribedMotion
from .region import BoxNodes

if TYPE_CHECKING:
    from sdm_deflect.deform.around.bound import ConstrainedNodes

NO_ROWS = np.empty(0, dtype=np.intp)
# Number of nodes, itself included, to which a node is joined by edges if patches have no faces.
NEIGHBOURS = 7
# Largest number of sites on fixed patches; larger sets are thinned, and checked completely.
MOST_FIXED = 30_000
# Largest radius of a kernel, in diagonals of the box; the least is a median edge over the same number.
MOST_RADIUS = 1e4
# Largest number of times that the spacing on the box is halved while no site is left.
HALVINGS = 6
# Strain times the surface's size over its largest displacement, above which the motion shears the surface.
SHEARED = 0.01
# Degrees, or share of a table, at which the shear is measured: up to there it changes by 1e-4 of itself.
SMALL = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """Known nodes inside the box, which of them are data sites, and zero sites on the box.

    Attributes
    ----------
    moving : (K,) moving nodes.
    distinct : rows of `moving` without repeated places: coincident nodes move as one.
    fixed : (F,) nodes inside that stay.
    sampled : rows of `fixed` that are data sites: at most `MOST_FIXED`, none at the place of a moving node.
    bind : the bound nodes; None without any.
    zero : zero sites on the box, and on sections of it, which hold some directions only.
    edges : (E, 2) rows of `known` that an edge of the boundary joins; without faces, rows of near nodes.
    sheared : (K,) moving nodes beside which the motion shears the surface, whatever the amount.
    spacing, edge, tolerance : lengths: between zero sites; median edge of the surface; largest error at a site.
    kernel, radius : the kernel and its radius, a length; 0 for a kernel without.
    """

    moving: IntArray = field(repr=False)
    distinct: IntArray = field(repr=False)
    fixed: IntArray = field(repr=False)
    sampled: IntArray = field(repr=False)
    bind: "ConstrainedNodes | None" = field(repr=False)
    zero: tuple[DataSites, ...] = field(repr=False)
    edges: IntArray = field(repr=False)
    sheared: BoolArray = field(repr=False)
    spacing: float
    edge: float
    tolerance: float
    kernel: Kernel
    radius: float

    @property
    def slid(self) -> IntArray:
        """Sorted indices of the bound nodes inside."""
        return self.bind.nodes if self.bind else NO_ROWS

    @property
    def sampled_sliding(self) -> IntArray:
        """Rows of `slid` that are data sites, at most `MOST_FIXED`."""
        return self.bind.sampled if self.bind else NO_ROWS

    @property
    def known(self) -> IntArray:
        """Indices of the known nodes inside: moving, fixed, bound; each once."""
        return np.concatenate([self.moving, self.fixed, self.slid])

    @property
    def coincident(self) -> int:
        """Number of moving nodes at the place of another one."""
        return len(self.moving) - len(self.distinct)

    def zero_sites(self, component: int) -> int:
        """Number of zero sites that hold one direction."""
        return sum(len(sites) for sites in self.zero if component in sites.components)

    @classmethod
    def of(cls, boundary: PrescribedMotion, region: BoxNodes, more: Sequence[Modifier] = ()) -> "Sites":
        """Place the sites; `more` are modifiers beyond those of the job."""
        job, mesh = boundary.job, boundary.mesh
        bind = _bind(boundary, region)
        slid = bind.nodes if bind else NO_ROWS
        distinct, sampled, sampled_sliding = _distinct(boundary, region.fixed, slid)
        bind = replace(bind, sampled=sampled_sliding) if bind else None
        if not job.near_wall:
            sampled = sampled[:0]
        edge = _surface_edge(boundary, distinct)
        known = np.concatenate([boundary.nodes, region.fixed, slid])
        around = known if job.near_wall else boundary.nodes
        modifiers = (*more, bind) if bind else tuple(more)
        spacing, zero = _sites_on_box(boundary, region, modifiers, mesh.points[around], edge)
        tolerance = job.fitting.tolerance or TOLERANCE * edge
        radius = _radius(job.fitting, region.hexahedron.corners, edge)
        kernel = kernel_of(job.fitting.kernel, radius)
        edges = _edges(boundary, known)
        sheared = _shear_mask(boundary, known, edges, len(boundary.nodes) + len(region.fixed))
        return cls(
            boundary.nodes, distinct, region.fixed, sampled, bind, zero, edges, sheared, spacing, edge, tolerance,
            kernel, radius,
        )  # fmt: skip

    def parts(self, boundary: PrescribedMotion) -> list[IntArray]:
        """Return the rows of `known` in each part of the boundary that may move differently from the others.

        Walls that share nodes, or have nodes at the same place, are joined: a blended flap and its wing are one part,
        the elements of a slotted wing several. Each joined set with a moving node is a part; what stays is one more,
        the last. A fixed plane at the side of the mesh joins nothing. Bound nodes belong to the part of the nearest
        wall.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components  # loading takes a while

        certain = len(self.moving) + len(self.fixed)
        points = boundary.mesh.points[self.known]
        on_side = _on_sides(boundary, self.known[:certain], points[:certain])
        edges = self.edges[(self.edges < certain).all(axis=1)]
        edges = edges[~on_side[edges].all(axis=1)]
        same = np.column_stack([np.arange(certain), first_coincident(points[:certain], ZERO_LENGTH * boundary.size)])
        joined = np.concatenate([edges, same])
        graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(certain, certain))
        label = connected_components(graph, directed=False)[1]
        moving = distinct(label[: len(self.moving)])
        owner = np.where(np.isin(label, moving), np.searchsorted(moving, label), len(moving))
        if len(self.slid):
            owner = np.append(owner, owner[cKDTree(points[:certain]).query(points[certain:])[1]])
        return [np.flatnonzero(owner == i) for i in range(len(moving) + 1)]

    def finer_edge(self, boundary: PrescribedMotion, parts: Sequence[IntArray]) -> float:
        """Return the smaller median edge of the moving surfaces and of the parts to which they belong."""
        points, inside = boundary.mesh.points[self.known], np.zeros(len(self.known), dtype=np.bool_)
        edge = self.edge
        for part in parts[:-1]:
            inside[:] = False
            inside[part] = True
            edges = self.edges[inside[self.edges].all(axis=1)]
            lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
            if len(lengths := lengths[lengths > 0.0]):
                edge = min(edge, float(np.median(lengths)))
        return edge


def _on_sides(boundary: PrescribedMotion, nodes: IntArray, points: FloatArray) -> BoolArray:
    """Return which of the nodes (K,), at points (K, 3), are on a fixed plane patch with all others on one side.

    Nodes on one line lie in many planes: then the plane is that of the whole patch.
    """
    mesh, on_side, near = boundary.mesh, np.zeros(len(nodes), dtype=np.bool_), PLANE_TOLERANCE * boundary.size
    for name in boundary.fixed:
        patch = mesh.patch(name).nodes
        on_patch = np.isin(nodes, patch)
        if np.count_nonzero(on_patch) <= 2:
            continue
        for places in (points[on_patch], mesh.points[patch]):
            if mesh.plane or not _on_line(places, near):
                heights = Plane.fitted(places, mesh.normal).distance(points)
                if np.abs(heights[on_patch]).max() <= near and ((heights >= -near).all() or (heights <= near).all()):
                    on_side |= on_patch
                break
    return on_side


def _on_line(points: FloatArray, near: float) -> bool:
    """Return whether points (K, 3), at least two, are within about `near` of one line."""
    return bool(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] <= near)


def _edges(boundary: PrescribedMotion, known: IntArray) -> IntArray:
    mesh = boundary.mesh
    faces = mesh.faces_of(boundary.declared_patches)
    if not faces:
        near = cKDTree(mesh.points[known]).query(mesh.points[known], min(NEIGHBOURS, len(known)))[1]
        return np.column_stack([np.repeat(near[:, 0], near.shape[1] - 1), near[:, 1:].ravel()])
    row = np.full(len(mesh.points), -1, dtype=np.int32)
    row[known] = np.arange(len(known))
    edges = row[edges_of(polygons_of(faces))[0]]
    return np.unique(np.sort(edges[(edges >= 0).all(axis=1)], axis=1), axis=0).astype(np.intp)


def _shear_mask(boundary: PrescribedMotion, known: IntArray, edges: IntArray, certain: int) -> BoolArray:
    """Return the mask `Sites.sheared`; the first `certain` of the known nodes (B,) are moving or fixed."""
    move = np.zeros((len(known), 3))
    tables = (moving.motion.unit == Table.unit for moving in boundary.job.surfaces)
    for is_table, surface, law in zip(tables, boundary.surfaces, boundary.laws, strict=True):
        displacement, rows = law.displacement(SMALL), np.searchsorted(boundary.nodes, surface.nodes)
        largest = float(np.linalg.norm(displacement, axis=1).max())
        there = move[rows] if is_table else 0.0
        move[rows] = there + (displacement / largest if largest else displacement)
    turning = LocalRotation.of(boundary.mesh.points[known], edges, certain, boundary.mesh.normal)
    return np.asarray(turning.strain(move)[: len(boundary.nodes)] * boundary.size > SHEARED)


def _radius(fitting: Fitting, corners: FloatArray, edge: float) -> float:
    """Return the kernel's radius as given or chosen; 0 for a kernel without. InputError if it is out of range.

    The chosen radius of Wendland's function is the diagonal of the box, so that every site reaches every other. For
    the multiquadric it is the surface's median edge: Hardy (1971) took about the distance of neighbouring points.
    """
    if not KERNELS[fitting.kernel].radius:
        return 0.0
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    radius = fitting.kernel_radius or (size if fitting.kernel == "wendland" else edge)
    if not edge / MOST_RADIUS <= radius <= MOST_RADIUS * size:
        raise InputError(
            f"kernel_radius = {radius:g} is out of range: the surface's median edge is {edge:.3g}, the diagonal of the "
            f"box {size:.3g}; leave it out to have it chosen by them"
        )
    return radius


def _distinct(boundary: PrescribedMotion, fixed: IntArray, slid: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the rows of moving, fixed and bound nodes, without repeated places.

    Raises InputError if coincident nodes would move differently.
    """
    mesh, tol = boundary.mesh, ZERO_LENGTH * boundary.size
    nodes = np.concatenate([boundary.nodes, fixed, slid])
    first = first_coincident(mesh.points[nodes], tol)
    move = np.vstack([boundary.displacement(boundary.job.amounts), np.zeros((len(fixed), 3))])
    torn = np.flatnonzero(np.abs(move - move[first[: len(move)]]).max(axis=1) > 10.0 * tol)
    if len(torn):
        raise InputError(
            f"{mesh.name}: {len(torn)} nodes of the moving surface lie exactly on nodes that move otherwise, such "
            f"as nodes {nodes[first[torn[0]]]} and {nodes[torn[0]]}"
        )
    is_first = first == np.arange(len(nodes))
    moving, at_rest, sliding = np.split(is_first, [len(boundary.nodes), len(move)])
    return np.flatnonzero(moving), _sample(at_rest), _sample(sliding)


def _sample(mask: BoolArray) -> IntArray:
    """Return the rows of a mask; more than `MOST_FIXED` are thinned evenly."""
    rows = np.flatnonzero(mask)
    return rows[:: max(1, -(-len(rows) // MOST_FIXED))]


def _bind(boundary: PrescribedMotion, region: BoxNodes) -> "ConstrainedNodes | None":
    """Return the bound nodes inside, without data sites yet; None if there are none."""
    mesh, known = boundary.mesh, union(boundary.nodes, region.fixed)
    pairs = union(*(pair.nodes for pair in mesh.periodic if not pair.thin))
    if not boundary.sliding and not len(boundary.images.nodes) and not len(pairs):
        return None
    from sdm_deflect.deform.around.bound import ConstrainedNodes

    def within(nodes: IntArray) -> IntArray:
        return np.setdiff1d(np.intersect1d(nodes, region.inside, assume_unique=True), known, assume_unique=True)

    slides = tuple(
        NodesOnShape(patch.patch, within(patch.nodes), patch.surface, of_patch=True) for patch in boundary.sliding
    )
    slid, planes = union(*(slide.nodes for slide in slides), within(pairs)), []
    for section, nodes in region.sections:
        if len(both := np.intersect1d(nodes, slid, assume_unique=True)):
            planes.append((Plane(section.point, np.eye(3)[section.component]), both))
    faces = tuple(planes)
    walls = boundary.walls if mesh.normal is None else ()
    return ConstrainedNodes(slid, NO_ROWS, slides, faces, boundary.images, boundary.components, _sides(boundary), walls)


def _sides(boundary: PrescribedMotion) -> tuple[tuple[Plane, float, float], ...]:
    """Return `ConstrainedNodes.sides`: sliding planes and periodic planes with the whole surface on one side."""
    sliding = [(patch.surface, ZERO_LENGTH) for patch in boundary.sliding if isinstance(patch.surface, Plane)]
    sides = []
    for plane, near in (*sliding, *((wall, PLANE_TOLERANCE) for wall in boundary.walls)):
        side, tol = plane.distance(boundary.mesh.points[boundary.nodes]), near * boundary.size
        if (side >= -tol).all() or (side <= tol).all():
            sides.append((plane, tol, float(np.copysign(1.0, side.sum()))))
    return tuple(sides)


def _surface_edge(boundary: PrescribedMotion, distinct: IntArray) -> float:
    """Return the median edge of the moving surfaces; without faces, the median distance of nearest nodes."""
    mesh = boundary.mesh
    faces = mesh.faces_of(boundary.moving)
    if faces:
        return median_edge(mesh.points, faces)
    if len(distinct) < 2:
        raise InputError(f"{mesh.name}: the moving surface has {len(distinct)} distinct nodes")
    points = mesh.points[boundary.nodes[distinct]]
    return float(np.median(cKDTree(points).query(points, 2)[0][:, 1]))


def _sites_on_box(
    boundary: PrescribedMotion, region: BoxNodes, modifiers: Sequence[Modifier], known: FloatArray, edge: float
) -> tuple[float, tuple[DataSites, ...]]:
    """Return the spacing of zero sites, and the sites, at some distance from known nodes (K, 3).

    A chosen spacing is halved while no site is left: a mesh of one layer of cells may have edges as long as the box.
    """
    fitting = boundary.job.fitting
    spacing = region.hexahedron.spacing(fitting.spacing, fitting.spacing_edges * edge)
    for _ in range(0 if fitting.spacing else HALVINGS):
        if len(zero_sites(_on_box(boundary, region, modifiers, spacing), known, spacing)):
            break
        spacing *= 0.5
    return spacing, _zero_sites(boundary, region, modifiers, known, spacing)


def _zero_sites(
    boundary: PrescribedMotion, region: BoxNodes, modifiers: Sequence[Modifier], known: FloatArray, spacing: float
) -> tuple[DataSites, ...]:
    """Return the zero sites at some distance from the known nodes (K, 3).

    All faces of the box but the open ones hold all directions. The section of a block's face holds its normal direction
    alone if nodes slide in its plane (section 5.2). Where all sides slide, their planes hold the mesh.
    """
    inner = _on_box(boundary, region, modifiers, spacing)
    faces = zero_sites(inner, known, spacing)
    held = {row for modifier in modifiers for row in modifier.held}
    if not len(faces) and region.box.open_faces != FACES.keys() and not held.issuperset(boundary.components):
        if not len(inner):
            raise InputError(
                "no face of the box is within the sides that slide, and these are not at right angles, so that nothing "
                f"would hold the mesh; take a smaller box ({boundary.job.box.settings}), or name a side in fixed"
            )
        raise InputError(
            f"spacing = {spacing:.3g} leaves no site on the box that is half as far from the surface; lower it, or "
            f"enlarge the box ({boundary.job.box.settings})"
        )
    sites = [fixed_sites(faces, boundary.components)] if len(faces) else []
    known = np.vstack([known, faces])
    for section in boundary.job.sections:
        try:
            polygon = region.hexahedron.section(section.point, np.eye(3)[section.component])
        except ValueError:
            plane = f"{'xyz'[section.component]} = {section.point[section.component]:g}"
            raise InputError(f"section of {section.patch}: its plane, {plane}, does not cut the box") from None
        on_block = zero_sites(polygon_sites(polygon, spacing), known, spacing)
        if len(on_block):
            sites.append(fixed_sites(on_block, (section.component,) if section.slides else (0, 1, 2)))
    return tuple(sites)


def _on_box(boundary: PrescribedMotion, region: BoxNodes, modifiers: Sequence[Modifier], spacing: float) -> FloatArray:
    """Return points (P, 3) on the faces of the box that are not open; in a plane mesh on its outline."""
    mesh, box = boundary.mesh, region.hexahedron
    if mesh.normal is None:
        sites = box.face_sites(spacing, skip=region.box.open_faces)
    else:
        sites = border_sites(box.section(mesh.points[0], mesh.normal), spacing)
        sites[:, mesh.across] = mesh.points[0, mesh.across]
    for modifier in modifiers:
        sites = modifier.on_box(box, sites, spacing)
    return sites

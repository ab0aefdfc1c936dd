"""Known nodes: those that move, those that stay, and those that slide or move like their images."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError, nearest
from sdm_deflect.base.ties import first_largest
from sdm_deflect.deform.rbf.data_sites import XYZ
from sdm_deflect.deform.surface.blended import Blended, BlendedLaw
from sdm_deflect.deform.surface.motions import TRACK_UNIT, MotionLaw
from sdm_deflect.deform.surface.placement import Placement, TablePlacement, check_aft
from sdm_deflect.deform.surface.reached_share import ReachedShare
from sdm_deflect.deform.surface.shapes import AnyShape, Shapes, ShapesLaw
from sdm_deflect.deform.surface.surface import Surface
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.surface.tail_root import Root
from sdm_deflect.meshing.mesh.edges import median_edge
from sdm_deflect.meshing.mesh.faces import node_keys, patch_keys
from sdm_deflect.meshing.mesh.images import THIN, Images, plane_of
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.sliding import Plane, SlidingPatch, fit_shape

from .job import Amounts, Job

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.thin import ThinMesh

# Lengths below this share of the moving surfaces' size are zero.
ZERO_LENGTH = 1e-9
# Least size of the moving surfaces, as a share of the largest coordinate or of 1.
LEAST = 1e-8
# A moving node this near to a sliding shape is moved onto it; a share of the moving surfaces' size.
ON_SHAPE = 1e-6
# Images that differ by less than this share of the largest displacement move by their mean and stay in their plane.
ALIKE = 0.01
# Cosine between a hinge and the normal of a plane, below which the surface turns across the plane.
ACROSS = 0.1
# Default of the largest error at a site, as a share of the surface's median edge.
TOLERANCE = 0.01
# A tolerance above this share of the moving surface's median edge is probably a mistake.
COARSE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedMotion:
    """Moving, fixed and sliding nodes of the whole mesh. A node with several roles is moving first, then fixed.

    Attributes
    ----------
    job : what to deflect.
    mesh : the mesh; in a case one cell thick the plane mesh, without the nodes of the back.
    surfaces, laws : the moving surfaces and their motions, in the job's order.
    nodes : (K,) sorted indices of their nodes, each once.
    fixed : patches that stay.
    fixed_nodes : (F,) sorted indices of the nodes of fixed patches that do not move.
    sliding : sliding patches, with the symmetry planes of the file.
    size : largest extent of the moving nodes.
    images : nodes that move like their images.
    pairs : patches of periodic pairs, which are neither fixed nor moving.
    sides : front and back of a case one cell thick.
    walls : planes of `pairs` and `sides`, where they are plane.
    covered : patches whose faces all belong to other named patches; the job need not name them.
    thin : the mesh one cell thick; None for others.
    known : displacements (K, 3) computed in advance, by amounts.
    """

    job: Job
    mesh: Mesh = field(repr=False)
    surfaces: tuple[Surface, ...]
    laws: tuple[MotionLaw, ...] = field(repr=False)
    nodes: IntArray = field(repr=False)
    fixed: tuple[str, ...]
    fixed_nodes: IntArray = field(repr=False)
    sliding: tuple[SlidingPatch, ...]
    size: float
    images: Images = field(default_factory=Images, repr=False)
    pairs: tuple[str, ...] = ()
    sides: tuple[str, ...] = ()
    walls: tuple[Plane, ...] = ()
    covered: tuple[str, ...] = ()
    thin: "ThinMesh | None" = None
    known: Mapping[Amounts, FloatArray] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, mesh: Mesh, job: Job) -> "PrescribedMotion":
        """Sort the patches of a mesh by role; InputError for an unknown patch, or one with two roles."""
        thin, mesh = _thin(mesh, job)
        if thin and any(isinstance(moving.motion, AnyShape) for moving in job.surfaces):
            raise InputError(
                f"{mesh.name}: places of nodes need a plane mesh or one in space; this one is one cell thick"
            )
        moves = [name for moving in job.surfaces for name in mesh.expand(moving.patches, "the surface")]
        slides = {name: slide.shape for slide in job.slides for name in mesh.expand([slide.patch], "slide")}
        slides = thin.slides(slides) if thin else slides
        pairs, sides, flat = _bound_patches(mesh, moves, slides)
        slides = {name: slides[name] for name in _without(slides, flat)}
        surfaces = _numbered([Surface.of(mesh, moving.patches) for moving in job.surfaces])
        others = {*moves, *slides, *pairs, *sides}.difference(job.fixed)
        fixed = _without(mesh.expand(job.fixed, "fixed"), others)
        slides |= _symmetry(mesh, (*others, *fixed))
        fixed = (*fixed, *_beside_roots(mesh, job, (*others, *fixed, *slides)))
        _check_parts(mesh, moves, fixed, slides)
        _check_shared(mesh, job, surfaces)
        _check_sections(mesh, job)
        _check_motions(job, surfaces)
        laws = tuple(moving.motion.law(surface) for moving, surface in zip(job.surfaces, surfaces, strict=True))
        nodes = union(*(surface.nodes for surface in surfaces))
        sliding = tuple(SlidingPatch.of(mesh, name, shape) for name, shape in slides.items())
        fixed_nodes = np.setdiff1d(mesh.on(*fixed), nodes, assume_unique=True)
        bound = _images(mesh, flat), _without(pairs, fixed), _without(sides, fixed), _walls(mesh)
        covered = _covered_patches(mesh, (*moves, *fixed, *slides, *pairs))
        size = _size(mesh, nodes)
        return cls(job, mesh, surfaces, laws, nodes, fixed, fixed_nodes, sliding, size, *bound, covered, thin)

    @property
    def moving(self) -> tuple[str, ...]:
        """Patches of the moving surfaces."""
        return tuple(dict.fromkeys(name for surface in self.surfaces for name in surface.patches))

    @property
    def edge(self) -> float:
        """Median edge of the moving surfaces."""
        return median_edge(self.mesh.points, self.mesh.faces_of(self.moving))

    @property
    def tolerance(self) -> float:
        """Largest error at a data site, before prism layers ask for a smaller one."""
        return self.job.fitting.tolerance or TOLERANCE * self.edge

    @property
    def components(self) -> tuple[int, ...]:
        """Directions in which nodes move: two in a plane mesh, otherwise all."""
        return tuple(c for c in XYZ if c != self.mesh.across) if self.mesh.plane else XYZ

    def both(self, nodes: IntArray) -> IntArray:
        """Return sorted nodes (K,); in a mesh one cell thick with their images on the other side."""
        return self.thin.images.closure(nodes, len(self.mesh.points)) if self.thin else nodes

    @property
    def declared_patches(self) -> tuple[str, ...]:
        """Patches with a role: named by the job, paired by the file, or covered."""
        return (*self.moving, *self.fixed, *(patch.patch for patch in self.sliding), *self.pairs, *self.covered)

    @property
    def free(self) -> tuple[str, ...]:
        """Patches whose nodes may move."""
        return (*self.moving, *(patch.patch for patch in self.sliding), *self.pairs, *self.sides, *self.covered)

    def displacement(self, amounts: Amounts) -> FloatArray:
        """Return the displacement (K, 3) of `nodes`.

        Raises InputError if two surfaces move a shared node differently, if a node shared with a fixed patch moves, or
        if one shared with a sliding patch leaves its shape.
        """
        if amounts in self.known:
            return self.known[amounts]
        parts = [law.displacement(amount) for law, amount in zip(self.laws, amounts, strict=True)]
        out = self.admitted(self._join(parts, "move differently"))
        out.flags.writeable = False
        return out

    def admitted(self, displacement: FloatArray) -> FloatArray:
        """Return a displacement (K, 3) of `nodes` within what their other patches allow; InputError as `displacement`.

        Nodes shared with a fixed patch stay, those on a shape stay on it, images move alike.
        """
        self._check_fixed(displacement)
        out = np.array(displacement)
        out[self.shared_with_fixed] = 0.0
        for patch, rows in self._on_sliding():
            out[rows] = self._project(patch, rows, out[rows])
        out = self._alike(out)
        self._keep_plane(out)
        return out

    def admitted_rate(self, displacement: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the derivative (K, 3) of `admitted` at a displacement (K, 3) that changes at a rate (K, 3)."""
        out, u = np.array(rate), np.array(displacement)
        fixed = self.shared_with_fixed
        out[fixed] = u[fixed] = 0.0
        for patch, rows in self._on_sliding():
            points = self.mesh.points[self.nodes[rows]]
            out[rows] = patch.surface.rate(points, u[rows], out[rows])
            u[rows] = patch.surface.projected(points, u[rows])
        out = self.images.among(self.nodes).projected(out)
        if self.mesh.plane:
            out = np.where(np.arange(3) == self.mesh.across, 0.0, out)
        return out

    def admitted_reverse(self, displacement: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the gradient (K, 3) by a displacement (K, 3), given that by what `admitted` makes of it."""
        trail, u = [], np.array(displacement)
        fixed = self.shared_with_fixed
        u[fixed] = 0.0
        for patch, rows in self._on_sliding():
            trail.append((patch, rows, u[rows]))
            u[rows] = patch.surface.projected(self.mesh.points[self.nodes[rows]], u[rows])
        out = np.array(gradient)
        if self.mesh.plane:
            out[:, self.mesh.across] = 0.0
        out = np.array(self.images.among(self.nodes).projected(out))
        for patch, rows, at in reversed(trail):
            out[rows] = patch.surface.rate(self.mesh.points[self.nodes[rows]], at, out[rows])
        out[fixed] = 0.0
        return out

    def knowing(self, some: Iterable[Amounts]) -> "PrescribedMotion":
        """Return the motion with the displacements at some amounts computed in advance: they may need a fit."""
        return replace(self, known={amounts: self.displacement(amounts) for amounts in some})

    def frozen_at(self, amounts: Amounts) -> "PrescribedMotion":
        """Return the motion whose laws keep their choices at these amounts, so that it is smooth around them."""
        laws = (law.frozen_at(amount) for law, amount in zip(self.laws, amounts, strict=True))
        return replace(self, laws=tuple(laws), known={})

    def straight_to(self, amounts: Amounts) -> "PrescribedMotion":
        """Return the motion to one of several shapes on a straight way; the motion itself without such."""
        if not any(isinstance(law, ShapesLaw) for law in self.laws):
            return self
        pairs = zip(self.laws, amounts, strict=True)
        laws = (law.straight_to(amount) if isinstance(law, ShapesLaw) else law for law, amount in pairs)
        return replace(self, laws=tuple(laws), known={})

    @property
    def warnings(self) -> tuple[str, ...]:
        """Signs that a hinge or the tolerance is wrong, as sentences."""
        texts: list[str] = []
        for placement, surface, blended in _placements(self.job, self.surfaces, self.laws):
            texts += placement.warnings(blended)
            if isinstance(placement, TablePlacement) and not blended:
                texts += self.moved_roots(placement, surface)
        edge, tolerance = self.edge, self.job.fitting.tolerance
        if (tolerance or 0.0) > COARSE * edge:
            texts.append(f"tolerance = {tolerance:g} is above {COARSE:g} of the surface's median edge, {edge:.3g}")
        for patch, rows in self._on_sliding() if any(map(self._ends_on, self.sliding)) else ():
            parts = [law.displacement(amount) for law, amount in zip(self.laws, self.job.amounts, strict=True)]
            off = self._join(parts, "move differently")[rows] - self.displacement(self.job.amounts)[rows]
            if (far := float(np.linalg.norm(off, axis=1).max())) > ON_SHAPE * self.size:
                texts.append(
                    f"nodes on {patch.patch}: {len(rows)} put back into its plane, up to {far:.4g} from the motion"
                )
        return tuple(texts)

    def moved_roots(self, placement: TablePlacement, surface: Surface) -> Iterator[str]:
        """Yield a sentence for each sliding patch on which a table moves nodes that should perhaps stay."""
        for patch in self.sliding:
            yield from placement.moved_on(patch.patch, surface.on([patch.patch]))

    def farthest(self, amounts: Amounts) -> Iterator[tuple[Surface, FloatArray, FloatArray]]:
        """Yield each surface with the place (3,) and displacement (3,) of the node that moves farthest."""
        move = self.displacement(amounts)
        for surface in self.surfaces:
            vectors = move[np.searchsorted(self.nodes, surface.nodes)]
            row = first_largest(np.linalg.norm(vectors, axis=1))
            yield surface, surface.points[row], vectors[row]

    def reaches(self, amounts: Amounts) -> Iterator[tuple[Surface, ReachedShare | None]]:
        """Yield each surface with the share of its angle by which it turns; None without a hinge or at angle 0.

        Tables that add to a turn are left out.
        """
        is_table = [moving.motion.unit == Table.unit for moving in self.job.surfaces]
        by_table = {name for of, table in zip(self.surfaces, is_table, strict=True) if table for name in of.patches}
        turned = tuple(0.0 if table else amount for amount, table in zip(amounts, is_table, strict=True))
        for surface, law, moving, amount in zip(self.surfaces, self.laws, self.job.surfaces, amounts, strict=True):
            move = self.displacement(amounts if by_table.isdisjoint(surface.patches) else turned)
            vectors, axis = move[np.searchsorted(self.nodes, surface.nodes)], moving.motion.axis
            turns = axis is not None and moving.motion.unit == "deg" and amount != 0.0
            yield surface, ReachedShare.of(surface.points, vectors, axis, amount, law) if axis and turns else None

    @property
    def shared_with_fixed(self) -> BoolArray:
        """Which of the moving nodes (K,) are shared with a fixed patch."""
        return np.isin(self.nodes, self.mesh.on(*self.fixed), assume_unique=True)

    def _on_sliding(self) -> Iterable[tuple[SlidingPatch, IntArray]]:
        """Yield the sliding patches with the rows of the moving nodes on them."""
        for patch in self.sliding:
            rows = np.flatnonzero(np.isin(self.nodes, patch.nodes, assume_unique=True))
            if len(rows):
                yield patch, rows

    def _join(self, parts: list[FloatArray], fault: str) -> FloatArray:
        """Join the displacements of the surfaces to those of `nodes` (K, 3); InputError where two patches differ.

        Displacements of surfaces that have a patch in common add up on it.
        """
        out = np.full((len(self.nodes), 3), np.nan)
        for name in self.moving:
            nodes = self.mesh.patch(name).nodes
            pairs = zip(self.surfaces, parts, strict=True)
            of_patch = (part[np.searchsorted(of.nodes, nodes)] for of, part in pairs if name in of.patches)
            part, rows = reduce(np.add, of_patch), np.searchsorted(self.nodes, nodes)
            known = out[rows]
            apart = np.abs(known - part).max(axis=1) > ZERO_LENGTH * self.size  # nan (unknown) compares false
            if apart.any():
                way = "blend both, and name the other one's patch in held, beside those that stay"
                if any(moving.motion.unit == Table.unit for moving in self.job.surfaces):
                    way = "name both patches for the table, which adds to a turn, or let it fall to zero there"
                raise InputError(
                    f"{self.mesh.name}: {int(apart.sum())} nodes of {name} also belong to another moving "
                    f"surface, and the two {fault} there; {way}"
                )
            out[rows] = np.where(np.isnan(known), part, known)
        return out

    def _check_fixed(self, displacement: FloatArray) -> None:
        """Raise InputError if a node shared with a fixed patch would move by more than the tolerance."""
        length = np.linalg.norm(displacement, axis=1)
        if not (length[self.shared_with_fixed] > ZERO_LENGTH * self.size).any():
            return
        moves = length > max(ZERO_LENGTH * self.size, self.tolerance)
        for name in self.fixed:
            shared = np.isin(self.nodes, self.mesh.patch(name).nodes, assume_unique=True)
            count = int(np.count_nonzero(shared & moves))
            if count:
                remedies = ((AnyShape, "leave them in place"), (Table, "let the table fall to zero there"))
                motions = [moving.motion for moving in self.job.surfaces]
                fitting = (text for kind, text in remedies if any(isinstance(motion, kind) for motion in motions))
                blend = next(fitting, "use a blended motion")
                raise InputError(
                    f"{self.mesh.name}: {count} nodes shared by the moving surface and {name}, which is fixed, "
                    f"would move by up to {float(length[shared].max()):.4g}; {blend}, or let {name} slide"
                )

    def _alike(self, displacement: FloatArray) -> FloatArray:
        """Return the displacement (K, 3) with images moving alike; InputError if the motion moves them differently."""
        if not len(self.images.nodes):
            return displacement
        mesh, largest = self.mesh, float(np.abs(displacement).max(initial=0.0))
        behind = self._left_behind(displacement)
        if behind > ZERO_LENGTH * self.size:
            raise InputError(
                f"{mesh.name}: nodes of the moving surface move by up to {behind:.4g}, but their "
                "images in a periodic pair are on no moving surface; name the patches on both sides"
            )
        out = self.images.among(self.nodes).projected(displacement)
        off = float(np.linalg.norm(out - displacement, axis=1).max(initial=0.0))
        if off > max(ZERO_LENGTH * self.size, ALIKE * largest):
            raise InputError(
                f"{mesh.name}: nodes of the moving surface would move unlike their periodic images, by up to "
                f"{off:.4g}; the hinge must fit to the periodicity"
            )
        return out

    def _keep_plane(self, displacement: FloatArray) -> None:
        """Project a displacement (K, 3) into the plane of a plane mesh; InputError if it leaves the plane."""
        if not self.mesh.plane:
            return
        off = np.abs(displacement[:, self.mesh.across]).max(initial=0.0)
        if off > (ALIKE * np.abs(displacement).max() if self.thin else 0.0):
            hinge = "the hinge must be normal to it" if self.thin else "give the hinge as one point, such as 0.7,0"
            raise InputError(
                f"{self.mesh.name}: the surface would leave the plane of the mesh by {off:.4g}; {hinge}, "
                f"and displacements without {'xyz'[self.mesh.across]}"
            )
        displacement[:, self.mesh.across] = 0.0

    def _left_behind(self, displacement: FloatArray) -> float:
        """Set to zero the displacement of nodes whose images are on no moving surface; return its largest value."""
        lone = np.isin(self.nodes, self.images.nodes, assume_unique=True)
        lone[self.images.among(self.nodes).nodes] = False
        largest = float(np.abs(displacement[lone]).max(initial=0.0))
        displacement[lone] = 0.0
        return largest

    def _project(self, patch: SlidingPatch, rows: IntArray, displacement: FloatArray) -> FloatArray:
        points = self.mesh.points[self.nodes[rows]]
        on_shape = patch.surface.projected(points, displacement)
        off = np.linalg.norm(on_shape - displacement, axis=1)
        leaving = off > ON_SHAPE * self.size
        if leaving.any() and not self._ends_on(patch):
            free = any(isinstance(moving.motion, AnyShape) for moving in self.job.surfaces)
            remedy = "the hinge must be normal to a plane, or blend the motion there"
            raise InputError(
                f"{self.mesh.name}: {int(leaving.sum())} nodes shared by the moving surface and {patch.patch} would "
                f"leave its shape by up to {float(off.max()):.4g}; {'keep them on it' if free else remedy}"
            )
        return on_shape

    def _ends_on(self, patch: SlidingPatch) -> bool:
        """Return whether a surface ends on this plane, such as an outlet: its nodes are then projected back onto it."""
        normals = [patch.surface.normal] if isinstance(patch.surface, Plane) else []
        axes = [moving.motion.axis for moving in self.job.surfaces]
        return all(axis and abs(float(axis.direction @ n)) < ACROSS for n in normals for axis in axes) and bool(normals)


def _images(mesh: Mesh, flat: tuple[str, ...]) -> Images:
    return Images.of(mesh, flat) if mesh.periodic or flat else Images()


def _thin(mesh: Mesh, job: Job) -> "tuple[ThinMesh | None, Mesh]":
    """Return the mesh one cell thick, or None, and the mesh in which displacements are interpolated."""
    if job.sections or not any(pair.thin for pair in mesh.periodic):
        return None, mesh
    from sdm_deflect.meshing.mesh.thin import ThinMesh

    thin = ThinMesh.of(mesh, job.fixed)
    return thin, thin.mesh if thin else mesh


def _bound_patches(mesh: Mesh, moves: list[str], slides: dict[str, str]) -> tuple[tuple[str, ...], ...]:
    """Return the patches of periodic pairs, the sides of cases one cell thick, and the patches of both that stay plane.

    Raises InputError if one of them moves, or slides on another shape than a plane.
    """
    known = {name: len(pair.nodes) for pair in mesh.periodic for name in pair.patches if name in mesh.names}
    thin = tuple(patch.name for patch in mesh.patches if patch.constraint in THIN)
    sides = thin if mesh.plane or any(pair.thin and len(pair.nodes) for pair in mesh.periodic) else ()
    names, pairs = tuple(dict.fromkeys((*known, *thin))), [name for name in known if known[name]]
    _check_bound(mesh, names, moves, slides, set(pairs))
    return _without(pairs, thin), sides, _without(names, set(names).difference(slides))


def _without(names: Iterable[str], others: Container[str]) -> tuple[str, ...]:
    return tuple(name for name in names if name not in others)


def _check_bound(mesh: Mesh, names: Iterable[str], moves: list[str], slides: dict[str, str], pairs: set[str]) -> None:
    """Raise if a periodic patch moves or slides on a shape; with paired nodes it may slide on its plane."""
    for name in names:
        if slides.get(name) == "plane" and name in pairs:
            fit_shape("plane", mesh.points[mesh.patch(name).nodes], name, mesh.normal)
        elif name in (*moves, *slides):
            constraint = mesh.patch(name).constraint
            what = f"is {constraint}" if constraint in THIN else "is one side of a periodic pair"
            raise InputError(
                f"{mesh.name}: patch {name} {what}, so that its nodes move as their images do; it can neither move by "
                "itself nor slide on a shape: leave it out"
            )


def _size(mesh: Mesh, nodes: IntArray) -> float:
    """Return the largest extent of the moving nodes (K,); InputError if rounding hides it."""
    size, far = float(np.ptp(mesh.points[nodes], axis=0).max()), float(np.abs(mesh.points[nodes]).max())
    if 0.0 < size < LEAST * max(1.0, far):
        raise InputError(
            f"{mesh.name}: the moving surface is {size:.2g} long at {far:.2g} from the origin: its nodes cannot be "
            "kept apart; take another unit of length, or another origin"
        )
    return size


def _check_sections(mesh: Mesh, job: Job) -> None:
    for section in job.sections:
        if section.patch not in mesh.names:
            hint = nearest(section.patch, mesh.names, "the patches are")
            raise InputError(f"{mesh.name}: section {section.patch!r} is no patch; {hint}")


def _symmetry(mesh: Mesh, named: tuple[str, ...]) -> dict[str, str]:
    """Return the symmetry planes that the job does not name: their nodes slide."""
    unnamed = [patch for patch in mesh.patches if patch.constraint == "symmetry" and patch.name not in named]
    return {patch.name: "plane" for patch in unnamed if plane_of(mesh, patch.nodes)}


def _beside_roots(mesh: Mesh, job: Job, named: tuple[str, ...]) -> tuple[str, ...]:
    """Return the patches without a role beside a body on which a tail turns: they stay, unless they are plane."""
    roots = [moving.motion for moving in job.surfaces if isinstance(moving.motion, Root)]
    nodes = mesh.on(*(name for root in roots for name in mesh.expand(root.on, "on")))
    known = {*named, *_covered_patches(mesh, named)} if roots else set()
    return tuple(
        patch.name
        for patch in (mesh.patches if roots else ())
        if patch.name not in known
        and len(np.intersect1d(patch.nodes, nodes, assume_unique=True))
        and not plane_of(mesh, patch.nodes)
    )


def _covered_patches(mesh: Mesh, named: tuple[str, ...]) -> tuple[str, ...]:
    """Return the unnamed patches whose faces all belong to named ones, such as a group of all walls."""
    nodes = mesh.on(*named)
    some = [p for p in mesh.patches if p.name not in named and np.isin(p.nodes, nodes, assume_unique=True).all()]
    if not some:
        return ()
    keys = node_keys(len(mesh.points))
    known = np.concatenate([patch_keys(mesh.patch(name), keys) for name in named])
    return tuple(patch.name for patch in some if np.isin(patch_keys(patch, keys), known).all())


def _walls(mesh: Mesh) -> tuple[Plane, ...]:
    """Return the planes of the sides of periodic pairs."""
    planes = [plane_of(mesh, nodes) for pair in mesh.periodic for nodes in pair.nodes.T]
    return tuple(plane for plane in planes if plane)


def _check_motions(job: Job, surfaces: Sequence[Surface]) -> None:
    for placement, surface, _ in _placements(job, surfaces):
        placement.check(surface, job.force)
    for moving, surface in zip(job.surfaces, surfaces, strict=True):
        motion = moving.motion
        for shape in motion.shapes if isinstance(motion, Shapes) else ():
            shape.check(surface, job.force)
        if moving.aft and motion.axis:
            check_aft(surface, motion.axis)


def _placements(
    job: Job, surfaces: Sequence[Surface], laws: Sequence[MotionLaw | None] = ()
) -> Iterator[tuple[Placement | TablePlacement, Surface, bool]]:
    """Yield the placement of each hinge and table, its surface, and whether the motion is blended.

    The hinge of a track may be anywhere. What a table moves is known with the laws.
    """
    for moving, surface, law in zip(job.surfaces, surfaces, laws or [None] * len(surfaces), strict=True):
        motion, blended = moving.motion, isinstance(moving.motion, Blended)
        table = motion.base if isinstance(motion, Blended) else motion
        if isinstance(table, Table):
            base = law.base if isinstance(law, BlendedLaw) else law
            moved = base.displacement(1.0) if base else None
            yield replace(TablePlacement.of(surface, table), moved=moved), surface, blended
        if motion.axis is not None and motion.unit != TRACK_UNIT:
            yield Placement.of(surface, motion.axis), surface, blended


def _check_parts(mesh: Mesh, moves: list[str], fixed: tuple[str, ...], sliding: dict[str, str]) -> None:
    for names, others, what in (
        (moves, fixed, "moving and fixed"),
        (moves, sliding, "moving and sliding"),
        (fixed, sliding, "fixed and sliding"),
    ):
        both = sorted(set(names) & set(others))
        if both:
            raise InputError(f"{mesh.name}: patch {both[0]} cannot be {what} at once")


def _check_shared(mesh: Mesh, job: Job, surfaces: Sequence[Surface]) -> None:
    """Raise InputError for a patch of two surfaces that turn; tables add to whatever else moves a patch."""
    turning = [
        name
        for moving, surface in zip(job.surfaces, surfaces, strict=True)
        for name in surface.patches
        if moving.motion.unit != Table.unit
    ]
    twice = sorted({name for name in turning if turning.count(name) > 1})
    if twice:
        raise InputError(f"{mesh.name}: patch {twice[0]} belongs to two moving surfaces; only tables add up")


def _numbered(surfaces: Sequence[Surface]) -> tuple[Surface, ...]:
    """Return surfaces with numbers for those of the same patches."""
    return tuple(
        replace(surface, number=1 + sum(other.patches == surface.patches for other in surfaces[:i]))
        for i, surface in enumerate(surfaces)
    )

"""The nodes in the box, and what must not be there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError, short_list
from sdm_deflect.deform.box.automatic import Automatic, BoxScene, Chosen
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.confined import inside
from sdm_deflect.deform.surface.motions import TRACK_UNIT
from sdm_deflect.meshing.mesh.cells import Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh

from .boundary import ZERO_LENGTH, PrescribedMotion
from .job import Amounts, Section

# Number of positions between rest and the full angle that the box must contain.
POSES = 4
# Nodes this near to a face of the box are on it; a share of the moving surfaces' size.
ON_FACE = 1e-6
# A patch without a role that is nearer than this share of the moving surfaces' size squeezes the box.
NARROW = 0.1
# Boxes that overlap by less than this share of a box's size only touch.
TOUCHING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class BoxNodes:
    """The confining hexahedron and the nodes in it.

    Attributes
    ----------
    box : the hexahedron, why it was chosen, and its open faces.
    inside : (M,) sorted indices of the nodes inside that may be interpolated.
    zones : names of the zones of these nodes.
    fixed : (F,) nodes inside that stay: on fixed patches, and on other patches that touch a face of the box.
    sections : block faces that cut the box, each with its nodes inside (S,) that are on no other patch.
    filter_seconds : time to find `inside`.
    """

    box: Chosen
    inside: IntArray = field(repr=False)
    zones: tuple[str, ...]
    fixed: IntArray = field(repr=False)
    sections: tuple[tuple[Section, IntArray], ...]
    filter_seconds: float

    @property
    def hexahedron(self) -> Hexahedron:
        """The box."""
        return self.box.hexahedron

    @classmethod
    def of(cls, boundary: PrescribedMotion, all_amounts: Sequence[Amounts]) -> "BoxNodes":
        """Confine the motion to all of the given amounts.

        Raises InputError if a moving node leaves the box, or if nodes of a patch without a role are in the box.
        """
        mesh = boundary.mesh
        zones, box = confining_box(boundary, all_amounts)
        box.hexahedron.contains(mesh.points[:1])  # loads compiled code, which is not counted as filter time
        start = perf_counter()
        inside = _inside(mesh, zones, box.hexahedron)
        if boundary.thin:
            inside = inside[np.isin(inside, boundary.thin.nodes[:, 0])]
        seconds = perf_counter() - start
        check_moving(boundary, box.hexahedron, all_amounts)
        _check_clear(boundary, box.hexahedron, inside)
        fixed, sections = _at_rest(boundary, inside)
        return cls(box, inside, tuple(zone.name for zone in zones), fixed, sections, seconds)


def confining_box(boundary: PrescribedMotion, all_amounts: Sequence[Amounts]) -> tuple[tuple[Zone, ...], Chosen]:
    """Return the zones that deform, and the box that contains the motion to all of the given amounts.

    Of the mesh only the patches are needed.
    """
    zones = _zones(boundary)
    return zones, boundary.job.box.choose(_scene(boundary, zones, all_amounts))


def check_disjoint(boxes: Sequence[tuple[str, Hexahedron]], settings: str = "box") -> None:
    """Raise InputError for the first pair of boxes that overlap; the message says by how much.

    The message ends with the `settings` that make them smaller.
    """
    for (first, a), (second, b) in combinations(boxes, 2):
        depth = shared_depth(a, b)
        if depth > TOUCHING * float(np.ptp(a.corners, axis=0).max()):
            raise InputError(
                f"the boxes of {first} and {second} overlap by {2.0 * depth:.3g}; make them smaller ({settings})"
            )


def shared_depth(a: Hexahedron, b: Hexahedron) -> float:
    """Return the radius of the largest ball in both hexahedra; negative if they are apart (linear program)."""
    from scipy.optimize import linprog  # loading takes 0.1 s

    planes = np.vstack([a.planes, b.planes])
    constraints = np.column_stack([planes[:, :3], np.ones(len(planes))])
    result = linprog([0.0, 0.0, 0.0, -1.0], A_ub=constraints, b_ub=planes[:, 3], bounds=[(None, None)] * 4)
    return float(result.x[3])


def _zones(boundary: PrescribedMotion) -> tuple[Zone, ...]:
    """Return the zones with moving nodes, and those that the job names."""
    mesh, wanted = boundary.mesh, boundary.job.zones
    names = [name for zone in mesh.zones for name in zone.blocks or (zone.name,)]
    for name in wanted:
        if name not in (*names, "*"):
            raise InputError(f"{mesh.name}: zones: {name!r} is no zone; the zones are {short_list(names)}")

    def moves(zone: Zone) -> bool:
        first, end = np.searchsorted(boundary.nodes, (zone.start, zone.stop))
        return bool(end > first)

    return tuple(
        z for z in mesh.zones if moves(z) or "*" in wanted or any(name in wanted for name in z.blocks or (z.name,))
    )


def _inside(mesh: Mesh, zones: tuple[Zone, ...], hexahedron: Hexahedron) -> IntArray:
    parts = [zone.start + inside(hexahedron, mesh.points[zone.start : zone.stop]) for zone in zones]
    return np.concatenate(parts)


def _scene(boundary: PrescribedMotion, zones: tuple[Zone, ...], all_amounts: Sequence[Amounts]) -> BoxScene:
    moving = boundary.mesh.points[boundary.nodes]
    poses = dict.fromkeys(
        tuple(share * amount for amount in amounts) for amounts in all_amounts for share in _shares(boundary, amounts)
    )
    moves = [boundary.displacement(pose) for pose in poses]
    largest = max(float(np.linalg.norm(move, axis=1).max()) for move in moves)
    track = np.vstack([moving + move for move in moves])
    axes = (surface.motion.axis for surface in boundary.job.surfaces)
    hinge = next((axis for axis in axes if axis is not None), None)
    far = any(surface.motion.unit == TRACK_UNIT for surface in boundary.job.surfaces)
    return BoxScene(moving, track, largest, hinge, boundary.mesh.points[_obstacles(boundary, zones)], far)


def _shares(boundary: PrescribedMotion, amounts: Amounts) -> list[float]:
    """Return shares of the amounts that the box must contain: `POSES` even ones, and the rows of tracks."""
    shares = {k / POSES for k in range(1, POSES + 1)}
    for surface, law, amount in zip(boundary.job.surfaces, boundary.laws, amounts, strict=True):
        if surface.motion.unit == TRACK_UNIT and amount:
            shares |= {stop / amount for stop in law.functions.stops if 0.0 < stop / amount < 1.0}
    return sorted(map(float, shares))


def _obstacles(boundary: PrescribedMotion, zones: tuple[Zone, ...]) -> IntArray:
    """Return the nodes (O,) of patches without a role, in the zones that deform."""
    known = (*boundary.declared_patches, *boundary.sides)
    nodes = boundary.mesh.on(*(name for name in boundary.mesh.names if name not in known))
    return np.concatenate([nodes[(nodes >= zone.start) & (nodes < zone.stop)] for zone in zones])


def squeezed(boundary: PrescribedMotion, zones: Sequence[str]) -> Iterator[str]:
    """Yield a sentence on each patch without a role that is so near that an automatic box has to end before it.

    `zones` are the names of those that deform.
    """
    if not isinstance(boundary.job.box, Automatic):
        return
    mesh, tree = boundary.mesh, cKDTree(boundary.mesh.points[boundary.nodes])
    obstacles = _obstacles(boundary, tuple(zone for zone in mesh.zones if zone.name in zones))
    apart = tree.query(mesh.points[obstacles], distance_upper_bound=NARROW * boundary.size)[0]
    near, apart = obstacles[apart < np.inf], apart[apart < np.inf]
    roles = {*boundary.declared_patches, *boundary.sides}
    for patch in mesh.patches if len(near) else ():
        if patch.name in roles:  # it shares nodes with one without a role
            continue
        least = float(apart[np.isin(near, patch.nodes)].min(initial=np.inf))
        if least < np.inf:
            names = short_list(surface.label for surface in boundary.surfaces)
            yield (
                f"{patch.name} is {least:.3g} from {names} and has no role: the box ends before it, and squeezes "
                f"cells; {_remedy(mesh, patch, ON_FACE * boundary.size)}"
            )


def check_moving(boundary: PrescribedMotion, hexahedron: Hexahedron, all_amounts: Sequence[Amounts]) -> None:
    """Raise if a moving node starts or ends outside the box."""
    start = boundary.mesh.points[boundary.nodes]
    for amounts in all_amounts:
        move = boundary.displacement(amounts)
        moves = np.abs(move).max(axis=1) > ZERO_LENGTH * boundary.size
        contained = [hexahedron.contains(places[moves], ON_FACE * boundary.size) for places in (start, start + move)]
        out = int(np.count_nonzero(~(contained[0] & contained[1])))
        if out:
            names = short_list(surface.label for surface in boundary.surfaces)
            both = np.vstack([start[moves], (start + move)[moves]])
            low, high = (", ".join(f"{x:.4g}" for x in end) for end in (both.min(axis=0), both.max(axis=0)))
            raise InputError(
                f"{boundary.mesh.name}: {out} of {int(moves.sum())} moving nodes of {names} leave the box at "
                f"{amounts[0]:g}; enlarge it ({boundary.job.box.settings}): they reach from ({low}) to ({high})"
            )


def _check_clear(boundary: PrescribedMotion, hexahedron: Hexahedron, inside: IntArray) -> None:
    mesh, job, tol = boundary.mesh, boundary.job, ON_FACE * boundary.size
    allowed = {*boundary.declared_patches, *boundary.sides} - (set() if job.near_wall else set(boundary.fixed))
    for patch in mesh.patches:
        if patch.name in allowed:
            continue
        nodes = np.intersect1d(patch.nodes, inside, assume_unique=True)
        nodes = np.setdiff1d(nodes, boundary.nodes, assume_unique=True)
        for section in job.sections:
            if section.patch == patch.name:
                nodes = nodes[~_in_plane(mesh.points[nodes], section, tol)]
        within = nodes[hexahedron.contains(mesh.points[nodes], -tol)]
        shared = np.intersect1d(patch.nodes, boundary.nodes, assume_unique=True)
        if len(within):
            raise InputError(
                f"{mesh.name}: the box contains {len(within)} of {len(patch.nodes)} nodes of {patch.name}"
                + (f" ({len(shared)} shared with the moving surface)" if len(shared) else "")
                + f", which must not move; {f'{_remedy(mesh, patch, tol)}, or ' if job.near_wall else ''}take a "
                f"smaller box ({job.box.settings})"
            )
        if len(shared) and patch.name not in boundary.declared_patches:
            raise InputError(
                f"{mesh.name}: {len(shared)} nodes of the moving surface also belong to {patch.name}; "
                f"{_remedy(mesh, patch, tol)}"
            )


def _remedy(mesh: Mesh, patch: Patch, tol: float) -> str:
    """Return how the user can give a patch a role; a plane one may also slide."""
    for pair in mesh.periodic:
        if patch.name in pair.patches:
            sides = " and ".join(dict.fromkeys(pair.patches))
            return f"the sides of {sides} do not match, so it can only stay: name it in fixed"
    points = mesh.points[patch.nodes]
    plane = np.linalg.matrix_rank(points - points[0], tol) < (2 if mesh.plane else 3)
    return f"name it in fixed{f' or slide ({patch.name}:plane)' if plane else ''}"


def _at_rest(boundary: PrescribedMotion, inside: IntArray) -> tuple[IntArray, tuple[tuple[Section, IntArray], ...]]:
    """Return the boundary nodes inside that stay, and the nodes of each section that slide in its plane."""
    mesh, tol = boundary.mesh, ON_FACE * boundary.size
    slides = [section for section in boundary.job.sections if section.slides]
    others = [name for name in mesh.names if name not in boundary.free]
    walls = mesh.on(*(name for name in others if name not in {section.patch for section in slides}))
    sections = []
    for section in slides:
        nodes = np.intersect1d(mesh.patch(section.patch).nodes, inside, assume_unique=True)
        nodes = np.setdiff1d(nodes, union(walls, boundary.nodes), assume_unique=True)
        sections.append((section, nodes[_in_plane(mesh.points[nodes], section, tol)]))
    fixed = np.setdiff1d(np.intersect1d(mesh.on(*others), inside, True), boundary.nodes, assume_unique=True)
    for _, nodes in sections:
        fixed = np.setdiff1d(fixed, nodes, assume_unique=True)
    return _with_images(boundary, inside, fixed), tuple(sections)


def _with_images(boundary: PrescribedMotion, inside: IntArray, fixed: IntArray) -> IntArray:
    """Return the nodes inside that stay, with those whose image stays or is not inside."""
    images, moves = boundary.images, np.zeros(len(boundary.mesh.points), dtype=np.bool_)
    if not len(images.nodes):
        return fixed
    moves[inside] = True
    moves[fixed] = False
    moves[boundary.nodes] = False
    some = np.setdiff1d(inside, boundary.nodes, assume_unique=True)
    return union(fixed, some[~images.complete(moves)[some]])


def _in_plane(points: FloatArray, section: Section, tol: float) -> BoolArray:
    return np.asarray(np.abs(points[:, section.component] - section.point[section.component]) <= tol)

"""Nodes that move as images of one another: those of periodic pairs, and both sides of a case one cell thick.

Files give pairs, or a motion, or neither, and a motion in single precision is 1e-7 off. So the motion is always fitted
to the pairs, and pairs that no rigid motion carries into one another are refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.deform.base.errors import InputError, short_list

from .axis import Axis
from .cells import Patch, Periodic, Polygons
from .edges import polygons_of
from .mesh import Mesh
from .sliding import Plane

THIN = ("empty", "wedge")
"""Constraints of the patches of plane and axisymmetric cases, which are one cell thick."""
CLOSED = 1e-9
"""Least eigenvalue of what binds a displacement: the square of an angle, of which files with six digits leave 1e-12."""
WHOLE = 1e-12
"""Entries of matrices that are this near to a whole number are that number, so that bits are kept."""
PLANE_TOLERANCE = 1e-5
"""Of its size: how far the nodes of a side may be off a plane."""
TOLERANCE = 1e-5
"""Default distance of a node from an image, as a share of the largest coordinate of both: files with six digits."""
LARGEST = 1e100
"""Products of larger coordinates are no numbers."""
SNAP = 1e-6
"""An axis nearer to a coordinate axis than this is that axis, so that the coordinate along it keeps its bits."""
RigidMotion = tuple[FloatArray, FloatArray]
"""Rotation (3, 3) and shift (3,): the image of x is ``rotation @ x + shift``."""
ORIGIN = np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Groups of nodes with one displacement each, which every node of a group has in its own orientation.

    Attributes
    ----------
    nodes : (K,) sorted indices.
    group : (K,) which group each is in, from 0.
    turn : (K, 3, 3) rotation from the group's displacement to that of each node.
    free : (G, 3, 3) projection of a group's displacement onto the directions that it may have.
    """

    nodes: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    group: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    turn: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)
    free: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)

    @classmethod
    def of(cls, mesh: Mesh, flat: Sequence[str] = ()) -> Images:
        """Join the nodes that are images of one another, in one step or several.

        Where a turn leads a node back to itself, as on an axis, its displacement is along the axis. It is within the
        plane of the node's own side in a case one cell thick, where the file says so by a constraint, and on patches
        that shall stay `flat`.
        """
        flat = (*flat, *(patch.name for patch in mesh.patches if patch.constraint))
        pairs = [pair for pair in mesh.periodic if len(pair.nodes)]
        if not pairs:
            return cls()
        nodes, rows = np.unique(np.concatenate([pair.nodes for pair in pairs]), return_inverse=True)
        ends = np.split(rows.reshape(-1, 2), np.cumsum([len(pair.nodes) for pair in pairs])[:-1])
        group = _groups(np.concatenate(ends), len(nodes))
        sides = list(zip(pairs, ends, strict=True))
        turn = _turns(sides, group)
        bound = np.zeros((int(group.max()) + 1, 3, 3))
        for pair, (one, other) in ((pair, own.T) for pair, own in sides):
            back = np.swapaxes(turn[other], 1, 2) @ pair.rotation @ turn[one] - np.eye(3)
            np.add.at(bound, group[one], np.swapaxes(back, 1, 2) @ back)
            plane = plane_of(mesh, pair.nodes[:, 0])
            if plane and not set(flat).isdisjoint(pair.patches):
                normal = np.einsum("kji,j->ki", turn[one], plane.normal)
                np.add.at(bound, group[one], normal[:, :, None] * normal[:, None, :])
        return cls(nodes, group, _whole(turn), _whole(_free(bound)))

    def projected(self, displacement: FloatArray) -> FloatArray:
        """Return displacements (N, 3) in which all nodes of a group have the mean of theirs, each as it is turned.

        It is an orthogonal projection: so a gradient by the result becomes one by the argument.
        """
        if not len(self.nodes):
            return displacement
        out, own = np.array(displacement), np.einsum("kji,kj->ki", self.turn, displacement[self.nodes])
        count = np.bincount(self.group)
        mean = np.stack([np.bincount(self.group, weights=own[:, i]) / count for i in range(3)], axis=1)
        mean = np.einsum("gij,gj->gi", self.free, mean)
        out[self.nodes] = np.einsum("kij,kj->ki", self.turn, mean[self.group])
        return out

    def complete(self, inside: BoolArray) -> BoolArray:
        """Return which nodes are in a mask (N,), those of groups only with all of their group."""
        out = np.array(inside)
        if len(self.nodes):
            all_in = np.bincount(self.group, weights=~inside[self.nodes]) == 0
            out[self.nodes] &= all_in[self.group]
        return out

    def closed(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (L,) with those of their groups; `size` is the number of nodes of the mesh."""
        if not len(self.nodes):
            return nodes
        some = np.zeros(size, dtype=np.bool_)
        some[nodes] = True
        return np.flatnonzero(~self.complete(~some) | some)

    def among(self, nodes: IntArray) -> Images:
        """Return the groups of which all nodes are among distinct ones (M,); their nodes are rows of these."""
        if not len(self.nodes) or not len(nodes):
            return Images()
        row = np.full(max(int(self.nodes[-1]), int(nodes.max())) + 1, -1, dtype=np.intp)
        row[nodes] = np.arange(len(nodes))
        own = self.within(row >= 0)
        order = np.argsort(row[own.nodes])
        return Images(row[own.nodes][order], own.group[order], own.turn[order], own.free)

    def within(self, inside: BoolArray) -> Images:
        """Return the groups of which all nodes are in a mask (N,)."""
        rows = np.flatnonzero(self.complete(inside)[self.nodes]) if len(self.nodes) else self.nodes
        groups, group = np.unique(self.group[rows], return_inverse=True)
        return Images(self.nodes[rows], group.ravel(), self.turn[rows], self.free[groups])


def plane_of(mesh: Mesh, nodes: IntArray) -> Plane | None:
    """Return the plane, in a plane mesh the line, that all these nodes (K,) are in; None if there is none."""
    points = mesh.points[nodes]
    if len(points) < (2 if mesh.plane else 3):
        return None
    plane = Plane.fitted(points, mesh.normal)
    off = float(np.abs(plane.distance(points)).max())
    return plane if off <= PLANE_TOLERANCE * float(np.ptp(points, axis=0).max()) else None


def _groups(ends: IntArray, count: int) -> IntArray:
    """Return which group (count,) each of so many nodes is in, given which are images of one another, (P, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # takes a while to load

    graph = coo_array((np.ones(len(ends), dtype=np.bool_), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _free(bound: FloatArray) -> FloatArray:
    """Return the projections (G, 3, 3) on the directions that matrices (G, 3, 3) send to zero."""
    some = np.abs(bound).max(axis=(1, 2)) > CLOSED
    free = np.tile(np.eye(3), (len(bound), 1, 1))
    values, vectors = np.linalg.eigh(bound[some])
    vectors = vectors * (values > CLOSED)[:, None, :]
    free[some] -= vectors @ np.swapaxes(vectors, 1, 2)
    return free


def _turns(sides: Sequence[tuple[Periodic, IntArray]], group: IntArray) -> FloatArray:
    """Return the rotation (K, 3, 3) from the first node of each group to each node, from pair to pair."""
    turn = np.tile(np.eye(3), (len(group), 1, 1))
    known = np.zeros(len(group), dtype=np.bool_)
    known[np.unique(group, return_index=True)[1]] = True
    while not known.all():
        for pair, (one, other) in ((pair, own.T) for pair, own in sides):
            for start, end, rotation in ((one, other, pair.rotation), (other, one, pair.rotation.T)):
                new = known[start] & ~known[end]
                turn[end[new]] = rotation @ turn[start[new]]
                known[end[new]] = True
    return turn


def _whole(values: FloatArray) -> FloatArray:
    """Return numbers of which those that are almost whole are so."""
    near = np.round(values) + 0.0
    return np.asarray(np.where(np.abs(values - near) < WHOLE, near, values))


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicPatches:
    """Two patches that are images of one another, as a user names them.

    Attributes
    ----------
    first, second : names of the patches; the motion leads from the first to the second.
    axis : axis of the rotation; its angle is that between the patches.
    translation : (3,) the translation. Without both: the translation between the patches, or the rotation about x, y
        or z through the origin, whichever fits.
    """

    first: str
    second: str
    axis: Axis | None = None
    translation: FloatArray | None = None

    def motions(self, points: FloatArray, patches: tuple[Patch, Patch]) -> Iterator[RigidMotion]:
        """Yield the motions that may lead from patch to patch; points (N, 3) are those of the mesh."""
        sides = points[patches[0].nodes], points[patches[1].nodes]
        if self.translation is not None:
            yield np.eye(3), self.translation
        elif self.axis:
            yield rotation_between(*sides, self.axis)
        else:
            yield translation_between(*sides)
            for direction in np.eye(3):
                try:
                    yield rotation_between(*sides, Axis(ORIGIN, direction))
                except InputError:
                    continue


def translation_between(here: FloatArray, there: FloatArray) -> RigidMotion:
    """Return the translation from points `here` (K, 3) to points `there`, in any order."""
    return np.eye(3), there.mean(axis=0) - here.mean(axis=0)


def rotation_between(here: FloatArray, there: FloatArray, axis: Axis) -> RigidMotion:
    """Return the rotation about an axis that leads from points `here` (K, 3) to points `there`, in any order.

    Raises InputError if the centre of either lies on the axis, which leaves the angle open.
    """
    size = max(np.abs(side - axis.point).max() for side in (here, there))
    here, there = (axis.radial(side.mean(axis=0)[None])[0] for side in (here, there))
    if min(np.linalg.norm(here), np.linalg.norm(there)) <= TOLERANCE * size:
        raise InputError("a periodic patch whose centre lies on the axis leaves the angle open: give the angle")
    angle = np.degrees(np.arctan2(axis.direction @ np.cross(here, there), here @ there))
    return about(axis, float(angle))


def about(axis: Axis, degrees: float) -> RigidMotion:
    """Return the rotation by an angle in degrees about an axis."""
    return axis.matrix(degrees), axis.displacement(np.zeros((1, 3)), degrees)[0]


def tolerance(points: FloatArray, *nodes: IntArray) -> float:
    """Return the default distance that a node may have from an image, in the unit of points (N, 3)."""
    return TOLERANCE * max((float(np.abs(points[some]).max(initial=0.0)) for some in nodes), default=0.0)


def images_of_faces(
    one: Polygons, other: Polygons, here: FloatArray, there: FloatArray, near: float
) -> IntArray | None:
    """Return the nodes of faces and their images among the nodes of other faces (K, 2), the first ones rising.

    Each face is matched with the one at its centre, then the corners of both: nodes at one place keep images of their
    own, as on baffles and sliding interfaces.

    Parameters
    ----------
    one, other : The faces.
    here, there : Where the images of the corners of `one` should be (C, 3), and the corners of `other` (D, 3).
    near : Largest distance of a corner from an image.

    Returns None if the faces do not match.
    """
    from scipy.spatial import cKDTree  # takes a tenth of a second to load

    sizes = [np.diff(faces.offsets) for faces in (one, other)]
    if len(one) != len(other) or not len(one):
        return None
    sums = [np.add.reduceat(*pair) for pair in ((here, one.offsets[:-1]), (there, other.offsets[:-1]))]
    centres = [total / size[:, None] for total, size in zip(sums, sizes, strict=True)]
    apart, rows = cKDTree(centres[1]).query(centres[0])
    if apart.max() > near or len(distinct(rows)) < len(rows) or (sizes[0] != sizes[1][rows]).any():
        return None
    images, off = _corner_images(one, other, here, there, rows)
    pairs = np.unique(np.column_stack([one.nodes, images]), axis=0)
    unique = all(len(distinct(side)) == len(pairs) for side in pairs.T)
    return pairs if unique and off.max() <= near else None


def _corner_images(
    one: Polygons, other: Polygons, here: FloatArray, there: FloatArray, rows: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return the node of the other faces, of rows (F,), at each corner (C,), and the largest distance (F,) of a face.

    The corners of a face follow one another in both, from any one on, and the same way or the other.
    """
    images, off, sizes = np.empty_like(one.nodes), np.full(len(one), np.inf), np.diff(one.offsets)
    for size in distinct(sizes):
        faces, corner = np.flatnonzero(sizes == size), np.arange(size)
        first, start = one.offsets[faces, None] + corner, other.offsets[rows[faces], None]
        for turn, sense in product(range(size), (-1, 1)):
            second = start + (turn + sense * corner) % size
            apart = np.abs(here[first] - there[second]).max(axis=(1, 2))
            closer = apart < off[faces]
            images[first[closer]], off[faces[closer]] = other.nodes[second[closer]], apart[closer]
    return images, off


def matched(
    points: FloatArray, patches: tuple[Patch, Patch], motion: RigidMotion, allowed: float | None = None
) -> IntArray:
    """Return each node of the first patch, and the node of the second that is its image, (K, 2); first ones rise.

    They are matched by faces, or by place alone where the faces of the two patches differ.

    Parameters
    ----------
    points : (N, 3) of the mesh.
    patches : Two patches; a node on the axis may be in both, and is its own image.
    motion : What leads from the first to the second.
    allowed : Largest distance of a node from an image; None for `tolerance`.

    Raises InputError if a node has no image, or an image belongs to two nodes.
    """
    from scipy.spatial import cKDTree  # takes a tenth of a second to load

    one, other = patches
    what = f"periodic patches {one.name} and {other.name}"
    first, second = one.nodes, other.nodes
    if len(first) != len(second) or not len(first):
        raise InputError(f"{what} have {len(first)} and {len(second)} nodes: they must match node by node")
    allowed = tolerance(points, first, second) if allowed is None else allowed
    here, there = polygons_of(one.faces), polygons_of(other.faces)
    if all(len(distinct(faces.nodes)) == len(first) for faces in (here, there)):
        moved = points[here.nodes] @ motion[0].T + motion[1]
        if (pairs := images_of_faces(here, there, moved, points[there.nodes], allowed)) is not None:
            return pairs
    images = points[first] @ motion[0].T + motion[1]
    apart, rows = cKDTree(points[second]).query(images)
    if apart.max() > allowed:
        worst = int(np.argmax(apart))
        place = ", ".join(f"{x:g}" for x in points[first[worst]])
        raise InputError(
            f"{what}: the node at ({place}) has no image within {allowed:.3g}, the nearest node of {other.name} is "
            f"{apart[worst]:.3g} away from it; check the rotation or the translation from {one.name} to {other.name}"
        )
    if len(distinct(rows)) < len(rows):
        raise InputError(f"{what}: two nodes have the same image, so the patches do not match node by node")
    return np.column_stack([first, second[rows]])


def fitted(
    points: FloatArray, name: str, patches: tuple[str, str], nodes: IntArray, allowed: float | None = None
) -> Periodic:
    """Return a pair with the rigid motion that fits its nodes: a translation if one does, else with a rotation.

    Parameters
    ----------
    points : (N, 3) of the mesh.
    name, patches : Of the pair.
    nodes : (K, 2) a node, and its image.
    allowed : Largest distance of an image from where the motion puts it; None for `tolerance`.

    Raises InputError if there are no nodes, one has two images, or no rigid motion fits all.
    """
    if np.array_equal(nodes[:, 0], nodes[:, 1]):
        raise InputError(f"periodic pair {name}: {'every node is its own image' if len(nodes) else 'it has no nodes'}")
    if any(len(distinct(side)) < len(side) for side in nodes.T):
        raise InputError(f"periodic pair {name}: a node has two images")
    allowed = tolerance(points, *nodes.T) if allowed is None else allowed
    here, there = points[nodes[:, 0]], points[nodes[:, 1]]
    if (largest := max(np.abs(here).max(), np.abs(there).max())) > LARGEST:
        raise InputError(f"periodic pair {name}: its nodes lie at up to {largest:.3g}; {LARGEST:g} is the limit")
    centre, target = here.mean(axis=0), there.mean(axis=0)
    rotation = np.eye(3)
    if np.abs(there - here - (target - centre)).max() > allowed:
        rotation = rotation_of(here - centre, there - target)
    shift = np.median(there - here @ rotation.T, axis=0)  # a mean of equal numbers is off in its last digits
    found = Periodic(name, patches, nodes, rotation, shift)
    apart = float(np.linalg.norm(found.image(here) - there, axis=1).max())
    if not apart <= allowed:
        raise InputError(f"periodic pair {name}: no rigid motion leads to all images, the best one is {apart:.3g} off")
    return found


def nearest_rotation(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that leads from vectors (K, 3) to others, by least squares (Kabsch 1976)."""
    u, _, v = np.linalg.svd(here.T @ there)
    return np.asarray(v.T @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ u.T)


def rotation_of(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that leads from vectors (K, 3) to others, about a coordinate axis if near one."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(nearest_rotation(here, there)).as_rotvec()
    flat = not (here[:, 2].any() or there[:, 2].any())
    direction = np.array([0.0, 0.0, 1.0]) if flat else turn / max(float(np.linalg.norm(turn)), SNAP)
    if np.abs(direction - np.round(direction)).max() < SNAP:
        direction = np.round(direction)
    if not direction.any():
        return np.eye(3)
    axis = Axis(ORIGIN, direction)
    here, there = axis.radial(here), axis.radial(there)
    angle = 0.0
    for _ in range(2):  # what is left of the angle is known to more digits than the angle
        turned = here @ axis.matrix(angle).T
        sine, cosine = axis.direction @ np.cross(turned, there).sum(axis=0), (turned * there).sum()
        angle += float(np.degrees(np.arctan2(sine, cosine)))
    return axis.matrix(angle)


def pair_of(points: FloatArray, patches: tuple[Patch, Patch], wanted: PeriodicPatches) -> Periodic:
    """Return the pair that two patches of points (N, 3) are; InputError if no motion that is wanted fits."""
    names = patches[0].name, patches[1].name
    if not all(len(patch.nodes) for patch in patches):
        raise InputError(f"periodic patches {names[0]} and {names[1]}: a patch without nodes has no images")
    errors: list[InputError] = []
    for motion in wanted.motions(points, patches):
        try:
            return fitted(points, names[0], names, matched(points, patches, motion))
        except InputError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    raise InputError(
        f"{errors[0]}; no rotation about x, y or z through the origin fits either: give the axis or the translation"
    )


def paired(mesh: Mesh, wanted: Sequence[PeriodicPatches]) -> Mesh:
    """Return the mesh with the pairs that a user names, in place of those of the file on the same patches.

    Raises InputError if a name is of no patch or of several, or the patches do not match node by node.
    """
    own = []
    for one in wanted:
        names = mesh.named([one.first, one.second], "periodic")
        if len(names) != 2:
            raise InputError(
                f"{mesh.name}: periodic {one.first} {one.second} stands for {short_list(names)}; name two patches"
            )
        own.append(pair_of(mesh.points, (mesh.patch(names[0]), mesh.patch(names[1])), one))
    taken = {name for pair in own for name in pair.patches}
    kept = [pair for pair in mesh.periodic if not taken & set(pair.patches)]
    return replace(mesh, periodic=(*kept, *own)) if own else mesh

"""Nodes that are images of one another, in periodic pairs and on both sides of a case one cell thick.

Files contain pairs, a motion, or neither; a motion in single precision is wrong by 1e-7. So the motion is always fitted
to the pairs, and pairs that no rigid motion fits are refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct
from sdm_deflect.base.errors import InputError, short_list

from .axis import Axis
from .cells import Patch, Periodic, Polygons
from .edges import polygons_of
from .mesh import Mesh
from .sliding import Plane

# Constraints of the patches of plane and axisymmetric cases, which are one cell thick.
THIN = ("empty", "wedge")
# Least eigenvalue of a constraint on a displacement: a squared angle; files with six digits give errors of 1e-12.
CLOSED = 1e-9
# Matrix entries this near to a whole number become that number, so that coordinates keep their bits.
WHOLE = 1e-12
# Largest distance of a side's nodes from a plane, as a share of its size.
PLANE_TOLERANCE = 1e-5
# Default of the largest distance from node to image, as a share of the largest coordinate: files with six digits.
TOLERANCE = 1e-5
# Larger coordinates would overflow in products.
LARGEST = 1e100
# An axis nearer to a coordinate axis becomes that axis, so that coordinates along it keep their bits.
SNAP = 1e-6
# Rotation (3, 3) and shift (3,): the image of x is ``rotation @ x + shift``.
RigidMotion = tuple[FloatArray, FloatArray]
ORIGIN = np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Groups of nodes with a common displacement, turned for each node.

    Attributes
    ----------
    nodes : (K,) sorted indices.
    group : (K,) group of each node, from 0.
    turn : (K, 3, 3) rotation from the group's displacement to each node's.
    free : (G, 3, 3) projection of a group's displacement onto its allowed directions.
    """

    nodes: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    group: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    turn: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)
    free: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)), repr=False)

    @classmethod
    def of(cls, mesh: Mesh, flat: Sequence[str] = ()) -> Images:
        """Group the nodes that are images of one another, directly or through other nodes.

        If a rotation maps a node to itself, as on an axis, the node moves along the axis. Nodes stay in the plane of
        their side in a case one cell thick with a constraint in the file, and on patches that shall stay `flat`.
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
        for pair, (first, second) in ((pair, sides_of.T) for pair, sides_of in sides):
            back = np.swapaxes(turn[second], 1, 2) @ pair.rotation @ turn[first] - np.eye(3)
            np.add.at(bound, group[first], np.swapaxes(back, 1, 2) @ back)
            plane = plane_of(mesh, pair.nodes[:, 0])
            if plane and not set(flat).isdisjoint(pair.patches):
                normal = np.einsum("kji,j->ki", turn[first], plane.normal)
                np.add.at(bound, group[first], normal[:, :, None] * normal[:, None, :])
        return cls(nodes, group, _whole(turn), _whole(_free(bound)))

    def projected(self, displacement: FloatArray) -> FloatArray:
        """Return displacements (N, 3) with the mean of each group at its nodes, turned for each.

        The projection is orthogonal, so it also turns a gradient by its result into one by its argument.
        """
        if not len(self.nodes):
            return displacement
        out, back = np.array(displacement), np.einsum("kji,kj->ki", self.turn, displacement[self.nodes])
        count = np.bincount(self.group)
        mean = np.stack([np.bincount(self.group, weights=back[:, i]) / count for i in range(3)], axis=1)
        mean = np.einsum("gij,gj->gi", self.free, mean)
        out[self.nodes] = np.einsum("kij,kj->ki", self.turn, mean[self.group])
        return out

    def complete(self, inside: BoolArray) -> BoolArray:
        """Return the mask (N,) without nodes of groups that are not completely in it."""
        out = np.array(inside)
        if len(self.nodes):
            all_in = np.bincount(self.group, weights=~inside[self.nodes]) == 0
            out[self.nodes] &= all_in[self.group]
        return out

    def closure(self, nodes: IntArray, size: int) -> IntArray:
        """Return sorted nodes (L,) with all nodes of their groups; `size` is the number of nodes of the mesh."""
        if not len(self.nodes):
            return nodes
        some = np.zeros(size, dtype=np.bool_)
        some[nodes] = True
        return np.flatnonzero(~self.complete(~some) | some)

    def among(self, nodes: IntArray) -> Images:
        """Return the groups whose nodes are all among distinct nodes (M,), as rows of these."""
        if not len(self.nodes) or not len(nodes):
            return Images()
        row = np.full(max(int(self.nodes[-1]), int(nodes.max())) + 1, -1, dtype=np.intp)
        row[nodes] = np.arange(len(nodes))
        complete = self.within(row >= 0)
        order = np.argsort(row[complete.nodes])
        return Images(row[complete.nodes][order], complete.group[order], complete.turn[order], complete.free)

    def within(self, inside: BoolArray) -> Images:
        """Return the groups whose nodes are all in a mask (N,)."""
        rows = np.flatnonzero(self.complete(inside)[self.nodes]) if len(self.nodes) else self.nodes
        groups, group = np.unique(self.group[rows], return_inverse=True)
        return Images(self.nodes[rows], group.ravel(), self.turn[rows], self.free[groups])


def plane_of(mesh: Mesh, nodes: IntArray) -> Plane | None:
    """Return the plane (in a plane mesh the line) through nodes (K,); None if they lie in no plane."""
    points = mesh.points[nodes]
    if len(points) < (2 if mesh.plane else 3):
        return None
    plane = Plane.fitted(points, mesh.normal)
    off = float(np.abs(plane.distance(points)).max())
    return plane if off <= PLANE_TOLERANCE * float(np.ptp(points, axis=0).max()) else None


def _groups(ends: IntArray, count: int) -> IntArray:
    """Return the group (count,) of each node, given pairs of images (P, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # loading takes a while

    graph = coo_array((np.ones(len(ends), dtype=np.bool_), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _free(bound: FloatArray) -> FloatArray:
    """Return the projections (G, 3, 3) onto the null spaces of matrices (G, 3, 3)."""
    some = np.abs(bound).max(axis=(1, 2)) > CLOSED
    free = np.tile(np.eye(3), (len(bound), 1, 1))
    values, vectors = np.linalg.eigh(bound[some])
    vectors = vectors * (values > CLOSED)[:, None, :]
    free[some] -= vectors @ np.swapaxes(vectors, 1, 2)
    return free


def _turns(sides: Sequence[tuple[Periodic, IntArray]], group: IntArray) -> FloatArray:
    """Return the rotation (K, 3, 3) from the first node of each group to each node, through pairs."""
    turn = np.tile(np.eye(3), (len(group), 1, 1))
    known = np.zeros(len(group), dtype=np.bool_)
    known[np.unique(group, return_index=True)[1]] = True
    while not known.all():
        for pair, (first, second) in ((pair, nodes.T) for pair, nodes in sides):
            for start, end, rotation in ((first, second, pair.rotation), (second, first, pair.rotation.T)):
                new = known[start] & ~known[end]
                turn[end[new]] = rotation @ turn[start[new]]
                known[end[new]] = True
    return turn


def _whole(values: FloatArray) -> FloatArray:
    """Return numbers; those near a whole number are rounded to it."""
    near = np.round(values) + 0.0
    return np.asarray(np.where(np.abs(values - near) < WHOLE, near, values))


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicPatches:
    """Two patches that the user calls images of each other.

    Attributes
    ----------
    first, second : names of the patches; the motion maps the first to the second.
    axis : axis of the rotation; the angle is that between the patches.
    translation : (3,) the translation. Without axis and translation: the translation between the patches, or the
        rotation about x, y or z through the origin, whichever fits.
    """

    first: str
    second: str
    axis: Axis | None = None
    translation: FloatArray | None = None

    def motions(self, points: FloatArray, patches: tuple[Patch, Patch]) -> Iterator[RigidMotion]:
        """Yield possible motions from patch to patch, given the points (N, 3) of the mesh."""
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
    """Return the translation from points `here` (K, 3) to points `there`, which may be in another order."""
    return np.eye(3), there.mean(axis=0) - here.mean(axis=0)


def rotation_between(here: FloatArray, there: FloatArray, axis: Axis) -> RigidMotion:
    """Return the rotation about an axis from points `here` (K, 3) to points `there`, which may be in another order.

    Raises InputError if the centre of either is on the axis, so that the angle is unknown.
    """
    size = max(np.abs(side - axis.point).max() for side in (here, there))
    here, there = (axis.radial(side.mean(axis=0)[None])[0] for side in (here, there))
    if min(np.linalg.norm(here), np.linalg.norm(there)) <= TOLERANCE * size:
        raise InputError("a periodic patch whose centre lies on the axis leaves the angle open: give the angle")
    angle = np.degrees(np.arctan2(axis.direction @ np.cross(here, there), here @ there))
    return about(axis, float(angle))


def about(axis: Axis, degrees: float) -> RigidMotion:
    """Return the rotation about an axis by an angle in degrees."""
    return axis.matrix(degrees), axis.displacement(np.zeros((1, 3)), degrees)[0]


def tolerance(points: FloatArray, *nodes: IntArray) -> float:
    """Return the default distance allowed between node and image, in the unit of points (N, 3)."""
    return TOLERANCE * max((float(np.abs(points[some]).max(initial=0.0)) for some in nodes), default=0.0)


def images_of_faces(
    one: Polygons, other: Polygons, here: FloatArray, there: FloatArray, near: float
) -> IntArray | None:
    """Return the nodes of faces and their images among the nodes of other faces (K, 2), sorted by the first.

    Each face is matched with one of the same centre, then their corners. So coincident nodes have images of their own,
    as on baffles and sliding interfaces.

    Parameters
    ----------
    one, other : The faces.
    here, there : Expected places of the images of `one`'s corners (C, 3), and `other`'s corners (D, 3).
    near : Largest distance between a corner and an image.

    Returns None if the faces do not match.
    """
    from scipy.spatial import cKDTree  # loading takes 0.1 s

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
    """Return the image (C,) of each corner, and each face's largest distance (F,); face i matches face `rows[i]`.

    The corners of matching faces have the same or the opposite order, with any first corner.
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


def match_nodes(
    points: FloatArray, patches: tuple[Patch, Patch], motion: RigidMotion, allowed: float | None = None
) -> IntArray:
    """Return the nodes of the first patch and their images in the second (K, 2), sorted by the first.

    Nodes are matched by faces, or by place alone if the faces differ.

    Parameters
    ----------
    points : (N, 3) of the mesh.
    patches : Two patches; a node on the axis may be in both and is its own image.
    motion : Motion from the first patch to the second.
    allowed : Largest distance between node and image; None for `tolerance`.

    Raises InputError if a node has no image, or two nodes have the same.
    """
    from scipy.spatial import cKDTree  # loading takes 0.1 s

    first_patch, second_patch = patches
    what = f"periodic patches {first_patch.name} and {second_patch.name}"
    first, second = first_patch.nodes, second_patch.nodes
    if len(first) != len(second) or not len(first):
        raise InputError(f"{what} have {len(first)} and {len(second)} nodes: they must match node by node")
    allowed = tolerance(points, first, second) if allowed is None else allowed
    here, there = polygons_of(first_patch.faces), polygons_of(second_patch.faces)
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
            f"{what}: the node at ({place}) has no image within {allowed:.3g}, the nearest node of {second_patch.name} "
            f"is {apart[worst]:.3g} away from it; check the rotation or the translation from {first_patch.name} to "
            f"{second_patch.name}"
        )
    if len(distinct(rows)) < len(rows):
        raise InputError(f"{what}: two nodes have the same image, so the patches do not match node by node")
    return np.column_stack([first, second[rows]])


def fit_motion(
    points: FloatArray, name: str, patches: tuple[str, str], nodes: IntArray, allowed: float | None = None
) -> Periodic:
    """Return a pair with the rigid motion that fits its nodes: a translation if possible, else with a rotation.

    Parameters
    ----------
    points : (N, 3) of the mesh.
    name, patches : Name and patches of the pair.
    nodes : (K, 2) node and image.
    allowed : Largest distance between an image and its place by the motion; None for `tolerance`.

    Raises InputError if there are no nodes, if a node has two images, or if no rigid motion fits.
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
    shift = np.median(there - here @ rotation.T, axis=0)  # the mean of equal numbers may differ in the last digits
    pair = Periodic(name, patches, nodes, rotation, shift)
    apart = float(np.linalg.norm(pair.image(here) - there, axis=1).max())
    if not apart <= allowed:
        raise InputError(f"periodic pair {name}: no rigid motion leads to all images, the best one is {apart:.3g} off")
    return pair


def nearest_rotation(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) between sets of vectors (K, 3), by least squares (Kabsch 1976)."""
    u, _, v = np.linalg.svd(here.T @ there)
    return np.asarray(v.T @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ u.T)


def rotation_of(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) between sets of vectors (K, 3), about a coordinate axis if its axis is near one."""
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
    for _ in range(2):  # the remainder of the angle is known to more digits than the angle
        turned = here @ axis.matrix(angle).T
        sine, cosine = axis.direction @ np.cross(turned, there).sum(axis=0), (turned * there).sum()
        angle += float(np.degrees(np.arctan2(sine, cosine)))
    return axis.matrix(angle)


def pair_of(points: FloatArray, patches: tuple[Patch, Patch], wanted: PeriodicPatches) -> Periodic:
    """Return two patches at points (N, 3) as a pair; InputError if none of the possible motions fits."""
    names = patches[0].name, patches[1].name
    if not all(len(patch.nodes) for patch in patches):
        raise InputError(f"periodic patches {names[0]} and {names[1]}: a patch without nodes has no images")
    errors: list[InputError] = []
    for motion in wanted.motions(points, patches):
        try:
            return fit_motion(points, names[0], names, match_nodes(points, patches, motion))
        except InputError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    raise InputError(
        f"{errors[0]}; no rotation about x, y or z through the origin fits either: give the axis or the translation"
    )


def pair_patches(mesh: Mesh, wanted: Sequence[PeriodicPatches]) -> Mesh:
    """Return the mesh with the pairs that a user names; they replace the file's pairs of the same patches.

    Raises InputError if a name means no patch or several, or if the patches do not match node by node.
    """
    pairs = []
    for named in wanted:
        names = mesh.expand([named.first, named.second], "periodic")
        if len(names) != 2:
            raise InputError(
                f"{mesh.name}: periodic {named.first} {named.second} stands for {short_list(names)}; name two patches"
            )
        pairs.append(pair_of(mesh.points, (mesh.patch(names[0]), mesh.patch(names[1])), named))
    taken = {name for pair in pairs for name in pair.patches}
    kept = [pair for pair in mesh.periodic if not taken & set(pair.patches)]
    return replace(mesh, periodic=(*kept, *pairs)) if pairs else mesh

"""Which node of one periodic patch is the image of which of the other, and by which rigid motion.

Files give pairs, or a motion, or neither, and a motion in single precision is 1e-7 off. So the motion is always fitted
to the pairs, and pairs that no rigid motion carries into one another are refused.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.sets import distinct
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.mesh.cells import Patch, Periodic
from sdm_deflect.deform.mesh.mesh import Mesh

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


def matched(
    points: FloatArray, patches: tuple[Patch, Patch], motion: RigidMotion, allowed: float | None = None
) -> IntArray:
    """Return each node of the first patch, and the node of the second that is its image, (K, 2); first ones rise.

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
                f"{mesh.name}: periodic {one.first} {one.second} stands for {', '.join(names)}; name two patches"
            )
        own.append(pair_of(mesh.points, (mesh.patch(names[0]), mesh.patch(names[1])), one))
    taken = {name for pair in own for name in pair.patches}
    kept = [pair for pair in mesh.periodic if not taken & set(pair.patches)]
    return replace(mesh, periodic=(*kept, *own)) if own else mesh

"""Hinges that follow from the mesh: candidates for a sealed flap, and a device that is cut from a clean wing."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sdm_deflect.base.arrays import FloatArray, IntArray, distinct
from sdm_deflect.base.errors import InputError
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Polygons, take_faces
from sdm_deflect.meshing.mesh.edges import Joints, are_lines, area_vectors, edges_of, polygons_of, unit
from sdm_deflect.meshing.mesh.mesh import Mesh, Warned
from sdm_deflect.meshing.mesh.selection import Before, Selection

# Degrees: two skins that meet at a smaller angle go on across a hinge; a root or a gap turns by more.
SMOOTH = 40.0
# Least cosine between an edge on a hinge and the flap's longest axis.
ALONG = 0.9
# Coordinates that are smaller, as shares of the largest, are shown as 0.
ROUNDING = 1e-9
# Share of a hinge's span to which a proposed one is rounded: meshers place its nodes less exactly.
ROUGH = 1e-5
# Length of the mean unit normal beside a line, above which there is one skin: a flap has two, which face apart.
ONE_SKIN = 0.7
# Least share of its speed with which a point aft of the hinge rises or falls; below, down and up mean nothing.
LEVER = 0.2
# Share of the span from an end of a wing at which its last section is taken: at the very end there is none.
ENDS = 0.01
# Share of the span of a device by which it may end elsewhere than was asked, before that is a warning.
OFF = 0.1
# Least length of a hinge, in spans of the flap; largest distance of its edges from the line, in chords.
COVERED, STRAIGHT = 0.5, 0.15


def candidates(mesh: Mesh, names: Sequence[str]) -> Iterator[FloatArray]:
    """Yield hinges (2, 3) of patches where their skins go on in other patches along a straight line.

    In a plane mesh both points are the middle of the two nodes where the skins meet.
    Slotted flaps, and tails on a fuselage, have none.
    """
    flap = polygons_of(mesh.faces_of(names))
    edges, face = _smooth_border(mesh, flap, polygons_of(mesh.faces_of([n for n in mesh.names if n not in names])))
    if are_lines(flap):
        if len(at := distinct(edges.ravel())) == 2:
            yield np.tile(mesh.points[at].mean(axis=0), (2, 1))
        return
    if not len(edges):
        return
    points = mesh.points[distinct(flap.nodes)]
    centred = points - points.mean(axis=0)
    chord, span = np.linalg.eigh(centred.T @ centred)[1].T[1:]
    way, places = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], mesh.points[edges].mean(axis=1)
    length, normals = np.linalg.norm(way, axis=1), unit(area_vectors(mesh.points, flap))[face]
    station, along = (places - points.mean(axis=0)) @ chord, np.abs(way @ span) > ALONG * length
    for side in (-1.0, 1.0):
        rows = np.flatnonzero(along & (side * station > 0.0))
        if len(rows) < 2 or np.linalg.norm(normals[rows].mean(axis=0)) > ONE_SKIN:
            continue
        line, middle = places[rows], np.average(places[rows], axis=0, weights=length[rows])
        axis = Axis(middle, np.linalg.svd(line - middle)[2][0])
        covers = np.ptp(line @ span) > COVERED * np.ptp(points @ span)
        if covers and np.abs(axis.radial(line) @ chord).max() < STRAIGHT * np.ptp(points @ chord):
            ends = (points - middle) @ axis.direction
            pair = middle + np.outer([ends.min(), ends.max()], axis.direction)
            yield pair[np.argsort(np.abs(pair @ span))]


def _smooth_border(mesh: Mesh, flap: Polygons, rest: Polygons) -> tuple[IntArray, IntArray]:
    """Return the edges (E, 2) across which the skin goes on smoothly, and the patch's face (E,) at each."""
    on = np.zeros(len(mesh.points), dtype=np.bool_)
    on[flap.nodes] = True
    if len(rest):
        rest = take_faces(rest, np.flatnonzero(np.logical_or.reduceat(on[rest.nodes], rest.offsets[:-1])))
    faces = Polygons(np.append(flap.nodes, rest.nodes), np.append(flap.offsets, flap.offsets[-1] + rest.offsets[1:]))
    joints = Joints.of(faces)
    within = joints.first < len(flap)
    kept = within != (joints.second < len(flap))
    kept &= joints.cosines(mesh.points, faces) > np.cos(np.radians(SMOOTH))
    return joints.edges[kept], np.where(within, joints.first, joints.second)[kept]


def ends_text(hinge: ArrayLike) -> str:
    """Return a hinge as words of the command line: two points, or x and y in a plane mesh; rounded by its span."""
    ends = np.asarray(hinge, dtype=np.float64)
    span = float(np.linalg.norm(ends[1] - ends[0]))
    ends = ends if span else ends[:1, :2]
    step = 10.0 ** np.round(np.log10(ROUGH * span)) if span else ROUNDING * np.abs(ends).max()
    clean = np.where(np.abs(ends) > step, np.round(ends / step) * step if span else ends, 0.0)
    return " ".join(",".join(f"{x:.6g}" for x in end) for end in clean)


def rise(direction: FloatArray, vertical: int) -> float:
    """Return the rate at which a point aft of a hinge rises in a positive turn about the hinge's direction (3,).

    Aft is along x. Raises InputError if the rate is nearly zero: down and up are then undefined.
    """
    rate = float(np.cross(direction, [1.0, 0.0, 0.0])[vertical])
    if abs(rate) < LEVER:
        other = "y" if vertical == 2 else "z"
        raise InputError(
            f"down and up: the hinge lies along {'xyz'[vertical]}, or along the flow, x: set vertical = {other}, or "
            "give the angle"
        )
    return rate


def device(
    mesh: Mesh, name: str, wall: str, stations: tuple[float, float], share: float
) -> tuple[FloatArray, Selection, str]:
    """Return the hinge (2, 3) of a device on a wing, the selection that cuts it out, named `name`, and a note.

    The flow is along x. The span is the longer one of the other axes, and stations are shares of it, from the end
    nearer to 0. The hinge is at a share of the local chord, half-way between the skins; its points are in the order of
    the growing span. The device lies behind it. It ends where faces do: of a coarse wing at the nearest stations. The
    note says which end of the wing is 0, and what was cut; it is a warning if that is far off.

    Raises InputError if stations or share are not ascending between 0 and 1, if there is no section at a station, or if
    nothing is cut out.
    """
    (patch,) = mesh.expand([wall], "device")
    if not 0.0 <= stations[0] < stations[1] <= 1.0 or not 0.0 < share < 1.0:
        raise InputError(f"device: stations {stations} must ascend from 0 to 1, and the share {share:g} be between")
    edges = np.unique(np.sort(edges_of(polygons_of(mesh.faces_of([patch])))[0], axis=1), axis=0)
    a, b = mesh.points[edges[:, 0]], mesh.points[edges[:, 1]]
    size = np.ptp(np.vstack([a, b]), axis=0)
    span, up = (1, 2) if size[1] >= size[2] else (2, 1)
    low, high = sorted((a[:, span].min(), a[:, span].max()), key=abs)
    taken = [ENDS if station == 0.0 else 1.0 - ENDS if station == 1.0 else station for station in stations]
    cuts = []
    for station in taken:
        at = low + station * (high - low)
        cut = np.flatnonzero((a[:, span] - at) * (b[:, span] - at) < 0.0)
        if len(cut) < 4:
            raise InputError(f"device: {patch} has no section at the station {station:g} of its span")
        along = (at - a[cut, span]) / (b[cut, span] - a[cut, span])
        cuts.append(_middle(a[cut] + along[:, None] * (b[cut] - a[cut]), share, up))
    slope = (cuts[1] - cuts[0]) / (taken[1] - taken[0])
    off = [(asked - at) * slope if asked != at else np.zeros(3) for asked, at in zip(stations, taken, strict=True)]
    first, second = (cut + way for cut, way in zip(cuts, off, strict=True))
    across = np.zeros(3)
    across[span] = 1.0 if second[span] > first[span] else -1.0
    aft = np.cross(second - first, np.eye(3)[up])
    aft *= np.sign(aft[0]) or 1.0
    planes = ((first, across), (second, -across), (first, aft))
    before = tuple(Before(tuple(point.tolist()), tuple(normal.tolist())) for point, normal in planes)
    sides = (",".join(map(repr, (*plane.point, *plane.normal))) for plane in before)
    behind = Selection(name, patch, before, text=" ".join([patch, *(f"side:{side}" for side in sides)]))
    along, asked = "xyz"[span], np.sort([first[span], second[span]])
    faces = behind.parts(mesh)[1][0].faces
    nodes = distinct(faces.nodes)
    made = np.array([mesh.points[nodes, span].min(), mesh.points[nodes, span].max()])
    hinge = first + ((made - first[span]) / (second[span] - first[span]))[:, None] * (second - first)
    tiny = ROUNDING * size[span]
    ends = " and ETA 1 at ".join(f"{along} = {end * (abs(end) > tiny):.4g}" for end in (low, high))
    text = (
        f"{name}: ETA 0 of {patch} is at {ends}; {along} from {asked[0]:.4g} to {asked[1]:.4g} was asked, and "
        f"{len(faces)} faces from {made[0]:.4g} to {made[1]:.4g} were cut, with {len(nodes)} nodes"
    )
    far = np.abs(made - asked).max() > OFF * (asked[1] - asked[0])
    return hinge, behind, Warned(f"{text}: the wing is coarse there") if far else text


def _middle(section: FloatArray, share: float, up: int) -> FloatArray:
    """Return the point half-way between the skins of a section (K, 3), at a share of its chord."""
    section = section[np.argsort(section[:, 0], kind="stable")]
    nose, tail = section[[0, -1]]
    out = nose + share * (tail - nose)
    height = section[:, up] - np.interp(section[:, 0], [nose[0], tail[0]], [nose[up], tail[up]])
    skins = [section[side] for side in (height >= 0.0, height <= 0.0)]
    out[up] = np.mean([np.interp(out[0], skin[:, 0], skin[:, up]) for skin in skins])
    return np.asarray(out)

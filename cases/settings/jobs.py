"""Conversion of settings to jobs of the engine: files are read; words become motions, nodes and boxes.

A selection of patches is written as ``flap=wall#2 box:0.6,-1,-1,1,1,1``.
"""

import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from math import isnan
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.unpacking import columns_of, damaged, read_rows
from sdm_deflect.deform.box.automatic import Automatic, BoxRule, Given, Outline
from sdm_deflect.deform.box.hexahedron import Hexahedron
from sdm_deflect.deform.options import JobOptions
from sdm_deflect.deform.surface.blended import Blended, Rib
from sdm_deflect.deform.surface.hinges import rise
from sdm_deflect.deform.surface.motions import Motion, Moving, Rotation, SoughtHinge
from sdm_deflect.deform.surface.shapes import Shapes
from sdm_deflect.deform.surface.surface import Listed, NodeSet, OnPatches, TrailingEdge
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.surface.tail_root import Root
from sdm_deflect.deform.volume.job import Amounts, Job, Section, Sliding, in_proportion, pose_of
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import real
from sdm_deflect.meshing.mesh.images import PeriodicPatches

from .conversion import read_toml, structure
from .job_settings import (
    MOST_ANGLES,
    Corner,
    JobSettings,
    PeriodicSettings,
    SectionSettings,
    SurfaceSettings,
    angles_of,
    check_swept,
)
from .node_places import read_places
from .spellings import SELECTION

if TYPE_CHECKING:
    from sdm_deflect.meshing.mesh.selection import Condition, Selection

Point = tuple[float, float, float]
SHARP = "sharp"
# Settings of a surface that say where it goes, as `to` does.
NOT_BESIDE_TO = ("hinge", "device", "down", "up", "table", "track", "shift", "slot", "mirror")
# Distance over a length of one, below which two hinges are the same.
SAME = 1e-6
NUMBERS = {"box": "two opposite corners, box:x,y,z,x,y,z", "side": "a point and a normal, side:x,y,z,nx,ny,nz"}


def selection(name: str, text: str) -> "Selection":
    """Return the selection of a name and an expression; InputError if the expression has another form."""
    if not re.fullmatch(r"[\w.+-]+", name):
        raise InputError(f"select = {shortened(name)}: a new patch is named by letters, digits and . _ + - alone")
    try:
        words = [word for word in shlex.split(text) if word != "and"]
    except ValueError:
        raise InputError(f"select.{name} = {text}: a quotation mark is not closed") from None
    if not words:
        raise InputError(f"select.{name} is empty; it must be {SELECTION}")
    from sdm_deflect.meshing.mesh.selection import Selection

    sharp = _degrees(name, words.pop()) if words[-1].startswith(f"{SHARP}:") and len(words) > 1 else None
    return Selection(name, words[0], tuple(_condition(name, word) for word in words[1:]), sharp, text)


def _condition(name: str, word: str) -> "Condition":
    from sdm_deflect.meshing.mesh.selection import Before, Component, Within

    kind, _, rest = word.partition(":")
    if word[0] == "#" and word[1:].isascii() and word[1:].isdigit():
        return Component(int(word[1:]))
    if kind not in NUMBERS:
        last = f"; {SHARP}: must come last" if kind == SHARP else ""
        raise InputError(f"select.{name}: {shortened(word)} is unknown{last}; it must be {SELECTION}")
    numbers = _numbers(rest)
    if len(numbers) not in (4, 6):
        raise InputError(f"select.{name}: {word} must be {NUMBERS[kind]}; of a plane mesh without z")
    first, second = np.array(numbers).reshape(2, -1)
    if kind == "box":
        return Within(_point(np.minimum(first, second), -np.inf), _point(np.maximum(first, second), np.inf))
    if not second.any() or not np.isfinite(numbers).all():
        raise InputError(f"select.{name}: {word}: point and normal must be finite, and the normal not zero")
    return Before(_point(first, 0.0), _point(second, 0.0))


def _point(of: FloatArray, z: float) -> Point:
    """Return a point; z completes one with only x and y."""
    x, y, *rest = of.tolist()
    return x, y, rest[0] if rest else z


def _degrees(name: str, word: str) -> float:
    numbers = _numbers(word.partition(":")[2])
    if len(numbers) != 1 or not 0.0 < numbers[0] < 180.0:
        raise InputError(f"select.{name}: {word} must be degrees between 0 and 180, such as {SHARP}:40")
    return numbers[0]


def _numbers(text: str) -> list[float]:
    """Return the numbers of a list with commas; nothing if a word is no number."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return [] if any(map(isnan, numbers)) else numbers


@dataclass(frozen=True, slots=True)
class _BoxFile:
    corners: tuple[Corner, ...]


def in_series(settings: JobSettings, *, by_range: bool = False) -> tuple[tuple[Job, ...], tuple[Amounts, ...]]:
    """Return the jobs and their poses: the amounts that are set, or one pose for each file of a series of shapes.

    Raises InputError as `jobs_of`; also for a further surface beside a series.
    """
    files = max((len(surface.to) for surface in settings.surface if isinstance(surface.to, tuple)), default=0)
    if files < 2:
        jobs = jobs_of(settings, by_range=by_range)
        return jobs, (pose_of(jobs),)
    if len(settings.surface) > 1 or settings.surface[0].range or settings.surface[0].amount != 1.0:
        raise InputError("to: several files are a series of one surface, without range and amount: give one file")
    return _jobs(settings, by_range), tuple((float(i),) for i in range(1, files + 1))


def jobs_of(settings: JobSettings, *, by_range: bool = False) -> tuple[Job, ...]:
    """Return one job for all surfaces, or one for each if each has its box; InputError as `job_of`.

    With `by_range` a surface with a range needs no angle.
    """
    if any(len(surface.to) > 1 for surface in settings.surface if isinstance(surface.to, tuple)):
        raise InputError(
            "to: several files are a series, which `sdm deflect` alone takes, without --angles: give one file"
        )
    return _jobs(settings, by_range)


def _jobs(settings: JobSettings, by_range: bool) -> tuple[Job, ...]:
    settings = replace(settings, surface=tuple(map(_with_angle, settings.surface)))
    count, sources = len(settings.surface), [i for i, one in enumerate(settings.surface) if one.mirror]
    settings = _with_reflections(settings, sources) if sources else settings
    given, job = [surface.box for surface in settings.surface], job_of(settings, by_range=by_range)
    if not settings.box_each:
        if any(given):
            raise InputError("box = of a surface: it has a box of its own only if box_each = true")
        return (job,)
    if len(given) == 1:
        raise InputError("box_each = true: there is one surface, which has one box; leave box_each out")
    if not isinstance(job.box, Automatic):
        raise InputError("box_each = true: each surface has a box of its own; give box in the table of each")
    boxes = [_at(corners) if corners else job.box for corners in given]
    images = [*[-1] * count, *sources]
    parts = zip(job.surfaces, boxes, images, strict=True)
    return tuple(replace(job, surfaces=(moving,), box=box, image_of=image) for moving, box, image in parts)


def _with_angle(surface: SurfaceSettings) -> SurfaceSettings:
    """Return a surface whose angle turns its trailing edge, aft along x, down or up as set.

    The hinge points of a device are in the order of growing span. Raises InputError for a hinge along the vertical or
    the flow, which makes down and up undefined.
    """
    given = [surface.angle, surface.down, surface.up]
    if surface.down is None and surface.up is None:
        return surface
    if sum(value is not None for value in given) > 1 or not (surface.hinge or surface.device):
        raise InputError("down and up need a hinge, and take the place of the angle: give one of the three")
    vertical = "xyz".index(surface.vertical or _upward(surface.hinge))
    direction = _rotation(surface.hinge).axis.direction if surface.hinge else np.eye(3)[3 - vertical]
    angle = np.sign(rise(direction, vertical)) * (surface.up if surface.down is None else -surface.down)
    return replace(surface, angle=float(angle))


def _upward(hinge: Sequence[Corner] | None) -> str:
    """Return the vertical axis: z, or y for a hinge of one point, which is one of a plane mesh."""
    return "y" if hinge and (len(hinge) == 1 or len(hinge[0]) == 2) else "z"


def _with_reflections(settings: JobSettings, sources: Sequence[int]) -> JobSettings:
    """Return settings with reflections of surfaces added at the end, each in a box of its own."""
    surfaces = settings.surface
    return replace(settings, surface=(*surfaces, *(_reflection(surfaces[i]) for i in sources)), box_each=True)


def _reflection(surface: SurfaceSettings) -> SurfaceSettings:
    """Return the reflection of a surface in y = 0; hinge points are exchanged, so that angles keep their meaning."""
    ends, others = surface.hinge or (), (surface.table, surface.track, surface.shift, surface.held)
    if [len(end) for end in ends] != [3, 3] or any(others):
        raise InputError(
            "mirror: the surface needs two hinge points in space, and no table, track, shift or held nodes"
        )
    if not surface.sign or {*surface.mirror} & {*surface.patches}:
        raise InputError(
            "mirror: name other patches than the surface's own; sign is 1 for equal angles, -1 for opposite"
        )
    ordered = sorted(surface.sign * end for end in surface.range or ())
    return replace(
        surface,
        patches=surface.mirror,
        hinge=tuple((x, -y, z) for x, y, z in reversed(ends)),
        angle=surface.angle and surface.sign * surface.angle,
        range=(ordered[0], ordered[-1]) if ordered else None,
        mirror=(),
        box=None,
    )


def swept(settings: JobSettings, angles: Any, *, by_range: bool = False) -> tuple[tuple[Job, ...], tuple[Amounts, ...]]:
    """Return the jobs and the poses of a sweep, one for each angle of the first surface or each row of a table.

    Parameters
    ----------
    settings : Of several surfaces with angles, the others keep their proportion to the first one.
    angles : As `angles_of` reads them. Or amounts of all surfaces (poses, surfaces), or a .csv of them with a title
        line that names the surfaces.

    Raises InputError as `jobs_of`; also for a column without a surface, or a surface without a column.
    """
    surfaces, rows = check_swept(settings).surface, _rows(angles, settings)
    if not rows:
        wanted = angles_of(angles)
        if len(surfaces) > 1:
            jobs = jobs_of(settings, by_range=by_range)
            return jobs, _without_minus_zero(in_proportion(jobs, wanted))
        rows = tuple((angle,) for angle in wanted)
    largest = (max(column, key=abs) for column in zip(*rows, strict=True))
    moved = (replace(surface, angle=most, amount=most) for surface, most in zip(surfaces, largest, strict=True))
    settings = replace(settings, surface=tuple(moved))
    mirrored = [(i, given.sign) for i, given in enumerate(settings.surface) if given.mirror]
    poses = tuple((*row, *(sign * row[i] for i, sign in mirrored)) for row in rows)
    return jobs_of(settings, by_range=by_range), _without_minus_zero(poses)


def _without_minus_zero(poses: Iterable[Amounts]) -> tuple[Amounts, ...]:
    """Return poses with 0 for -0, which would be another name of the same mesh."""
    return tuple(tuple(amount + 0.0 for amount in pose) for pose in poses)


def _rows(angles: Any, settings: JobSettings) -> tuple[Amounts, ...]:
    """Return rows of amounts, from numbers or a .csv, in the order of the surfaces; nothing for single angles."""
    names = [surface.patches for surface in settings.surface]
    if isinstance(angles, str | Path) and Path(angles).suffix == ".csv":
        given = _columns(Path(angles), names)
    elif (
        isinstance(angles, str) or not isinstance(angles, Iterable) or not any(isinstance(x, Iterable) for x in angles)
    ):
        return ()
    else:
        given = real(list(angles), "angles")
    if given.ndim != 2 or given.shape[1] != len(names):
        raise InputError(f"angles {given.shape}: rows of {len(names)} amounts, one for each surface")
    if not 0 < len(given) <= MOST_ANGLES or not np.isfinite(given).all():
        raise InputError(f"angles: 1 to {MOST_ANGLES} rows of finite numbers")
    return tuple(map(tuple, given.tolist()))


def _columns(path: Path, names: Sequence[tuple[str, ...]]) -> FloatArray:
    """Read a table with a column for each surface, in the order of the surfaces' patch `names`.

    A column is titled by the first patch; of several surfaces with that one by ``wing``, ``wing (2)``. Any other patch
    of one surface alone will do.
    """
    first, every = [name[0] for name in names], [patch for name in names for patch in name]
    numbers = [first[: i + 1].count(patch) for i, patch in enumerate(first)]
    wanted = [f"{patch} ({number})" if number > 1 else patch for patch, number in zip(first, numbers, strict=True)]
    others = ([patch for patch in name if every.count(patch) == 1] for name in names)
    known = {title: (title, *patches) for title, patches in zip(wanted, others, strict=True)}
    titles, given = read_rows(path, "table of amounts", ",".join(wanted))
    with damaged(path, "table of amounts"):
        columns = columns_of(titles, known)
    if len(columns) < len(names) or len(columns) < len(titles):
        some = f"one column for each surface, titled {','.join(wanted)}"
        raise InputError(f"{path}: {some}; its titles are {','.join(titles)}")
    return given[:, [columns[title] for title in wanted]]


def job_of(settings: JobSettings, *, by_range: bool = False) -> Job:
    """Build the job and read its files; InputError if a file cannot be read, or a value is wrong or missing."""
    if not settings.surface:
        raise InputError("no surface to move: name its patches (--surface); sdm quality MESH lists them")
    return Job(
        surfaces=tuple(_moving(given, _stays_beside(given, settings), by_range) for given in settings.surface),
        slides=tuple(Sliding(patch, shape) for patch, shape in settings.slide.items()),
        box=_box(settings),
        sections=tuple(_section(section) for section in settings.section),
        repair_slides=tuple(Sliding(patch, shape) for patch, shape in settings.repair_slide.items()),
        selections=tuple(selection(name, text) for name, text in settings.select.items()),
        periodic=tuple(_pair(pair) for pair in settings.periodic),
        **{option.name: getattr(settings, option.name) for option in fields(JobOptions) if option.name != "fixed"},
        fixed=(*settings.fixed, *(name for surface in settings.surface for name in surface.on)),
    )


def _stays_beside(surface: SurfaceSettings, settings: JobSettings) -> tuple[str, ...]:
    """Return the patches on which nodes of a blended surface are held: fixed patches and other surfaces."""
    turn = attrgetter("hinge", "device", "angle", "shift", "track", "slot", "gap", "overlap")
    others = (other for other in settings.surface if turn(other) != turn(surface))
    names = (name for other in others for name in other.patches if name not in surface.patches)
    return (*settings.fixed, *names)


def _moving(surface: SurfaceSettings, fixed: tuple[str, ...], by_range: bool) -> Moving:
    """Return the moving patches with their motion; nodes on `fixed` patches are held unless others are named."""
    motion = _motion(surface, fixed)
    amount = surface.angle if motion.unit == "deg" else surface.amount
    if amount is None and not (by_range and surface.range):
        raise InputError(f"the angle of {', '.join(surface.patches)} is missing: give it in degrees")
    panels = (motion.panels,) if isinstance(motion, Root) else ()
    aft = (surface.down, surface.up) != (None, None)
    return Moving((*surface.patches, *panels), motion, amount or 0.0, surface.range, aft)


def _motion(surface: SurfaceSettings, fixed: tuple[str, ...]) -> Motion:
    if not isinstance(surface.motion, str):
        if surface.hinge and not _is_along(surface.motion.axis, _rotation(surface.hinge).axis):
            raise InputError(f"hinge = {surface.hinge}: the motion has another one; leave hinge out")
        return surface.motion
    if surface.to:
        return _shapes(surface)
    if surface.largest:
        raise InputError(f"largest = {surface.largest:g}: only new places of a surface's nodes (to) have a use for it")
    hinge = _rotation(surface.hinge) if surface.hinge else None
    if surface.motion == "root":
        return _root(surface, hinge)
    base = _turn(surface, hinge)
    if surface.table:
        read = surface.table if isinstance(surface.table, Table) else Table.read(Path(surface.table))
        base = replace(read, hinge=hinge.axis if hinge else None)
    base = _track(surface, hinge) or base
    if surface.motion == "rigid":
        return base
    held = _nodes(surface.held, "held") if surface.held != () else OnPatches(fixed)
    return Blended(base, held, _nodes(surface.driven, "driven"), _rib(surface, base))


def _shapes(surface: SurfaceSettings) -> Shapes:
    """Return the shapes whose places a surface is given; InputError for a setting that has no use for them."""
    given = [name for name in NOT_BESIDE_TO if getattr(surface, name) not in (None, ())]
    if surface.angle not in (None, surface.amount):
        given.append("angle")
    if surface.motion != "rigid":
        given.append("motion")
    if given:
        raise InputError(
            f"{given[0]}: `to` says where all nodes of {', '.join(surface.patches)} go; leave out one of them"
        )
    shapes = (
        surface.to.shapes if isinstance(surface.to, Shapes) else tuple(read_places(Path(file)) for file in surface.to)
    )
    return Shapes(shapes, surface.largest)


def _turn(surface: SurfaceSettings, hinge: Rotation | None) -> Motion:
    """Return the rotation about a hinge; without one the hinge is searched in the mesh."""
    if not surface.device:
        return hinge or SoughtHinge()
    if len(surface.device) != 4 or len(surface.patches) > 1 or surface.hinge:
        raise InputError(
            f"device = {shortened(surface.device)}: must be WING,ETA1,ETA2,XSI, with one new name of the surface, and "
            "no hinge"
        )
    wing, first, second, share = surface.device
    given = (surface.down, surface.up) != (None, None)
    vertical = "xyz".index(surface.vertical or "z") if given else None
    return SoughtHinge((str(wing), float(first), float(second), float(share)), vertical)


def _root(surface: SurfaceSettings, hinge: Rotation | None) -> Root:
    if not surface.on or not hinge or len(surface.patches) != 1 or surface.patches[0] in surface.on:
        raise InputError("motion = root: give one patch of the tail, the hinge, and in `on` other patches, of the body")
    return Root(hinge.axis, surface.patches[0], surface.on, surface.shape, surface.depth, surface.panel)


def _rib(surface: SurfaceSettings, base: Motion) -> Rib:
    """Return the strip beside closed ribs, of a given width or chosen by the largest angle."""
    largest = max(map(abs, (surface.angle or 0.0, *(surface.range or ()))))
    if not surface.strip and (base.unit != "deg" or not largest):
        raise InputError("strip = auto: its width follows from the angle; give it as a share of the span")
    return Rib(share=surface.strip) if surface.strip else Rib(turn=largest)


def _track(surface: SurfaceSettings, hinge: Rotation | None) -> Motion | None:
    """Return the track of a surface from a shift, the rows of a file, or the setting of a slot; or None."""
    given = [name for name in ("table", "track", "shift", "slot") if getattr(surface, name) is not None]
    if not surface.slot and {surface.gap, surface.overlap} != {None}:
        raise InputError("gap and overlap need slot: the patch on the other side of the slot")
    if given in ([], ["table"]):
        return None
    if hinge is None or len(given) > 1:
        raise InputError(f"{' and '.join(given)}: {'give one of them' if hinge else 'the hinge is missing'}")
    return _track_about(hinge.axis, surface, surface.angle or 0.0)


def _track_about(hinge: Axis, surface: SurfaceSettings, angle: float) -> Motion:
    from sdm_deflect.deform.surface.slots import SlotSetting
    from sdm_deflect.deform.surface.tracks import Track, shifts_of

    if surface.track:
        return Track.read(surface.track, hinge)
    if surface.slot:
        return SlotSetting(hinge, surface.slot, angle, surface.gap, surface.overlap)
    if any(len(end) == 3 for end in surface.hinge or ()) and any(len(row) == 2 for row in surface.shift or ()):
        raise InputError(f"shift = {shortened(surface.shift)}: the hinge lies in space, so give dx,dy,dz")
    return Track.straight(hinge, angle, *shifts_of(surface.shift or ()))


def _rotation(hinge: tuple[Corner, ...]) -> Rotation:
    """Return the rotation about two points, or in a plane about one, which may be given twice."""
    single = len(hinge[0]) == 2 and hinge[1:] in ((), hinge[:1])
    if not single and len(hinge) != 2:
        raise InputError(f"hinge = {shortened(hinge)}: must be two points, or one of two numbers in a plane mesh")
    return Rotation.about(*hinge[: 1 if single else 2])


def _is_along(axis: Axis | None, hinge: Axis) -> bool:
    if axis is None:
        return False
    ends = np.stack([hinge.point, hinge.point + hinge.direction])
    return bool(np.abs(axis.radial(ends)).max() <= SAME and hinge.direction @ axis.direction > 0.0)


def _nodes(value: tuple[str | int, ...] | NodeSet, name: str) -> NodeSet:
    """Return a node set from ``edges:40``, a .txt file of node indices, a list of them, or patches."""
    if not isinstance(value, tuple):
        return value
    names = [item for item in value if isinstance(item, str)]
    if not names:
        return Listed(np.array(value, dtype=np.intp))
    if len(names) < len(value):
        raise InputError(f"{name} must be patches, or indices of nodes, not both")
    word, _, degrees = names[0].partition(":")
    if word == "edges":
        try:
            return TrailingEdge(float(degrees or 40.0))
        except ValueError:
            raise InputError(f"{name} = {names[0]}: must be edges:DEG, such as edges:40") from None
    return Listed.read(Path(names[0])) if names[0].endswith(".txt") else OnPatches(tuple(names))


def _section(given: SectionSettings) -> Section:
    return Section(given.patch, np.array(given.point), "xyz".index(given.axis), given.slides)


def _pair(given: PeriodicSettings) -> PeriodicPatches:
    try:
        axis = _rotation(given.axis).axis if given.axis else None
    except InputError as error:
        raise InputError(f"periodic {' '.join(given.patches)}: {str(error).replace('hinge', 'axis')}") from None
    shift = np.array([*given.translation, 0.0][:3]) if given.translation else None
    return PeriodicPatches(given.patches[0], given.patches[1], axis, shift)


def _box(settings: JobSettings) -> BoxRule:
    rule, largest = _rule(settings.box, settings.margin), max((each.largest for each in settings.surface), default=0.0)
    if largest and not isinstance(rule, Automatic):
        raise InputError(f"largest = {largest:g}: only the automatic box has a use for it; leave it or the box out")
    if isinstance(rule, Automatic):
        rule = replace(rule, largest=largest)
    if not settings.open_faces:
        return rule
    if not isinstance(rule, Given):
        raise InputError("open_faces needs a box given by its corners")
    return Given(rule.hexahedron, frozenset(settings.open_faces))


def _rule(box: str | tuple[Corner, ...] | BoxRule | Hexahedron, margin: float) -> BoxRule:
    if isinstance(box, Hexahedron):
        return Given(box)
    if isinstance(box, tuple):
        return _at(box)
    if not isinstance(box, str):
        return box
    if box == "auto":
        return Automatic(margin)
    try:
        return _at(structure(read_toml(Path(box)), _BoxFile).corners)
    except InputError as error:
        raise InputError(f"box = {box}: {error}") from None


def _at(corners: tuple[Corner, ...]) -> BoxRule:
    """Return the box with these corners: a hexahedron, or a quadrilateral if they have two coordinates."""
    try:
        return (Outline if len(corners[:1][0]) == 2 else Given).at(np.array(corners))
    except (IndexError, ValueError) as error:
        raise InputError(f"the box: {str(error).removeprefix('the box: ')}") from None

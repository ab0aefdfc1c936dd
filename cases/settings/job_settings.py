"""A job from text or keywords: the settings of `sdm deflect`, of its TOML file and of `deflect` are the same."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf, isnan
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sdm_deflect.cases.settings.conversion import Nested, assigned, names_of, read_toml, structured
from sdm_deflect.cases.settings.selections import selection, selections_of
from sdm_deflect.deform.base.errors import InputError, nearest, shortened
from sdm_deflect.deform.checks import MIN_QUALITY
from sdm_deflect.deform.hexahedron import Hexahedron
from sdm_deflect.deform.mesh.axis import Axis
from sdm_deflect.deform.mesh.pairing import PeriodicPatches
from sdm_deflect.deform.rbf.fitting import LARGEST_ANGLE, Fitting, Repair, RepairMode
from sdm_deflect.deform.surface.blended import Blended, Rib
from sdm_deflect.deform.surface.motions import Motion, Moving, Rotation, Table
from sdm_deflect.deform.surface.surface import Listed, NodeSet, OnPatches, TrailingEdge
from sdm_deflect.deform.volume.box import Automatic, BoxRule, Given, Outline
from sdm_deflect.deform.volume.job import Job, Section, Sliding

Point = tuple[float, float, float]
Corner = tuple[float, ...]
"""A point, or two coordinates in a plane mesh."""
MOST_ANGLES = 1000
SAME = 1e-6  # two hinges nearer to one another, over a length of one, are one


@dataclass(frozen=True, slots=True)
class SurfaceSettings:
    """One moving surface: a table ``[[surface]]``.

    Attributes
    ----------
    patches : names or wildcards of the patches that move.
    hinge : two points of the hinge line; one point, x and y, in a plane mesh.
    angle : degrees, right-handed from the first point to the second; about one point counter-clockwise.
    motion : the whole surface rigidly, or blended between nodes that stay and nodes that follow; or a `Motion`.
    held : blended: nodes that stay: patches, a .txt of node indices, the indices, or a `NodeSet`; none: `fixed`.
    driven : blended: nodes that follow: the same, or ``edges:DEG``.
    strip : blended: width beside a closed rib, as a share of the span.
    table : file of displacements instead of a rotation.
    amount : share of the table.
    cpacs : CPACS file with the hinge line, in the mesh's unit of length, and the angle where none is given.
    device : uID of a trailing edge device in it; ``uID=step`` for the angle of a step, or between two.
    """

    patches: tuple[str, ...]
    hinge: tuple[Corner, ...] | None = None
    angle: float | None = None
    motion: Literal["rigid", "blended"] | Motion = "rigid"
    held: tuple[str | int, ...] | NodeSet = ()
    driven: tuple[str | int, ...] | NodeSet = ("edges:40",)
    strip: float = 0.2
    table: str | None = None
    amount: float = 1.0
    cpacs: str | None = None
    device: str | None = None

    def moving(self, fixed: tuple[str, ...]) -> Moving:
        """Return the patches with their motion; nodes on `fixed` patches are held if no others are named."""
        if self.cpacs or self.device:
            return self._of_cpacs().moving(fixed)
        motion = self._motion(fixed)
        amount = self.angle if motion.unit == "deg" else self.amount
        if amount is None:
            raise InputError(f"the angle of {', '.join(self.patches)} is missing: give it in degrees")
        return Moving(self.patches, motion, amount)

    def _of_cpacs(self) -> "SurfaceSettings":
        """Return the same with hinge and angle of the device."""
        if not self.cpacs or not self.device:
            raise InputError("cpacs and device go together: a CPACS file, and the uID of a trailing edge device in it")
        if self.hinge:
            raise InputError(f"hinge = {self.hinge}: that of the device is taken; leave out hinge or cpacs")
        from sdm_deflect.cases.settings.cpacs import hinge_and_angle

        hinge, angle = hinge_and_angle(Path(self.cpacs), self.device, self.angle if self.table is None else 0.0)
        return replace(self, hinge=hinge, angle=angle, cpacs=None, device=None)

    def _motion(self, fixed: tuple[str, ...]) -> Motion:
        if not isinstance(self.motion, str):
            if self.hinge and not _is_along(self.motion.axis, _rotation(self.hinge).axis):
                raise InputError(f"hinge = {self.hinge}: the motion has another one; leave hinge out")
            return self.motion
        hinge = _rotation(self.hinge) if self.hinge else None
        base: Motion | None = Table.read(Path(self.table), hinge.axis if hinge else None) if self.table else hinge
        if base is None:
            raise InputError("the hinge is missing: give two points of it, such as 0.7,0,0 and 0.7,1,0; in a plane one")
        if self.motion == "rigid":
            return base
        held = _nodes(self.held, "held") if self.held != () else OnPatches(fixed)
        return Blended(base, held, _nodes(self.driven, "driven"), Rib(share=self.strip))


@dataclass(frozen=True, slots=True)
class SectionSettings:
    """A face of an overlapping block that cuts the box: a table ``[[section]]``.

    Attributes
    ----------
    patch : name of the block's outer faces.
    point : a point of the plane.
    axis : the axis along its normal.
    slides : whether nodes slide in it.
    """

    patch: str
    point: Point
    axis: Literal["x", "y", "z"]
    slides: bool = True

    def section(self) -> Section:
        """Return it as the engine has it."""
        return Section(self.patch, np.array(self.point), "xyz".index(self.axis), self.slides)


@dataclass(frozen=True, slots=True)
class PeriodicSettings:
    """Two patches that are images of one another: a table ``[[periodic]]``.

    Attributes
    ----------
    patches : names of the two.
    axis : two points of the axis about which the first is turned onto the second; one point, x and y, in a plane mesh.
    translation : from the first to the second. Without both, the translation between the patches, or the rotation about
        x, y or z through the origin, whichever fits.
    """

    patches: tuple[str, ...]
    axis: tuple[Corner, ...] | None = None
    translation: Corner | None = None

    def __post_init__(self) -> None:
        if len(self.patches) != 2:
            raise InputError(f"periodic {shortened(self.patches)}: two patches are images of one another")
        if self.axis and self.translation:
            raise InputError(f"translation = {self.translation}: the axis says all; leave out one of them")
        if self.translation and len(self.translation) not in (2, 3):
            raise InputError(f"translation = {self.translation}: must be three numbers, or two in a plane mesh")

    def pair(self) -> PeriodicPatches:
        """Return it as the engine has it."""
        try:
            axis = _rotation(self.axis).axis if self.axis else None
        except InputError as error:
            raise InputError(f"periodic {' '.join(self.patches)}: {str(error).replace('hinge', 'axis')}") from None
        shift = np.array([*self.translation, 0.0][:3]) if self.translation else None
        return PeriodicPatches(self.patches[0], self.patches[1], axis, shift)


@dataclass(frozen=True, slots=True)
class JobSettings:
    """What moves, what stays, what slides, and in which box.

    Attributes
    ----------
    surface : the moving surfaces; angles of a sweep are those of the first one.
    select : parts of patches that become patches by these names, before all else; see `selections.selection`.
    fixed : names or wildcards of patches that stay.
    slide : patches that stay on their shape.
    periodic : pairs of patches that are images of one another, where the file does not say so.
    box : ``"auto"``, a .toml file with `corners`, the corners, or a `BoxRule`.
    margin : distance from the surface to an automatic box; 0: chosen.
    open_faces : faces of a given box without zero sites, such as ``y-``.
    section : faces of an overlapping block that cut the box (the paper's section 5.2).
    near_wall : whether the mesh near walls follows them rigidly; False, as in the paper: the moving surface and the box
        are the only data sites.
    zones : further zones that deform; ``*`` for all.
    allow_inverted : whether a mesh that has inverted cells is taken.
    min_quality : share of the undeflected mesh's least quality that the touched cells of each type must keep; 0: no
        such check.
    repair : when spoiled cells are mended: ``"auto"``, ``"off"`` or ``"always"``.
    repair_share : of the undeflected mesh's least quality, below which ``"auto"`` mends.
    repair_slide : further patches whose nodes may slide while cells are mended, moving ones too.
    fitting : how the displacement is interpolated; its names stand beside the others.
    """

    surface: tuple[SurfaceSettings, ...] = ()
    select: dict[str, str] = field(default_factory=dict)
    fixed: tuple[str, ...] = ()
    slide: dict[str, Literal["plane", "cylinder", "surface"]] = field(default_factory=dict)
    periodic: tuple[PeriodicSettings, ...] = ()
    box: str | tuple[Corner, ...] | BoxRule = "auto"
    margin: float = 0.0
    open_faces: tuple[str, ...] = ()
    section: tuple[SectionSettings, ...] = ()
    near_wall: bool = True
    zones: tuple[str, ...] = ()
    allow_inverted: bool = False
    min_quality: float = MIN_QUALITY
    repair: RepairMode = "auto"
    repair_share: float = 0.9
    repair_slide: dict[str, Literal["plane", "cylinder", "surface"]] = field(default_factory=dict)
    fitting: Fitting = field(default_factory=Fitting)

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_quality <= 1.0:
            raise InputError(f"min_quality = {self.min_quality:g} must be a share between 0 and 1")
        Repair(self.repair, self.repair_share)

    def job(self) -> Job:
        """Return the job, files read; InputError if one cannot be, or a value does not fit or is missing."""
        if not self.surface:
            raise InputError("no surface to move: name its patches")
        return Job(
            surfaces=tuple(one.moving(self.fixed) for one in self.surface),
            fixed=self.fixed,
            slides=tuple(Sliding(patch, shape) for patch, shape in self.slide.items()),
            box=self._box(),
            sections=tuple(one.section() for one in self.section),
            near_wall=self.near_wall,
            zones=self.zones,
            fitting=self.fitting,
            repair=Repair(self.repair, self.repair_share),
            repair_slides=tuple(Sliding(patch, shape) for patch, shape in self.repair_slide.items()),
            allow_inverted=self.allow_inverted,
            selections=tuple(selection(name, text) for name, text in self.select.items()),
            periodic=tuple(one.pair() for one in self.periodic),
        )

    def _box(self) -> BoxRule:
        if isinstance(self.box, str):
            box: BoxRule = Automatic(self.margin) if self.box == "auto" else _box_of(Path(self.box))
        else:
            box = _given(self.box) if isinstance(self.box, tuple) else self.box
        if not self.open_faces:
            return box
        if not isinstance(box, Given):
            raise InputError("open_faces needs a box given by its corners")
        return Given(box.hexahedron, frozenset(self.open_faces))


@dataclass(frozen=True, slots=True)
class _BoxFile:
    corners: tuple[Corner, ...]


@dataclass(frozen=True, slots=True)
class _Angles:
    angles: tuple[float, ...]


IN_PYTHON = {"surface": "surfaces", "patches": "surfaces", "amount": "angle"}
"""Settings of files that are arguments of another name."""
IDLE = {
    "rigid": ("held", "driven", "strip"),
    "blended": (),
    "own": ("table", "held", "driven", "strip", "cpacs", "device"),
}
"""Settings of a surface that a motion has no use for."""
OF_SURFACE = tuple(one.name for one in fields(SurfaceSettings))


def job_settings(nested: Mapping[str, Any]) -> JobSettings:
    """Return the settings that nested tables describe; InputError names the first that does not fit."""
    surfaces = nested.get("surface")
    if isinstance(surfaces, list | tuple):
        nested = {**nested, "surface": [_with_point(one) for one in surfaces]}
    try:
        return structured(nested, JobSettings)
    except InputError as error:
        several = len(_tables(nested.get("surface"))) > 1
        raise InputError(str(error) if several else str(error).replace("surface[0].", "")) from None


def settings_of(surfaces: Any, hinge: Any, angle: Any, options: Mapping[str, Any]) -> JobSettings:
    """Return the settings that arguments of `deflect` describe.

    Parameters
    ----------
    surfaces : Name of a patch, or several, wildcards allowed; or tables of `SurfaceSettings`, one for each moving
        surface.
    hinge : (2, 3) two points of the hinge line; None where `motion` or `table` needs none.
    angle : Degrees; of a table of displacements its share.
    options : Settings of `JobSettings` and, for the surface, of `SurfaceSettings`.

    Raises InputError for an option that is unknown or without effect, or a value of another type or out of range: one
    sentence.
    """
    for name in IN_PYTHON.keys() & options.keys():
        raise InputError(f"unknown setting {name}; did you mean {IN_PYTHON[name]}?")
    parts = _parted({"hinge": hinge, "angle": angle, **options})
    own, rest = ({name: value for name, value in part.items() if value is not None} for part in parts)
    several = tables_of(surfaces)
    if several and own:
        raise InputError(f"{min(own)} belongs to one surface: put it into the tables of surfaces")
    if isinstance(rest.get("box"), Hexahedron):
        rest["box"] = Given(rest["box"])
    for kind in {"slide", "repair_slide"} & rest.keys():
        rest[kind] = slides_of(rest[kind], kind)
    if "periodic" in rest:
        rest["periodic"] = periodic_of(rest["periodic"])
    if "select" in rest:
        rest["select"] = selections_of(rest["select"])
    share = {"amount": own["angle"]} if "angle" in own else {}
    tables = several or [{"patches": surfaces, **own, **share}]
    _check_use(tables, rest)
    try:
        return job_settings({**rest, "surface": tables})
    except InputError as error:
        raise InputError(str(error).replace("patches =", "surfaces =").replace("surface[", "surfaces[")) from None


def tables_of(surfaces: Any) -> list[Nested]:
    """Return the tables if surfaces are given as tables, else none."""
    rows = surfaces if isinstance(surfaces, list | tuple) else [surfaces]
    return [dict(one) for one in rows] if all(isinstance(one, Mapping) for one in rows) else []


def slides_of(value: Any, setting: str = "slide") -> Any:
    """Return ``NAME:SHAPE``, or several of them, as a table; tables as they are."""
    if isinstance(value, Mapping) or not isinstance(value, str | list | tuple):
        return value
    out = {}
    for text in value.split(",") if isinstance(value, str) else value:
        name, colon, shape = str(text).rpartition(":")
        if not colon or not name:
            raise InputError(f"{setting} = {text}: must be NAME:plane, NAME:cylinder or NAME:surface")
        out[name.strip()] = shape.strip()
    return out


def periodic_of(value: Any) -> Any:
    """Return a pair of names, or several pairs, as tables; tables as they are."""
    if not isinstance(value, list | tuple):
        return [value] if isinstance(value, Mapping) else value
    pairs = [value] if value and all(isinstance(one, str) for one in value) else value
    return [one if isinstance(one, Mapping) else {"patches": one} for one in pairs]


def _check_use(surfaces: Sequence[Nested], rest: Nested) -> None:
    """Refuse settings that a motion or a box has no use for: they would change nothing."""
    for own in surfaces:
        motion = own.get("motion", "rigid")
        for name in IDLE.get(motion, ()) if isinstance(motion, str) else IDLE["own"]:
            if own.get(name) is not None:
                kind = f"a {motion} motion has no use for it" if isinstance(motion, str) else "the motion has its own"
                raise InputError(f"{name} = {shortened(own[name])}: {kind}")
    if "margin" in rest and not (isinstance(rest.get("box", "auto"), str) and rest.get("box", "auto") == "auto"):
        raise InputError(f"margin = {shortened(rest['margin'])}: only the automatic box has a margin")


def read_job(path: Path) -> Nested:
    """Return the tables of a configuration file; files that it names are taken as relative to it."""
    nested = read_toml(path)
    nested.pop("mesh", None)  # of the settings beside a report, which the command names itself
    for table in (nested, *_tables(nested.get("surface"))):
        for key in ("box", "table", "held", "driven", "cpacs"):
            value = table.get(key)
            if isinstance(value, str) and (key in ("table", "cpacs") or value.endswith((".toml", ".txt"))):
                table[key] = str(path.parent / value)
    return nested


def with_options(nested: Nested, options: Mapping[str, Any], assignments: Sequence[str] = ()) -> Nested:
    """Return tables with options in place of their values; those of a surface concern the first one.

    Further surfaces turn in their proportion to the first one's angle. An option ``patches`` makes it the only one.
    """
    given = {key: value for key, value in options.items() if value not in (None, ())}
    own, new = _parted({**given, **assigned(assignments)})
    tables = {key: {**_table(nested.get(key)), **_table(new.pop(key, None))} for key in ("select", "slide")}
    out = {**nested, **new, **{key: table for key, table in tables.items() if table}}
    surfaces = _tables(nested.get("surface"))
    if "patches" in own:
        out["surface"] = [own]
    elif own and surfaces:
        out["surface"] = [{**surfaces[0], **own}, *_in_proportion(surfaces, own.get("angle"))]
    return out


def angles_of(wanted: Any) -> tuple[float, ...]:
    """Return the angles of ``first:last:step``, ends included, of a list with commas, or a sequence; or InputError."""
    if not isinstance(wanted, str):
        several = isinstance(wanted, Iterable) and not isinstance(wanted, Mapping)
        if found := structured({"angles": list(wanted) if several else wanted}, _Angles).angles:
            return found
        raise InputError("angles is empty: give at least one")
    text = wanted
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = int(np.floor((last - first) / step + 1e-9)) + 1
            angles = [round(first + i * step, 12) for i in range(min(count, MOST_ANGLES + 1))]
        else:
            angles = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(f"angles = {text}: must be first:last:step, such as -30:30:5, or a list with commas") from None
    if not angles or len(angles) > MOST_ANGLES:
        raise InputError(f"angles = {text}: must be 1 to {MOST_ANGLES} angles")
    worst = max(angles, key=lambda angle: inf if isnan(angle) else abs(angle))
    if not abs(worst) <= LARGEST_ANGLE:
        raise InputError(f"angles = {text}: {worst:g} deg is out of range: at most {LARGEST_ANGLE:g} deg either way")
    return tuple(dict.fromkeys(angles))


def _parted(options: Mapping[str, Any]) -> tuple[Nested, Nested]:
    """Return the settings of the surface, and those of the job; InputError for one that is neither."""
    known = (*names_of(JobSettings), *OF_SURFACE)
    for name in options:
        if name not in (*known, "fitting"):
            raise InputError(f"unknown setting {name}; {nearest(name, known)}")
    own = {name: value for name, value in options.items() if name in OF_SURFACE}
    return own, {name: value for name, value in options.items() if name not in own}


def _table(value: Any) -> dict[str, Any]:
    return dict(value) if isinstance(value, Mapping) else {}


def _tables(value: Any) -> list[dict[str, Any]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _in_proportion(surfaces: list[dict[str, Any]], angle: float | None) -> list[dict[str, Any]]:
    """Return the further surfaces, turned in their proportion to the first one's angle; InputError if that is zero."""
    first = surfaces[0].get("angle")
    if angle is None or first is None or angle == first:
        return surfaces[1:]
    if first == 0 and any(one.get("angle") for one in surfaces[1:]):
        raise InputError(
            f"angle = {angle:g}: the first surface has angle 0, so that the others cannot be in proportion to it; put "
            "a surface that moves first"
        )
    return [{**one, "angle": one["angle"] * angle / first} if one.get("angle") else one for one in surfaces[1:]]


def _nodes(value: tuple[str | int, ...] | NodeSet, name: str) -> NodeSet:
    """Return a node set: ``edges:40``, a .txt file of node indices, a list of them, or patches."""
    if not isinstance(value, tuple):
        return value
    names = [one for one in value if isinstance(one, str)]
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


def _with_point(surface: Any) -> Any:
    """Return the table of a surface with a hinge of one point as a list of points."""
    hinge = surface.get("hinge") if isinstance(surface, Mapping) else None
    hinge = hinge.tolist() if isinstance(hinge, np.ndarray) else hinge
    one = isinstance(hinge, list | tuple) and len(hinge) == 2 and not any(isinstance(x, Iterable) for x in hinge)
    return {**surface, "hinge": [hinge]} if one else surface


def _rotation(hinge: tuple[Corner, ...]) -> Rotation:
    """Return the rotation about two points, or about one of two numbers, which may be there twice."""
    single = len(hinge[0]) == 2 and hinge[1:] in ((), hinge[:1])
    if not single and len(hinge) != 2:
        raise InputError(f"hinge = {shortened(hinge)}: must be two points, or one of two numbers in a plane mesh")
    return Rotation.about(*hinge[: 1 if single else 2])


def _is_along(axis: Axis | None, hinge: Axis) -> bool:
    """Return whether an axis is the hinge, in its direction."""
    if axis is None:
        return False
    ends = np.stack([hinge.point, hinge.point + hinge.direction])
    return bool(np.abs(axis.radial(ends)).max() <= SAME and hinge.direction @ axis.direction > 0.0)


def _given(corners: tuple[Corner, ...]) -> BoxRule:
    """Return the box with these corners; a quadrilateral if they have two coordinates."""
    try:
        return (Outline if len(corners[:1][0]) == 2 else Given).at(np.array(corners))
    except (IndexError, ValueError) as error:
        raise InputError(f"the box: {error}") from None


def _box_of(path: Path) -> BoxRule:
    """Read the corners of a box."""
    try:
        return _given(structured(read_toml(path), _BoxFile).corners)
    except InputError as error:
        raise InputError(f"box = {path}: {error}") from None

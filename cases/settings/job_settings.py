"""A job from text or keywords: the settings of `sdm deflect`, of its TOML file and of `deflect` are the same."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, inf, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, runtime_checkable

from sdm_deflect.base.errors import InputError, nearest, shortened
from sdm_deflect.base.schema import ONLY_SET, Doc, Option, Range, Spelling, check_settings, settings_in
from sdm_deflect.deform.options import LARGEST_ANGLE, JobOptions

from .conversion import Nested, parse_assignments, parse_spelling, read_toml, structure
from .spellings import (
    device_of,
    pairs_of,
    points_of,
    range_of,
    selections_of,
    shape_of_array,
    shapes_of,
    shift_of,
    strip_of,
    table_of_arrays,
)  # fmt: skip

if TYPE_CHECKING:
    from sdm_deflect.deform.box.automatic import BoxRule
    from sdm_deflect.deform.box.hexahedron import Hexahedron
    from sdm_deflect.deform.surface.motions import Motion
    from sdm_deflect.deform.surface.shapes import Shapes
    from sdm_deflect.deform.surface.surface import NodeSet
    from sdm_deflect.deform.surface.tables import Table
else:  # known by what they have: settings are read, and help is shown, before any code is compiled

    def _with(name: str, *parts: str) -> Any:
        return runtime_checkable(type(name, (Protocol,), dict.fromkeys(parts)))

    Motion, NodeSet = _with("Motion", "unit", "axis", "law"), _with("NodeSet", "of")
    Table, Shapes = _with("Table", "points", "vectors"), _with("Shapes", "shapes")
    BoxRule, Hexahedron = _with("BoxRule", "settings", "choose"), _with("Hexahedron", "corners", "contains")


Point = tuple[float, float, float]
# A point, or two coordinates in a plane mesh.
Corner = tuple[float, ...]
Shape = Literal["plane", "cylinder", "surface"]
# Largest number of angles of a sweep; more are probably a mistake in the step.
MOST_ANGLES = 1000
SHAPES = "NAME:plane|cylinder|surface"
# Settings of files that are arguments of another name.
IN_PYTHON = {"surface": "surfaces", "patches": "surfaces", "amount": "angle"}


@dataclass(frozen=True, slots=True)
class Only:
    """The motions that use a setting of a surface: ``"rigid"``, ``"blended"``; other settings belong to one motion."""

    motions: tuple[str, ...]


BLENDED, RIGID, ROOT = Only(("blended",)), Only(("rigid",)), Only(("root",))
IN_WORDS = Only((*RIGID.motions, *BLENDED.motions))
IN_ANGLE = Only((*IN_WORDS.motions, *ROOT.motions))


@dataclass(frozen=True, slots=True)
class SurfaceSettings:
    """One moving surface: a table ``[[surface]]``."""

    # fmt: off
    patches: Annotated[tuple[str, ...], Option("--surface", "NAME"), Doc(
        "What moves", "Patches that move; repeat, or use commas. wall#2 is a part.")]
    hinge: Annotated[tuple[Corner, ...] | None, Option(metavar="x0,y0,z0 x1,y1,z1"), Spelling(read=points_of), Doc(
        "What moves", "Two points of the hinge line; one, x,y, in a plane mesh.")] = None
    device: Annotated[
        tuple[str | float, ...] | None, Option(metavar="WING,ETA1,ETA2,XSI"), Spelling(read=device_of), IN_WORDS, Doc(
        "What moves", "Cut the surface from a clean wing.",
        "It has its own hinge, and lies between two shares of the span, behind a share of the chord. The flow is "
        "along x; the surface's name is new.")] = None
    angle: Annotated[float | None, Doc(
        "What moves", "Degrees, right-handed from the first hinge point to the second.",
        "Counter-clockwise about one point: trailing edge up. At most 90 either way.")] = None
    down: Annotated[float | None, IN_ANGLE, Doc(
        "What moves", "Degrees that turn the trailing edge down.",
        "In place of the angle; the trailing edge lies aft along x.")] = None
    up: Annotated[float | None, IN_ANGLE, Doc(
        "What moves", "Degrees that turn the trailing edge up.")] = None
    vertical: Annotated[Literal["y", "z"] | None, IN_ANGLE, Doc(
        "What moves", "The axis that is up (default: z; y about one point, in a plane mesh).")] = None
    range: Annotated[tuple[float, float] | None, Option(metavar="A:B"), Spelling(read=range_of), Doc(
        "What moves", "Amounts that the box, and a plan, must hold, such as -25:25 (default: 0 to the angle).",
        "In a file or in Python two numbers.")] = None
    motion: Annotated[Literal["rigid", "blended", "root"] | Motion, Doc(
        "What moves", "rigid: the surface turns as a whole; blended: its border stays and its trailing edge turns; "
        "root: a tail turns, and its root slides on a body.",
        "In Python also a motion such as `Rotation`, `Blended` or `Table`, which has its own hinge.")] = "rigid"
    held: Annotated[tuple[str | int, ...] | NodeSet, Spelling(file=".txt"), BLENDED, Doc(
        "Blended", "blended: nodes that stay: patches, or a .txt of node indices (default: on `fixed` patches).",
        "Or node indices (K,) counted from 0; in Python also `OnPatches`, `TrailingEdge` or `Listed`.")] = ()
    driven: Annotated[tuple[str | int, ...] | NodeSet, Spelling(file=".txt"), BLENDED, Doc(
        "Blended", "blended: nodes that turn by the angle: edges[:DEG], patches, or a .txt.",
        "``edges:40`` are the sharp edges far from the hinge. Otherwise as `held`.")] = ("edges:40",)
    strip: Annotated[float, Range(0.0, 1.0), Option(metavar="SHARE|auto"), Spelling(read=strip_of), BLENDED, Doc(
        "Blended", "blended: width of the strip beside a closed rib, as a share of the span; auto: by the angle.",
        "0 is auto: the strip is as narrow as lets the largest angle shear cells at its trailing edge by 35 degrees.",
        )] = 0.2
    on: Annotated[tuple[str, ...], Option(metavar="NAME"), ROOT, Doc(
        "Root", "root: patches of the body.",
        "A panel around the root is cut from them; the rest stays.")] = ()
    shape: Annotated[Literal["skin", "cylinder"], ROOT, Doc(
        "Root", "root: the body's shape.")] = "skin"
    depth: Annotated[float, Range(0.0), ROOT, Doc(
        "Root", "root: length of the part of the tail that is lengthened (default: half the root's chord).",
        )] = 0.0
    panel: Annotated[float, Range(0.0, above=True), ROOT, Doc(
        "Root", "root: width of the panel of the body that follows the root, in chords of the root.",
        "A tail that needs more room on its body takes a wider one.")] = 0.5
    table: Annotated[str | Table | None, Spelling(file="", read=table_of_arrays), IN_WORDS, Doc(
        "What moves", "Displacements in place of a hinge: a .csv of x,y,z,dx,dy,dz, or an .npz.",
        "Points of a beam add rotations rx,ry,rz in radians. In Python also points, displacements and rotations (P, 3) "
        "each.")] = None
    to: Annotated[tuple[str, ...] | Shapes, Option(metavar="FILE..."), Spelling(file="", read=shape_of_array), RIGID,
        Doc(
        "What moves", "New places of the surface's nodes in place of a hinge; several files are a series.",
        "SU2's list of surface positions (.dat: number, place), a .csv of x,y,z and PointID, an .npz of points and "
        "nodes; or .vtu, .vtk, .ply, .obj. Without numbers the rows are in the mesh's order. In Python an array (K, 3)."
        )] = ()
    largest: Annotated[float, Range(0.0), RIGID, Doc(
        "Box", "With `to`: the largest displacement to come, which the box holds (default: that of the files).",
        "Runs with the same `largest` have the same box.")] = 0.0
    shift: Annotated[tuple[Corner, ...] | None, Option(metavar="x,y,z"), Spelling(read=shift_of), IN_WORDS, Doc(
        "Track", "Distance by which the hinge moves while the surface turns by the angle.",
        "In a file or in Python also two, one for each hinge point.")] = None
    track: Annotated[str | None, Spelling(file=""), IN_WORDS, Doc(
        "Track", "Places of the surface: a .csv of parameter,angle,dx,dy[,dz], with a title line.",
        "The mesh stands at parameter 0. Further columns dx2,dy2[,dz2] are the shift of the second hinge point. Rows "
        "are joined smoothly, or linearly if the first title is `controlParameter`, as in CPACS.")] = None
    slot: Annotated[str | None, Option(metavar="NAME"), IN_WORDS, Doc(
        "Slot", "Plane mesh: patch on the other side of the slot, for `gap` and `overlap`.")] = None
    gap: Annotated[float | None, IN_WORDS, Doc(
        "Slot", "With `slot`: gap at the amount 1, a length (default: the mesh's).",
        "It is the least distance between the trailing edge ahead and the skin behind.")] = None
    overlap: Annotated[float | None, IN_WORDS, Doc(
        "Slot", "With `slot`: overlap at the amount 1, a length (default: the mesh's).",
        "The foremost point of the skin behind lies so far ahead of the trailing edge, along x.")] = None
    mirror: Annotated[tuple[str, ...], Option(metavar="NAME"), IN_WORDS, Doc(
        "Mirror", "Patches that are this surface's reflection in y = 0: they move as its reflection.",
        "Each surface then has a box of its own. A mesh that is symmetric to the bit stays so.")] = ()
    sign: Annotated[int, Range(-1, 1), IN_WORDS, Doc(
        "Mirror", "With `mirror`: 1 for equal angles, -1 for opposite ones.")] = 1
    amount: Annotated[float, ONLY_SET, Doc(
        "Track", "Share of the table, or parameter of the track; in Python this is the `angle`.")] = 1.0
    box: Annotated[tuple[Corner, ...] | None, ONLY_SET, Doc(
        "Box", "With `box_each`: the corners of this surface's box.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        check_settings(self)


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


@dataclass(frozen=True, slots=True)
class PeriodicSettings:
    """Two patches that are images of one another: a table ``[[periodic]]``.

    Attributes
    ----------
    patches : names of the two.
    axis : two points of the axis of rotation from the first to the second; in a plane mesh one point, x and y.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSettings(JobOptions):
    """The settings of a job: moving, fixed and sliding patches, box, and everything else that a job can be given.

    Attributes
    ----------
    surface : the moving surfaces; angles of a sweep are those of the first one.
    """

    # fmt: off
    surface: tuple[SurfaceSettings, ...] = ()
    select: Annotated[dict[str, str], Option(metavar="NAME=EXPR|FILE"), Spelling(read=selections_of), Doc(
        "What moves", "Make a part of a patch a patch, such as flap=wall#2; repeat.",
        "``wall#2`` is the second connected component of ``wall``; it needs no selection. ``wall box:x,y,z,x,y,z`` are "
        "the faces with their centre in a box, ``wall side:x,y,z,nx,ny,nz`` those in front of a plane. ``wall "
        "sharp:40`` makes ``flap~1``, ``flap~2``, ... between edges that turn by more than 40 degrees. A .toml file "
        "may hold a table `select`.")] = field(default_factory=dict)
    slide: Annotated[dict[str, Shape], Option(metavar=SHAPES), Spelling(read=shapes_of), Doc(
        "What stays", "Patches whose nodes move, but stay on their shape.",
        "Planes and cylinders are fitted to the patch's nodes and verified. A surface is the patch as it is.",
        )] = field(default_factory=dict)
    periodic: Annotated[
        tuple[PeriodicSettings, ...], Option(metavar="NAME NAME"), Spelling(read=pairs_of), Doc(
        "What stays", "Two patches whose nodes are images, if the file does not say so; repeat.",
        "The program finds the translation, or the rotation about x, y or z through the origin. For another one give a "
        "table: `patches`, and `axis` (two points) or `translation` (3,).")] = ()
    box: Annotated[
        str | tuple[Corner, ...] | BoxRule | Hexahedron, Option(metavar="auto|FILE"), Spelling(file=".toml"), Doc(
        "Box", "The box: auto, or a .toml with `corners`.",
        "Or eight corners (8, 3), or two opposite ones (2, 3) of a box along the axes. In a plane mesh four or two, "
        "without z. In Python also a `Hexahedron`.")] = "auto"
    margin: Annotated[float, Doc("Box", "Distance from the surface to an automatic box; 0: the program chooses.")] = 0.0
    box_each: Annotated[bool, Doc(
        "Box", "A box for each surface; boxes must not overlap.")] = False
    open_faces: Annotated[tuple[str, ...], ONLY_SET, Doc(
        "Box", "Faces of a given box without zero sites: x-, x+, y-, y+, z-, z+.")] = ()
    section: Annotated[tuple[SectionSettings, ...], ONLY_SET, Doc(
        "Box", "Faces of an overlapping block that cut the box (section 5.2 of the paper).",
        "A table for each: `patch`, `point` (3,) of its plane, `axis` ``x``, ``y`` or ``z`` along its normal, and "
        "`slides` (true), whether nodes slide in it.")] = ()
    repair_slide: Annotated[dict[str, Shape], ONLY_SET, Spelling(read=shapes_of), Doc(
        "Repair", "Further patches, as in `slide`, whose nodes may slide in the repair; moving ones, too.",
        )] = field(default_factory=dict)
    # fmt: on

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class _Angles:
    angles: tuple[float, ...]


OF_SURFACE, OF_JOB = settings_in(SurfaceSettings), settings_in(JobSettings)
# All settings of a job with one surface, whose box is that of the job.
BY_NAME = OF_SURFACE | {name: setting for name, setting in OF_JOB.items() if name != "surface"}
# Settings of earlier versions and their names now.
RENAMED = {"corners": "box"}
# Settings of a surface that not every motion has a use for.
IDLE = {name: only for name, setting in OF_SURFACE.items() if (only := setting.note(Only))}


def job_settings(nested: Mapping[str, Any]) -> JobSettings:
    """Return the settings that nested tables describe; InputError names the first that does not fit."""
    for table in _tables(nested.get("surface")):
        _refuse_renamed(table)
    try:
        return structure(nested, JobSettings)
    except InputError as error:
        several = len(_tables(nested.get("surface"))) > 1
        raise InputError(str(error) if several else str(error).replace("surface[0].", "")) from None


def settings_of(surfaces: Any, hinge: Any, angle: Any, options: Mapping[str, Any]) -> JobSettings:
    """Return the settings that arguments of `deflect` describe.

    Parameters
    ----------
    surfaces : Name of a patch, or several, wildcards allowed; or tables of `SurfaceSettings`, one for each moving
        surface.
    hinge : (2, 3) two points of the hinge line; None if `motion` or `table` needs none.
    angle : Degrees, or the share of a table of displacements.
    options : Settings of `JobSettings` and, for the surface, of `SurfaceSettings`.

    Raises InputError, of one sentence, for an option that is unknown or without effect, or a wrong value.
    """
    for name in IN_PYTHON.keys() & options.keys():
        raise InputError(f"unknown setting {name}; did you mean {IN_PYTHON[name]}?")
    given = {name: value for name, value in {"hinge": hinge, "angle": angle, **options}.items() if value is not None}
    of_surface, rest = _split_options(given)
    several = tables_of(surfaces)
    if several and of_surface:
        raise InputError(f"{min(of_surface)} belongs to one surface: put it into the tables of surfaces")
    share = (
        {"amount": of_surface["angle"]} if "angle" in of_surface and not of_surface.keys() & {"shift", "slot"} else {}
    )
    tables = several or [{"patches": surfaces, **of_surface, **share}]
    _check_use(tables, rest)
    try:
        return job_settings({**rest, "surface": tables})
    except InputError as error:
        raise InputError(str(error).replace("patches =", "surfaces =").replace("surface[", "surfaces[")) from None


def check_swept(settings: JobSettings, swept: bool = True) -> JobSettings:
    """Return the settings; InputError for a shift or a slot, whose own angle a sweep would replace."""
    if swept and any(surface.shift or surface.slot for surface in settings.surface):
        raise InputError(
            "shift and slot are one setting with an angle of its own: for a sweep give the places as a track"
        )
    return settings


def tables_of(surfaces: Any) -> list[Nested]:
    """Return surfaces given as tables, or as a mapping from patch to table; nothing if they are names."""
    if (
        isinstance(surfaces, Mapping)
        and surfaces
        and all(isinstance(surface, Mapping) for surface in surfaces.values())
    ):
        return [{"patches": name, **table} for name, table in surfaces.items()]
    rows = surfaces if isinstance(surfaces, list | tuple) else [surfaces]
    return [dict(row) for row in rows] if all(isinstance(row, Mapping) for row in rows) else []


def _check_use(surfaces: Sequence[Nested], rest: Nested) -> None:
    for surface in surfaces:
        motion = surface.get("motion", "rigid")
        word = motion if isinstance(motion, str) else ""
        why = f"a {word} motion has no use for it" if word else "the motion has its own"
        for name, only in IDLE.items() if word in ("", *IN_ANGLE.motions) else ():
            if word not in only.motions and surface.get(name) is not None:
                raise InputError(f"{name} = {shortened(surface[name])}: {why}")
    box = rest.get("box", "auto")
    if "margin" in rest and not (isinstance(box, str) and box == "auto"):
        raise InputError(f"margin = {shortened(rest['margin'])}: only the automatic box has a margin")


def read_job(path: Path) -> Nested:
    """Return the tables of a settings file; files that it names are relative to it."""
    nested = read_toml(path)
    nested.pop("mesh", None)  # of the settings beside a report, which the command names itself
    for table in (nested, *_tables(nested.get("surface"))):
        for name in table.keys() & BY_NAME.keys():
            value, ending = table[name], BY_NAME[name].spelling.file
            if isinstance(value, str) and ending is not None and value.endswith(ending):
                table[name] = str(path.parent / value)
            elif isinstance(value, list) and ending == "":
                table[name] = [str(path.parent / item) if isinstance(item, str) else item for item in value]
    return nested


def with_options(nested: Nested, options: Mapping[str, Any], assignments: Sequence[str] = ()) -> Nested:
    """Return tables with values replaced by options; options of a surface concern the first.

    Further surfaces keep their proportion to its angle. With the option ``patches`` it is the only surface.
    """
    given = {key: value for key, value in options.items() if value not in (None, ())}
    of_surface, new = _split_options({**given, **parse_assignments(assignments)})
    for name in ("select", "slide"):
        old, added = (parse_spelling(part.get(name, {}), OF_JOB[name], name) for part in (nested, new))
        if name in new and isinstance(old, Mapping) and isinstance(added, Mapping):
            new[name] = {**old, **added}
    out = {**nested, **new}
    surfaces = _tables(nested.get("surface"))
    if "patches" in of_surface:
        out["surface"] = [of_surface]
    elif of_surface and surfaces:
        out["surface"] = [{**surfaces[0], **of_surface}, *_in_proportion(surfaces, of_surface.get("angle"))]
    return out


def angles_of(wanted: Any) -> tuple[float, ...]:
    """Return angles from ``first:last:step``, ends included, a list with commas, or a sequence; else InputError."""
    if not isinstance(wanted, str):
        several = isinstance(wanted, Iterable) and not isinstance(wanted, Mapping)
        if angles := structure({"angles": list(wanted) if several else wanted}, _Angles).angles:
            return angles
        raise InputError("angles is empty: give at least one")
    try:
        angles = _range(wanted) if ":" in wanted else tuple(float(part) for part in wanted.split(","))
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(
            f"angles = {wanted}: must be first:last:step, such as -30:30:5, or a list with commas"
        ) from None
    if not 1 <= len(angles) <= MOST_ANGLES:
        raise InputError(f"angles = {wanted}: must be 1 to {MOST_ANGLES} angles")
    worst = max(angles, key=lambda angle: inf if isnan(angle) else abs(angle))
    if not abs(worst) <= LARGEST_ANGLE:
        raise InputError(f"angles = {wanted}: {worst:g} deg is out of range: at most {LARGEST_ANGLE:g} deg either way")
    return tuple(dict.fromkeys(angles))


def _range(text: str) -> tuple[float, ...]:
    """Return the numbers of ``first:last:step``; of too many, one more than `MOST_ANGLES`."""
    first, last, step = (float(part) for part in text.split(":"))
    count = floor((last - first) / step + 1e-9) + 1
    return tuple(round(first + i * step, 12) for i in range(min(count, MOST_ANGLES + 1)))


def _refuse_renamed(names: Iterable[str]) -> None:
    """Raise InputError for a setting that has another name now."""
    for name in names:
        if name in RENAMED:
            raise InputError(f"unknown setting {name}; it is {RENAMED[name]} now")


def _split_options(options: Mapping[str, Any]) -> tuple[Nested, Nested]:
    """Return the options of the surface and those of the job; InputError for an unknown option."""
    known = (*OF_JOB, *OF_SURFACE)
    for name in options:
        if name not in (*known, "fitting"):
            _refuse_renamed([name])
            raise InputError(f"unknown setting {name}; {nearest(name, known)}")
    of_surface = {name: value for name, value in options.items() if name in OF_SURFACE and name not in OF_JOB}
    return of_surface, {name: value for name, value in options.items() if name not in of_surface}


def _tables(value: Any) -> list[dict[str, Any]]:
    return [table for table in value if isinstance(table, dict)] if isinstance(value, list) else []


def _in_proportion(surfaces: list[dict[str, Any]], angle: float | None) -> list[dict[str, Any]]:
    """Return the further surfaces with their proportion to the first one's angle kept; InputError if that is zero."""
    first = surfaces[0].get("angle")
    if angle is None or first is None or angle == first:
        return surfaces[1:]
    moves = [table.get("patches") for table in surfaces[1:] if table.get("angle")]
    if first == 0 and moves:
        raise InputError(
            f"angle = {angle:g}: the first surface has angle 0, so that the others cannot be in proportion to it; put "
            f"{shortened(moves[0])} first"
        )
    return [
        {**table, "angle": table["angle"] * angle / first} if table.get("angle") else table for table in surfaces[1:]
    ]

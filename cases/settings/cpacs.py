"""Hinge line and deflection of a trailing edge device in a CPACS 3 file.

A hinge point lies at the eta of the device's border and at a xsi of its own in the chord surface of the component
segment: straight between the chords of the wing's elements, with etas in proportion to the distances between the
middles of these chords. Its height is a share of the way from the lower to the upper skin, which are straight between
elements, too. Eta and positionings are understood as TiGL does, the reference implementation; see the documentation of
`controlSurfacePathType`, `transformationType` and `wingPositioningType` in the schema of CPACS.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, TreeBuilder, XMLParser

import numpy as np

from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.base.errors import InputError, nearest, shortened
from sdm_deflect.deform.base.reading import damaged
from sdm_deflect.deform.mesh.mesh import bounded

DEVICE = "trailingEdgeDevice"
BORDERS = ("inner", "outer")


REMEDY = "leave out what is not of the wing"
ATTRIBUTES = ("uID", "refType")
"""Attributes that are read."""


@dataclass(frozen=True, slots=True)
class FileLimits:
    """How large a file may be: bytes, elements, and levels of elements in one another."""

    size: int = 10_000_000
    elements: int = 1_000_000
    depth: int = 100


USUAL = FileLimits()
Point = tuple[float, float, float]


class PathStep(NamedTuple):
    """A step of a device's path: its parameter, how far it turns in degrees, and whether the hinge line moves."""

    parameter: float
    rotation: float
    moves: bool


@dataclass(frozen=True, slots=True, eq=False)
class Device:
    """A trailing edge device.

    Attributes
    ----------
    uid : its uID.
    hinge : (2, 3) inner and outer hinge point, in metres.
    steps : its path, by rising parameter.
    """

    uid: str
    hinge: FloatArray
    steps: tuple[PathStep, ...]

    @classmethod
    def read(cls, path: Path, uid: str, limits: FileLimits = USUAL) -> "Device":
        """Read a device by its uID.

        Raises InputError if the file is larger than the limits, has no such device, or describes it by what is not
        read.
        """
        with damaged(path, "CPACS file"), path.open("rb") as file:
            text = file.read(limits.size + 1)
            if len(text) > limits.size:
                raise InputError(f"is larger than {limits.size / 1e6:g} MB: {REMEDY}")
            parser = XMLParser(target=_Bounded(limits))
            parser.feed(text)
            return _Tree.of(parser.close()).device(uid)

    def rotation(self, parameter: float | None) -> float:
        """Return the degrees at a parameter, straight between steps; of None, those of the only step that turns.

        Positive is right-handed from the inner to the outer hinge point. Raises InputError if the parameter is missing
        or outside the path, or the hinge line itself moves.
        """
        parameter = self._only() if parameter is None else parameter
        parameters = [step.parameter for step in self.steps]
        if not parameters or not parameters[0] <= parameter <= parameters[-1]:
            raise InputError(f"device {self.uid} has no step {parameter:g}; its steps are {self._known()}")
        near = np.interp(parameter, parameters, [float(step.moves) for step in self.steps])
        if near > 0.0:
            raise InputError(f"device {self.uid} is also shifted at step {parameter:g}; only rotations are read")
        return float(np.interp(parameter, parameters, [step.rotation for step in self.steps]))

    def _known(self) -> str:
        return ", ".join(f"{step.parameter:g} ({step.rotation:g} deg)" for step in self.steps) or "none"

    def _only(self) -> float:
        """Return the parameter of the only step that turns."""
        turning = [step.parameter for step in self.steps if step.rotation]
        if len(turning) != 1:
            raise InputError(f"device {self.uid} has the steps {self._known()}: give angle, or {self.uid}=STEP")
        return turning[0]


def hinge_and_angle(path: Path, text: str, angle: float | None) -> tuple[tuple[Point, Point], float]:
    """Return inner and outer hinge point of ``uID`` or ``uID=step``, and the angle: that given, or of the step.

    Raises InputError as `Device.read` and `Device.rotation`, and if both an angle and a step are given.
    """
    uid, equals, step = (part.strip() for part in text.partition("="))
    device = Device.read(path, uid)
    if angle is not None and equals:
        raise InputError(f"device = {text}: the angle is given already; leave out angle or ={step}")
    try:
        parameter = float(step) if equals else None
    except ValueError:
        raise InputError(f"device = {text}: {shortened(step)} is no number; it must be a step of the path") from None
    first, second = (_point(row) for row in device.hinge)
    return (first, second), device.rotation(parameter) if angle is None else angle


class _Bounded(TreeBuilder):
    """Builds elements without namespaces, and of their attributes those that are read, within limits."""

    def __init__(self, limits: FileLimits) -> None:
        super().__init__()
        self.limits, self.count, self.depth = limits, 0, 0

    def start(self, tag: Any, attributes: Any, /) -> Element:
        """Open an element; InputError where there are too many."""
        self.count += 1
        self.depth += 1
        if self.count > self.limits.elements:
            raise InputError(f"has more than {self.limits.elements} elements: {REMEDY}")
        if self.depth > self.limits.depth:
            raise InputError(f"has elements more than {self.limits.depth} levels deep, and CPACS has fewer")
        own = {name: attributes[name] for name in ATTRIBUTES if name in attributes}
        return super().start(tag.rpartition("}")[2], own)

    def end(self, tag: str, /) -> Element:
        """Close an element."""
        self.depth -= 1
        return super().end(tag)


@dataclass(frozen=True, slots=True, eq=False)
class _Tree:
    """The elements of a file, those with a uID by it."""

    root: Element
    known: Mapping[str, Element] = field(repr=False)

    @classmethod
    def of(cls, root: Element) -> "_Tree":
        return cls(root, {one.attrib["uID"]: one for one in root.iter() if "uID" in one.attrib})

    def device(self, uid: str) -> Device:
        places = {
            device.get("uID", ""): (wing, segment, device)
            for wing in self.root.iter("wing")
            for segment in wing.iter("componentSegment")
            for device in segment.iter(DEVICE)
        }
        if uid not in places:
            raise InputError(f"device {uid!r} is no {DEVICE}; {nearest(uid, places, 'there are')}")
        wing, segment, device = places[uid]
        elements = self._elements(wing, _text(segment, "fromElementUID"), _text(segment, "toElementUID"))
        skins = [self._skin(wing, element) for element in elements]
        hinge = [_hinge_point(device, border, segment.get("uID", ""), skins) for border in BORDERS]
        steps = sorted(_step(one) for one in device.iterfind("path/steps/step"))
        return Device(uid, np.array(hinge), tuple(steps))

    def _elements(self, wing: Element, first: str, last: str) -> list[str]:
        """Return the elements from the first of a component segment to the last, along the wing's segments."""
        following = {}
        for one in wing.iterfind("segments/segment"):
            if one.find("guideCurves") is not None:
                raise InputError(f"wing {wing.get('uID')} has guide curves, which are not read")
            following[_text(one, "fromElementUID")] = _text(one, "toElementUID")
        found = [first]
        while found[-1] != last and found[-1] in following and len(found) <= len(following):
            found.append(following[found[-1]])
        if found[-1] != last or len(found) < 2:
            raise InputError(f"wing {wing.get('uID')}: no segments lead from element {first} to element {last}")
        return found

    def _skin(self, wing: Element, uid: str) -> "_Skin":
        """Return the profile of an element where it is in space."""
        section = next((one for one in wing.iter("section") for e in one.iter("element") if e.get("uID") == uid), None)
        element = self.known.get(uid)
        if section is None or element is None:
            raise InputError(f"wing {wing.get('uID')} has no element {uid}")
        airfoil = self.known.get(_text(element, "airfoilUID"))
        points = None if airfoil is None else airfoil.find("pointList")
        if points is None:
            raise InputError(f"the profile of element {uid} is no list of points")
        xyz = np.column_stack([_vector(points, name) for name in "xyz"])
        skin = _Skin.of(bounded(xyz, f"the profile of element {uid}"), uid)
        shift = self._position(wing, section.get("uID", ""))
        return (
            skin.moved(*_transformation(element))
            .moved(*_transformation(section))
            .moved(np.eye(3), shift)
            .moved(*self._wing(wing))
        )

    def _position(self, wing: Element, section: str) -> FloatArray:
        """Return how far positionings shift a section."""
        into = {_text(one, "toSectionUID"): one for one in wing.iterfind("positionings/positioning")}
        shift = np.zeros(3)
        for _ in range(len(into) + 1):
            one = into.get(section)
            if one is None:
                return shift
            sweep, dihedral = (np.radians(_number(one, name)) for name in ("sweepAngle", "dihedralAngle"))
            along = [np.sin(sweep), np.cos(sweep) * np.cos(dihedral), np.cos(sweep) * np.sin(dihedral)]
            shift += _number(one, "length") * np.array(along)
            section = one.findtext("fromSectionUID", "").strip()
        raise InputError(f"the positionings of wing {wing.get('uID')} lead in a circle")

    def _wing(self, wing: Element) -> tuple[FloatArray, FloatArray]:
        """Return the transformation of a wing; InputError if it is relative to a parent that is moved itself."""
        child, seen = wing, {wing.get("uID")}
        while (uid := child.findtext("parentUID", "").strip()) and _is_local(child):
            if uid not in self.known or uid in seen:
                raise InputError(f"{child.tag} {child.get('uID')} has no parent {uid}")
            child = self.known[uid]
            seen.add(uid)
            if any(_triple(child, name, 0.0).any() for name in ("rotation", "translation")):
                raise InputError(f"wing {wing.get('uID')} is placed relative to {uid}, which is not at the origin")
        return _transformation(wing)


@dataclass(frozen=True, slots=True, eq=False)
class _Skin:
    """A profile: leading and trailing edge, and both skins from the one to the other.

    Attributes
    ----------
    ends : (2, 3).
    lower, upper : (K, 3) each; K differs.
    """

    ends: FloatArray
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, points: FloatArray, uid: str) -> "_Skin":
        """Divide the points (N, 3) of a profile, which begin and end at the trailing edge, at the farthest from it."""
        if len(points) < 3:
            raise InputError(f"the profile of element {uid} has {len(points)} points; it needs at least 3")
        trailing = 0.5 * (points[0] + points[-1])
        nose = int(np.argmax(np.linalg.norm(points - trailing, axis=1)))
        sides = sorted((points[nose::-1], points[nose:]), key=lambda side: float(side[:, 2].mean()))
        if min(map(len, sides)) < 2:
            raise InputError(f"the profile of element {uid} does not begin and end at the trailing edge")
        return cls(np.array([points[nose], trailing]), *sides)

    def moved(self, matrix: FloatArray, shift: FloatArray) -> "_Skin":
        """Return it multiplied by a matrix (3, 3) and shifted by (3,)."""
        return _Skin(*(points @ matrix.T + shift for points in (self.ends, self.lower, self.upper)))

    def at(self, xsi: float) -> FloatArray:
        """Return the lower and the upper point (2, 3) at a share of the chord."""
        chord = self.ends[1] - self.ends[0]
        found = []
        for side in (self.lower, self.upper):
            shares = (side - self.ends[0]) @ chord / (chord @ chord)
            order = np.argsort(shares, kind="stable")
            found.append([np.interp(xsi, shares[order], column[order]) for column in side.T])
        return np.array(found)


def _hinge_point(device: Element, border: str, segment: str, skins: Sequence[_Skin]) -> FloatArray:
    """Return the inner or the outer hinge point (3,)."""
    place = f"outerShape/{border}Border/etaLE"
    nested = device.find(f"{place}/eta") is not None
    if nested and (reference := _text(device, f"{place}/referenceUID")) != segment:
        raise InputError(f"{place} refers to {reference}, not to the component segment {segment}")
    eta = _share(device, f"{place}/eta" if nested else place)
    xsi, height = (_share(device, f"path/{border}HingePoint/{name}") for name in ("hingeXsi", "hingeRelHeight"))
    middles = np.array([skin.ends.mean(axis=0) for skin in skins])
    etas = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middles, axis=0), axis=1))])
    if not etas[-1] > 0.0:
        raise InputError(f"component segment {segment} has no span")
    pairs = np.array([skin.at(xsi) for skin in skins])
    lower, upper = (
        np.array([np.interp(eta, etas / etas[-1], column) for column in side.T]) for side in (pairs[:, 0], pairs[:, 1])
    )
    return np.asarray(lower + height * (upper - lower))


def _point(row: FloatArray) -> Point:
    x, y, z = row.tolist()
    return x, y, z


def _step(step: Element) -> PathStep:
    """Return a step; before CPACS 3.1 its parameter was called relDeflection."""
    name = "controlParameter" if step.find("controlParameter") is not None else "relDeflection"
    found = [step.find(f"{border}HingeTranslation") for border in BORDERS]
    moves = any(_number(one, axis, 0.0) for one in found if one is not None for axis in "xyz")
    return PathStep(_number(step, name), _number(step, "hingeLineRotation", 0.0), moves)


def _transformation(element: Element) -> tuple[FloatArray, FloatArray]:
    """Return the matrix (3, 3) and the shift (3,) of an element: scaled, turned about x, y' and z'', then shifted."""
    x, y, z = np.radians(_triple(element, "rotation", 0.0))
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return about_x @ about_y @ about_z @ np.diag(_triple(element, "scaling", 1.0)), _triple(element, "translation", 0.0)


def _is_local(element: Element) -> bool:
    shift = element.find("transformation/translation")
    return shift is None or shift.get("refType", "absLocal") != "absGlobal"


def _triple(element: Element, name: str, usual: float) -> FloatArray:
    return np.array([_number(element, f"transformation/{name}/{axis}", usual) for axis in "xyz"])


def _share(element: Element, place: str) -> float:
    found = _number(element, place)
    if not 0.0 <= found <= 1.0:
        raise InputError(f"{place} of {element.get('uID')} is {found:g}; it must be between 0 and 1")
    return found


def _vector(points: Element, name: str) -> FloatArray:
    text = _text(points, name)
    try:
        return np.array([float(part) for part in text.rstrip("; \n").split(";")])
    except ValueError:
        raise InputError(f"pointList/{name} is no list of numbers with semicolons between them") from None


def _number(element: Element, place: str, usual: float | None = None) -> float:
    if usual is not None and element.find(place) is None:
        return usual
    text = _text(element, place)
    try:
        return float(bounded(float(text), place))
    except ValueError:
        raise InputError(f"{place} of {element.get('uID', element.tag)} is {shortened(text)}, no number") from None


def _text(element: Element, place: str) -> str:
    text = element.findtext(place, "").strip()
    if not text:
        raise InputError(f"{element.tag} {element.get('uID', '')} lacks {place}")
    return text

"""The hinge of a trailing edge device of a wing in CPACS 3, as TiGL has it: ``cpacs_hinge.py aircraft.xml UID``.

Without UID it lists those of the devices.
"""

import sys
from argparse import ArgumentParser
from xml.etree.ElementTree import Element, ParseError, parse

import numpy as np
from scipy.spatial.transform import Rotation


def moved(points: np.ndarray, element: Element) -> np.ndarray:
    """Scale points (N, 3), turn them about x, y' and z'', and shift them, as an element's transformation says."""
    find, parts = element.findtext, [("scaling", "1"), ("rotation", "0"), ("translation", "0")]
    rows = [[float(find(f"transformation/{what}/{axis}", usual)) for axis in "xyz"] for what, usual in parts]
    return Rotation.from_euler("XYZ", rows[1], degrees=True).apply(points * rows[0]) + rows[2]


def skins(root: Element, wing: Element, uid: str, xsi: float) -> np.ndarray:
    """Return lower and upper point of an element at a share of its chord, and the chord's middle (3, 3)."""
    section, element = next((s, e) for s in wing.iter("section") for e in s.iter("element") if e.get("uID") == uid)
    profile = next(one for one in root.iter() if one.get("uID") == element.findtext("airfoilUID"))
    lists = (profile.findtext(f"pointList/{axis}").strip("; \n").split(";") for axis in "xyz")
    points = moved(moved(np.array(list(lists), dtype=float).T, element), section)
    into = {one.findtext("toSectionUID"): one for one in wing.iter("positioning")}
    place = into.get(section.get("uID"))
    while place is not None:
        length, sweep, dihedral = (float(place.findtext(key)) for key in ("length", "sweepAngle", "dihedralAngle"))
        points += Rotation.from_euler("zx", [-sweep, dihedral], degrees=True).apply([0.0, length, 0.0])
        place = into.get(place.findtext("fromSectionUID"))
    points = moved(points, wing)
    nose = int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    chord = 0.5 * (points[0] + points[-1]) - points[nose]
    sides = sorted((points[nose::-1], points[nose:]), key=lambda side: side[:, 2].mean())
    shares = ((side - points[nose]) @ chord / (chord @ chord) for side in sides)
    found = [[np.interp(xsi, share, column) for column in side.T] for share, side in zip(shares, sides, strict=True)]
    return np.array([*found, points[nose] + 0.5 * chord])


def hinge(path: str, uid: str) -> np.ndarray:
    """Return inner and outer hinge point (2, 3) of a device; KeyError with the devices' UIDs for another one."""
    root, points = parse(path).getroot(), []
    places = ((w, s, d) for w in root.iter("wing") for s in w.iter("componentSegment") for d in s.iter())
    known = {place[2].get("uID", ""): place for place in places if place[2].find("path/innerHingePoint") is not None}
    if uid not in known:
        raise KeyError(f"{path}: {uid or 'a UID'} is no device with a hinge; there are: {', '.join(sorted(known))}")
    wing, segment, device = known[uid]
    ends = {one.findtext("fromElementUID"): one.findtext("toElementUID") for one in wing.iter("segment")}
    elements = [segment.findtext("fromElementUID")]
    while elements[-1] != segment.findtext("toElementUID"):
        elements.append(ends[elements[-1]])
    for border in ("inner", "outer"):
        eta = device.find(f"outerShape/{border}Border/etaLE")
        point = device.find(f"path/{border}HingePoint")
        xsi, height = (float(point.findtext(key)) for key in ("hingeXsi", "hingeRelHeight"))
        each = np.array([skins(root, wing, one, xsi) for one in elements])
        etas = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(each[:, 2], axis=0), axis=1)))
        share = float(eta.findtext("eta", eta.text)) * etas[-1]
        columns = (each[:, 0] + height * (each[:, 1] - each[:, 0])).T
        points.append([np.interp(share, etas, column) for column in columns])
    return np.array(points)


if __name__ == "__main__":
    arguments = ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file")
    arguments.add_argument("uid", nargs="?", default="")
    given = arguments.parse_args()
    try:
        ends = hinge(given.file, given.uid)
    except (OSError, ParseError, KeyError) as error:
        sys.exit(str(error.args[-1]))
    print("--hinge", *(",".join(f"{value:.9g}" for value in point) for point in ends))

"""Fuselage, canopy and inlet."""

from itertools import pairwise
from math import cos, radians, sin

import cadquery as cq

from sdm_deflect.geometry.fuse import NamedSolid
from sdm_deflect.geometry.parameters import Canopy, Fuselage, Inlet

_ORIGIN = cq.Vector(0, 0, 0)
_AXIS = cq.Vector(1, 0, 0)


def fuselage_parts(fuselage: Fuselage) -> list[NamedSolid]:
    """Nose, cylinder and base as sectors of revolution about x.

    Every border of a patch, and every place where the surface is smooth or nearly so (nose to cylinder, the
    plane of symmetry), separates two solids: a mesher finds such a border only where a face stands behind it.
    """
    f, angle = fuselage, fuselage.panel_angle
    parts = []
    for start, side in ((-90.0, "right"), (90.0, "left")):
        lower, upper = 90.0 + start - angle, 90.0 + start + angle
        parts += [
            NamedSolid("fuselage", _sector(_ogive(f, start), 180.0)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.nose_length, f.panel_front, start), 180.0)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.panel_front, f.panel_rear, start), lower - start)),
            NamedSolid(f"fuselage_panel_{side}", _sector(_rectangle(f, f.panel_front, f.panel_rear, lower), 2 * angle)),
            NamedSolid("fuselage", _sector(_rectangle(f, f.panel_front, f.panel_rear, upper), lower - start)),
            NamedSolid("fuselage_rear", _sector(_rectangle(f, f.panel_rear, f.length, start), 180.0)),
        ]
    return parts


def _at(x: float, r: float, polar: float) -> cq.Vector:
    """The point at distance `r` from the axis, `polar` degrees above the starboard horizontal."""
    return cq.Vector(x, r * cos(radians(polar)), r * sin(radians(polar)))


def _rectangle(f: Fuselage, front: float, rear: float, polar: float) -> cq.Wire:
    corners = [(front, 0.0), (front, f.radius), (rear, f.radius), (rear, 0.0)]
    return cq.Wire.makePolygon([_at(x, r, polar) for x, r in corners], close=True)


def _ogive(f: Fuselage, polar: float) -> cq.Wire:
    apex, shoulder, foot = (_at(x, r, polar) for x, r in ((0, 0), (f.nose_length, f.radius), (f.nose_length, 0)))
    arc_radius = (f.radius**2 + f.nose_length**2) / (2.0 * f.radius)
    middle = 0.5 * f.nose_length
    height = (arc_radius**2 - (f.nose_length - middle) ** 2) ** 0.5 + f.radius - arc_radius
    arc = cq.Edge.makeThreePointArc(apex, _at(middle, height, polar), shoulder)
    return cq.Wire.assembleEdges([arc, cq.Edge.makeLine(shoulder, foot), cq.Edge.makeLine(foot, apex)])


def _sector(outline: cq.Wire, degrees: float) -> cq.Solid:
    return cq.Solid.revolve(outline, [], degrees, _ORIGIN, _AXIS)


def canopy_parts(canopy: Canopy) -> list[NamedSolid]:
    """An ellipsoid with its poles and its seam inside the fuselage."""
    sphere = cq.Solid.makeSphere(1.0, _ORIGIN, _AXIS, -90, 90, 360).rotate(_ORIGIN, _AXIS, 180.0)
    c = canopy
    scale = [[c.semi_length, 0, 0, c.x], [0, c.semi_width, 0, 0], [0, 0, c.semi_height, c.z]]
    return [NamedSolid("canopy", sphere.transformGeometry(cq.Matrix(scale)))]


def inlet_parts(inlet: Inlet) -> list[NamedSolid]:
    """Ruled lofts between neighbouring stations."""
    outlines = [_inlet_outline(*station) for station in inlet.stations()]
    lofts = [cq.Solid.makeLoft([a, b], True) for a, b in pairwise(outlines)]
    return [NamedSolid("inlet", loft) for loft in lofts]


def _inlet_outline(x: float, half_width: float, side: float, bottom: float) -> cq.Wire:
    # The top lies well inside the fuselage at every station.
    top = 0.4 * side
    around = ((-half_width, side), (-half_width, top), (half_width, top), (half_width, side))
    corners = [cq.Vector(x, y, z) for y, z in around]
    arc = cq.Edge.makeThreePointArc(corners[-1], cq.Vector(x, 0, bottom), corners[0])
    return cq.Wire.assembleEdges([*(cq.Edge.makeLine(a, b) for a, b in pairwise(corners)), arc])

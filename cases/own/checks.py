"""What must hold of a deflected mesh."""

import numpy as np

from sdm_deflect.cases.own.course import Course
from sdm_deflect.cases.own.plan import Plan
from sdm_deflect.cases.validation import Check
from sdm_deflect.deform.rbf.kernels import FloatArray
from sdm_deflect.deform.touched import Layers

LAYER_CHANGE = 0.01  # of the first layer's height
ON_WALL = 1e-9  # of the moving surface's size: how far sliding nodes may be from where they slid


def checks_of(plan: Plan, course: Course, layers: Layers | None) -> list[Check]:
    """Return what must hold of the mesh at one angle."""
    subject, points, sites = plan.subject, course.points, plan.sites
    moved = _moved(subject.points, points)
    outside = np.ones(len(points), dtype=bool)
    outside[plan.region.inside] = outside[plan.boundary.nodes] = False
    error = max(fits.error for one in course.solutions for fits in (one.first, one.fits) if fits)
    tolerance = sites.tolerance
    found = [
        Check("outside_moved", _largest(moved[outside]), 0.0, "", f"{int(outside.sum())} nodes outside the box"),
        Check("fixed_surfaces_moved", _largest(moved[sites.still]), 0.0, "", f"{len(sites.still)} nodes inside"),
        Check("site_error", error, tolerance, "", f"all data sites, {len(course.solutions)} step(s)"),
    ]
    if subject.cells:
        limit = sum(plan.touched.inverted)
        where = f"{plan.touched.count} cells with a node in the box" + (", as before" if limit else "")
        found.append(Check("inverted_cells", course.inverted, limit, "cells", where))
    for i, nodes in sites.sliding:
        sheet = plan.boundary.sheets[i]
        drift = np.abs(sheet.wall.distance(points[nodes]) - sheet.wall.distance(subject.points[nodes]))
        allowed, where = ON_WALL * plan.boundary.size, f"{len(nodes)} sliding nodes"
        found.append(Check(f"on_{sheet.patch}", _largest(drift), allowed, "", where))
    if layers:
        where = f"{layers.edges} edges off the walls, from {layers.lowest:.3g}; 99 % within {layers.p99:.2e}"
        found.append(Check("first_layer", layers.largest, LAYER_CHANGE, "", where))
    return found


def _moved(before: FloatArray, after: FloatArray) -> FloatArray:
    return np.asarray(np.abs(after - before).max(axis=1))


def _largest(values: FloatArray) -> float:
    return float(values.max(initial=0.0))

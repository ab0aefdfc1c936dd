"""Measure a deflected mesh against what it should be, and against the deflected CAD."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.motion import FloatArray, IndexArray, axis_of
from sdm_deflect.cases.reference import Reference
from sdm_deflect.cases.sdm.overset import overset_checks
from sdm_deflect.cases.turn import Turn
from sdm_deflect.cases.validate_surface import Shape, surface_checks
from sdm_deflect.cases.validation import Check, worst
from sdm_deflect.cases.zero_sites import BLOCK
from sdm_deflect.deform.quality import mean_ratio, signed_volumes
from sdm_deflect.meshing.mesh import TetMesh


def validate(
    case: Case,
    mesh: TetMesh,
    deflected: TetMesh,
    turns: Sequence[Turn],
    reference: Reference,
    background: TetMesh | None = None,
) -> tuple[Check, ...]:
    """Return every check that applies to the case.

    Parameters
    ----------
    mesh, deflected : before and after; same cells, same order.
    turns : what each control surface was to do.
    reference : the deflected CAD.
    background : the mesh around a Chimera block.
    """
    checks = list(mesh_checks(case, mesh, deflected, turns))
    for turn in turns:
        shape = Shape(case, mesh, deflected, turn, axis_of(case.fighter, turn.surface))
        suffix = f":{turn.surface}" if len(turns) > 1 else ""
        checks += [replace(check, name=check.name + suffix) for check in surface_checks(shape, reference)]
    if background is not None:
        checks += overset_checks(case, mesh, deflected, background)
    return tuple(checks)


def mesh_checks(case: Case, mesh: TetMesh, deflected: TetMesh, turns: Sequence[Turn]) -> Iterator[Check]:
    """Checks of the whole mesh: nothing outside or on a fixed patch moved, no cell inverted, good shape."""
    moved = np.linalg.norm(deflected.points - mesh.points, axis=1)
    outside = np.ones(len(moved), dtype=bool)
    for turn in turns:
        outside[turn.region.inside] = False
    yield unmoved("outside_moved", moved, np.flatnonzero(outside), mesh.points)
    volumes = signed_volumes(deflected.points, deflected.tets)
    yield Check("inverted_cells", float(np.count_nonzero(volumes <= 0.0)), 0.0, "cells", f"of {len(volumes)}")
    moving = [patch for turn in turns for patch in turn.motion.patches]
    fixed = mesh.on(*(name for name in mesh.names[1:] if name not in (*moving, BLOCK)))
    check = unmoved("fixed_surfaces_moved", moved, fixed, mesh.points)
    border = np.intersect1d(fixed, mesh.on(*moving), assume_unique=True)
    yield replace(check, where=f"{check.where}, of which {len(border)} border a moving patch")
    quality = mean_ratio(deflected.points, deflected.tets)
    x, y, z = deflected.points[deflected.tets[quality.argmin()]].mean(axis=0)
    where = f"mean ratio, worst cell at ({x:.4f}, {y:.4f}, {z:.4f})"
    yield Check("quality_min", float(quality.min()), case.limits.quality_min, "-", where, "at least")


def unmoved(name: str, moved: FloatArray, nodes: IndexArray, points: FloatArray) -> Check:
    """Check that these nodes did not move by a single bit."""
    return Check(name, float(moved[nodes].max(initial=0.0)), 0.0, "m", worst(moved[nodes], points[nodes]))

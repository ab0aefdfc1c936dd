"""Figures of a deflection under the names that other programs read."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.numbers import percent
from sdm_deflect.base.ties import first_largest
from sdm_deflect.deform.checks import Check, verdict
from sdm_deflect.deform.rbf.data_sites import DIRECTIONS
from sdm_deflect.deform.rbf.fitting import KERNELS, ORDERS
from sdm_deflect.deform.surface.motions import TRACK_UNIT, MotionLaw, Moving
from sdm_deflect.deform.surface.reached_share import ReachedShare
from sdm_deflect.deform.volume.deflection import BoxDeflection, Deflection
from sdm_deflect.deform.volume.job import Amounts
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.mesh.mesh import REGION, Warned
from sdm_deflect.meshing.mesh.quality import SEVERE, SKEW, Quality
from sdm_deflect.meshing.mesh.selection import point_text

from .advice import strip_of

Json = dict[str, Any]
# Mean turn over the span, as a share of the angle, below which there is a warning.
REACHED = 0.9
# What the figures of faces are called, and their format.
FACES = {
    "non_orthogonality_max": ("largest non-orthogonality, deg", ".2f"),
    "non_orthogonality_mean": ("mean non-orthogonality, deg", ".2f"),
    "severely_non_orthogonal": (f"faces above {SEVERE:g} deg", ",d"),
    "skewness_max": ("largest skewness", ".3f"),
    "highly_skew": (f"faces of a skewness above {SKEW:g}", ",d"),
}


def mesh_figures(plan: Plan) -> Json:
    """Return the sizes of a mesh and of its patches."""
    return {
        "name": plan.mesh.name,
        "points": plan.mesh.point_count,
        "cells": sum(plan.mesh.cell_counts),
        "patches": {patch.name: {"points": len(patch.nodes), "triangles": len(patch)} for patch in plan.mesh.patches},
    }


def figures_by_box(deflection: Deflection) -> Json:
    """Return the figures of the deflection in each box, by its first moving patch."""
    return {part.plan.surface: deflection_figures(part) for part in deflection.parts}


def deflection_figures(deflection: Deflection) -> Json:
    """Return box, sites, adaptation and quality of one deflection of any mesh; lengths in the mesh's unit.

    Of several boxes, box, sites and adaptation are those of the first; cells, repair and motion are those of all.
    """
    first, whole = deflection.boxes[0], deflection.plan
    plan = first.plan
    sites, region = plan.sites, plan.region
    return {
        "confinement": {
            "corners": region.hexahedron.corners.tolist(),
            "why": region.box.why,
            "inside": len(plan.inside),
            "filter_seconds": region.filter_seconds,
            "spacing": sites.spacing,
        },
        "sites": {
            "surface": len(sites.distinct),
            "fixed": len(sites.sampled),
            "sliding": len(sites.sampled_sliding),
            "hexahedron": {d: sites.zero_sites(c) for c, d in enumerate(DIRECTIONS)},
            "tolerance": sites.tolerance,
            "median_edge": sites.edge,
            "coincident": sites.coincident,
        },
        "kernel": kernel_figures(plan),
        "adaptation": _adaptation(first),
        "error_between_sites": asdict(first.error_between) if first.error_between else None,
        "motion": motion_figures(whole, deflection.amounts),
        "surfaces": surface_figures(whole, deflection.amounts),
        "farthest": farthest_figures(whole, deflection.amounts),
        "cells_touched": whole.affected.count,
        "quality_inside": {"before": by_shape(whole.before), "after": by_shape(deflection.quality)},
        **face_figures(deflection),
        "repair": repair_figures(deflection),
        "steps": max(len(box.steps) for box in deflection.boxes),
        "seconds": deflection.seconds,
        "largest_correction": max(step.correction for box in deflection.boxes for step in box.steps),
    }


def kernel_figures(plan: BoxPlan) -> Json:
    """Return the kernel, its radius (null without one) and the polynomial."""
    fitting = plan.job.fitting
    return {"name": fitting.kernel, "radius": plan.sites.radius or None, "polynomial": fitting.polynomial}


def kernel_text(figures: Json) -> str:
    """Return a text on a kernel from its figures; the radius is in the mesh's unit of length."""
    needs, radius = KERNELS[figures["name"]], figures["radius"]
    wide = f" of radius {radius:.4g}" if radius else ""
    added = f"a {figures['polynomial']} polynomial" if ORDERS[figures["polynomial"]] else "no polynomial"
    definite = f"conditionally positive definite of order {needs.order}" if needs.order else "positive definite"
    return f"{needs.name}{wide} ({definite}) with {added}"


def fit_text(figures: Json) -> str:
    """Return a text on a deflection's interpolation: centres by direction, and accuracy."""
    fits, between = figures["adaptation"], figures["error_between_sites"]
    centers = ", ".join(f"{fit['centers']} ({name})" for name, fit in fits.items())
    condition = max((fit["condition"] or 0.0 for fit in fits.values()), default=0.0)
    error = max(fit["max_error"] for fit in fits.values())
    off = f", between them {between['max']:.1e} (99 %: {between['p99']:.1e})" if between else ""
    return f"interpolation: centres {centers}; condition {condition:.1e}, error at the sites {error:.1e}{off}"


def face_figures(deflection: Deflection) -> Json:
    """Return checkMesh's figures of affected polyhedra's faces, before and after; nothing without polyhedra."""
    faces, after = deflection.plan.faces, deflection.faces
    if not faces or not after:
        return {}
    pair = {"before": faces.before.quality().as_dict(), "after": after.quality().as_dict()}
    return {"face_quality": {"touched": pair}}


def face_rows(figures: Json) -> tuple[str, list[tuple[str, str, str]]]:
    """Return the scope of the face metrics and each of them before and after; empty if none were measured."""
    affected = figures.get("face_quality", {}).get("touched")
    if not affected:
        return "", []
    pairs = ((*FACES[key], *(affected[when][key] for when in ("before", "after"))) for key in FACES)
    return "faces of the affected cells", [(name, f"{old:{form}}", f"{new:{form}}") for name, form, old, new in pairs]


def repair_figures(deflection: Deflection) -> Json | None:
    """Return figures of the repairs, and the affected cells' quality before them; None without a repair."""
    repairs = deflection.repairs
    if not repairs:
        return None
    quality = repairs[0].quality
    if len(deflection.boxes) > 1 and (moved := deflection.moved_by_repair) is not None:
        quality = deflection.plan.affected.quality(deflection.points - moved)
    return {
        "spoiled": sum(repair.spoiled for repair in repairs),
        "left": sum(repair.left for repair in repairs),
        "moved": sum(len(repair.moved) for repair in repairs),
        "search_steps": sum(repair.steps for repair in repairs),
        "seconds": sum(repair.seconds for repair in repairs),
        "quality": by_shape(quality),
        "inverted_before": sum(shape.inverted for shape in quality),
    }


def repair_text(figures: Json) -> str:
    """Return a text on the repair in a deflection's figures; empty without one."""
    repair = figures["repair"]
    if not repair:
        return ""
    after = figures["quality_inside"]["after"].values()
    inverted = repair["inverted_before"], sum(quality["inverted"] for quality in after)
    counts = [("to mend", repair["spoiled"], repair["left"]), *([("inverted", *inverted)] if any(inverted) else ())]
    told = [f"{before} cell{'s' * (before != 1)} {word}, {after or 'none'} left" for word, before, after in counts]
    return f"{'; '.join(told)}; {repair['moved']:,} nodes moved"


def by_shape(qualities: Sequence[Quality]) -> Json:
    """Return the quality of each type of cell by the type's name."""
    return {quality.shape: asdict(quality) for quality in qualities}


def verdict_figures(checks: Sequence[Check]) -> Json:
    """Return the checks, whether all hold, and the verdict in words."""
    passed = all(check.passed for check in checks)
    return {"checks": [check.as_dict() for check in checks], "passed": passed, "verdict": verdict(checks)}


def warnings_of(plan: Plan) -> tuple[str, ...]:
    """Return sentences on probable mistakes, although every check may hold."""
    notes = [note for note in (*plan.mesh.notes, *plan.reflections) if isinstance(note, Warned)]
    texts = (text for box in plan.boxes for text in box.warnings)
    return tuple(dict.fromkeys([*notes, *texts]))


def _figures(reached: ReachedShare) -> Json:
    return {name: value for name, value in asdict(reached).items() if name != "but"}


def short_turns(plan: Plan, pose: Amounts) -> tuple[str, ...]:
    """Return a sentence for each surface whose mean turn at a pose is below 90 % of its angle.

    It names --strip if that is why.

    This is no warning: a blended surface always turns less at its ends.
    """
    sentences = []
    motion = {surface.label: moving.motion for moving, surface in plan.moving}
    for name, reached in _reaches(plan, pose):
        if reached and reached.mean < REACHED:
            turns, its = ("turn", "their") if "," in name else ("turns", "its")
            why = " (--strip)" * (bool(strip_of(motion[name], plan.mesh.plane)))
            sentences.append(f"{name} {turns} by {percent(reached.mean)} of {its} angle on average{why}")
    return tuple(sentences)


def notes_of(plan: Plan) -> tuple[str, ...]:
    """Return sentences on what a user may not expect of a mesh."""
    notes = [note for note in (*plan.mesh.notes, *plan.reflections) if not isinstance(note, Warned)]
    if coincident := sum(box.sites.coincident for box in plan.boxes):
        notes.append(f"{coincident} moving nodes coincide with others; they move as one")
    if min(plan.affected.orientation, default=1.0) < 0.0:
        notes.append("the file counts the nodes of cells left-handed; judged accordingly")
    inverted = sum(plan.affected.inverted)
    if inverted:
        notes.append(f"{inverted} cells were inverted in the file already")
    return tuple(notes)


def farthest(plan: Plan, pose: Amounts) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Yield each surface's name, and place and displacement (3,) of its node that moves farthest at a pose."""
    for box, amounts in plan.by_box(pose):
        for surface, place, move in box.boundary.farthest(amounts):
            yield surface.label, place, move


def motion_figures(plan: Plan, pose: Amounts) -> Json:
    """Return the share of its angle that each surface reaches (`ReachedShare`); null for a motion without an angle."""
    return {name: reached and _figures(reached) for name, reached in _reaches(plan, pose)}


def _hinge(moving: Moving, law: MotionLaw, amount: float) -> list[list[float]] | None:
    """Return the two points of a hinge after the motion; None without a hinge."""
    axis = moving.motion.axis
    if axis is None:
        return None
    ends = np.array([axis.point, axis.point + (axis.length or 1.0) * axis.direction])
    carried = law.functions.positions(ends, amount) if moving.motion.unit == TRACK_UNIT else ends
    first, second = carried.tolist()
    return [first, second]


def surface_figures(plan: Plan, pose: Amounts) -> Json:
    """Return each surface's amount at a pose, its reached share, and two points of its hinge.

    The hinge of a track is given at its moved place.
    """
    out = {}
    for box, amounts in plan.by_box(pose):
        rows = zip(box.moving, box.boundary.laws, amounts, box.boundary.reaches(amounts), strict=True)
        for (moving, _), law, amount, (surface, reached) in rows:
            hinge = _hinge(moving, law, amount)
            share = {"full": reached.full, "mean": reached.mean} if reached else {"full": None, "mean": None}
            row = _track_row(moving, law, amount) if moving.motion.unit == TRACK_UNIT else {}
            out[surface.label] = {"amount": amount, "unit": moving.motion.unit, **share, "hinge": hinge, **row}
    return out


def _track_row(moving: Moving, law: MotionLaw, amount: float) -> Json:
    """Return, for the setting of a slot, the row of a track: parameter, angle and the shift dx, dy."""
    from sdm_deflect.deform.surface.slots import SlotSetting  # loads SciPy's splines in 0.1 s
    from sdm_deflect.deform.surface.tracks import TrackLaw

    if not isinstance(moving.motion, SlotSetting) or not isinstance(law, TrackLaw):
        return {}
    return {"track": [float(value) for value in amount * law.track.rows[-1, :4]]}


def signed(amount: float, unit: str) -> str:
    """Return an amount with its sign and unit, as pages show it: ``+15°``, ``−0.5 of the table``."""
    number = f"{amount:+g}".replace("-", "\N{MINUS SIGN}")
    return f"{number}\N{DEGREE SIGN}" if unit == "deg" else f"{number} {unit}"


def amounts(plan: Plan, pose: Amounts) -> Iterator[tuple[str, str]]:
    """Yield the name of each surface with its amount and, where it has one, its hinge, as text."""
    for name, figures in surface_figures(plan, pose).items():
        ends = [", ".join(f"{x:.6g}" for x in point) for point in figures["hinge"] or ()]
        yield name, f"{figures['amount']:+g} {figures['unit']}" + (f" about ({ends[0]}) to ({ends[1]})" if ends else "")


def cuts(plan: Plan, pose: Amounts) -> Iterator[tuple[str, str]]:
    """Yield the name of each surface with a selection in it and, as text, what was cut and how many nodes move."""
    chosen = [selection.name for selection in plan.job.selections]
    for box, amounts in plan.by_box(pose) if chosen else ():
        move = box.boundary.displacement(amounts)
        for surface in box.boundary.surfaces:
            if any(name.partition(REGION)[0] in chosen for name in surface.patches):
                low, high = (point_text(end) for end in (surface.points.min(axis=0), surface.points.max(axis=0)))
                moving = np.count_nonzero(move[np.searchsorted(box.boundary.nodes, surface.nodes)].any(axis=1))
                yield surface.label, f"cut out from {low} to {high}; {moving} of its {len(surface.nodes)} nodes move"


def farthest_figures(plan: Plan, pose: Amounts) -> Json:
    """Return, by surface, place and displacement of the node that moves farthest at a pose."""
    return {name: {"at": at.tolist(), "move": move.tolist()} for name, at, move in farthest(plan, pose)}


def motions(plan: Plan, pose: Amounts, whole: bool = True) -> Iterator[tuple[str, str]]:
    """Yield the name of each turning surface and, as text, the share of its angle that it reaches at a pose.

    With `whole` the text has the distance from a rigid turn, too, and surfaces count that turn by all of it.
    """
    for name, reached in _reaches(plan, pose):
        if reached and (whole or reached.full < 1.0):
            yield name, reached.text if whole else reached.turn


def _reaches(plan: Plan, pose: Amounts) -> Iterator[tuple[str, ReachedShare | None]]:
    """Yield the name of each surface, and its reached share at a pose."""
    for box, amounts in plan.by_box(pose):
        for surface, reached in box.boundary.reaches(amounts):
            yield surface.label, reached


def travels(plan: Plan, pose: Amounts) -> Iterator[tuple[str, str]]:
    """Yield each surface's name, and length, direction and place of its largest displacement at a pose, as text."""
    for name, place, move in farthest(plan, pose):
        size = float(np.linalg.norm(move))
        at = ", ".join(f"{x:.4g}" for x in place)
        yield name, f"{size:.4g} towards {way_of(move, plan.mesh.plane)}, at ({at})" if size else "0"


def way_of(move: FloatArray, plane: bool) -> str:
    """Return the axis along which a displacement (3,) is largest, with its sign; in a plane mesh also up or down."""
    axis = first_largest(np.abs(move))
    up_or_down = (" (down)" if move[1] < 0.0 else " (up)") if plane and axis == 1 else ""
    return f"{'-' if move[axis] < 0.0 else '+'}{'xyz'[axis]}{up_or_down}"


def peak_rss_bytes() -> int:
    """Largest resident memory of this process or of any subprocess that has ended; 0 where the system does not say."""
    try:
        import resource
    except ModuleNotFoundError:
        return 0
    used = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return used if sys.platform == "darwin" else 1024 * used


def _adaptation(deflection: BoxDeflection) -> Json:
    """Return, by direction, the centres, error and condition of the step with most centres, and all steps' seconds."""
    table: Json = {}
    groups = list(zip(*(step.fits.adaptations for step in deflection.steps), strict=True))
    for fits, condition in zip(groups, deflection.conditions or [None] * len(groups), strict=True):
        entry = {
            "centers": max(len(fit.chosen) for fit in fits),
            "iterations": sum(fit.history[-1].iteration for fit in fits),
            "max_error": max(fit.max_error for fit in fits),
            "seconds": sum(fit.history[-1].seconds for fit in fits),
            "stop": fits[-1].stop.value,
            "condition": condition,
        }
        table.update({DIRECTIONS[c]: entry for c in fits[0].components})
    return table

"""Checks that can fail: what must hold of a deflected mesh."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import BoolArray, FloatArray, IntArray, distinct, union
from sdm_deflect.base.errors import short_list
from sdm_deflect.base.ties import first_largest
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.surface import OnPatches
from sdm_deflect.deform.volume.deflection import BoxDeflection, Deflection, fell_poor, poor_below
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.deform.volume.submesh import boundary_in_file
from sdm_deflect.meshing.mesh import polyhedra
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.crossing import IntersectingFaces
from sdm_deflect.meshing.mesh.edges import edges_of, polygons_of
from sdm_deflect.meshing.mesh.faces import faces_of, on_boundary
from sdm_deflect.meshing.mesh.images import plane_of
from sdm_deflect.meshing.mesh.layers import LayerChange
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.precision import EVERY_BIT
from sdm_deflect.meshing.mesh.quality import PLURALS, inverted_of
from sdm_deflect.meshing.mesh.standard import type_of

# Largest change of a coordinate by rounding, as a share of an edge's length.
ROUNDED = 0.01
# Largest distance of sliding nodes from their shape, as a share of the moving surface's size.
ON_SHAPE = 1e-9
# Largest distance of nodes from their images, as a share of the pair's size: rounding.
ON_IMAGE = 1e-14
# Allowed ratio of such a distance to that before, in files with fewer digits.
WORSE = 4.0
# Nodes nearer than this share of the box's size are at the same place.
SAME_PLACE = 1e-9

# Largest relative change of a layer's height about which nothing is said: half of a usual growth from layer to layer.
LAYER_CHANGE = 0.1
# Largest one of a mesh that can be used: heights of a family of meshes differ by a factor of 1.5 from level to level
# (gridding guidelines of the fourth AIAA drag prediction workshop, 2008).
MOST_CHANGE = 0.5
# Largest growth of the first layer: y+ grows with it, while a thinner one lowers it. A share of the columns, at least
# one, may grow by up to `MOST_CHANGE`, such as those at a corner.
GROWTH, FEW = 0.1, 0.005
# Degrees between a cell's axis and where its wall would have carried it, up to which the column stands: cos 60 = .5.
MOST_TILT = 60.0

# Why layers change their heights, by a key that tells what helps.
CAUSES = {
    "rounding": "the file has too few digits",
    "repair": "the repair moved them",
    "following": "no node follows the wall",
    "shear": "the motion shears the wall",
    "gap": "another wall is near, or the wall ends",
}

Judgement = Literal["at most", "at least", "information"]
Grade = Literal["passed", "usable", "FAILED"]
Verdict = Grade | Literal["information", "not applicable"]


@dataclass(frozen=True, slots=True)
class Check:
    """A measured value beside its limit.

    Attributes
    ----------
    name : fixed name; with several boxes the surface is appended.
    value, limit : measured value and limit, in `unit`.
    unit : unit of both; empty for shares, and for lengths in the mesh's own unit.
    where : what was measured, on how many nodes, and where the worst one is.
    judgement : the check passes if value <= limit (``"at most"``) or value >= limit (``"at least"``);
            ``"information"`` has an expected value, but no limit.
    over : number of nodes or cells measured; with none the check is not applicable.
    nodes, distances : (K,) nodes and the value at each, if a map of them is worth drawing.
    figures : measured value of each part, by name.
    reservation : what is not good although the check passes, such as "36 of 30,926 tetrahedra poor"; else empty.
    cause : why it is so, a key of `CAUSES`; empty if unknown.
    window : least and largest coordinates around the worst place, before and after, if it is worth a picture.
    """

    name: str
    value: float
    limit: float
    unit: str
    where: str
    judgement: Judgement = "at most"
    over: int = 1
    nodes: IntArray | None = field(default=None, compare=False, repr=False)
    distances: FloatArray | None = field(default=None, compare=False, repr=False)
    figures: dict[str, dict[str, float]] = field(default_factory=dict, compare=False, repr=False)
    reservation: str = ""
    cause: str = ""
    window: tuple[tuple[float, ...], tuple[float, ...]] | None = field(default=None, compare=False, repr=False)

    @property
    def is_judged(self) -> bool:
        """True if the check has a limit, and something was measured."""
        return bool(self.over) and self.judgement != "information"

    @property
    def passed(self) -> bool:
        """True if the value keeps its limit or nothing was measured; nan never passes."""
        if not self.is_judged:
            return True
        return self.value <= self.limit if self.judgement == "at most" else self.value >= self.limit

    @property
    def verdict(self) -> Verdict:
        """The result in a word or two."""
        if not self.is_judged:
            return "information" if self.over else "not applicable"
        return "FAILED" if not self.passed else "usable" if self.reservation else "passed"

    def as_dict(self) -> dict[str, Any]:
        """Return the check for JSON; values that are not finite are null."""
        value = self.value if self.over and np.isfinite(self.value) else None
        return {
            "name": self.name,
            "value": value,
            "limit": self.limit,
            "passed": self.passed,
            "verdict": self.verdict,
            "judgement": self.judgement,
            "over": self.over,
            "unit": self.unit,
            "where": self.where,
            **{name: value for name in ("reservation", "cause", "window", "figures") if (value := getattr(self, name))},
        }


def reservations(checks: Iterable[Check]) -> tuple[str, ...]:
    """Return what is not good of a mesh although its checks pass, each once."""
    return tuple(dict.fromkeys(check.reservation for check in checks if check.is_judged and check.reservation))


def grade(checks: Sequence[Check]) -> Grade:
    """Return the verdict on all checks in a word: a usable mesh is not as good as one should be."""
    if not all(check.passed for check in checks):
        return "FAILED"
    return "usable" if reservations(checks) else "passed"


def verdict(checks: Sequence[Check], mesh: str = "this mesh") -> str:
    """Return the verdict on all checks of a mesh as a text."""
    judged = [check for check in checks if check.is_judged]
    failed, faults = [check.name for check in judged if not check.passed], ""
    if failed:
        faults = f"{len(failed)} of {len(judged)} checks: {', '.join(dict.fromkeys(failed))}"
    return in_words(faults, reservations(judged), mesh)


def in_words(faults: str, told: Sequence[str], mesh: str = "this mesh") -> str:
    """Return a verdict as a text: what failed, or else what is not good, or else that all passed."""
    if faults:
        return f"FAILED: do not use {mesh}; {faults}"
    return f"usable, with {' and '.join(told)}" if told else "all validations passed"


def tally(checks: Sequence[Check]) -> str:
    """Return how many of the checks that judge the mesh are passed: ``17 of 18``."""
    judged = [check for check in checks if check.is_judged]
    return f"{sum(check.passed for check in judged)} of {len(judged)}"


def worst(distances: FloatArray, points: FloatArray) -> str:
    """Describe the largest of distances (N,) at points (N, 3), with rms and count."""
    if not distances.any():
        return f"{len(distances)} nodes"
    x, y, z = points[int(np.argmax(distances))]
    rms = float(np.sqrt(np.mean(distances**2)))
    return f"{len(distances)} nodes, rms {rms:.1e}, worst at ({x:.4f}, {y:.4f}, {z:.4f})"


def layer_change(box: BoxPlan, points: FloatArray) -> LayerChange:
    """Return how the first layers changed over the walls that are joined with a moving surface of a box."""
    return LayerChange.of(box.layers, box.mesh.points, points, box.moved_walls, box.mesh.normal)


def checks_of(deflection: Deflection, unit: str = "") -> tuple[Check, ...]:
    """Check the mesh at one angle as the file will hold it; a check that fails by rounding alone says so.

    `unit` is the unit of lengths, if it is known.
    """
    checks = tuple(_checks(deflection, unit))
    precision = deflection.plan.precision
    if precision.is_double or all(check.passed for check in checks):
        return checks
    failing = {check.name for check in _checks(deflection.rounded(EVERY_BIT), unit) if not check.passed}
    why = f"; fails by rounding to {precision}"
    return tuple(
        check if check.passed or check.name in failing else replace(check, where=check.where + why) for check in checks
    )


def site_error(deflection: BoxDeflection, unit: str = "") -> Check:
    """Check that the error at every data site of a box is within the tolerance."""
    error, steps = deflection.site_error, len(deflection.steps)
    where = f"all data sites, {steps} step{'s' if steps > 1 else ''}"
    return Check("site_error", error, deflection.plan.sites.tolerance, unit, where)


def _checks(deflection: Deflection, unit: str) -> Iterator[Check]:
    plan, points = deflection.plan, deflection.points
    mesh = plan.mesh
    moved = np.abs(points - plan.undeflected_points).max(axis=1)
    outside = np.ones(len(points), dtype=bool)
    outside[plan.movable] = False
    rest = mesh.point_count - len(points)
    beyond = f", of all {rest + int(outside.sum())}: the others are copied" if rest else ""
    yield _check_still("outside_moved", moved[outside], f"nodes outside the box{beyond}", unit)
    slid = slid_nodes(deflection)
    fixed = np.setdiff1d(plan.fixed, slid, assume_unique=True)
    yield _check_still("fixed_surfaces_moved", moved[fixed], "nodes inside the box", unit)
    if len(slid):
        yield _slid_on_surfaces(deflection, slid, unit)
    yield left_behind(deflection, unit)
    yield from _parted(deflection)
    for box in filter(attrgetter("steps"), deflection.boxes):
        yield from with_surface([site_error(box, unit)], box.plan, plan)
    if mesh.cells:
        yield _inverted_cells(deflection)
        yield from _boundary_checks(deflection)
    yield surfaces_crossed(mesh, points)
    if plan.precision.every and not plan.precision.is_double:
        yield _rounding(deflection)
    if mesh.cells and plan.job.repair.min_quality:
        yield from _quality_checks(deflection)
    if plan.faces and deflection.faces:
        yield from (Check(*row) for row in plan.faces.verdicts(deflection.faces))
    yield from _sliding(deflection, unit)
    yield from _pairs(deflection)
    if mesh.cells:
        yield _layer_height(deflection)


def _parted(deflection: Deflection) -> Iterator[Check]:
    """Check that boundary nodes at one place are still together, if there are any.

    Pairs of a moving and a fixed node are left out: the job parts them.
    """
    points, parted, over, where = deflection.points, 0, 0, ""
    for box in deflection.plan.boxes:
        moving = np.isin(box.twins, box.boundary.both(box.sites.moving))
        fixed = np.isin(box.twins, box.boundary.both(box.sites.fixed))
        pairs = box.twins[~(moving | fixed).all(axis=1) | (moving.all(axis=1) | fixed.all(axis=1))]
        gaps = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        far = gaps > SAME_PLACE * float(np.ptp(box.region.hexahedron.corners, axis=0).max())
        over += len(pairs)
        parted += int(np.count_nonzero(far))
        if far.any():
            row = int(np.argmax(gaps))
            names = short_list(p.name for p in deflection.plan.mesh.patches if np.isin(pairs[row], p.nodes).any())
            where = f"; the farthest, on {names}, is now {gaps[row]:.4g} apart"
    if over:
        yield Check(
            "nodes_parted", parted, 0, "pairs", f"of {over} pairs of boundary nodes at one place{where}", over=over
        )


def left_behind(deflection: Deflection, unit: str = "") -> Check:
    """Check that no other zone or patch has a copy of the moving surface that stays behind."""
    mesh, moved = deflection.plan.mesh, np.linalg.norm(deflection.points - deflection.plan.undeflected_points, axis=1)
    behind: dict[str, int] = {}
    largest, stay, over = 0.0, 0, 0
    for box in deflection.plan.boxes:
        near = SAME_PLACE * float(np.ptp(box.region.hexahedron.corners, axis=0).max())
        goes = box.movable[moved[box.movable] > near]
        over += len(goes)
        for holder, places, on_skin in _staying(box, moved == 0.0, near):
            stay += len(places)
            low, high = places.min(axis=0, initial=np.inf) - near, places.max(axis=0, initial=-np.inf) + near
            some = goes[np.all((mesh.points[goes] >= low) & (mesh.points[goes] <= high), axis=1)]
            if len(some):
                gaps, rows = cKDTree(places).query(mesh.points[some], distance_upper_bound=near)
                hit = np.isfinite(gaps)
                if hit.any():
                    hit[hit] = np.isin(rows[hit], on_skin(distinct(rows[hit])))
                behind[holder] = behind.get(holder, 0) + len(distinct(rows[hit]))
                largest = max(largest, float(moved[some[hit]].max(initial=0.0)))
    where = f"{over} nodes that moved, beside {stay} in the box that stay, without patches in fixed and held"
    if count := sum(behind.values()):
        names = short_list(f"{number} of {holder}" for holder, number in behind.items() if number)
        where = (
            f"{names}; moving nodes that were there are now up to {largest:.4g} {unit}".rstrip()
            + " away: let the zone deform (--zone) and its patch move (--surface), or name the patch in fixed"
        )
    return Check("left_behind", float(count), 0.0, "nodes", where, over=over)


def _staying(
    box: BoxPlan, still: BoolArray, near: float
) -> Iterator[tuple[str, FloatArray, Callable[[IntArray], IntArray]]]:
    """Yield the patches and zones of the file, with their nodes (K, 3) in the box that are `still` (N,).

    With each comes a function of some rows (R,) of these nodes. It returns those on the boundary: a node inside the
    flow of another zone, such as an overset one, is no copy.
    """
    mesh, job, region = box.mesh, box.job, box.region
    held = [surface.motion.held for surface in job.surfaces if isinstance(surface.motion, Blended)]
    names = [name for nodes in held if isinstance(nodes, OnPatches) for name in mesh.expand(nodes.names, "held")]
    may = still.copy()
    may[union(mesh.on(*box.boundary.fixed, *names), *(pair.nodes.ravel() for pair in mesh.periodic))] = False
    rows = np.flatnonzero(may)
    rows = rows[region.hexahedron.contains(box.affected.places[rows], near)]
    for patch in mesh.patches:
        staying = np.intersect1d(patch.nodes, rows, assume_unique=True)
        rows = np.setdiff1d(rows, staying, assume_unique=True)
        yield f"patch {patch.name}", mesh.points[staying], np.asarray
    for zone in mesh.zones:
        staying = rows[(rows >= zone.start) & (rows < zone.stop)]

        def on_skin(some: IntArray, staying: IntArray = staying) -> IntArray:
            skin = on_boundary(mesh.cells, len(mesh.points), staying[some])
            return some[np.isin(staying[some], skin)]

        yield f"zone {zone.name!r}", mesh.points[staying], on_skin
    if (whole := mesh.whole) and len(region.zones) < len(mesh.zones):
        pieces, known = whole.pieces, whole.nodes
        for start in range(0, pieces.points, threads.LIMITS.points):
            stop = min(start + threads.LIMITS.points, pieces.points)
            rest = np.setdiff1d(np.arange(start, stop), known, assume_unique=True)
            places = pieces.coordinates(start, stop)[rest - start]
            rest = rest[inside := region.hexahedron.contains(places, near)]

            def in_file(some: IntArray, rest: IntArray = rest) -> IntArray:
                return some[np.isin(rest[some], boundary_in_file(pieces, rest[some]))]

            yield "zones that do not deform", places[inside], in_file


def _sliding(deflection: Deflection, unit: str) -> Iterator[Check]:
    for box in deflection.boxes:
        checks, thin = [], box.plan.boundary.thin
        for name, nodes, shape, _ in (part for modifier in box.plan.modifiers for part in modifier.shapes()):
            if not isinstance(shape, str):  # the mesh before says which plane face
                states = (at[nodes] for at in (box.plan.mesh.points, box.points))
                before, now = map(shape.distance, map(thin.halfway.places, states) if thin else states)
                drift, where = float(np.abs(now - before).max(initial=0.0)), f"{len(nodes)} sliding nodes"
                checks.append(Check(f"on_{name}", drift, _on_shape(box), unit, where, over=len(nodes)))
        yield from with_surface(checks, box.plan, deflection.plan)


def _layer_height(deflection: Deflection) -> Check:
    """Grade the first layers: as they were, changed and usable, or not.

    The check has the value and the limit of what is worst: the growth of the first layer, the tilt, or any change.
    """
    changes = [layer_change(box.plan, deflection.points) for box in deflection.boxes]
    heights, tilts, growth = (
        np.concatenate([getattr(change, name) for change in changes]) for name in ("changes", "tilts", "growth")
    )
    if not (over := len(heights)):
        where = "no layers of prisms or hexahedra on the moved walls; layers of tetrahedra are not measured"
        return Check("layer_height", 0.0, MOST_CHANGE, "", where, over=0)
    measured = {"change": heights, "tilt_deg": tilts, "first_layer_growth": growth}
    figures = {
        name: {"max": float(values.max()), "p99": float(np.percentile(values, 99.0))}
        for name, values in measured.items()
    }
    where = f"{over} columns of {max(change.layers for change in changes)} layers; cells tilt by up to "
    where += "{max:.2g} degrees, 99 % by up to {p99:.2g}".format(**figures["tilt_deg"])
    name, value, limit, unit = "changes", float(heights.max()), MOST_CHANGE, ""
    told = f"layers changed by up to {value:.2g} in {np.count_nonzero(heights > LAYER_CHANGE)} of {over} columns"
    thicker = int(np.count_nonzero(growth > GROWTH))
    if thicker > max(1.0, FEW * over):
        name, value, limit = "growth", float(growth.max()), GROWTH
        told = f"the first layer, and y+ with it, grew by up to {value:.2g} in {thicker} of {over} columns"
    elif value <= MOST_CHANGE and tilts.max() > MOST_TILT:
        name, value, limit, unit = "tilts", float(tilts.max()), MOST_TILT, "degrees"
        told = f"{np.count_nonzero(tilts > MOST_TILT)} of {over} columns lie down, by up to {value:.2g} degrees"
    elif value <= LAYER_CHANGE:
        return Check("layer_height", value, limit, unit, where, over=over, figures=figures)
    worst = first_largest(np.array([getattr(change, name).max(initial=0.0) for change in changes]))
    box, row = deflection.boxes[worst], first_largest(getattr(changes[worst], name))
    nodes = box.plan.layers.nodes_of(int(changes[worst].faces[row]))
    cause = _cause(box, name, row, nodes)
    because = f"{CAUSES[cause]}; {box.plan.crowding}" if cause == "gap" and box.plan.crowding else CAUSES[cause]
    told += " at ({:.4g}, {:.4g}, {:.4g})".format(*box.plan.mesh.points[nodes].mean(axis=0))
    return Check(
        "layer_height", value, limit, unit, f"{told}, where {because}; {where}", over=over, figures=figures,
        reservation=told if value <= limit else "", cause=cause,
        window=_window(box.plan.mesh.points[nodes], deflection.points[nodes]),
    )  # fmt: skip


def _window(before: FloatArray, after: FloatArray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the least and largest coordinates around a face (k, 3) before and after, its own size beyond it."""
    both, size = np.vstack([before, after]), np.ptp(before, axis=0).max()
    return tuple((both.min(axis=0) - size).tolist()), tuple((both.max(axis=0) + size).tolist())


def _cause(box: BoxDeflection, name: str, row: int, nodes: IntArray) -> str:
    """Return why the column in a row of `LayerChange` over a face's nodes changed: a key of `CAUSES`.

    `name` is the measure that is too large: ``"changes"``, ``"growth"`` or ``"tilts"``.
    """
    plan, limit = box.plan, {"changes": LAYER_CHANGE, "growth": GROWTH, "tilts": MOST_TILT}[name]
    if getattr(layer_change(plan, box.exact), name)[row] <= limit:
        return "rounding"
    if box.repaired and getattr(layer_change(plan, box.interpolated), name)[row] <= limit:
        return "repair"
    if not plan.job.near_wall:
        return "following"
    sheared = plan.boundary.both(plan.sites.moving[plan.sites.sheared])
    return "shear" if np.isin(nodes, sheared).any() else "gap"


def _pairs(deflection: Deflection) -> Iterator[Check]:
    """Check that periodic nodes in the box still match their images, and that thin cases stay in their planes."""
    mesh, points = deflection.plan.mesh, deflection.points
    may_move = np.zeros(len(points), dtype=np.bool_)
    may_move[deflection.plan.movable] = True
    for pair in mesh.periodic:
        nodes = pair.nodes[may_move[pair.nodes].any(axis=1)]
        size = float(np.abs(mesh.points[nodes]).max(initial=0.0))
        off = [np.linalg.norm(pair.image(at[nodes[:, 0]]) - at[nodes[:, 1]], axis=1) for at in (mesh.points, points)]
        name, where = "periodic", f"{len(nodes)} pairs of nodes"
        if pair.thin:
            name, where = "plane", f"{where} on both sides of one cell, and from their side"
            plane = plane_of(mesh, pair.nodes[:, 0])
            moved = (points - mesh.points)[nodes[:, 0]]
            off[1] = np.maximum(off[1], np.abs(moved @ plane.normal) if plane else 0.0)
        before, now = (float(distances.max(initial=0.0)) / (size or 1.0) for distances in off)
        finest = 2.0 * deflection.plan.precision.resolution(mesh.points[nodes]) / (size or 1.0)
        limit = max(ON_IMAGE, WORSE * before, finest)
        if len(pair.nodes):
            where += f", {before:.1e} of their largest coordinate before"
            yield Check(f"{name}_{pair.name}", now, limit, "", where, over=len(nodes))


def _inverted_cells(deflection: Deflection) -> Check:
    affected = deflection.plan.affected
    before = sum(quality.inverted for quality in deflection.plan.before)
    where = f"of {affected.count} cells with a node in the box"
    where += f", without {before} that were inverted before" if before else ""
    if deflection.inverted:
        where += f"; {first_inverted(deflection)}"
    return Check("inverted_cells", deflection.inverted, 0, "cells", where, over=affected.count)


def surfaces_crossed(mesh: Mesh, points: FloatArray) -> Check:
    """Check that no face newly intersects another one, with the nodes at points (N, 3)."""
    crossings = IntersectingFaces.of(mesh, points)
    where = f"of {crossings.moved} faces that moved, beside {crossings.near - crossings.moved} near them"
    where += f"; {crossings.where}" if crossings.faces else ""
    return Check("surfaces_crossed", crossings.faces, 0, "faces", where, over=crossings.moved)


def slid_nodes(deflection: Deflection) -> IntArray:
    """Return the sorted nodes (K,) of fixed patches that the repair slid on their shapes."""
    slid = (np.intersect1d(repair.moved, repair.freedom.sliding, assume_unique=True) for repair in deflection.repairs)
    return np.intersect1d(deflection.plan.fixed, union(*slid), assume_unique=True)


def _slid_on_surfaces(deflection: Deflection, slid: IntArray, unit: str) -> Check:
    """Check that nodes (K,) of fixed patches which a repair slid are still on the undeflected patch."""
    points, off = deflection.points, np.zeros(len(slid))
    for box in deflection.boxes:
        for slide in box.repaired.freedom.slides if box.repaired else ():
            rows = np.flatnonzero(np.isin(slid, slide.nodes, assume_unique=True))
            before, now = (slide.shape.distance(where[slid[rows]]) for where in (box.interpolated, points))
            off[rows] = np.abs(now - before)
    where = f"{worst(off, points[slid])}, of fixed patches"
    return Check("slid_on_surfaces", float(off.max()), max(map(_on_shape, deflection.boxes)), unit, where)


def _on_shape(deflection: BoxDeflection) -> float:
    """Return the allowed distance of sliding nodes from their shape: at least the file's precision."""
    plan = deflection.plan
    return max(ON_SHAPE * plan.boundary.size, plan.precision.resolution(plan.mesh.points))


def with_surface(checks: Iterable[Check], box: BoxPlan, plan: Plan) -> list[Check]:
    """Append the surface to the names of a box's checks, if there are several boxes."""
    return [replace(check, name=f"{check.name}:{box.surface}") if len(plan.boxes) > 1 else check for check in checks]


def first_inverted(deflection: Deflection) -> str:
    """Describe the first newly inverted cell: number, patches, and whether the repair could move it."""
    plan, mesh, row = deflection.plan, deflection.plan.mesh, 0
    numbers = whole.rows if (whole := mesh.whole) else tuple(np.arange(len(block)) for block in mesh.cells)
    for i, (block, rows, sign) in enumerate(
        zip(mesh.cells, plan.affected.rows, plan.affected.orientation, strict=True)
    ):
        bad = inverted_of(deflection.points, block, rows, sign) & ~inverted_of(mesh.points, block, rows, sign)
        if bad.any():
            cell = int(rows[np.argmax(bad)])
            number = row + int(numbers[i][cell])
            nodes = polyhedra.nodes_of(block, cell) if isinstance(block, Polyhedra) else block.nodes[cell]
            return cell_text(deflection, number, nodes, type_of(block, cell))
        row += mesh.cell_counts[i]
    raise ValueError("no cell is inverted that was not before")


def cell_text(deflection: Deflection, row: int, nodes: IntArray, shape: str) -> str:
    """Describe an inverted cell: row in the mesh, type, and patches of its nodes."""
    plan, repairs = deflection.plan, deflection.repairs
    on = [patch.name for patch in plan.mesh.patches if np.isin(nodes, patch.nodes).any()]
    text = f"the first is cell {row} ({shape})" + (f" with nodes on {short_list(on)}" if on else "")
    if not repairs:
        return text
    stay = not any(np.isin(nodes, repair.freedom.nodes).any() for repair in repairs)
    return f"{text}; all its nodes stay: no repair can mend it" if stay else f"{text}; the repair could not mend it"


def _rounding(deflection: Deflection) -> Check:
    plan, largest, count = deflection.plan, 0.0, 0
    for block in plan.mesh.cells:
        faces = [block.faces] if isinstance(block, Polyhedra) else faces_of(block, np.arange(len(block)))
        for start, end in (edges_of(polygons_of([face]))[0].T for face in faces):
            edges = plan.mesh.points[end] - plan.mesh.points[start]
            change = np.linalg.norm(plan.undeflected_points[end] - plan.undeflected_points[start] - edges, axis=1)
            lengths = np.linalg.norm(edges, axis=1)
            largest = max(largest, float((change[lengths > 0.0] / lengths[lengths > 0.0]).max(initial=0.0)))
            count += len(start)
    where = f"change of an edge, of its length, of {count} edges of all cells of the undeflected mesh"
    return Check("rounding", largest, ROUNDED, "", where, over=count)


def _boundary_checks(deflection: Deflection) -> Iterator[Check]:
    """Check that patches cover the boundary where nodes may move, and have no other faces."""
    gaps = [box.uncovered for box in deflection.plan.boxes]
    faces, loose, inner = (sum(getattr(gap, name) for gap in gaps) for name in ("faces", "loose", "inner"))
    if faces:
        where = f"on no patch, of {faces} faces of the boundary in the box that are on none"
        yield Check("boundary_on_no_patch", sum(len(gap.nodes) for gap in gaps), 0, "nodes", where)
    if loose or inner:
        where = f"{loose} faces of patches in the box are of no cell, {inner} of moving ones between two"
        yield Check("faces_off_boundary", loose + inner, 0, "faces", where)


def _quality_checks(deflection: Deflection) -> Iterator[Check]:
    """Check that the affected cells of each type keep a share of their least quality before.

    Cells that were inverted or of quality 0 before are left out.
    """
    for of, (old, new) in zip(deflection.quality, deflection.least, strict=True):
        where = f"{of.measure} of {new.cells:,} {PLURALS[of.shape]}, {old.quality:.3f} before"
        if new.cells < of.cells:
            where += f", without {of.cells - new.cells} that were inverted or flat before"
        limit, poor = deflection.plan.job.repair.min_quality * old.quality if old.cells else 0.0, ""
        if fell_poor(old, new):
            below = poor_below(old.quality)
            count = deflection.plan.affected.count_below(deflection.points, of.shape, below)
            poor = f"{count} of {new.cells:,} {PLURALS[of.shape]} poor"
            where += f"; {count} below {below:.3g}"
        yield Check(
            f"quality_min:{of.shape}", new.quality, limit, "", where, "at least", over=new.cells, reservation=poor
        )


def _check_still(name: str, moved: FloatArray, what: str, unit: str) -> Check:
    return Check(name, float(moved.max(initial=0.0)), 0.0, unit, f"{len(moved)} {what}", over=len(moved))

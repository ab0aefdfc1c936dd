"""The folder of a run: settings, figures, arrays, pictures and the page."""

import json
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from os.path import normpath, relpath
from pathlib import Path
from tomllib import loads
from typing import Any

import numpy as np
import tomli_w

from sdm_deflect.base import threads
from sdm_deflect.base.arrays import FloatArray, IntArray, union
from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.cases.run.mesh_files import SETTINGS
from sdm_deflect.cases.run.metrics import (
    Json,
    amounts,
    deflection_figures,
    figures_by_box,
    mesh_figures,
    motions,
    notes_of,
    peak_rss_bytes,
    short_turns,
    travels,
    verdict_figures,
    warnings_of,
)
from sdm_deflect.cases.run.output import lacks, write_convergence, write_interpolants
from sdm_deflect.cases.settings.conversion import table_of
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.options import JobOptions
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Motion, Moving, Rotation
from sdm_deflect.deform.surface.shapes import Shapes
from sdm_deflect.deform.surface.slots import SlotSetting
from sdm_deflect.deform.surface.surface import Listed, NodeSet, OnPatches, Surface, TrailingEdge, name_of
from sdm_deflect.deform.surface.tables import Table
from sdm_deflect.deform.surface.tail_root import Root
from sdm_deflect.deform.surface.tracks import CPACS, Track
from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.job import Amounts, Sliding
from sdm_deflect.deform.volume.plan import BoxPlan, Plan
from sdm_deflect.meshing.formats.registry import ending
from sdm_deflect.meshing.formats.vtu import write_vtu
from sdm_deflect.meshing.mesh.axis import Axis
from sdm_deflect.meshing.mesh.cells import Cells, Faces, Patch, Polyhedra, take_faces
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.quality import quality_of

from .data import MESH_UNITS, Box, FitRows, ReportData, before_repair, in_view, rows_of
from .near import some_cells

PLAN = "plan.npz"
# Largest bytes of a plan's arrays in the folder of a report: it should fit into a message.
LARGEST_PLAN = 20e6
# Note on the page of one amount among several.
NO_SLIDERS = (
    "no sliders: a sweep makes no plan for each page; with a range of amounts (--range LOW:HIGH, or range for each "
    "surface) one plan moves all"
)
PART = "deflected.vtu holds only the {cells:,} cells with a node that may move; its array node numbers their nodes"


def folder_of(out: Path) -> Path:
    """Return the folder of a deflected mesh file: ``wing-report`` beside ``wing.su2``."""
    return out.with_name(f"{out.name.removesuffix(ending(out))}-report")


def write_run_folder(
    folder: Path,
    deflection: Deflection,
    checks: tuple[Check, ...],
    out: Path | None,
    timings: Mapping[str, float],
    home: Path | None = None,
    motion: MeshMotion | None = None,
) -> ReportData:
    """Write settings.toml, metrics.json, deflected.vtu, convergence.csv, interpolant.npz, figures and report.html.

    A plan for other amounts is written as plan.npz. Figures and page are left out if their libraries are not installed
    (`lacks`).

    Parameters
    ----------
    folder : The folder; it may exist.
    deflection : The deflection.
    checks : The checks of it.
    out : The file of the deflected mesh, beside which `folder_of` puts the final folder. None if there is no file.
    timings : Seconds by stage.
    home : Final place of `folder`; if None, it follows from `out`, or else is `folder`.
    motion : The plan that moves the mesh to other amounts; None without one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    place = folder_of(out) if out else home or folder
    settings = tomli_w.dumps(settings_of(deflection, place, folder))
    (folder / SETTINGS).write_text(settings, encoding="utf-8")
    whole = is_small(deflection.plan.mesh)
    write_arrays(folder, deflection, whole)
    large = motion is not None and motion.nbytes > LARGEST_PLAN
    figures = metrics_of(deflection, checks, out, timings) | written_plan(None if large else folder, motion)
    data = replace(data_of(deflection, settings, place.name), motion=motion)
    if motion and large:
        way = _plan_command(settings_of(deflection, place, folder), place, motion)
        figures["notes"].append(f"{PLAN} would have {motion.nbytes / 1e6:.2g} MB and is left out; `{way}` writes it")
        data = replace(data, moves=f"{way} && {data.moves.replace(str(Path(place.name, PLAN)), PLAN)}")
    if motion is None and len(deflection.plan.poses) > 1:
        figures["notes"].append(NO_SLIDERS)
    figures["notes"] += [] if whole else [PART.format(cells=deflection.plan.affected.count)]
    (folder / "metrics.json").write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    data = data.with_verdict(checks, figures)
    if not lacks("report"):
        from .page import write_report
        from .pictures import draw_pictures

        write_report(data, draw_pictures(data, folder / "figures"), folder)
    return data


def plan_around(deflection: Deflection, progress: Progress = silent) -> MeshMotion | None:
    """Return the judged plan of a deflection; None if its fields do not repeat the deflection.

    It reaches as far to the opposite side as all checks pass in the box of the deflection; at least from 0 to the
    amounts of the deflection.
    """
    for plan in (_both_ways(deflection.plan), deflection.plan):
        with suppress(InputError):
            motion = MeshMotion.of(plan, progress, deflection).judged(progress)
            if plan is deflection.plan or not motion.shortfalls:
                return motion
            motion = motion.where_passed()
            reached = all(
                control.low <= own <= control.high for control, own in zip(motion.controls, motion.amounts, strict=True)
            )
            if reached and not motion.shortfalls:
                return motion
    return None


def _both_ways(plan: Plan) -> Plan:
    """Return a plan whose turning surfaces also reach the opposite amounts, in the same boxes."""
    boxes = []
    for box in plan.boxes:
        surfaces = tuple(
            replace(moving, range=(-abs(moving.amount), abs(moving.amount)))
            if moving.motion.unit == "deg" and moving.amount
            else moving
            for moving in box.job.surfaces
        )
        boxes.append(replace(box, boundary=replace(box.boundary, job=replace(box.job, surfaces=surfaces))))
    return replace(plan, boxes=tuple(boxes))


def written_plan(folder: Path | None, motion: MeshMotion | None) -> Json:
    """Write plan.npz into a folder, if there is one, and return its figures.

    No file is written if nodes at one place move apart.
    """
    if motion is None:
        return {"plan": None}
    with suppress(InputError):
        if folder:
            motion.save(folder / PLAN)
    return {"plan": {"surfaces": motion.figures()}}


def data_of(deflection: Deflection, settings: str = "", name: str = "") -> ReportData:
    """Return the content of a deflection's pictures, without the verdict.

    `settings` is the content of settings.toml in the folder `name`.
    """
    fits, repair = [FitRows.of(box) for box in deflection.boxes], deflection.moved_by_repair
    return job_data(deflection.plan, deflection.amounts, deflection.points, (settings, name), fits, repair)


def job_data(
    plan: Plan, pose: Amounts, points: FloatArray, stored: tuple[str, str], fits: Sequence[FitRows],
    repair: FloatArray | None,
) -> ReportData:  # fmt: skip
    """Return a report's content for a mesh at points (N, 3); a repair moved them by (N, 3), or None.

    `stored` is the content of settings.toml and the name of its folder.
    """
    mesh, (settings, folder) = plan.mesh, stored
    boxes = tuple(
        Box.of(box, at_pose, name_of(plan.patches) if len(plan.boxes) == 1 else box.surface, fit)
        for (box, at_pose), fit in zip(plan.by_box(pose), fits, strict=True)
    )
    moves = "; ".join(f"{surface.name} by {surface.amount_text}" for box in boxes for surface in box.surfaces)
    shown = in_view(mesh, (*plan.patches, *plan.stays))
    places, nested = mesh.points[mesh.on(*shown)], loads(settings)
    tables = {f"surface[{i}]": rows_of(row, {}) for i, row in enumerate(nested.pop("surface", []))}
    return ReportData(
        title=f"{mesh.name}: {moves}",
        subject=mesh.name,
        facts=(
            ("mesh", mesh.name),
            *((f"amount of {name}", text) for name, text in amounts(plan, pose)),
            *((f"{name} moves by up to", travel) for name, travel in travels(plan, pose)),
            *((f"motion of {name}", text) for name, text in motions(plan, pose)),
        ),
        mesh=mesh,
        points=points,
        boxes=boxes,
        length=MESH_UNITS,
        settings=settings,
        settings_file=SETTINGS,
        repeat=shlex.join(["sdm", "deflect", _source(nested, folder), "--config", str(Path(folder, SETTINGS))]),
        moves=shlex.join(["sdm", "apply", str(Path(folder, PLAN)), "--angle=AMOUNTS", _source(nested, folder)]),
        tables={"settings": rows_of(nested, table_of(JobOptions(), JobOptions)), **tables},
        middle=0.5 * (places.min(axis=0) + places.max(axis=0)),
        drawn=shown,
        hidden=tuple(name for name in mesh.names if name not in shown),
        interpolated=before_repair(points, repair),
    )


def _plan_command(settings: Mapping[str, Any], folder: Path, motion: MeshMotion) -> str:
    """Return the command that writes the plan of a run with its final folder."""
    words = ["sdm", "deflect", _source(settings, folder.name), "--config", str(Path(folder.name, SETTINGS))]
    ranged = any("range" in surface for surface in settings["surface"])
    for control in () if ranged else motion.controls[:1]:
        words.append(f"--range={control.low:g}:{control.high:g}")
    return shlex.join([*words, "--plan", PLAN, "--no-mesh", "--no-report"])


def _source(settings: Mapping[str, Any], folder: str) -> str:
    """Return the path of the mesh, relative to the place of the folder."""
    return normpath(Path(folder, settings["mesh"])) if settings.get("mesh") else "MESH"


def metrics_of(
    deflection: Deflection, checks: tuple[Check, ...], out: Path | None, timings: Mapping[str, float]
) -> Json:
    """Return the content of metrics.json; lengths in the mesh's unit."""
    plan, figures = deflection.plan, deflection_figures(deflection)
    boxes = figures_by_box(deflection) if len(deflection.boxes) > 1 else {name_of(plan.patches): figures}
    return {
        "mesh": mesh_figures(plan),
        "angle_deg": deflection.angle,
        "unit": plan.unit,
        "strategy": plan.job.fitting.strategy,
        "version": version("sdm-deflect"),
        **figures,
        "evaluation": {"seconds": sum(step.evaluation_seconds for box in deflection.boxes for step in box.steps)},
        "validation": verdict_figures(checks),
        "deflections": boxes,
        "warnings": list(warnings_of(plan)),
        "short_turns": list(short_turns(plan, deflection.amounts)),
        "notes": list(notes_of(plan)),
        "files": [str(out)] if out else [],
        "timings": dict(timings),
        "total_seconds": sum(timings.values()),
        "peak_rss_bytes": peak_rss_bytes(),
    }


def settings_of(deflection: Deflection, home: Path, folder: Path) -> dict[str, Any]:
    """Return every resolved setting for a settings file in `home`; tables become files in `folder`."""
    plan, job = deflection.plan, deflection.plan.job
    source, tables = plan.mesh.source, []
    for number, ((moving, surface), amount) in enumerate(zip(plan.moving, deflection.amounts, strict=True)):
        tables.append(_surface(number, moving, surface, amount, folder))
    for table, box in zip(tables, plan.boxes, strict=True) if len(plan.boxes) > 1 else ():
        table["box"] = box.region.hexahedron.corners.tolist()
    _join_mirrored(tables, deflection)
    boxes = {"box_each": True} if len(plan.boxes) > 1 else _numbers(plan.boxes[0])

    def shapes(slides: Sequence[Sliding], setting: str) -> dict[str, str]:
        return {name: slide.shape for slide in slides for name in plan.mesh.expand([slide.patch], setting)}

    return {
        **({"mesh": relpath(source, home)} if source else {}),
        **({"select": {chosen.name: chosen.text for chosen in job.selections}} if job.selections else {}),
        **table_of(job, JobOptions),
        "fixed": list(plan.stays),
        "slide": shapes(job.slides, "slide"),
        **boxes,
        "repair_slide": shapes(job.repair_slides, "repair_slide"),
        "surface": tables,
    }


def _join_mirrored(tables: list[dict[str, Any]], deflection: Deflection) -> None:
    """Join each reflection with the table of its surface, if both amounts are equal or opposite."""
    for i in reversed([i for i, box in enumerate(deflection.plan.boxes) if box.mirror]):
        of = deflection.plan.boxes[i].job.image_of
        amount, reflected = deflection.amounts[of], deflection.amounts[i]
        if abs(amount) == abs(reflected):
            tables[of].update(mirror=tables.pop(i)["patches"], sign=1 if amount == reflected else -1)


def _numbers(plan: BoxPlan) -> dict[str, Any]:
    """Return the chosen box, and the chosen numbers of its data sites, as settings."""
    return {
        "box": plan.region.hexahedron.corners.tolist(),
        "zones": [name for name in plan.region.zones if name],
        "tolerance": plan.sites.tolerance,
        "spacing": plan.sites.spacing,
        "kernel_radius": plan.sites.radius,
    }


def _surface(number: int, moving: Moving, surface: Surface, amount: float, folder: Path) -> dict[str, Any]:
    motion, table = moving.motion, folder / f"table_{number}.npz"
    out: dict[str, Any] = {"patches": list(surface.patches)} | ({"range": list(moving.range)} if moving.range else {})
    if isinstance(motion, Root):
        settings = {"motion": "root", "on": list(motion.on), "shape": motion.shape, "angle": amount}
        settings |= {"depth": motion.depth, "panel": motion.width}
        return out | settings | {"patches": [motion.tail], "hinge": _ends(motion.hinge, surface.points)}
    if not isinstance(motion, Blended):
        return out | _base(motion, surface, amount, table)
    out |= {"held": _nodes(motion.held, surface), "driven": _nodes(motion.driven, surface)}
    return out | {"motion": "blended", "strip": _strip(motion, surface)} | _base(motion.base, surface, amount, table)


def _strip(motion: Blended, surface: Surface) -> float:
    """Return the width of the strip as a share of the span."""
    if not motion.rib.turn or motion.axis is None:
        return motion.rib.share
    span = float(np.ptp(surface.points @ motion.axis.direction))
    return min(1.0, motion.rib.width_for(surface.points, motion.axis) / span)


def _base(base: Motion, surface: Surface, amount: float, table: Path) -> dict[str, Any]:
    hinge = {"hinge": _ends(base.axis, surface.points)} if base.axis else {}
    if isinstance(base, Table):
        turns: dict[str, Any] = {} if base.rotations is None else {"rotations": base.rotations}
        np.savez_compressed(table, points=base.points, vectors=base.vectors, **turns)
        return {**hinge, "table": table.name, "amount": amount}
    if isinstance(base, Shapes):
        return _shape(base, amount, table.with_name(table.name.replace("table", "shape")))
    if isinstance(base, Rotation):
        return {**hinge, "angle": amount}
    if isinstance(base, SlotSetting):
        sizes = {name: value for name in ("gap", "overlap") if (value := getattr(base, name)) is not None}
        return {**hinge, "amount": amount, "angle": base.angle, "slot": base.beside, **sizes}
    if isinstance(base, Track):
        return {**hinge, "amount": amount} | _track(base, table.with_name(table.name.replace("table", "track")))
    return {**hinge, "angle" if base.unit == "deg" else "amount": amount, "law": type(base).__name__}


def _shape(base: Shapes, amount: float, file: Path) -> dict[str, Any]:
    """Return the settings of the shape that a surface takes; its places are written to a file."""
    alone = len(base.shapes) == 1
    shape = base.shapes[0 if alone else int(amount) - 1]
    arrays = {"points": shape.places} | ({} if shape.numbers is None else {"nodes": shape.numbers})
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return {"to": [file.name], "amount": amount if alone else 1.0}


def _track(track: Track, file: Path) -> dict[str, Any]:
    """Return the settings of a track; unless it is a single shift, its rows are written to a file."""
    if len(track.rows) == 2 and not track.smooth and track.rows[-1, 0] == 1.0:
        _, angle, *shifts = track.rows[-1].tolist()
        return {"angle": angle, "shift": [shifts[:3], shifts[3:]]}
    titles = f"{'parameter' if track.smooth else CPACS},angle,dx,dy,dz,dx2,dy2,dz2"
    np.savetxt(file.with_suffix(".csv"), track.rows, "%.17g", ",", header=titles, comments="")
    return {"track": file.with_suffix(".csv").name}


def _ends(axis: Axis, points: FloatArray) -> list[list[float]]:
    """Return the two points of a hinge: as given, or at the ends of the surface; in a plane mesh its only point."""
    if axis.length is not None:
        return [axis.point.tolist(), (axis.point + axis.length * axis.direction).tolist()]
    if not np.ptp(points[:, 2]) and abs(axis.direction[2]) == 1.0:
        return [axis.point[:2].tolist()]
    along = (points - axis.point) @ axis.direction
    return [(axis.point + station * axis.direction).tolist() for station in (along.min(), along.max())]


def _nodes(nodes: NodeSet, surface: Surface) -> list[str] | list[int]:
    if isinstance(nodes, OnPatches):
        return list(surface.mesh.expand(nodes.names, "a node set") or surface.neighbours)
    if isinstance(nodes, TrailingEdge):
        return [f"edges:{nodes.dihedral:g}"]
    return [int(node) for node in nodes.nodes] if isinstance(nodes, Listed) else [type(nodes).__name__]


def is_small(mesh: Mesh) -> bool:
    """Return whether the whole mesh is written."""
    return not mesh.is_part and sum(mesh.cell_counts) <= threads.LIMITS.shown


def write_arrays(folder: Path, deflection: Deflection, whole: bool) -> None:
    """Write convergence.csv, interpolant.npz and deflected.vtu, of the `whole` mesh or of the part that may change.

    deflected.vtu holds cells and faces with displacement and quality.
    """
    plan = deflection.plan
    write_convergence(folder / "convergence.csv", deflection.boxes)
    write_interpolants(folder / "interpolant.npz", deflection.boxes)
    moved, node, quality = _mesh_shown(plan, deflection.points, whole)
    numbers = {} if whole else {"node": plan.mesh.numbers(node)}
    arrays = {"displacement": moved.points - plan.mesh.points[node], **numbers}
    if (repair := deflection.moved_by_repair) is not None:
        arrays["repair"] = repair[node]
    write_vtu(folder / "deflected.vtu", moved, arrays, {"quality": quality})


def _mesh_shown(plan: Plan, points: FloatArray, whole: bool) -> tuple[Mesh, IntArray, FloatArray]:
    """Return a mesh at `points` (N, 3) or the part that may change, its nodes (P,), and its cells' quality (L,)."""
    mesh, affected, node = plan.mesh.with_points(points), plan.affected, np.arange(len(points))
    rows = [np.arange(len(block)) for block in mesh.cells] if whole else list(affected.rows)
    parts = zip(mesh.cells, rows, affected.orientation, strict=True)
    quality = np.concatenate([np.empty(0), *(quality_of(points, *part) for part in parts)])
    if not whole:
        mesh, node = part_of(mesh, rows, plan.movable)
    return mesh, node, quality


def part_of(mesh: Mesh, rows: Sequence[IntArray], nodes: IntArray) -> tuple[Mesh, IntArray]:
    """Return given rows of each block of cells, the faces with one of the nodes (K,), and the nodes (P,) of both."""
    chosen = np.zeros(len(mesh.points), dtype=bool)
    chosen[nodes] = True
    cells = [some_cells(block, row) for block, row in zip(mesh.cells, rows, strict=True)]
    faces = [[_with_node(block, chosen) for block in patch.faces] for patch in mesh.patches]
    used = [block.faces.nodes if isinstance(block, Polyhedra) else block.nodes.ravel() for block in cells]
    used += [block.nodes.ravel() for patch in faces for block in patch]
    node, place = union(nodes, *used), np.full(len(mesh.points), -1)
    place[node] = np.arange(len(node))
    named = zip(mesh.patches, faces, strict=True)
    patches = [Patch(patch.name, tuple(_renumber(block, place) for block in blocks)) for patch, blocks in named]
    return Mesh(mesh.points[node], tuple(_renumber(block, place) for block in cells), tuple(patches)), node


def _with_node(block: Faces, chosen: np.ndarray) -> Faces:
    if isinstance(block, Cells):
        return Cells(block.shape, block.nodes[chosen[block.nodes].any(axis=1)])
    return take_faces(block, np.flatnonzero(np.logical_or.reduceat(chosen[block.nodes], block.offsets[:-1])))


def _renumber(block: Any, place: IntArray) -> Any:
    """Return cells or faces with renumbered nodes: node i becomes place[i], (N,)."""
    if isinstance(block, Polyhedra):
        return replace(block, faces=_renumber(block.faces, place))
    return replace(block, nodes=place[block.nodes])

"""Points, cells, patches and quality of a mesh file of any format."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.arrays import FloatArray
from sdm_deflect.base.errors import InputError, printable
from sdm_deflect.base.numbers import percent
from sdm_deflect.cases.settings.jobs import selection
from sdm_deflect.deform.surface.hinges import candidates, ends_text
from sdm_deflect.meshing.formats.registry import read
from sdm_deflect.meshing.mesh.cells import Polyhedra
from sdm_deflect.meshing.mesh.mesh import MARK, Mesh
from sdm_deflect.meshing.mesh.quality import PLURALS, by_shape, check_most, find_orientation
from sdm_deflect.meshing.mesh.selection import Part, with_selections

Json = dict[str, Any]

NOTHING: Mapping[str, str] = {}
# Components of a patch that are listed.
MOST = 50
QUALITY_TITLES = ("cells", "measure", "worst", "1 %", "mean", "below 0.2", "below 0.4", "inverted")
# Share of a patch's size within which two hinges are one line.
SAME_LINE = 0.01
# Names of zones that are listed.
SHOWN = 20


def inspect(path: Path, select: Mapping[str, str] = NOTHING, slot: tuple[str, ...] = ()) -> str:
    """Return a text of a few lines on the content of a mesh file; errors as in `file_figures`."""
    figures = file_figures(path, select, slot)
    plane = ", two-dimensional" if figures["plane"] else ""
    lines = [
        f"{figures['file']}: {figures['points']:,} points, {figures['cells']:,} cells{plane}",
        *_zone_lines(figures["zones"], figures["blocks"]),
        *_columns(QUALITY_TITLES, map(_quality_row, figures["quality"])),
        *([_face_line(figures["face_quality"])] if figures["face_quality"] else ()),
        *(["the file counts the nodes of cells left-handed; judged accordingly"] if figures["left_handed"] else ()),
        *figures["notes"],
        *_patch_lines(figures),
        *([_slot_line(figures["slot"])] if figures["slot"] else ()),
        *(
            f"hinge of {name}, if it moves: {ends_text(hinge)}"
            for name, hinges in figures["hinges"].items()
            for hinge in hinges
        ),
    ]
    return "\n".join(map(printable, lines))


def _zone_lines(zones: Json, blocks: Json) -> Iterator[str]:
    """Yield the sizes of zones, if there are several, and the zones of the file in each, if there are several."""
    if len(zones) > 1:
        yield "zones (points): " + ", ".join(f"{name} {count}" for name, count in zones.items())
    for name, parts in blocks.items():
        shown = ", ".join(parts[:SHOWN]) + (f" and {len(parts) - SHOWN} more" if len(parts) > SHOWN else "")
        called = f" as {name}" if len(zones) > 1 else ""
        yield f"{len(parts)} zones of the file fit together{called}: {shown}"


def _slot_line(slot: Json) -> str:
    lengths = ", ".join(
        f"{name} {slot[name]:.6g} ({percent(slot[name] / slot['chord'], 3)})" for name in ("gap", "overlap")
    )
    return f"slot: {lengths} of {slot['chord']:.6g}, the extent of both elements along x"


def _columns(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield a table as lines: the first column begins on the left, all others end on the right."""
    table = [titles, *rows]
    wide = [max(map(len, column)) for column in zip(*table, strict=True)]
    for first, *others in table if len(table) > 1 else ():
        cells = (f"{text:>{width}}" for text, width in zip(others, wide[1:], strict=True))
        yield "  ".join((f"{first:<{wide[0]}}", *cells))


def _extent_row(name: str, count: int, extent: list[list[float]]) -> list[str]:
    """Return a name, a number of faces and the extents along x, y and z, each as one number where it has none."""
    ends = zip(*extent, strict=True) if extent else [()] * 3
    texts = (list(dict.fromkeys(f"{round(x, 12) + 0.0:.4g}" for x in pair)) for pair in ends)
    return [name, f"{count:,}", *(" \N{HORIZONTAL ELLIPSIS} ".join(some) for some in texts)]


def _patch_lines(figures: Json) -> Iterator[str]:
    rows = [_extent_row(name, count, figures["extents"][name]) for name, count in figures["patches"].items()]
    yield from _columns(("patch", "faces", *"xyz"), rows)
    for name, count in figures["components"].items():
        yield f"{name} has {count} connected components" + (f", the largest {MOST}" if count > MOST else "")
    if figures["parts"]:
        yield "parts of patches (faces, extent):"
    for part in figures["parts"]:
        yield f"  {part['name']} {part['faces']:,}{reach([part['low'], part['high']])}"


def file_figures(path: Path, select: Mapping[str, str] = NOTHING, slot: tuple[str, ...] = ()) -> Json:
    """Return the figures of a mesh file.

    Parameters
    ----------
    path : The file, or the folder of an OpenFOAM case.
    select : Selections that make further patches, by name.
    slot : Two patches of a plane mesh whose slot is measured, or nothing.

    Returns
    -------
    dict ``file``; ``points`` and ``cells``, their numbers; ``plane``, whether the mesh is two-dimensional; ``zones``,
        name: number of points; ``blocks``, for a zone joined from several of the file, their names; ``patches``, name:
        number of faces; ``extents``, name: least and largest coordinates; ``components``, the number of connected
        components of the patches that have several; ``parts``, of each of these components (`MOST` of a patch) and of
        each selection the name, the number of ``faces`` and the least and largest coordinates, ``low`` and ``high``;
        ``quality``, the fields of `Quality` for each type of cell; ``face_quality``, the figures of checkMesh for the
        faces of polyhedra, None without any; ``left_handed``, whether the file has left-handed cells; ``notes``,
        sentences on what a user may not expect; ``slot``, its ``gap`` and ``overlap`` as lengths, and ``chord``, the
        extent of both elements along x; None if it is not asked for; ``hinges``, for patches whose skin continues in
        others beyond a straight line, the two points of this line, equal in a plane mesh.

    Raises InputError or MeshFileError if the file is missing, damaged, of an unknown format, holds no cells with a
    volume, or more inverted cells than others, and InputError if a selection does not suit it.
    """
    if not path.exists():
        raise InputError(f"{path} is not a file")
    whole = read(path)
    mesh = with_selections(whole, [selection(name, text) for name, text in select.items()], slot)
    signs, count = _signs(mesh, str(path)), sum(map(len, mesh.cells))
    components, parts = _components(whole)
    parts += [Part.of(mesh, patch) for patch in mesh.patches if patch.name not in whole.names]
    return {
        "file": str(path),
        "points": len(mesh.points),
        "cells": count,
        "plane": mesh.plane,
        "zones": {zone.name: zone.stop - zone.start for zone in mesh.zones},
        "blocks": {zone.name: list(zone.blocks) for zone in mesh.zones if zone.blocks},
        "patches": dict(zip(mesh.names, map(len, mesh.patches), strict=True)),
        "extents": {patch.name: extent(mesh.points[patch.nodes]) for patch in mesh.patches},
        "components": components,
        "parts": [
            {"name": part.name, "faces": len(part), "low": low.tolist(), "high": high.tolist()}
            for part, (low, high) in ((part, part.extent) for part in parts)
        ],
        "quality": [asdict(quality) for quality in by_shape(mesh.points, [*zip(mesh.cells, repeat(None), signs)])],
        "face_quality": _face_quality(mesh),
        "left_handed": min(signs) < 0.0,
        "notes": list(mesh.notes),
        "slot": _slot(mesh, slot),
        "hinges": hinges_of(mesh),
    }


def hinges_of(mesh: Mesh) -> dict[str, list[list[list[float]]]]:
    """Return the hinges of patches; if two patches meet at a line, it is the hinge of the smaller."""
    lines = {name: list(candidates(mesh, [name])) for name in mesh.names}
    size = {
        name: float(np.linalg.norm(np.ptp(mesh.points[mesh.on(name)], axis=0)))
        for name, ends_of in lines.items()
        if ends_of
    }

    def turns(name: str, ends: FloatArray) -> bool:
        others = (one for other in size if size[other] < size[name] for one in lines[other])
        return not any(_on_line(ends.mean(axis=0), other) <= SAME_LINE * size[name] for other in others)

    kept = {name: [ends.tolist() for ends in ends_of if turns(name, ends)] for name, ends_of in lines.items()}
    return {name: ends_of for name, ends_of in kept.items() if ends_of}


def _on_line(point: FloatArray, ends: FloatArray) -> float:
    """Return the distance of a point (3,) from a line through two points (2, 3), which may be one."""
    way = ends[1] - ends[0]
    along = way / (np.linalg.norm(way) or 1.0)
    arm = point - ends[0]
    return float(np.linalg.norm(arm - (arm @ along) * along))


def _slot(mesh: Mesh, names: tuple[str, ...]) -> Json | None:
    """Return gap and overlap of two elements as lengths, and their common extent along x; None without names."""
    if not names:
        return None
    from sdm_deflect.deform.surface.slots import Slot

    setting = Slot.of(mesh, *names).setting
    nodes = mesh.on(*mesh.expand(names, "slot"))
    return {"gap": setting.gap, "overlap": setting.overlap, "chord": float(np.ptp(mesh.points[nodes, 0]))}


def _signs(mesh: Mesh, name: str) -> list[float]:
    """Return for each block 1, or -1 if its nodes are left-handed; InputError if most cells are inverted."""
    signs, inverted = zip(*(find_orientation(mesh.points, block) for block in mesh.cells), strict=True)
    check_most(name, sum(inverted), sum(map(len, mesh.cells)))
    return list(signs)


def _components(mesh: Mesh) -> tuple[dict[str, int], list[Part]]:
    """Return the number of components of the patches that have several, and the components."""
    counts, parts = {}, []
    for patch in mesh.patches:
        part = Part.of(mesh, patch)
        labels = part.components()
        if (count := int(labels.max(initial=-1)) + 1) > 1:
            counts[patch.name] = count
            parts += part.cut(labels, MARK, MOST)
    return counts, parts


def extent(points: FloatArray) -> list[list[float]]:
    """Return the least and largest coordinates of points (K, 3); nothing without points."""
    return [end.tolist() for end in (points.min(axis=0), points.max(axis=0))] if len(points) else []


def reach(extent: list[list[float]]) -> str:
    """Return an extent as text, after a comma; empty without points."""
    return ", " * bool(extent) + " to ".join(f"({', '.join(f'{x:.4g}' for x in corner)})" for corner in extent)


def _quality_row(quality: Json) -> list[str]:
    counts = [f"{quality['cells']:,} {PLURALS[quality['shape']]}", quality["measure"]]
    values = [f"{quality[key]:.3f}" for key in ("min", "p01", "mean")]
    shares = [percent(quality[key], 2) for key in ("below_0_2", "below_0_4")]
    return [*counts, *values, *shares, f"{quality['inverted']:,}"]


def _face_quality(mesh: Mesh) -> Json | None:
    """Return checkMesh's figures of polyhedra's faces; None without polyhedra."""
    if not any(isinstance(block, Polyhedra) for block in mesh.cells):
        return None
    from sdm_deflect.meshing.mesh.orthogonality import face_quality  # loads the compiler

    quality = face_quality(mesh)
    return quality.as_dict() if quality else None


def _face_line(quality: Json) -> str:
    return (
        f"faces as OpenFOAM's checkMesh measures them: non-orthogonality max {quality['non_orthogonality_max']:.2f}, "
        f"mean {quality['non_orthogonality_mean']:.2f} degrees, {quality['severely_non_orthogonal']} above 70; "
        f"skewness max {quality['skewness_max']:.3f}, {quality['highly_skew']} above 4"
    )

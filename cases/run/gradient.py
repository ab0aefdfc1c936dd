"""`sdm gradient`: derivatives of an objective by the amounts of a plan, from the nodal sensitivities of any adjoint."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from sdm_deflect.deform.base.arrays import BoolArray, FloatArray, IntArray
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.base.threads import Progress, silent
from sdm_deflect.deform.base.unpacking import damaged, read_arrays
from sdm_deflect.deform.held import HeldPlan
from sdm_deflect.deform.volume.field import POINTS_AT_A_TIME
from sdm_deflect.deform.volume.modes import Modes
from sdm_deflect.meshing.formats.format import about

from .apply import check_places, deforming, points_of

NEAR = 1e-6
"""Largest distance of a table's points from the plan's, as a share of the mesh's size: tables have seven digits."""
COLUMN = re.compile(r"sensitivity[ _:-]?([xyz012])", re.IGNORECASE)
"""Titles of components: `Sensitivity_x` of SU2, `Sensitivity:0` of ParaView."""
Piece = tuple[IntArray, FloatArray]
"""Nodes (M,) and their sensitivities (M, 3); further columns, up to three, are deflected coordinates."""


def amount_derivatives(
    path: Path,
    plan: Path,
    amounts: Mapping[str, float] | float,
    mesh: Path | None = None,
    zones: Sequence[str] = (),
    progress: Progress = silent,
) -> tuple[HeldPlan, dict[str, float], int]:
    """Sum d(objective)/d(coordinates) times d(coordinates)/d(amount) over all nodes, a part of them at a time.

    Parameters
    ----------
    path : The sensitivities d(objective)/d(coordinates): a .csv, an .npz, a .cgns, or a point field of OpenFOAM.
    plan : A file of `HeldPlan.save`.
    amounts : Where the adjoint was solved: of the only surface, or by the surfaces' names.
    mesh : The undeflected mesh; the one of that name beside the plan if None.
    zones, progress : As for `apply_plan`.

    Returns
    -------
    The plan, the derivatives per unit of each amount by the surfaces' names, and the number of nodes in the file.

    Raises InputError if sensitivities do not belong to the mesh at these amounts; MeshFileError for a damaged mesh.
    """
    held = HeldPlan.load(plan)
    pose, mesh = held.in_order(amounts), mesh or plan.with_name(held.source or "undeflected mesh")
    if not mesh.exists():
        raise InputError(f"{mesh} is not there: name the undeflected mesh of the plan in --mesh")
    check_places(held, plan, [mesh], zones, progress)
    points, own = points_of(mesh)
    near, total, seen = NEAR * float(np.ptp(points, axis=0).max()), np.zeros(len(pose)), np.zeros(len(points), np.int32)
    deforms = np.zeros((len(pose), len(points)), dtype=np.bool_)
    for mask, placed in zip(deforms, held.by_place, strict=True):
        for some in deforming(mesh, own, placed.zones, zones):
            mask[some] = True
    for nodes, rows in pieces(path, len(points)):
        np.add.at(seen, nodes, 1)
        if seen.max() > 1:
            raise InputError(f"{path}: node {np.argmax(seen)} has two rows; give each node once")
        modes = _among(held.on(points[nodes]), deforms[:, nodes])
        total += modes.vjp(pose, rows[:, :3])
        off = np.abs(rows[:, 3:] - modes.at(pose)[:, : rows.shape[1] - 3]).max(axis=1, initial=0.0)
        if (worst := off.max(initial=0.0)) > near:
            where = f"node {nodes[np.argmax(off)]} is {worst:g} from where the plan brings it"
            raise InputError(f"{path}: {where}: amounts, or the order of nodes, differ")
        progress(f"reading {path.name}", seen.sum() / len(points))
    return held, dict(zip((one.name for one in held.controls), total.tolist(), strict=True)), int(seen.sum())


def _among(modes: Modes, deforms: BoolArray) -> Modes:
    """Return the modes, for each surface only at the nodes that deform with it (n, N)."""
    kept = [mask[rows] for mask, rows in zip(deforms, modes.rows, strict=True)]
    fields = tuple(own[:, some] for own, some in zip(modes.fields, kept, strict=True))
    return replace(modes, rows=tuple(map(np.compress, kept, modes.rows)), fields=fields)


def pieces(path: Path, count: int) -> Iterator[Piece]:
    """Yield what a file holds for a mesh of `count` nodes; InputError if it is not of such a mesh."""
    if path.suffix.lower() == ".csv":
        yield from _of_table(path, count)
        return
    reader = {".npz": _of_arrays, ".cgns": _of_cgns}.get(path.suffix.lower(), _of_field)
    rows = reader(path)
    if rows.shape != (count, 3) or rows.dtype.kind != "f" or not np.isfinite(rows).all():
        raise InputError(f"{path}: must have sensitivities ({count}, 3) of finite real numbers for this mesh")
    for start in range(0, count, POINTS_AT_A_TIME):
        nodes = np.arange(start, min(start + POINTS_AT_A_TIME, count))
        yield nodes, rows[nodes]


def _of_table(path: Path, count: int) -> Iterator[Piece]:
    """Yield rows of a .csv with titles; without a column PointID they are in the order of the mesh's nodes."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        titles = [title.strip() for title in next(csv.reader(file), [])]
        with damaged(path, "table of sensitivities"):
            own = components_of(titles)
        places = [titles.index(name) for name in "xyz"[: len(own)] if name in titles]
        used = [*own, *places, *(titles.index(name) for name in titles if name == "PointID")]
        start, numbered = 0, "PointID" in titles
        while lines := list(islice(file, POINTS_AT_A_TIME)):
            with damaged(path, "table of sensitivities"):
                given = np.loadtxt(lines, delimiter=",", usecols=used, ndmin=2)
                nodes = given[:, -1].astype(np.intp) if numbered else start + np.arange(len(given))
                if not np.isfinite(given).all() or nodes.min() < 0 or nodes.max() >= count:
                    raise InputError(f"a number is not finite, or a node is not one of the mesh, 0 to {count - 1}")
            rows = np.zeros((len(given), 3 + len(places)))
            rows[:, : len(own)], rows[:, 3:] = given[:, : len(own)], given[:, len(own) : len(own) + len(places)]
            yield nodes, rows
            start += len(rows)


def components_of(titles: Sequence[str]) -> list[int]:
    """Return the indices of the titles of x, y and, if there is one, z; InputError if one is missing or repeated."""
    found = sorted(
        ("xyz012".index(match[1].lower()) % 3, i) for i, t in enumerate(titles) if (match := COLUMN.search(t))
    )
    if [axis for axis, _ in found] not in ([0, 1], [0, 1, 2]):
        raise InputError("there must be Sensitivity_x, Sensitivity_y and in space Sensitivity_z, once each")
    return [i for _, i in found]


def _of_arrays(path: Path) -> FloatArray:
    arrays = read_arrays(path)
    if "sensitivity" not in arrays:
        raise InputError(f"{path}: has no array sensitivity, but {', '.join(arrays)}")
    return arrays["sensitivity"]


def _of_cgns(path: Path) -> FloatArray:
    """Return the sensitivities (N, 3) in solutions at the vertices."""
    import h5py

    from sdm_deflect.meshing.formats.cgns_boundary import location
    from sdm_deflect.meshing.formats.cgns_nodes import children, reals
    from sdm_deflect.meshing.formats.cgns_read import base_of, may_fit

    with about(path), h5py.File(path) as file:
        base, out = base_of(file), []
        if may_fit(base):
            raise InputError("its zones share points: give the sensitivities of the mesh's nodes in an .npz")
        for zone in base.zones.values():
            solutions = [one for _, one in children(zone, "FlowSolution_t") if location(one) == "Vertex"]
            arrays = [pair for some in solutions for pair in children(some, "DataArray_t")]
            own = [reals(arrays[i][1])[()].ravel() for i in components_of([name for name, _ in arrays])]
            out.append(np.column_stack([*own, *[np.zeros_like(own[0])] * (3 - len(own))]))
        return np.concatenate(out)


def _of_field(path: Path) -> FloatArray:
    from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors

    with about(path):
        file = open_foam(path.parent, path.name)
        begin = file.data.find(b"List<vector>", file.start) + len(b"List<vector>")
        if file.entries.get("class") != "pointVectorField" or begin < file.start:
            raise InputError("must be a pointVectorField with different values, or a .csv, an .npz or a .cgns")
        end = None if file.binary else file.data.find(b";", begin)
        return vectors(replace(file, data=file.data[:end], start=begin)).values

"""The work of `sdm gradient`: derivatives by a plan's amounts from an adjoint's nodal sensitivities."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError, short_list
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.unpacking import PLACES, columns_of, damaged, read_arrays, read_titles, refuse_device
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.mesh.cells import Zone

from .apply import compare, located, points_of

# Rows of a table that are read at a time.
POINTS_AT_A_TIME = 1 << 18
# Largest distance of a table's points from the plan's, as a share of the mesh's size: tables have seven digits.
NEAR = 1e-6
# Bound of a sensitivity: sums of larger ones overflow.
LARGEST = 1e300
# Titles of components: those of SU2, and those of ParaView.
TITLES = {f"Sensitivity_{name}": (f"Sensitivity_{name}", f"Sensitivity:{i}") for i, name in enumerate("xyz")}
NUMBER = "PointID"
EXAMPLE = '"PointID","x","y","z","Sensitivity_x","Sensitivity_y","Sensitivity_z"'
# Nodes (M,) and their sensitivities (M, 3); further columns, up to three, are deflected coordinates.
Piece = tuple[IntArray, FloatArray]


@dataclass(frozen=True, slots=True)
class AmountDerivatives:
    """Derivatives of an objective by the amounts of a plan.

    Attributes
    ----------
    motion : the plan.
    values : derivatives per unit of each amount, by the surfaces' names.
    nodes : number of nodes in the file of sensitivities.
    """

    motion: MeshMotion
    values: dict[str, float]
    nodes: int


def amount_derivatives(
    path: Path,
    plan: Path,
    amounts: Mapping[str, float] | float,
    mesh: Path | None = None,
    zones: Sequence[str] = (),
    progress: Progress = silent,
) -> AmountDerivatives:
    """Return the sums over all nodes of d(objective)/d(coordinates) times d(coordinates)/d(amount).

    Parameters
    ----------
    path : The sensitivities d(objective)/d(coordinates): a .csv, an .npz, a .cgns, or a point field of OpenFOAM.
    plan : A file of `MeshMotion.save`.
    amounts : Amounts at which the adjoint was solved: one of the only surface, or by the surfaces' names.
    mesh : The undeflected mesh; if None, the mesh whose name is in the plan, beside the plan.
    zones, progress : As for `apply_plan`.

    Raises InputError if sensitivities do not belong to the mesh at these amounts, or if one of a node that moves is
    missing; MeshFileError for a damaged mesh.
    """
    motion = MeshMotion.load(plan)
    pose, mesh = motion.in_order(amounts), mesh or plan.with_name(motion.source or "undeflected mesh")
    if not mesh.exists():
        raise InputError(f"{mesh} is not there: name the undeflected mesh of the plan in --mesh")
    compare(motion, plan, [mesh], zones, progress)
    points, zones_of_mesh = points_of(mesh)
    near, total, seen = near_of(points), np.zeros(len(pose)), np.zeros(len(points), np.intp)
    place = located(motion, mesh, points, zones_of_mesh, zones)
    plane = not np.ptp(points, axis=0).all()
    for nodes, rows in pieces(path, points, zones_of_mesh, plane):
        np.add.at(seen, nodes, 1)
        if seen.max() > 1:
            raise InputError(f"{path}: node {np.argmax(seen)} has two rows; give each node once")
        there = motion.taken(points[nodes], place[nodes])
        total += there.vjp(pose, rows[:, :3])
        off = np.abs(rows[:, 3:] - there.at(pose)[:, : rows.shape[1] - 3]).max(axis=1, initial=0.0)
        if (worst := off.max(initial=0.0)) > near:
            where = f"node {nodes[np.argmax(off)]} is {worst:g} from where the plan brings it"
            raise InputError(f"{path}: {where}: amounts, or the order of nodes, differ")
        progress(f"reading {path.name}", seen.sum() / len(points))
    _refuse_missing(path, motion, place, seen)
    if not np.isfinite(total).all():
        raise InputError(f"{path}: the sensitivities are too large to add up")
    values = dict(zip((control.name for control in motion.controls), total.tolist(), strict=True))
    return AmountDerivatives(motion, values, int(seen.sum()))


def near_of(points: FloatArray) -> float:
    """Return the largest distance between a place in a file and its node at points (N, 3)."""
    return NEAR * float(np.ptp(points, axis=0).max())


def _refuse_missing(path: Path, motion: MeshMotion, place: IntArray, seen: IntArray) -> None:
    """Raise InputError if a node that a surface moves, by its place (N,), is not `seen` (N,)."""
    moves = np.zeros(len(motion.by_place.start) + 1, dtype=np.bool_)
    for rows in motion.by_place.rows:
        moves[rows] = True
    if missing := int(np.count_nonzero(moves[place] & (seen == 0))):
        raise InputError(f"{path}: has {int(seen.sum())} of {len(seen)} nodes; {missing} that move are missing")


def pieces(path: Path, points: FloatArray, zones: Sequence[Zone], plane: bool) -> Iterator[Piece]:
    """Yield the sensitivities in a file for a mesh with nodes at `points` (N, 3); InputError for another mesh's."""
    refuse_device(path)
    count = len(points)
    if path.suffix.lower() == ".csv":
        yield from _of_table(path, count, plane)
        return
    if path.suffix.lower() == ".cgns":
        rows = _of_cgns(path, points, zones, plane)
    else:
        rows = _of_arrays(path) if path.suffix.lower() == ".npz" else _of_field(path)
    if rows.ndim != 2 or rows.shape not in ((count, 3), (count, 6)) or rows.dtype.kind != "f":
        raise InputError(f"{path}: must have sensitivities ({count}, 3) of finite real numbers for this mesh")
    _check_numbers(path, rows)
    for start in range(0, count, POINTS_AT_A_TIME):
        nodes = np.arange(start, min(start + POINTS_AT_A_TIME, count))
        yield nodes, rows[nodes]


def _check_numbers(path: Path, rows: FloatArray) -> None:
    if not (np.abs(rows) < LARGEST).all():
        raise InputError(f"{path}: a sensitivity is not finite, or beyond {LARGEST:g}")


def _of_table(path: Path, count: int, plane: bool) -> Iterator[Piece]:
    """Yield rows of a .csv with titles; without a column PointID they are in the order of the mesh's nodes."""
    with damaged(path, "table of sensitivities"):
        file = path.open(encoding="utf-8-sig", errors="replace")
    with file:
        with damaged(path, "table of sensitivities"):
            titles = read_titles(file, EXAMPLE)
            components = components_of(titles, plane)
            at = columns_of(titles, {**PLACES, NUMBER: (NUMBER,)})
        places = [at[name] for name in "xyz"[: len(components)] if name in at]
        used = [*components, *places, *([at[NUMBER]] if NUMBER in at else [])]
        start, numbered = 0, NUMBER in at
        while lines := list(islice(file, POINTS_AT_A_TIME)):
            with damaged(path, "table of sensitivities"):
                given = np.loadtxt(lines, delimiter=",", usecols=used, ndmin=2, comments=None)
                nodes = given[:, -1] if numbered else start + np.arange(len(given))
                if not (nodes == np.floor(nodes)).all() or nodes.min() < 0 or nodes.max() >= count:
                    raise InputError(f"a node is not one of the mesh, 0 to {count - 1}")
            _check_numbers(path, given)
            rows = np.zeros((len(given), 3 + len(places)))
            rows[:, : len(components)], rows[:, 3:] = (
                given[:, : len(components)],
                given[:, len(components) : len(components) + len(places)],
            )
            yield nodes.astype(np.intp), rows
            start += len(rows)


def components_of(titles: Sequence[str], plane: bool) -> list[int]:
    """Return the indices of the titles of x, y and, in space, z; InputError if one is missing."""
    columns = columns_of(titles, TITLES)
    if [*columns] not in ([*TITLES], [*TITLES][:2] if plane else [*TITLES]):
        raise InputError(
            f"there must be Sensitivity_x, Sensitivity_y and in space Sensitivity_z; there is {short_list(titles)}"
        )
    return list(columns.values())


def _of_arrays(path: Path) -> FloatArray:
    arrays = read_arrays(path)
    if "sensitivity" not in arrays:
        raise InputError(f"{path}: has no array sensitivity, but {', '.join(arrays)}")
    return arrays["sensitivity"]


def _of_cgns(path: Path, points: FloatArray, zones: Sequence[Zone], plane: bool) -> FloatArray:
    """Return the sensitivities (N, 3) in solutions at the vertices, zone by zone of the mesh.

    With coordinates, (N, 6), if all zones have other coordinates than the undeflected ones.
    """
    from sdm_deflect.meshing.formats.cgns import open_tree
    from sdm_deflect.meshing.formats.cgns_boundary import location
    from sdm_deflect.meshing.formats.cgns_nodes import Node, children, reals
    from sdm_deflect.meshing.formats.cgns_read import base_of, may_fit

    def columns(node: Node, label: str, names: Sequence[str] = ()) -> FloatArray:
        """Return the vectors (M, 3) among the arrays of all solutions, or of the coordinates, of a zone."""
        parts = [child for _, child in children(node, label) if names or location(child) == "Vertex"]
        arrays = [pair for part in parts for pair in children(part, "DataArray_t")]
        titles = [name for name, _ in arrays]
        found = list(columns_of(titles, PLACES).values()) if names else components_of(titles, plane)
        vectors = [reals(arrays[i][1]).read().ravel() for i in found]
        return (
            np.column_stack([*vectors, *[np.zeros_like(vectors[0])] * (3 - len(vectors))])
            if vectors
            else np.empty((0, 3))
        )

    with about(path), open_tree(path) as file:
        base, out = base_of(file), []
        if may_fit(base):
            raise InputError("its zones share points: give the sensitivities of the mesh's nodes in an .npz")
        names = [zone.name if len(zones) > 1 else next(iter(base.zones), "") for zone in zones]
        if sorted(names) != sorted(base.zones):
            raise InputError(f"its zones are {short_list(base.zones)}; those of the mesh are {short_list(names)}")
        for name, zone in zip(names, zones, strict=True):
            zone_node, size = base.zones[name], zone.stop - zone.start
            vectors, places = columns(zone_node, "FlowSolution_t"), columns(zone_node, "GridCoordinates_t", ["x"])
            if len(vectors) != size or len(places) not in (0, size):
                raise InputError(f"zone {name} has {len(vectors)} sensitivities, and the mesh {size} nodes there")
            start = points[zone.start : zone.stop]
            same = not len(places) or np.abs(places - start).max(initial=0.0) <= near_of(points)
            out.append(vectors if same else np.hstack([vectors, places]))
        width = min(part.shape[1] for part in out)
        return np.concatenate([part[:, :width] for part in out])


def _of_field(path: Path) -> FloatArray:
    from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors

    with about(path):
        file = open_foam(path.parent, path.name)
        begin = file.data.find(b"List<vector>", file.start) + len(b"List<vector>")
        if file.entries.get("class") != "pointVectorField" or begin < file.start:
            raise InputError("must be a pointVectorField with different values, or a .csv, an .npz or a .cgns")
        end = None if file.binary else file.data.find(b";", begin)
        return vectors(replace(file, data=file.data[:end], start=begin)).values

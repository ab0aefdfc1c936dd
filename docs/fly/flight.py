"""Data of `docs/fly.html`: the fighter, the fields by which a plan moves it, and the sites of the left tail.

A page has the walls, all cells that can change, and those beside them in the section of the left tail. Every processor
chooses the same centres, so the data are the same within one quantum of 16 bits.
"""

import gzip
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple, Self

import numpy as np

import sdm_deflect
from docs.fly.tail import SECTION, START, SURFACE, WORSE, Tail, fighter
from sdm_deflect.base.arrays import FloatArray, IntArray, union
from sdm_deflect.deform.confined import initial_centers
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.deform.rbf.interpolant import Interpolant, fit
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.meshing.mesh.cells import Patch

# Largest number of 16 bits with a sign; a field is stored as shares of its largest component.
MOST = 32_767
# Bits of a coordinate by which nodes are put in order, so that neighbours have similar numbers.
BITS = 10
# Distance of the lattice's lines, and margin of the section's view beyond the box, in metres.
LATTICE, BESIDE = 0.005, 0.03
# The patch that is not drawn.
FAR = "far_field"
ALONG_Y = np.array([0.0, 1.0, 0.0])


class Packed:
    """Arrays one after another, of each the first bytes of all its numbers, then the second ones, and so on."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.index: dict[str, tuple[int, int, str]] = {}

    def add(self, name: str, values: np.ndarray) -> None:
        """Add an array under a name: its place, its length and its type are kept in `index`."""
        values = np.ascontiguousarray(values)
        self.index[name] = (len(self.data), values.size, values.dtype.str[1:])
        self.data += values.reshape(-1).view(np.uint8).reshape(values.size, -1).T.tobytes()

    def add_field(self, name: str, field: FloatArray) -> list[float]:
        """Add a field (M, c) in 16 bits, component by component; return the quantum of each component."""
        quanta = np.abs(field).max(axis=0) / MOST
        quanta[quanta == 0.0] = 1.0
        self.add(name, np.round(field / quanta).T.astype(np.int16))
        return [float(quantum) for quantum in quanta]

    def bytes(self, meta: dict[str, Any]) -> bytes:
        """Return all, compressed: a line of JSON, and the arrays."""
        head = json.dumps({**meta, "arrays": self.index}, separators=(",", ":"))
        return gzip.compress(head.encode() + b"\n" + bytes(self.data), 9, mtime=0)


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return what was packed: the line of JSON, and the arrays by name."""
    head, _, arrays = gzip.decompress(data).partition(b"\n")
    meta, out = json.loads(head), {}
    for name, (start, count, kind) in meta["arrays"].items():
        size = np.dtype(kind).itemsize
        planes = np.frombuffer(arrays, np.uint8, count * size, start).reshape(size, count)
        out[name] = np.ascontiguousarray(planes.T).view(kind).ravel()
    return meta, out


class Plane(NamedTuple):
    """The plane of a section: points p with normal . p = offset."""

    normal: FloatArray
    offset: float

    def cuts(self, corners: FloatArray) -> np.ndarray:
        """Return whether it cuts cells with corners (K, 4, 3)."""
        above = corners @ self.normal >= self.offset
        return np.asarray(above.any(axis=1) & ~above.all(axis=1))


def section_of(name: str, hinge: Sequence[Sequence[float]]) -> Plane:
    """Return the plane across a surface: half-way along its hinge; that of the other pictures for the tails."""
    first, second = np.array(hinge)
    if name.startswith("tail"):
        return Plane(ALONG_Y, SECTION if name == SURFACE else -SECTION)
    along = (second - first) / np.linalg.norm(second - first)
    return Plane(along, float(along @ (first + second) / 2.0))


def planned() -> MeshMotion:
    """Return the plan of the fighter's surfaces with the settings of `fighter.toml`."""
    mesh, settings = fighter()
    surfaces = [{key: value for key, value in one.items() if key != "angle"} for one in settings["surface"]]
    return sdm_deflect.plan(mesh, surfaces, fixed=settings["fixed"], box_each=True)


def in_order(points: FloatArray) -> IntArray:
    """Return the rows of points (N, 3) along a space-filling curve (Morton's)."""
    low, high = points.min(axis=0), points.max(axis=0)
    cell = ((points - low) / (high - low).max() * (2**BITS - 1)).astype(np.int64)
    key = sum((cell[:, c] >> bit & 1) << (3 * bit + c) for bit in range(BITS) for c in range(3))
    return np.argsort(key, kind="stable")


def rolled(cells: IntArray) -> IntArray:
    """Return tetrahedra (K, 4) with their smallest node first, sorted by it; each keeps its sign."""
    even = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
    first = np.take_along_axis(cells, even[cells.argmin(axis=1)], axis=1)
    return first[np.lexsort(first.T[::-1])]


def differences(cells: IntArray) -> np.ndarray:
    """Return rows of nodes (K, n) as small numbers: the step of the first node, and the others beyond it."""
    first = cells[:, :1]
    steps = np.diff(first, axis=0, prepend=0)
    return np.concatenate([steps, cells[:, 1:] - first], axis=1).T.astype(np.int16)


class Lattice(NamedTuple):
    """A lattice in the section of the left tail's box: its first place (x, z), its rows and columns, and its step.

    `inside` are the numbers (K,) of its places in the box, row by row, and `points` their coordinates (K, 3).
    """

    origin: tuple[float, float]
    shape: tuple[int, int]
    step: float
    inside: list[int]
    points: FloatArray

    @classmethod
    def of(cls, tail: Tail) -> Self:
        """Put a lattice over the box and its margin."""
        corners = tail.plan.region.hexahedron.corners[:, [0, 2]]
        low, high = corners.min(axis=0), corners.max(axis=0)
        x, z = (np.arange(low[k] - BESIDE, high[k] + BESIDE, LATTICE) for k in range(2))
        flat = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
        inside = np.flatnonzero(((flat > low) & (flat < high)).all(axis=1))
        points = np.insert(flat[inside], 1, SECTION, axis=1)
        return cls((float(x[0]), float(z[0])), (len(z), len(x)), LATTICE, inside.tolist(), points)


def seen_in(tail: Tail, plane: Plane) -> IntArray:
    """Return the rows of the cells in the section of the left tail, up to `BESIDE` from its box."""
    corners = tail.mesh.points[tail.tets]
    box = tail.plan.region.hexahedron.corners
    low, high = box.min(axis=0) - BESIDE, box.max(axis=0) + BESIDE
    near = ((corners > low) & (corners < high)).all(axis=2).any(axis=1)
    return np.flatnonzero(near & plane.cuts(corners))


def with_all(tail: Tail, rows: IntArray, fields: FloatArray) -> Interpolant:
    """Return the interpolant of fields (k, M, 3) at all sites of the left tail, as columns (3 k)."""
    values = np.zeros((len(tail.sites.points), len(fields), 3))
    nodes = tail.plan.sites
    values[: tail.on_tail] = fields[:, np.searchsorted(rows, nodes.moving[nodes.distinct])].transpose(1, 0, 2)
    return fit(ThinPlateSpline(), tail.sites.points, values.reshape(len(values), -1))


class Shown(NamedTuple):
    """The part of the mesh that the page has.

    `patches` are the walls, `faces` their triangles, `changed` and `beside` nodes (K, 4) of cells. `nodes` (N,) are in
    the page's order, and `number` has the place of each node of the mesh in it.
    """

    patches: list[Patch]
    faces: list[IntArray]
    changed: IntArray
    beside: IntArray
    nodes: IntArray
    number: IntArray

    @classmethod
    def of(cls, tail: Tail, plan: MeshMotion) -> Self:
        """Take the walls, the cells that a plan can change, and those beside them in the section of the left tail."""
        tets, points = tail.tets, tail.mesh.points
        patches = [patch for patch in tail.mesh.patches if patch.name != FAR]
        faces = [np.concatenate([block.nodes for block in patch.faces]) for patch in patches]
        rows = np.flatnonzero(np.isin(tets, union(*plan.rows)).any(axis=1))
        changed, beside = tets[rows], tets[np.setdiff1d(seen_in(tail, Plane(ALONG_Y, SECTION)), rows)]
        nodes = union(*(some.ravel() for some in (*faces, changed, beside)))
        nodes = nodes[in_order(points[nodes])]
        number = np.full(len(points), -1)
        number[nodes] = np.arange(len(nodes))
        return cls(patches, faces, changed, beside, nodes, number)

    def add(self, packed: Packed, points: FloatArray) -> None:
        """Add nodes, triangles and cells."""
        packed.add("points", points[self.nodes].T.astype(np.float32))
        packed.add("faces", differences(np.concatenate([self.number[nodes] for nodes in self.faces])))
        packed.add("cells", differences(rolled(self.number[self.changed])))
        packed.add("beside", differences(rolled(self.number[self.beside])))


def add_surfaces(packed: Packed, plan: MeshMotion, number: IntArray) -> list[dict[str, Any]]:
    """Add the fields of a plan; return what the page must know of each surface."""
    hinges = {one["patches"]: one["hinge"] for one in fighter()[1]["surface"]}
    out = []
    for k, (control, rows, fields) in enumerate(zip(plan.controls, plan.rows, plan.fields, strict=True)):
        order = np.argsort(number[rows])
        packed.add(f"rows{k}", np.diff(number[rows][order], prepend=0).astype(np.uint16))
        quanta = packed.add_field(f"fields{k}", fields[:, order].transpose(1, 0, 2).reshape(len(rows), -1))
        plane = section_of(control.name, hinges[control.name])
        out.append({
            "name": control.name, "low": control.low, "high": control.high, "quanta": quanta,
            "functions": {"kind": type(control.functions).__name__, **asdict(control.functions)},
            "box": plan.snapshots[k].box.region.hexahedron.corners.tolist(),
            "normal": plane.normal.tolist(), "offset": plane.offset,
        })  # fmt: skip
    return out


def add_tail(packed: Packed, tail: Tail, number: IntArray, whole: Interpolant) -> dict[str, Any]:
    """Add the sites of the left tail, and what an interpolant does to its free nodes and to a lattice."""
    nodes, lattice = tail.plan.sites, Lattice.of(tail)
    packed.add("moving", number[nodes.moving[nodes.distinct]].astype(np.uint16))
    packed.add("held", number[nodes.fixed[nodes.sampled]].astype(np.uint16))
    packed.add("free", number[tail.free].astype(np.uint16))
    packed.add("zero", tail.sites.points[tail.in_mesh :].T.astype(np.float32))
    return {
        "start": initial_centers(tail.sites, tail.on_tail, START).tolist(),
        "lattice": {
            "origin": lattice.origin, "shape": lattice.shape, "step": lattice.step, "inside": lattice.inside,
            "quanta": packed.add_field("lattice", whole(lattice.points)),
        },
        "free": packed.add_field("whole", whole(tail.mesh.points[tail.free])),
    }  # fmt: skip


def flight() -> bytes:
    """Return the data of the page."""
    tail, plan, packed = Tail.at(), planned(), Packed()
    shown, live = Shown.of(tail, plan), [control.name for control in plan.controls].index(SURFACE)
    shown.add(packed, tail.mesh.points)
    # What moves is a surface, or the panel on which the root of one slides.
    moves = {name.split("~")[0]: "panel" for control in plan.controls for name in control.patches}
    moves |= {control.name: "surface" for control in plan.controls}
    return packed.bytes({
        "live": live, "section": SECTION, "worse": WORSE,
        "patches": [
            {"name": patch.name, "faces": len(nodes), "moves": moves.get(patch.name)}
            for patch, nodes in zip(shown.patches, shown.faces, strict=True)
        ],
        "surfaces": add_surfaces(packed, plan, shown.number),
        **add_tail(packed, tail, shown.number, with_all(tail, plan.rows[live], plan.fields[live])),
    })  # fmt: skip

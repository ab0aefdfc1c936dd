"""Meshes as Fluent stores them in HDF5: by its solver (.cas.h5), and by its mesher (.msh.h5)."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sdm_deflect.meshing.formats.polyhedra import Bounded, polyhedral_cells
from sdm_deflect.meshing.formats.shapes import polygons, turn_faces
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Polyhedra
from sdm_deflect.meshing.mesh.mesh import Mesh

# Fluent's numbers of the shapes of cells; polyhedra are 7.
TYPES = {"triangle": 1, "quad": 3, "tetra": 2, "hexahedron": 4, "pyramid": 5, "wedge": 6}
LAYOUTS = ("solver", "meshing")
PACKED = {"compression": "gzip", "chunks": True}
COORDS = "meshes/1/nodes/coords/1"
ZONES = "meshes/1/faces/zoneTopology"
# Types of zones by the name of the patch; all others are walls.
KINDS = {"symmetry": 7, "inlet": 10, "far_field": 9, "left": 12, "right": 8}


def written(mesh: Mesh, path: Path, layout: str = "solver", real: str = "f8", **stored: Any) -> Path:
    """Write a mesh; `stored` says how h5py stores the larger arrays, such as ``compression="gzip"``."""
    found = lines_of(mesh) if mesh.plane else polyhedral_cells(mesh)
    faces, dimension = found.cells.faces, 2 if mesh.plane else 3
    if dimension == 3:
        faces = turn_faces(faces, np.ones(len(faces), dtype=bool))  # normals into c0
    inner, count = len(found.cells.neighbour), len(faces)
    zones = [("interior-fluid", 0, inner, 2)]
    zones += [(name, first, first + size, KINDS.get(name, 3)) for name, first, size in found.patches]
    zones = [zone for zone in zones if zone[1] < zone[2]]
    parts = [(0, count)] if layout == "solver" else [(first, last) for _, first, last, _ in zones]
    right = found.cells.owner + 1
    left = np.concatenate([found.cells.neighbour + 1, np.zeros(count - inner, dtype=np.intp)])
    half = len(mesh.points) // 2 if layout == "meshing" else 0
    with h5py.File(path, "w") as file:
        root = file.create_group("meshes/1")
        root.attrs.update({
            name: np.array([value], "u8")
            for name, value in (("nodeCount", len(mesh.points)), ("faceCount", count), ("cellCount", len(found.cells)),
                                ("nodeOffset", 1), ("faceOffset", 1), ("cellOffset", 1))
        })  # fmt: skip
        root.attrs["dimension"] = np.array([dimension], "i4")
        spans = [(half, len(mesh.points)), (0, half)] if half else [(0, len(mesh.points))]
        _nodes(root.create_group("nodes"), mesh.points[:, :dimension].astype(real), spans, stored)
        group = root.create_group("faces")
        _zones(group, zones)
        _faces(group, polygons(faces.nodes + 1, np.diff(faces.offsets)), parts, stored)
        for name, cells in (("c0", right), ("c1", left)):
            own = parts if name == "c0" or layout == "meshing" else [(0, inner)]
            _sections(group.create_group(name), cells.astype("u4"), own, stored)
        _cells(root.create_group("cells"), mesh, len(found.cells))
        settings = file.create_group("settings")
        settings["Version"] = np.array([b"21.0.0"])
        settings["Thread Variables"] = np.array([b"(39 (2 wall wing)())"])
        settings["Version"].attrs["version"] = np.array([1], "i4")
    return path


def plane_mesh() -> Mesh:
    """Quads around a hole, of which those above are cut into triangles."""
    lattice = np.arange(36).reshape(6, 6)
    quads = [
        lattice[[j, j, j + 1, j + 1], [i, i + 1, i + 1, i]] for j in range(5) for i in range(5) if (i, j) != (2, 2)
    ]
    low = np.array([row for row in quads if row[0] < 24])
    high = np.array([[row[0], row[1], row[2]] for row in quads if row[0] >= 24])
    high = np.concatenate([high, [[row[0], row[2], row[3]] for row in quads if row[0] >= 24]])
    x, y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6))
    points = np.stack([x + 0.05 * np.sin(3 * y), y, 0 * x], axis=-1).reshape(-1, 3)
    body = np.array([[15, 14], [14, 20], [20, 21], [21, 15]])
    far = np.concatenate([np.stack([edge[:-1], edge[1:]], axis=1) for edge in (
        lattice[0], lattice[:, -1], lattice[-1, ::-1], lattice[::-1, 0])])  # fmt: skip
    patches = (Patch("body", (Cells("line", body),)), Patch("far_field", (Cells("line", far),)))
    return Mesh(points, (Cells("quad", low), Cells("triangle", high)), patches)


def lines_of(mesh: Mesh) -> Bounded:
    """The lines of a plane mesh, with their cells on the left, as `polyhedral_cells` has faces."""
    cells = [row for block in mesh.cells for row in block.nodes.tolist()]
    pairs: dict[frozenset[int], list[tuple[int, tuple[int, int]]]] = {}
    for i, row in enumerate(cells):
        for line in zip(row, [*row[1:], row[0]], strict=True):
            pairs.setdefault(frozenset(line), []).append((i, line))
    inner = [both for both in pairs.values() if len(both) == 2]
    outer, ranges = [], []
    for patch in mesh.patches:
        rows = [pairs[frozenset(row)] for faces in patch.faces for row in faces.nodes.tolist()]
        ranges.append((patch.name, len(inner) + len(outer), len(rows)))
        outer += rows
    ordered = [both[0] for both in (*inner, *outer)]
    lines = polygons(np.array([line for _, line in ordered]).ravel(), np.full(len(ordered), 2))
    owner, neighbour = np.array([i for i, _ in ordered]), np.array([both[1][0] for both in inner])
    return Bounded(Polyhedra(lines, owner, neighbour), tuple(ranges), ())


def _sections(group: Any, values: Any, parts: Any, stored: Any) -> None:
    group.attrs["nSections"] = np.array([len(parts)], "u8")
    for i, (first, last) in enumerate(parts, 1):
        own = group.create_dataset(f"{i}", data=values[first:last], **stored)
        _range(own, first, last)


def _range(node: Any, first: int, last: int) -> None:
    node.attrs["minId"], node.attrs["maxId"] = np.array([first + 1], "u8"), np.array([last], "u8")
    node.attrs["chunkDim"] = np.array([last - first], "u8")


def _nodes(group: Any, points: Any, spans: Any, stored: Any) -> None:
    _sections(group.create_group("coords"), points, spans, stored)
    topology = group.create_group("zoneTopology")
    topology.attrs["nZones"] = np.array([len(spans)], "u8")
    topology["id"] = np.arange(1, len(spans) + 1, dtype="i4")
    topology["minId"] = np.array([first + 1 for first, _ in spans], "u8")
    topology["maxId"] = np.array([last for _, last in spans], "u8")
    topology["dimension"] = np.full(len(spans), 3, "u8")


def _faces(group: Any, faces: Any, parts: Any, stored: Any) -> None:
    nodes = group.create_group("nodes")
    nodes.attrs["nSections"] = np.array([len(parts)], "u8")
    for i, (first, last) in enumerate(parts, 1):
        own = nodes.create_group(f"{i}")
        rows = faces.rows(first, last)
        own.create_dataset("nnodes", data=np.diff(rows.offsets).astype("i2"), **stored)
        own.create_dataset("nodes", data=rows.nodes.astype("u4"), **stored)
        _range(own, first, last)


def _zones(group: Any, zones: Any) -> None:
    names, firsts, lasts, kinds = zip(*zones, strict=True)
    topology = group.create_group("zoneTopology")
    topology.attrs["nZones"] = np.array([len(zones)], "u8")
    topology["id"] = np.arange(11, 11 + len(zones), dtype="i4")
    topology["name"] = np.array([";".join(names).encode()])
    topology["minId"], topology["maxId"] = np.array(firsts, "u8") + 1, np.array(lasts, "u8")
    topology["zoneType"] = np.array(kinds, "i4")
    topology["dimension"] = np.full(len(zones), 2, "u8")
    for name in ("faceType", "childZoneId", "shadowZoneId", "flags"):
        topology[name] = np.zeros(len(zones), "i4")


def _cells(group: Any, mesh: Mesh, count: int) -> None:
    topology = group.create_group("zoneTopology")
    topology.attrs["nZones"] = np.array([1], "u8")
    topology["name"] = np.array([b"fluid"])
    for name, value in (("minId", 1), ("maxId", count), ("dimension", 3)):
        topology[name] = np.array([value], "u8")
    for name, value in (("id", 2), ("cellType", 0), ("childZoneId", 0), ("zoneType", 1)):
        topology[name] = np.array([value], "i4")
    kinds = [np.full(len(b), 7 if isinstance(b, Polyhedra) else TYPES[b.shape], "i2") for b in mesh.cells]
    sections = group.create_group("ctype")
    sections.attrs["nSections"] = np.array([1], "u8")
    own = sections.create_group("1")
    own.attrs["elementType"] = np.array([0], "i2")
    own["cell-types"] = np.concatenate(kinds)
    _range(own, 0, count)

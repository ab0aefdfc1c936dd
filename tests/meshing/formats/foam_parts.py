"""OpenFOAM cases decomposed as decomposePar does it, into any parts."""

from itertools import chain
from pathlib import Path

import numpy as np

from sdm_deflect.deform.mesh.mesh import Mesh
from sdm_deflect.deform.mesh.parts import taken
from sdm_deflect.meshing.formats.openfoam_files import MESH
from sdm_deflect.meshing.formats.shapes import polygons

LISTS = ("pointProcAddressing", "faceProcAddressing", "cellProcAddressing", "boundaryProcAddressing")
HEAD = 'FoamFile\n{{\n    format {};\n    class {};\n    arch "LSB;label=64;scalar=64";\n    object {};\n}}\n'
PATCH = "{name}\n{{\n    type {type};\n    nFaces {count};\n    startFace {start};\n{more}}}\n"


def parts_of(mesh: Mesh, part: np.ndarray, binary: bool) -> list[dict[str, bytes]]:
    """Return the files of each part, by name, of a mesh read from a case; `part` (C,) is the part of each cell."""
    return [_files(mesh, part, number, binary) for number in range(int(part.max()) + 1)]


def write_parts(case: Path, files: list[dict[str, bytes]], collated: bool = False, first: int = 0) -> None:
    """Write ``processor0`` and so on, or all parts into ``processors4``; `first` of those in ``processors4_2-3``."""
    if not collated:
        for number, own in enumerate(files):
            _put(case / f"processor{number}" / MESH, own)
        return
    head = HEAD.format("binary", "decomposedBlockData", "all").encode()
    blocks = {name: [own[name] if i + first == 0 else own[name].partition(b"}\n")[2] for i, own in enumerate(files)]
              for name in files[0]}  # fmt: skip
    if first:  # the first block of a file has a header
        blocks = {name: [files[0][name], *rest[1:]] for name, rest in blocks.items()}
    whole = {
        name: head + b"".join(b"\n// Processor%d\n\n%d\n(%s)" % (first + i, len(d), d) for i, d in enumerate(each))
        for name, each in blocks.items()
    }
    _put(case / f"processors{first + len(files)}" / MESH, whole)


def _put(folder: Path, files: dict[str, bytes]) -> None:
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)


def _files(mesh: Mesh, part: np.ndarray, own: int, binary: bool) -> dict[str, bytes]:
    cells = mesh.cells[0]
    inner = len(cells.neighbour)
    back = part[cells.owner]
    front = np.append(part[cells.neighbour], np.full(len(cells.faces) - inner, -1))
    inside = np.flatnonzero((back == own) & (front == own))
    groups, patches, start = [inside], [], len(inside)
    ends = inner + np.cumsum([0, *(len(patch) for patch in mesh.patches)])
    for i, patch in enumerate(mesh.patches):
        rows = np.arange(ends[i], ends[i + 1])
        groups.append(rows[back[rows] == own])
        patches.append({"name": patch.name, "type": "wall", "count": len(groups[-1]), "more": ""})
    for other in range(int(part.max()) + 1):
        rows = np.flatnonzero(((back == own) & (front == other)) | ((back == other) & (front == own)))
        if other != own and len(rows):
            groups.append(rows)
            more = f"    myProcNo {own};\n    neighbProcNo {other};\n"
            name = f"procBoundary{own}to{other}"
            patches.append({"name": name, "type": "processor", "count": len(rows), "more": more})
    for patch, group in zip(patches, groups[1:], strict=True):
        patch["start"], start = start, start + len(group)
    rows = np.concatenate(groups)
    flipped = back[rows] != own
    kept = taken(cells.faces, rows)
    faces = [
        np.concatenate([row[:1], row[:0:-1]]) if flip else row
        for row, flip in zip(np.split(kept.nodes, kept.offsets[1:-1]), flipped, strict=True)
    ]
    points, nodes = np.unique(np.concatenate(faces), return_inverse=True)
    mine = np.flatnonzero(part == own)
    ahead = np.append(cells.neighbour, 0)[np.minimum(rows, inner)]
    local = np.searchsorted(mine, np.where(flipped, ahead, cells.owner[rows]))
    numbers = {
        "owner": local,
        "neighbour": np.searchsorted(mine, cells.neighbour[inside]),
        "pointProcAddressing": points,
        "faceProcAddressing": np.where(flipped, -1, 1) * (rows + 1),
        "cellProcAddressing": mine,
        "boundaryProcAddressing": np.array([i if p["type"] == "wall" else -1 for i, p in enumerate(patches)]),
    }
    boundary = "\n".join([f"{len(patches)}\n(", *(PATCH.format(**patch) for patch in patches), ")\n"])
    return {
        "points": _points(mesh.points[points], binary),
        "faces": _faces(polygons(nodes.ravel(), np.array([len(face) for face in faces])), binary),
        "boundary": (HEAD.format("ascii", "polyBoundaryMesh", "boundary") + boundary).encode(),
        **{name: _labels(name, values, binary) for name, values in numbers.items()},
    }


def _labels(name, values, binary):
    if binary:
        return HEAD.format("binary", "labelList", name).encode() + _packed(values.astype("<i8"))
    return (
        HEAD.format("ascii", "labelList", name) + f"{len(values)}\n(\n" + "\n".join(map(str, values.tolist()))
    ).encode() + b"\n)\n"


def _points(values, binary):
    if binary:
        return HEAD.format("binary", "vectorField", "points").encode() + _packed(values.astype("<f8"))
    rows = "\n".join(f"({' '.join(map(repr, row))})" for row in values.tolist())
    return (HEAD.format("ascii", "vectorField", "points") + f"{len(values)}\n(\n{rows}\n)\n").encode()


def _faces(faces, binary):
    if binary:
        head = HEAD.format("binary", "faceCompactList", "faces").encode()
        return head + _packed(faces.offsets.astype("<i8")) + _packed(faces.nodes.astype("<i8"))
    rows = (f"{len(row)}({' '.join(map(str, row.tolist()))})" for row in np.split(faces.nodes, faces.offsets[1:-1]))
    lines = chain([f"{len(faces)}", "("], rows, [")", ""])
    return (HEAD.format("ascii", "faceList", "faces") + "\n".join(lines)).encode()


def _packed(values):
    return b"\n%d\n(%s)\n" % (len(values), values.tobytes()) if len(values) else b"\n0\n"

"""A mesh format of one's own: a header, then tables of points, tetrahedra, triangles and their patches.

python docs/examples/own_format.py
"""

from pathlib import Path

import numpy as np

from sdm_deflect.base.errors import MeshFileError
from sdm_deflect.base.files import fresh
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.meshing.errors import about
from sdm_deflect.meshing.formats.format import Format
from sdm_deflect.meshing.formats.polyhedra import standard_cells
from sdm_deflect.meshing.formats.registration import registered
from sdm_deflect.meshing.formats.shapes import refuse_plane, simple_faces
from sdm_deflect.meshing.formats.table_pieces import CellTable, PointRange, TablePieces
from sdm_deflect.meshing.formats.tables import FileTable
from sdm_deflect.meshing.mesh.cells import Cells, Patch, Zone
from sdm_deflect.meshing.mesh.mesh import Mesh
from sdm_deflect.meshing.mesh.pieces import MeshOnDisk

# Mark of the format, then how many points, tetrahedra, boundary triangles and letters of names there are.
HEADER = np.dtype([("mark", "S4"), ("points", "<i4"), ("tets", "<i4"), ("faces", "<i4"), ("names", "<i4")])


@registered
class Tets(Format):
    """Points (8 bytes), nodes of tetrahedra and of triangles (4 bytes, from 0), the patch of each triangle, names."""

    name, suffixes = "tets", (".tets",)
    for_workers = "files of tetrahedra"

    def layout(self, path: Path, scratch: Path | None = None, progress: Progress = silent) -> MeshOnDisk:
        """See `Format.layout`."""
        with about(path):
            head = np.fromfile(path, HEADER, 1)
            if len(head) < 1 or head["mark"][0] != b"TETS":
                raise MeshFileError("does not begin with TETS")
            count = {name: int(head[name][0]) for name in HEADER.names[1:]}
            shapes = (("points", "<f8", 3), ("tets", "<i4", 4), ("faces", "<i4", 3), ("faces", "<i4", 1))
            tables, at = [], HEADER.itemsize
            for what, kind, width in shapes:
                tables.append(FileTable(path.resolve(), at, kind, count[what], width))
                at += count[what] * tables[-1].step
            if min(count.values()) < 0 or path.stat().st_size != at + count["names"]:
                raise MeshFileError("has another length than its header tells; it is truncated or damaged")
            points, tets, faces, labels = tables
            names = path.read_bytes()[at:].decode("utf-8", "replace").split("\n")
            triangles = CellTable("triangle", faces, 0).everything(points.rows)
            number = labels.integers()[:, 0]
            if len(number) and not 0 <= number.min() <= number.max() < len(names):
                raise MeshFileError(f"has patches {number.min()} to {number.max()}, but {len(names)} names")
            patches = tuple(Patch(name, (Cells("triangle", triangles[number == i]),)) for i, name in enumerate(names))
            ranges = (PointRange(0, points.rows, points),)
            pieces = TablePieces(str(path.resolve()), points.rows, ranges, (CellTable("tetra", tets, 0),)).orient()
        return MeshOnDisk(path.resolve().name, pieces, patches, (Zone("", 0, points.rows),))

    def write(self, mesh: Mesh, out: Path, progress: Progress = silent) -> tuple[str, ...]:
        """See `Format.write`; other cells than tetrahedra are a MeshFileError."""
        refuse_plane(mesh, "TETS")
        with fresh(out) as beside, about(out):
            cells = [block for block in standard_cells(mesh) if len(block)]
            faces = [(i, block) for i, patch in enumerate(mesh.patches) for block in simple_faces(patch)]
            if {block.shape for block in cells} != {"tetra"} or any(face.shape != "triangle" for _, face in faces):
                raise MeshFileError("holds tetrahedra and triangles alone")
            tets = np.concatenate([block.nodes for block in cells])
            nodes = np.concatenate([np.empty((0, 3), np.intp), *(block.nodes for _, block in faces)])
            labels = np.concatenate([np.empty(0, np.intp), *(np.full(len(block), i) for i, block in faces)])
            names = "\n".join(mesh.names).encode()
            head = np.array([(b"TETS", len(mesh.points), len(tets), len(nodes), len(names))], HEADER)
            tables = (mesh.points.astype("<f8"), *(own.astype("<i4") for own in (tets, nodes, labels)))
            beside.write_bytes(b"".join([head.tobytes(), *(own.tobytes() for own in tables), names]))
        return ("its zones are one mesh",) if len(mesh.zones) > 1 else ()


def block() -> Mesh:
    """A cube of six tetrahedra whose floor and lid are patches."""
    points = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    tets = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
    sides = {"floor": [[0, 3, 1], [0, 2, 3]], "lid": [[4, 5, 7], [4, 7, 6]]}
    return Mesh(points, (Cells("tetra", tets),), tuple(Patch(n, (Cells("triangle", f),)) for n, f in sides.items()))


if __name__ == "__main__":
    Tets().write(block(), Path("cube.tets"))
    print(Tets().read(Path("cube.tets")))

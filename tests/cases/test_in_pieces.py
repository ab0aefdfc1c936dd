"""A mesh file read in pieces is deflected as one read whole: the same bytes, the same figures."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.threads import Threads
from sdm_deflect.deform.volume import submesh
from sdm_deflect.meshing.formats import openfoam_pieces, rewriting, tables
from sdm_deflect.meshing.formats.registry import format_of, in_pieces
from sdm_deflect.meshing.formats.shapes import mirror_nodes
from sdm_deflect.meshing.mesh import polyhedra
from sdm_deflect.meshing.mesh.cells import Cells, Patch
from sdm_deflect.meshing.mesh.mesh import Mesh
from tests.deform.blocks import two_bodies
from tests.limits import limited
from tests.meshing.formats.adf_files import in_adf
from tests.meshing.formats.gmsh_files import gmsh_data
from tests.meshing.formats.wing import wing

CASE = pytest.param("", id="case")


def nightly(*values):
    """The same values as parameters of nightly tests."""
    return (pytest.param(value, marks=pytest.mark.nightly) for value in values)


FLAP = [
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended",
    "--hinge", "0.7,0.3,0", "0.7,0.7,0",
]  # fmt: skip


@pytest.fixture(scope="module")
def small():
    return wing(cells=3).mesh


def shuffled(mesh: Mesh) -> Mesh:
    """The same with nodes and cells of each block in random order: neighbours in a file are far from one another."""
    rng = np.random.default_rng(7)
    order = rng.permutation(len(mesh.points))
    number = np.argsort(order)
    cells = tuple(Cells(own.shape, number[rng.permutation(own.nodes)]) for own in mesh.cells)
    patches = tuple(Patch(p.name, tuple(Cells(f.shape, number[f.nodes]) for f in p.faces)) for p in mesh.patches)
    return Mesh(mesh.points[order], cells, patches)


def left_handed(mesh: Mesh) -> Mesh:
    """The same with the nodes of the first and the last block in the order of the mirror image."""
    first, *others, last = (Cells(own.shape, mirror_nodes(own.shape, own.nodes)) for own in mesh.cells)
    return Mesh(mesh.points, (first, *mesh.cells[1:-1], last), mesh.patches) if others else mesh


def turned(mesh: Mesh) -> Mesh:
    """The same with all cells left-handed, as those of a case are if some are: they are one block."""
    return Mesh(
        mesh.points, tuple(Cells(own.shape, mirror_nodes(own.shape, own.nodes)) for own in mesh.cells), mesh.patches
    )


def written(mesh: Mesh, path: Path) -> Path:
    """Write a mesh; a file of Gmsh in binary, with a part of nodes and of elements for each of two volumes."""
    if path.suffix == ".msh":
        path.write_bytes(gmsh_data(mesh))
    else:
        format_of(path).write(mesh, path)
    return path


@pytest.fixture
def called(monkeypatch, sdm):
    """Run a command; return its code, what it printed, and how many meshes were read in pieces."""
    taken = []
    whole = submesh.submesh
    monkeypatch.setattr(submesh, "submesh", lambda *all_: taken.append(1) or whole(*all_))

    def call(large, *words):
        taken.clear()
        limited(monkeypatch, file=large)
        return *sdm(*words), len(taken)

    return call


def figures(found, name=""):
    """What was found, by its place, without times and files, and how many of the nodes that stay were looked at."""
    if not isinstance(found, list | dict):
        return {name: found}
    items = found if isinstance(found, dict) else {str(i): own for i, own in enumerate(found)}
    left_out = {"timings", "files", "reports", *(("over", "where") if items.get("name") == "outside_moved" else ())}
    kept = [(key, own) for key, own in items.items() if key not in left_out and "seconds" not in key]
    return {place: value for key, own in kept for place, value in figures(own, f"{name}/{key}").items()}


@pytest.fixture
def alike(called, monkeypatch, tmp_path):
    """Deflect a file whole and in many pieces; return the figures, which are the same, as all bytes written are."""

    limited(monkeypatch, points=1000, cells=700, in_memory=0)
    small_values = (tables, "SMALL", 0), (rewriting, "RANGE", 500), (polyhedra, "ROWS", 300)
    for module, name, size in (*small_values, (openfoam_pieces, "SPAN", 50), (openfoam_pieces, "BATCH", 200)):
        monkeypatch.setattr(module, name, size)

    def compare(source, *words, code=0):
        ended, found = [], []
        for name, large in (("whole", 1 << 60), ("pieces", 0)):
            folder = tmp_path / name
            folder.mkdir()
            out = folder / f"turned{source.name.removeprefix(source.name.partition('.')[0])}"
            own, text, complaint, taken = called(
                large, "deflect", source, *words, "--json", "--quiet", "--out", out, "--no-report"
            )
            assert own == code, complaint
            assert taken == (not large)
            ended.append(figures(json.loads(text)))
            found.append({path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()})
        assert ended[0].items() ^ ended[1].items() == set()
        assert found[0] == found[1]
        return ended[0]

    return compare


class Apart(Threads):
    """Threads that claim to have a memory of their own."""

    shares_memory = False


def flaps():
    """Ways to write a mesh and to read it: nightly all, else each format once and left-handed cells of two."""
    quick = [(suffix, shuffled, True) for suffix in (".cgns", ".su2", ".lb8.ugrid", ".msh", "")]
    quick += [(suffix, left_handed, False) for suffix in (".cgns", "")]
    for suffix in (".cgns", ".su2", ".lb8.ugrid", ".r4.ugrid", ".b8l.ugrid", ".msh", ""):
        for change, shared in ((shuffled, True), (shuffled, False), (left_handed, False), (lambda mesh: mesh, False)):
            marks = () if (suffix, change, shared) in quick else pytest.mark.nightly
            yield pytest.param(suffix, change, shared, marks=marks, id=f"{suffix or 'case'}-{change.__name__}-{shared}")


@pytest.mark.parametrize(("suffix", "change", "shared"), list(flaps()))
def test_a_flap_in_cells_of_four_shapes(suffix, change, shared, small, alike, tmp_path, monkeypatch):
    """By threads that hold the points of a scattered mesh in memory, and by others that cannot."""
    if not shared:
        own = submesh.submesh

        def apart(mesh, job, angles, _, told):
            return own(mesh, job, angles, Apart(), told)

        monkeypatch.setattr(submesh, "submesh", apart)
    if not suffix and change is left_handed:
        change = turned
    found = alike(written(change(small), tmp_path / f"wing{suffix}"), *FLAP, "--angle", "8")
    assert found["/passed"]
    assert found["/mesh/cells"] == sum(len(own) for own in small.cells)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_flap_in_adf(order, small, alike, tmp_path):
    path = written(shuffled(small), tmp_path / "wing.cgns")
    path.write_bytes(in_adf(path, order))
    assert alike(path, *FLAP, "--angle", "8")["/passed"]


@pytest.fixture(params=(".cgns", *nightly(".lb8.ugrid", ".msh"), CASE))
def plates(request, tmp_path):
    """Two plates of hexahedra, in one patch."""
    mesh = two_bodies()
    faces = np.vstack([mesh.patch(name).faces[0].nodes for name in ("right", "left", "wall")])
    one = Mesh(mesh.points, mesh.cells, (Patch("wall", (Cells("quad", faces),)),))
    return written(one, tmp_path / f"plates{request.param}")


HINGE = ["--hinge", "1.25,-1,0", "1.25,1,0", "--angle", "6", "--force"]


def test_a_box_for_each_of_two_plates(plates, alike, tmp_path):
    """Their names are parts of one patch, which become patches once for both boxes."""
    tables = (
        f"[[surface]]\npatches = ['wall#{part}']\nhinge = [[{x}, -1, 0], [{x}, 1, 0]]\nangle = {angle}\n"
        for part, x, angle in ((2, 1.25, 6), (3, -1.25, -3))
    )
    (tmp_path / "two.toml").write_text(
        "fixed = ['wall']\nbox_each = true\nforce = true\nmargin = 0.4\n" + "".join(tables)
    )
    found = alike(plates, "--config", tmp_path / "two.toml")
    assert found["/passed"]
    assert found["/angles/0/cells_touched"] == sum(
        found[f"/angles/0/deflections/wall#{part}/cells_touched"] for part in (2, 3)
    )


@pytest.mark.parametrize(
    "words",
    [
        ["--surface", "wall#2", "--fixed", "wall"],
        ["--select", "flap=wall#2", "--surface", "flap", "--fixed", "wall"],
        ["--select", "side=wall#2 sharp:40", "--surface", "side~*", "--fixed", "wall"],
        ["--select", "flap=wall box:0.5,-1,-1,2,1,1", "--surface", "flap", "--fixed", "wall"],
    ],
)
def test_parts_of_a_patch(words, plates, alike):
    assert alike(plates, *words, *HINGE)["/passed"]


@pytest.mark.parametrize("suffix", [".cgns", *nightly(".su2", ".lb8.ugrid", ".r4.ugrid", ".b8l.ugrid", ".msh"), CASE])
def test_nodes_by_their_numbers_in_the_file(suffix, small, alike, tmp_path):
    """Held and driven nodes are numbers of the whole file's nodes, wherever they are in a submesh."""
    mesh = shuffled(small)
    flap = mesh.on(*(name for name in mesh.names if "flap" in name))
    held = np.intersect1d(flap, mesh.on(*(name for name in mesh.names if "wing" in name)))
    np.savetxt(tmp_path / "held.txt", held, fmt="%d")
    np.savetxt(tmp_path / "driven.txt", np.setdiff1d(flap[mesh.points[flap, 0] > 0.95], held), fmt="%d")
    lists = ["--held", tmp_path / "held.txt", "--driven", tmp_path / "driven.txt"]
    found = alike(written(mesh, tmp_path / f"wing{suffix}"), *FLAP, *lists, "--angle", "5")
    assert found["/sites/surface"] > 0


def put(path: Path, block: int, row: int, values) -> None:
    """Replace the nodes, numbered as in the file, of a cell: whatever the format."""
    with in_pieces(path) as found:
        table = found.pieces.cells[block].table
        put_row(next(iter(getattr(table, "tables", (table,)))), row, values)


def inner(path: Path) -> int:
    """The row of a cell of the first block whose nodes are on no patch."""
    mesh = format_of(path).read(path)
    return int(np.argmin(np.isin(mesh.cells[0].nodes, mesh.on(*mesh.names)).any(axis=1)))


def put_point(path: Path, value: float) -> None:
    with in_pieces(path) as found:
        put_row(found.pieces.ranges[0].table, 7, lambda own: np.full_like(own, value))


def put_row(table: tables.FileTable, row: int, values) -> None:
    own = table.read(row, row + 1)[0].copy()
    with table.path.open("r+b") as file:
        file.seek(table.begin + row * table.step)
        file.write(np.asarray(values(own), own.dtype).tobytes())


TWISTED = {4: [1, 0, 2, 3], 8: [1, 0, 2, 3, 4, 5, 6, 7]}
DAMAGE = {
    "a node too many": (lambda path: put(path, 1, 5, lambda own: own * 0 + 99999), "99999|99998|not among"),
    "a node too few": (lambda path: put(path, 1, 5, lambda own: own * 0 - 1), "nodes -2 to|not among"),
    "no number": (lambda path: put_point(path, np.nan), "points are not finite, the first is point 7$"),
    "too large": (lambda path: put_point(path, 1e41), r"points are beyond 1e\+40, the first is point 7$"),
    "inverted": (
        lambda path: put(path, 0, inner(path), lambda own: own[TWISTED[len(own)]]),
        r"1 of \d+ cells \(\w+\) are inverted",
    ),
    "cut": (lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3]), "truncated|end|shorter"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("suffix", [".cgns", ".lb8.ugrid", ".msh"])
def test_what_is_wrong_is_said_in_one_line(suffix, shared, damage, small, called, tmp_path, monkeypatch):
    monkeypatch.setattr(Threads, "shares_memory", shared or suffix == ".su2")  # whose tables are in this machine
    path = written(small, tmp_path / f"wing{suffix}")
    change, said = DAMAGE[damage]
    change(path)
    complaints = []
    for large in (1 << 60, 0):
        out = tmp_path / f"out{suffix}"
        words = ["--angle", "8", "--quiet", "--no-report", "--out", out]
        code, table, complaint, _ = called(large, "deflect", path, *FLAP, *words)
        assert (code, table, complaint.count("\n")) == (2, "", 1), complaint
        assert re.search(said, complaint)
        assert path.name in complaint
        complaints.append(complaint)
    assert complaints[0] == complaints[1] or damage != "inverted"
    assert {own.suffix for own in tmp_path.iterdir()} <= {path.suffix, ".mapbc"}

"""`sdm deflect --history`: a case of OpenFOAM that moves, as OpenFOAM itself reads and measures it."""

import json
import re
import shutil
from dataclasses import replace
from math import pi, sin

import numpy as np
import pytest

from benchmarks.foam_motion import LAPLACIAN, GivenBoundary, Motion
from sdm_deflect.cases.run.history import MOST_TIMES, History, deflect_history
from sdm_deflect.deform.base.errors import InputError
from sdm_deflect.deform.mesh.faces import FACE_SHAPES, FACES
from sdm_deflect.deform.mesh.mesh import Cells, Mesh, Patch
from sdm_deflect.deform.mesh.swept import Swept
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from sdm_deflect.meshing.formats.openfoam_history import Times
from sdm_deflect.meshing.formats.openfoam_write import header
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.calls import files_of_at_most
from tests.cases import foam
from tests.deform.blocks import grid
from tests.deform.jobs import turn
from tests.deform.plates import plate
from tests.deform.shapes import SHAPES, body_in, named

BODY = ["--surface", "body", "--hinge", "0,0,0", "0,1,0", "--quiet"]
TIMES = [k / 40 for k in range(9)]
PERIOD = [round(10.0 * sin(2.0 * pi * k / 8), 6) for k in range(9)]
NAMES = ["0", "0.025", "0.05", "0.075", "0.1", "0.125", "0.15", "0.175", "0.2"]
PCG = 'solvers { "cellDisplacement.*" { solver PCG; preconditioner diagonal; tolerance 1e-6; relTol 0; } }\n'
"""GAMG refuses cells that have no neighbour."""
LIST = re.compile(rb"nonuniform List<scalar>\n\d+\n\(.*?\)\n;", re.DOTALL)


def written(path, times=TIMES, angles=PERIOD, titles="time,angle"):
    path.write_text(f"{titles}\n" + "".join(f"{t!r},{a!r}\n" for t, a in zip(times, angles, strict=True)))
    return path


def points_at(case, time):
    return vectors(open_foam(case / time / "polyMesh", "points")).values


def field(path):
    """The numbers of a field of scalars that OpenFOAM or we wrote, in binary: those inside, then on patches.

    Of a uniform field there is one.
    """
    data, found, at = path.read_bytes(), [], 0
    while number := re.compile(rb"nonuniform List<scalar>\s+(\d+)\s*\(").search(data, at):
        at = number.end() + 8 * int(number[1])
        found.append(np.frombuffer(data[number.end() : at], "<f8"))
    uniform = re.search(rb"(?:internalField|value)\s+uniform\s+([-+.e\d]+)", data)
    return np.concatenate(found) if found else np.array([float(uniform[1])])


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """One period of a body in cells of each shape."""
    folder = tmp_path_factory.mktemp("cases")
    written(folder / "body.csv")
    made = {}
    for shape in SHAPES:
        source = folder / (f"{shape}.vtu" if shape == "polyhedron" else f"{shape}.su2")
        FORMATS["vtu" if shape == "polyhedron" else "su2"].write(body_in(shape), source)
        done = deflect_history(source, "body", [[0, 0, 0], [0, 1, 0]], folder / "body.csv")
        assert done.passed
        assert done.names == tuple(NAMES)
        made[shape] = folder / f"{shape}-history"
    return made


def test_a_period_is_a_case_with_the_times_of_openfoam(cases):
    case = cases["hexahedron"]
    assert sorted(path.name for path in case.iterdir()) == sorted([*NAMES, "case.foam", "constant", "system"])
    assert sorted(path.name for path in (case / "0").iterdir()) == ["polyMesh"]
    assert sorted(path.name for path in (case / "0.2").iterdir()) == ["V0", "meshPhi", "polyMesh"]
    mesh = body_in("hexahedron")
    np.testing.assert_array_equal(points_at(case, "0"), mesh.points)
    np.testing.assert_array_equal(OpenFoam().read(case).points, mesh.points)
    np.testing.assert_array_equal(points_at(case, "0.05"), turn(mesh, angle=10.0).points)
    content = {time: (case / time / "polyMesh" / "points").read_bytes().partition(b"}\n")[2] for time in NAMES}
    assert content["0"] == content["0.1"] == content["0.2"] != content["0.05"]
    assert content["0.025"] == content["0.075"] != content["0.125"] == content["0.175"]


@pytest.mark.parametrize("shape", SHAPES)
def test_openfoam_reads_every_time_and_its_own_volumes_change_by_our_sweeps(shape, cases, tmp_path):
    """checkMesh; div(meshPhi) is OpenFOAM's sum of our sweeps over its own volume."""
    case = tmp_path / "case"
    shutil.copytree(cases[shape], case)
    said = foam.run("checkMesh", case)
    assert re.findall(r"^Time = (.*)$", said, re.MULTILINE) == NAMES
    assert said.count("Mesh OK.") == len(NAMES)
    foam.run("postProcess", case, "-funcs", "(div(meshPhi) writeCellVolumes)")
    ones = np.ones(len(OpenFoam().read(case).cells[0]))
    volumes = [ones * field(case / time / "V")[: len(ones)] for time in NAMES]
    largest = 0.0
    for k in range(1, len(NAMES)):
        change = volumes[k] - volumes[k - 1]
        swept = field(case / NAMES[k] / "div(meshPhi)")[: len(change)] * volumes[k] * (TIMES[k] - TIMES[k - 1])
        np.testing.assert_array_less(np.abs(swept - change), 1e-12 * volumes[k])
        np.testing.assert_allclose(ones * field(case / NAMES[k] / "V0"), volumes[k - 1], rtol=1e-13)
        largest = max(largest, np.abs(change / volumes[k]).max())
    assert largest > 0.03


def apart(mesh, points):
    """Each cell of a mesh with nodes of its own, so that all are on the boundary; and where `points` are there."""
    first, blocks, faces, nodes = 0, [], {}, [block.nodes.ravel() for block in mesh.cells]
    for block in mesh.cells:
        own = first + np.arange(block.nodes.size).reshape(block.nodes.shape)
        first += own.size
        blocks.append(Cells(block.shape, own))
        for face in FACES[block.shape]:
            faces.setdefault(FACE_SHAPES[len(face)], []).append(own[:, list(face)])
    outer = Patch("all", tuple(Cells(shape, np.vstack(rows)) for shape, rows in faces.items()))
    return Mesh(mesh.points[np.concatenate(nodes)], tuple(blocks), (outer,)), points[np.concatenate(nodes)]


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if shape != "polyhedron"])
def test_faces_sweep_what_openfoam_says_that_they_sweep(shape, tmp_path):
    """moveDynamicMesh moves a boundary; of cells that are all boundary it moves every node to where we say."""
    whole = body_in(shape, 6)
    mesh, after = apart(whole, turn(whole).points)
    OpenFoam().write(mesh, tmp_path / "case")
    given = GivenBoundary(tmp_path / "case", mesh, "all", after - mesh.points, ())
    shutil.copytree(tmp_path / "case", tmp_path / "moved")
    given.write(Motion(LAPLACIAN, 1), tmp_path / "moved")
    (tmp_path / "moved" / "system" / "fvSolution").write_text(header("dictionary", "fvSolution", "system") + PCG)
    foam.run("moveDynamicMesh", tmp_path / "moved")
    moved = points_at(tmp_path / "moved", "1")
    np.testing.assert_allclose(moved, after, atol=1e-15)
    theirs = field(tmp_path / "moved" / "1" / "meshPhi")
    ours = Swept.of(OpenFoam().read(tmp_path / "case").cells[0], mesh.points, moved).faces
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-13 * np.abs(theirs).max())
    assert np.count_nonzero(np.abs(theirs) > 1e-6) > 0.5 * len(theirs)


def test_openfoam_starts_from_a_time_with_its_sweeps_and_old_volumes(cases, tmp_path):
    """It reads both there: it complains of numbers too few."""
    case = tmp_path / "case"
    shutil.copytree(cases["hexahedron"], case)
    foam.run("postProcess", case, "-time", "0.1", "-func", "writeCellVolumes")
    for name in ("V0", "meshPhi"):
        path = case / "0.1" / name
        good = path.read_bytes()
        path.write_bytes(LIST.sub(b"nonuniform List<scalar> 1(\0\0\0\0\0\0\0\0);", good, count=1))
        assert path.read_bytes() != good
        with pytest.raises(AssertionError, match=r"not equal to the given value|size 0"):
            foam.run("postProcess", case, "-time", "0.1", "-func", "writeCellVolumes")
        path.write_bytes(good)


KINDS = {
    "x-": "cyclic; neighbourPatch x+", "x+": "cyclic; neighbourPatch x-", "y-": "empty", "y+": "empty",
    "z-": "symmetryPlane", "z+": "patch",
}  # fmt: skip


def one_layer(case):
    """A case of one layer of cells around a body, as OpenFOAM has planes: empty, cyclic and symmetry patches."""
    points, cells = grid([-2.0, -0.25, -2.0], [2.0, 0.25, 2.0], [8, 1, 8])
    cells = cells[(np.abs(points[cells].mean(axis=1)) > 0.5).any(axis=1)]
    used, cells = np.unique(cells, return_inverse=True)
    block = Cells("hexahedron", cells.reshape(-1, 8))
    mesh = named(points[used] * [1.0, 8.0, 1.0], block)  # as wide as the block of which it knows the sides
    OpenFoam().write(replace(mesh, points=points[used]), case)
    path = case / MESH / "boundary"
    text = path.read_text()
    for name, kind in KINDS.items():
        text = re.sub(rf"( {re.escape(name)}|\n{re.escape(name)})\n\{{\n    type \w+;\n(    inGroups 1\(wall\);\n)?",
                      rf"\1\n{{\n    type {kind};\n", text)  # fmt: skip
    path.write_text(text)


def test_planes_of_openfoam_move_with_patches_of_its_own_kinds(sdm, tmp_path):
    one_layer(tmp_path / "plane")
    words = ["--slide", "y-:plane", "--slide", "y+:plane", "--history", written(tmp_path / "t.csv")]
    code, table, complaint = sdm("deflect", tmp_path / "plane", *BODY, *words)
    assert code == 0, table + complaint
    case = tmp_path / "plane-history"
    assert foam.run("checkMesh", case).count("Mesh OK.") == len(NAMES)
    flux = (case / "0.05" / "meshPhi").read_bytes()
    for name, kind in KINDS.items():
        own = "calculated" if kind == "patch" else kind.partition(";")[0]
        assert f"    {name}\n    {{\n        type {own};\n".encode() in flux
    foam.run("postProcess", case, "-time", "0.05", "-funcs", "(div(meshPhi) writeCellVolumes)")
    volumes = field(case / "0.05" / "V")[: len(OpenFoam().read(case).cells[0])]
    swept = field(case / "0.05" / "div(meshPhi)")[: len(volumes)] * volumes * 0.025
    np.testing.assert_allclose(swept, volumes - field(case / "0.05" / "V0"), rtol=0.0, atol=1e-12 * volumes.min())
    assert np.abs(swept).max() > 1e-3 * volumes.max()


def test_a_copy_of_a_users_case_gets_times_and_keeps_all_else(cases, sdm, tmp_path):
    """The first time's angle is not zero: it is that of the mesh in constant."""
    source = tmp_path / "my.case"
    shutil.copytree(cases["polyhedron"], source, ignore=lambda _, names: {name for name in names if name in NAMES})
    (source / "0").mkdir()
    (source / "0" / "U").write_text("mine")
    before = {path.relative_to(source): path.read_bytes() for path in source.rglob("*") if path.is_file()}
    written(tmp_path / "t.csv", [0.0, 1 / 3, 2 / 3], [4.0, 8.0, 4.0])
    code, table, complaint = sdm("deflect", source, *BODY, "--history", tmp_path / "t.csv")
    assert code == 0, complaint
    assert "set timePrecision 13 in its controlDict" in " ".join(table.split())
    out = tmp_path / "my-case-history"
    changed = [path for path, data in before.items() if (out / path).read_bytes() != data]
    assert changed == [MESH / "points"]
    np.testing.assert_array_equal(points_at(out, "0"), OpenFoam().read(out).points)
    np.testing.assert_array_equal(points_at(out, "0.6666666666667"), OpenFoam().read(out).points)
    assert np.abs(points_at(out, "0") - OpenFoam().read(source).points).max() > 0.01
    assert {path.relative_to(source): path.read_bytes() for path in source.rglob("*") if path.is_file()} == before
    code, _, complaint = sdm("deflect", out, *BODY, "--history", tmp_path / "t.csv", "--out", tmp_path / "again")
    assert (code, complaint.count("\n")) == (2, 1)
    assert "has a mesh that moves in 0" in complaint
    assert not (tmp_path / "again").exists()


def test_the_command_prints_what_it_did_and_a_dry_run_writes_nothing(sdm, tmp_path):
    FORMATS["su2"].write(body_in("wedge", 6), tmp_path / "body.su2")
    words = ["deflect", tmp_path / "body.su2", *BODY, "--history", written(tmp_path / "t.csv"), "--json"]
    code, out, _ = sdm(*words, "--dry-run")
    assert (code, json.loads(out)["files"]) == (0, [str(tmp_path / "body-history")])
    assert not (tmp_path / "body-history").exists()
    code, out, _ = sdm(*words)
    figures = json.loads(out)
    assert code == 0
    assert figures["history"]["folders"] == NAMES
    assert figures["history"]["angles"] == [angle + 0.0 for angle in PERIOD]
    assert len(figures["history"]["face_sweeps"]) == 8
    assert len(figures["angles"]) == 5
    (check,) = figures["validation"]["checks"]
    assert (check["name"], check["passed"]) == ("face_sweeps", True)
    assert 0.0 < check["value"] <= check["limit"] == 1e-12
    code, _, complaint = sdm(*words)
    assert code == 2
    assert "exists already" in complaint


def test_an_angle_that_spoils_the_mesh_fails_as_it_does_alone(sdm, tmp_path):
    FORMATS["su2"].write(body_in("hexahedron", 6), tmp_path / "body.su2")
    history = written(tmp_path / "t.csv", [0.0, 1.0, 2.0], [0.0, 5.0, 88.0])
    words = ["--history", history, "--margin", "0.6", "--steps", "1", "--repair", "off"]
    code, table, _ = sdm("deflect", tmp_path / "body.su2", *BODY, *words)
    assert code == 1
    assert "inverted_cells" in table
    assert "A VALIDATION FAILED: " in table


def test_shares_of_a_table_move_in_time_as_angles_do(sdm, tmp_path):
    mesh = body_in("tetra", 6)
    FORMATS["su2"].write(mesh, tmp_path / "body.su2")
    nodes = mesh.on("body")
    np.savez(tmp_path / "up.npz", points=mesh.points[nodes], vectors=np.full((len(nodes), 3), [0.0, 0.0, 0.1]))
    history = written(tmp_path / "t.csv", [-1.0, 0.0, 1.0], [0.0, 1.0, -0.5], "time,share")
    words = ["--surface", "body", "--table", tmp_path / "up.npz", "--history", history, "--quiet"]
    code, _, complaint = sdm("deflect", tmp_path / "body.su2", *words)
    assert code == 0, complaint
    moved = points_at(tmp_path / "body-history", "1")[nodes] - mesh.points[nodes]
    np.testing.assert_allclose(moved, np.full((len(nodes), 3), [0.0, 0.0, -0.05]), atol=1e-12)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no history"),
        ("time,angle\n", "no history"),
        ("time,angle\n0,1\n", "2 to 10000 numbers"),
        ("0,1\n1,2\n", "its first line must be the titles"),
        ("time,angle\n0,1\n0,2\n", "times must rise, but 0 follows 0"),
        ("time,angle\n1,1\n0.5,2\n", "times must rise, but 0.5 follows 1"),
        ("time,angle\n0,1\n1,nan\n", "not finite"),
        ("time,angle\n0,1\ninf,1\n", "not finite"),
        ("time,angle\n0,1\n1,two\n", "could not convert string 'two'"),
        ("time,angle\n0,1\n1\n", "number of columns changed"),
        ("time,angle\n0,1,2\n1,1,2\n", "rows of 3 numbers instead of time, angle"),
        ("time,angle\n0,1\n1,95\n", "95 deg of body is out of range"),
        ("time,angle\n0,1\n1e-300,2\n", "steps must be at least"),
        ("time,angle\n0,1\n1e35,2\n", "steps must be at least"),
        ("time,angle\n1e9,1\n1000000000.0000001,2\n", "steps must be at least"),
        ("time,angle\n" + "".join(f"{k},{k % 3}\n" for k in range(MOST_TIMES + 1)), "2 to 10000 numbers"),
        ("time,angle\n" + "".join(f"{k},{k / 1e3}\n" for k in range(1200)), "1200 different angles, at most 1000"),
        ("time,angle\n" + 2_000_000 * "0", "a history has at most 10000 times"),
        ("time,angle\n" + 5000 * "0,", "no history"),
        ("\0\n", "no history"),
    ],
)
def test_a_file_that_is_no_history_is_one_sentence(content, said, sdm, tmp_path):
    FORMATS["su2"].write(body_in("hexahedron", 4), tmp_path / "body.su2")
    (tmp_path / "t.csv").write_text(content)
    code, out, complaint = sdm("deflect", tmp_path / "body.su2", *BODY, "--history", tmp_path / "t.csv")
    assert (code, out, complaint.count("\n")) == (2, "", 1)
    assert said in complaint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["body.su2", "t.csv"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--angle", "0"], "--angle: --history has no use for it"),
        (["--angles", "1,2"], "--angles: --history has no use for it"),
        (["--sensitivity"], "--sensitivity: --history has no use for it"),
        (["--workers", "2"], "--workers: --history has no use for it"),
        (["--scheduler", "tcp://x:1"], "--scheduler: --history has no use for it"),
        (["--worker-memory", "2GB"], "--worker-memory: --history has no use for it"),
        (["--to-solver", "openfoam"], "--to-solver: --history has no use for it"),
        (["--far-field", "body"], "--far-field: --history has no use for it"),
        (["--report"], "--report: --history makes none"),
        (["--out", "turned.su2"], "a history becomes an OpenFOAM case; name a folder in out"),
        (["--out", "."], "exists already"),
    ],
)
def test_what_makes_no_sense_beside_a_history_is_refused(words, said, sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    FORMATS["su2"].write(body_in("hexahedron", 4), tmp_path / "body.su2")
    written(tmp_path / "t.csv")
    code, out, complaint = sdm("deflect", "body.su2", *BODY, "--history", "t.csv", *words)
    assert (code, out, complaint.count("\n")) == (2, "", 1)
    assert said in complaint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["body.su2", "t.csv"]


def test_parts_of_a_case_its_mesh_alone_and_plane_meshes_are_refused(cases, sdm, tmp_path):
    (tmp_path / "case" / "processor0" / MESH).mkdir(parents=True)
    with pytest.raises(InputError, match="put them together with reconstructParMesh"):
        deflect_history(tmp_path / "case", "body", [[0, 0, 0], [0, 1, 0]], History((0, 1), (0, 1)))
    with pytest.raises(InputError, match="name the folder of the case"):
        deflect_history(cases["tetra"] / MESH, "body", [[0, 0, 0], [0, 1, 0]], History((0, 1), (0, 1)))
    FORMATS["su2"].write(plate(), tmp_path / "plane.su2")
    written(tmp_path / "t.csv")
    words = ["--surface", "hole", "--hinge", "0,0", "--history", tmp_path / "t.csv", "--quiet"]
    code, _, complaint = sdm("deflect", tmp_path / "plane.su2", *words)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "OpenFOAM holds no two-dimensional meshes" in complaint


@pytest.mark.parametrize(
    ("times", "digits", "names"),
    [
        ((0.0, 0.1, 0.2, 0.30000000000000004), 6, ("0", "0.1", "0.2", "0.3")),
        ((-0.0, 1e-5, 2e-5), 6, ("0", "1e-05", "2e-05")),
        ((100.0, 100.001), 6, ("100", "100.001")),
        ((1000.0, 1000.001), 7, ("1000", "1000.001")),
        ((0.0, 1 / 3), 12, ("0", "0.333333333333")),
        ((-1.5, 0.0), 6, ("-1.5", "0")),
    ],
)
def test_times_are_called_as_openfoam_calls_them(times, digits, names):
    found = Times(times)
    assert (found.digits, found.names) == (digits, names)
    assert f"timePrecision   {digits};" in found.control


def test_a_history_of_python_is_checked_as_a_file_is():
    assert History([0, 1], np.array([5, -7])).largest == -7.0
    for times, angles in (([0, 1], [1]), ([0], [1]), ([[0, 1]], [[1, 2]]), ("ab", [1, 2]), ([0, 1], [1, None])):
        with pytest.raises(InputError, match="history"):
            History(times, angles)
    for value in (5, "\0", None):
        with pytest.raises(InputError, match="no path"):
            History.read(value)
        with pytest.raises(InputError, match="no path"):
            deflect_history(value, "body", [[0, 0, 0], [0, 1, 0]], History((0, 1), (0, 1)))


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_full_disk_is_one_line_and_leaves_nothing(share, cases, sdm, tmp_path):
    """A limit of the size of files stands for the disk: the mesh does not fit, or the sweeps do not."""
    FORMATS["su2"].write(body_in("hexahedron"), tmp_path / "body.su2")
    largest = max(path.stat().st_size for path in cases["hexahedron"].rglob("*"))
    words = ["--history", written(tmp_path / "t.csv"), "--set", "near_wall=false"]
    with files_of_at_most(int(share * largest)):
        code, _, complaint = sdm("deflect", tmp_path / "body.su2", *BODY, *words)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "cannot be written" in complaint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["body.su2", "t.csv"]


def test_progress_of_python_tells_of_every_stage(tmp_path):
    FORMATS["su2"].write(body_in("hexahedron", 6), tmp_path / "body.su2")
    told = []
    turned = [[0, 0, 0], [0, 1, 0]]
    done = deflect_history(
        tmp_path / "body.su2", "body", turned, History((0, 1), (0, 5)), tmp_path / "out",
        progress=lambda text, share: told.append(text), repair="off",
    )  # fmt: skip
    assert done.passed
    assert {"read", "plan", "deflect", "face sweeps", "time 1"} <= set(told)
    with pytest.raises(InputError, match="exists already"):
        deflect_history(tmp_path / "body.su2", "body", turned, History((0, 1), (0, 5)), tmp_path / "out")

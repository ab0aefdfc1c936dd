"""`sdm apply`: a saved plan moves mesh files, and the parts of a decomposed case, to the bits of the deflection."""

import json
import re
import shlex
import shutil

import numpy as np
import pytest
from scipy.spatial import KDTree

from sdm_deflect import InputError, deflect, read
from sdm_deflect.deform.mesh_motion import MeshMotion
from sdm_deflect.meshing.formats.openfoam import MESH, OpenFoam
from sdm_deflect.meshing.formats.openfoam_files import open_foam, vectors
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.cases import foam
from tests.deform.blocks import block_with_body, joined
from tests.deform.jobs import placed

TURN = ["--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--quiet"]
TURN += ["--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "8", "--no-report"]
AT_8 = ["--angle", "8"]
BODY = ["--surface", "body", "--hinge", "0,0,0", "0,1,0", "--angle", "5", "--no-report", "--quiet"]
DECOMPOSE = """FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }
numberOfSubdomains %d; method random;
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, hybrid_wing):
    """A wing as a case, in SU2 and in CGNS."""
    folder = tmp_path_factory.mktemp("apply")
    OpenFoam().write(hybrid_wing.mesh, folder / "wing")
    for name in ("wing.su2", "wing.cgns", "wing.vtu"):
        FORMATS[name.partition(".")[2]].write(hybrid_wing.mesh, folder / name)
    return folder


@pytest.fixture
def field(folder, sdm):
    """The field of the case, and the deflected case."""
    out, field = folder / "whole", folder / "flap.npz"
    if not field.exists():
        assert sdm("deflect", folder / "wing", *TURN, "--out", out, "--plan", field)[0] == 0
    return field


def decompose(case, count, form="writeFormat binary;"):
    """Cut a case with decomposePar, by chance: every part has nodes on most others."""
    control = case / "system" / "controlDict"
    control.write_text(re.sub(r"writeFormat +\w+;", form, control.read_text()))
    (case / "system" / "decomposeParDict").write_text(DECOMPOSE % count)
    foam.run("decomposePar", case)


def points_in(part):
    return vectors(open_foam(part / MESH, "points")).values


@pytest.mark.parametrize(("count", "form"), [(3, "binary"), (8, "binary"), (3, "ascii")])
def test_the_parts_of_the_deflected_whole_are_the_moved_parts(count, form, folder, field, sdm, tmp_path):
    case, deflected = tmp_path / "case", tmp_path / "deflected"
    shutil.copytree(folder / "wing", case)
    shutil.copytree(folder / "whole", deflected)
    for one in (case, deflected):
        decompose(one, count, f"writeFormat {form}; writePrecision 17;")
    parts = sorted(case.glob("processor*"))
    for path in (*case.glob(f"processor*/{MESH}/faces"), *case.glob(f"processor*/{MESH}/owner")):
        path.rename(path.with_suffix(".away"))  # nothing but points is read
    code, said, _ = sdm("apply", field, *AT_8, *parts, "--out", tmp_path / "moved", "--json", "--quiet")
    for path in case.glob(f"processor*/{MESH}/*.away"):
        path.rename(path.with_suffix(""))
    assert code == 0
    told = json.loads(said)
    assert [one["points"] for one in told["files"]] == [len(points_in(part)) for part in parts]
    assert told["missing"] == 0
    for part in parts:
        moved, expected = tmp_path / "moved" / part.name, deflected / part.name
        assert np.array_equal(points_in(moved), points_in(expected))
        if form == "binary":
            assert (moved / MESH / "points").read_bytes() == (expected / MESH / "points").read_bytes()
    shutil.rmtree(tmp_path / "moved")
    assert sdm("apply", field, *AT_8, *parts, "--quiet")[0] == 0
    moved = tmp_path / "case-deflected"
    assert not (moved / MESH / "points").exists()
    assert all((moved / part.name / MESH / "faces").is_symlink() for part in parts)
    before, after = (foam.run("checkMesh", one, ranks=count) for one in (case, moved))
    assert foam.complaints(after) == foam.complaints(before)
    foam.run("reconstructParMesh", moved, "-constant")
    whole = OpenFoam().read(deflected).points
    distance, nearest = KDTree(whole).query(OpenFoam().read(moved).points)  # in an order of its own
    assert sorted(nearest) == list(range(len(whole)))
    assert distance.max() <= (1e-15 if form == "ascii" else 0.0)


@pytest.mark.parametrize("count", [3, 8])
def test_one_plan_moves_the_parts_to_every_angle_of_its_range(count, folder, sdm, tmp_path):
    angles, held = (-5, 3, 8), tmp_path / "flap.npz"
    words = [*TURN[:-3], "--no-report", "--angles=-5,3,8", "--plan", held, "--out", tmp_path / "whole"]
    assert sdm("deflect", folder / "wing", *words)[0] == 0
    case = tmp_path / "case"
    shutil.copytree(folder / "wing", case)
    decompose(case, count, "writeFormat binary; writePrecision 17;")
    parts = sorted(case.glob("processor*"))
    for angle in angles:
        whole = OpenFoam().read(tmp_path / f"whole_{angle:+d}")
        moved = tmp_path / f"moved{angle}"
        code, said, _ = sdm("apply", held, f"--angle={angle}", *parts, "--out", moved, "--json", "--quiet")
        told = json.loads(said)
        assert (code, told["faults"], told["missing"]) == (0, [], 0)
        assert told["ranges"] == {"flap": [-5.0, 8.0]}
        foam.run("reconstructParMesh", moved, "-constant")
        distance, nearest = KDTree(whole.points).query(OpenFoam().read(moved).points)
        assert sorted(nearest) == list(range(len(whole.points)))
        assert distance.max() == 0.0


def test_amounts_that_did_not_pass_end_with_1(folder, sdm, tmp_path):
    held = tmp_path / "flap.npz"
    words = [*TURN[:-3], "--range", "-80:10", "--plan", held, "--no-mesh", "--steps", "1", "--repair", "off"]
    code, said, _ = sdm("deflect", folder / "wing.su2", *words, "--out", tmp_path / "x.su2", "--json")
    (surface,) = json.loads(said)["plan"]["surfaces"]
    assert (code, surface["range"], len(surface["measured"])) == (1, [-80.0, 10.0], 9)
    assert json.loads(said)["verdict"].startswith("FAILED: plan: flap passed -")
    assert json.loads(said)["verdict"].endswith(" of -80:10 deg; try range -40:5")
    assert surface["passed"][0] > -80.0
    assert not (tmp_path / "x.su2").exists()
    for angle, wanted in ((surface["passed"][0], 0), (-79.0, 1), (12.0, 2)):
        out = tmp_path / f"{angle}.su2"
        code, said, err = sdm("apply", held, f"--angle={angle}", folder / "wing.su2", "--out", out)
        assert code == wanted, err
        assert ("FAILED: do not use this mesh; flap = -79 deg: outside" in said) == (wanted == 1)


def test_a_part_alone_says_what_is_elsewhere_and_keeps_the_rest(folder, field, sdm, tmp_path):
    case = tmp_path / "case"
    shutil.copytree(folder / "wing", case)
    decompose(case, 3)
    before = {path: path.read_bytes() for path in case.rglob("*") if path.is_file()}
    code, said, _ = sdm("apply", field, *AT_8, case / "processor1")
    assert code == 0
    assert re.search(r"case-deflected/processor1: \d+ of \d+ points moved", said)
    assert re.search(rf"\d+ of \d+ places of {field} are in none of these meshes", said)
    assert not (tmp_path / "case-deflected" / "processor0").exists()
    assert {path: path.read_bytes() for path in before} == before
    assert {path for path in case.rglob("*") if path.is_file()} == {*before}


@pytest.mark.parametrize("name", ["wing.su2", "wing.cgns", "wing.vtu", "wing"])
def test_a_mesh_of_any_format_is_moved_as_deflect_moves_it(name, folder, field, sdm, tmp_path):
    code, said, _ = sdm("apply", field, *AT_8, folder / name, "--out", tmp_path / f"moved{name[4:]}", "--quiet")
    assert (code, "points moved" in said) == (0, True)
    assert np.array_equal(read(tmp_path / f"moved{name[4:]}").points, OpenFoam().read(folder / "whole").points)


def test_several_meshes_are_written_together_beside_themselves(folder, field, sdm, tmp_path):
    for name in ("wing.su2", "wing.cgns"):
        shutil.copy(folder / name, tmp_path)
    code, said, _ = sdm("apply", field, *AT_8, tmp_path / "wing.su2", tmp_path / "wing.cgns", "--json", "--quiet")
    assert code == 0
    assert [one["file"] for one in json.loads(said)["files"]] == [
        str(tmp_path / name) for name in ("wing-deflected.su2", "wing-deflected.cgns")
    ]
    (tmp_path / "wing.cgns").write_bytes((tmp_path / "wing.cgns").read_bytes()[:3000])
    (tmp_path / "wing-deflected.su2").unlink()
    assert sdm("apply", field, *AT_8, tmp_path / "wing.su2", tmp_path / "wing.cgns", "--quiet")[0] == 2
    assert not (tmp_path / "wing-deflected.su2").exists()


@pytest.fixture
def pair(tmp_path):
    """Two zones at one place, each with a body; the body of the first turns."""
    one = block_with_body(8)
    FORMATS["cgns"].write(joined(one, one), tmp_path / "pair.cgns")
    return tmp_path


def test_other_zones_stay_unless_they_deform(pair, sdm):
    names = (pair / name for name in ("pair.cgns", "field.npz", "turned.cgns", "both.cgns"))
    source, field, turned, both = names
    assert sdm("deflect", source, *BODY, "--plan", field, "--out", turned)[0] == 1  # nodes of the other body stay
    code, said, _ = sdm("apply", field, "--angle", "5", source, "--quiet")
    assert (code, "FAILED: do not use this mesh; body = 5 deg: no amount passed; failed: left_behind" in said) == (
        1,
        True,
    )  # the plan knows
    found, start = read(pair / "pair-deflected.cgns").points, read(source).zones[1].start
    assert np.array_equal(found, read(turned).points)
    assert np.array_equal(found[start:], read(source).points[start:])
    assert sdm("apply", field, "--angle", "5", source, "--zone", "far", "--quiet", "--out", both)[0] == 1
    moved = read(both).points
    assert np.array_equal(moved[start:], moved[:start])


def test_a_plan_and_a_mesh_that_do_not_belong_together(folder, field, sdm, tmp_path):
    FORMATS["su2"].write(block_with_body(8), tmp_path / "block.su2")
    code, _, said = sdm("apply", field, *AT_8, tmp_path / "block.su2", "--quiet")
    assert code == 2
    assert re.search(r"is of another mesh: 0 of its \d+ places are points of block\.su2", said)
    mesh = read(folder / "wing.su2")
    points = mesh.points.copy()
    points[mesh.on("flap_upper")[::2]] += 1e-3
    FORMATS["su2"].write(mesh.with_points(points), tmp_path / "other.su2")
    code, _, said = sdm("apply", field, *AT_8, tmp_path / "other.su2", "--quiet")
    assert code == 2
    assert re.search(r"is of another mesh: \d+ of its \d+ places are points of other\.su2", said)
    FORMATS["su2"].write(mesh.with_points(np.round(mesh.points, 9)), tmp_path / "rounded.su2")
    code, _, said = sdm("apply", field, *AT_8, tmp_path / "rounded.su2", "--quiet")
    assert code == 2
    assert re.search(r"\d+ of its places are nearly points of rounded\.su2: write all digits", said)
    FORMATS["ugrid"].write(mesh, tmp_path / "wing.lb4.ugrid")
    code, _, said = sdm("apply", field, *AT_8, tmp_path / "wing.lb4.ugrid", "--quiet")
    assert (code, "wing.lb4.ugrid: has coordinates of 32 bits" in said) == (2, True)
    assert not list(tmp_path.glob("*-deflected*"))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("places", lambda array: 1e300 * array),
        ("places", lambda array: array[:-1]),
        ("fields_0", lambda array: np.nan * array),
        ("fields_0", lambda array: array[:1]),
        ("rows_0", lambda array: array[::-1]),
        ("rows_0", lambda array: array + 10**6),
        ("box", lambda array: array - 1),
        ("corners_0", lambda array: array[:7]),
        ("plan", lambda array: None),
        ("plan", lambda array: np.array("{}")),
        ("plan", lambda array: np.array(str(array).replace("fixed", "mixed"))),
    ],
)
def test_a_damaged_plan_is_one_sentence(name, change, folder, field, sdm, tmp_path):
    with np.load(field) as stored:
        arrays = dict(stored)
    arrays[name] = change(arrays[name])
    np.savez(tmp_path / "bad.npz", **{key: array for key, array in arrays.items() if array is not None})
    code, _, said = sdm(
        "apply", tmp_path / "bad.npz", *AT_8, folder / "wing.su2", "--out", tmp_path / "out.su2", "--quiet"
    )
    assert code == 2
    assert said.startswith(f"sdm: {tmp_path / 'bad.npz'}: ")
    assert said.count("\n") == 1
    assert not (tmp_path / "out.su2").exists()


def test_a_plan_appears_with_its_mesh_or_not_at_all(folder, sdm, tmp_path, monkeypatch):
    shutil.copy(folder / "wing.su2", tmp_path)
    out, field = tmp_path / "out.su2", tmp_path / "f.npz"
    words = ["deflect", tmp_path / "wing.su2", *TURN, "--out", out, "--plan", field]
    assert sdm(*words)[0] == 0
    before = {path: path.read_bytes() for path in (out, field)}

    def changed(_):
        raise InputError("wing.su2: was changed or replaced while it was in use; run the command again")

    monkeypatch.setattr("sdm_deflect.cases.run.deflect_file.check_unchanged", changed)
    assert sdm(*words, "--angle", "3")[0] == 2
    assert {path: path.read_bytes() for path in (out, field)} == before
    for name in (tmp_path / "f.txt", tmp_path / "deep" / "f.npz"):
        code, _, said = sdm(*words[:-1], name)
        assert (code, "must be an .npz in" in said) == (2, True)


def test_what_cannot_be_is_one_sentence(folder, field, sdm, tmp_path):
    case = tmp_path / "case"
    (case / "processor0" / MESH).mkdir(parents=True)
    shutil.copy(folder / "wing" / MESH / "points", case / "processor0" / MESH)
    (case / "processors4" / MESH).mkdir(parents=True)
    way = "join it by `reconstructParMesh -constant`, deflect the whole with --plan FILE, and move the parts by "
    way += f"`sdm apply FILE --angle A {case}/processor* --out CASE`"
    both = [folder / "wing.su2", folder / "wing.cgns"]
    for words, want in (
        (["deflect", case / "processor0", *TURN], f"{case}: is decomposed: {way}"),
        (["quality", case], f"{case}: is decomposed: {way}"),
        (["apply", field, *AT_8, case], f"{case}: is decomposed: {way}"),
        (["apply", field, *AT_8, case / "processors4"], "is collated: decompose it with `-fileHandler uncollated`"),
        (
            ["apply", field, *AT_8, case / "processor0", folder / "wing.su2"],
            "name mesh files, or parts of one case, in one",
        ),
        (["apply", field, *AT_8, *both, "--out", "x.su2"], "is one place, and there are 2"),
        (
            ["apply", field, *AT_8, folder / "wing.su2", "--out", tmp_path / "x.cgns"],
            "is applied to a copy; name a file .su2",
        ),
        (["apply", field, *AT_8, folder / "wing.su2", "--out", folder / "wing.su2"], "this is a file that is read"),
        (["apply", folder / "wing.su2", *AT_8, folder / "wing.su2"], "wing.su2: no archive of arrays"),
        (["deflect", folder / "wing.su2", *TURN, "--no-mesh"], "nothing would be written; name a file in --plan"),
        (["deflect", folder / "wing.su2", *TURN, "--range", "9:20"], "range = 9:20 of flap_* must hold 0 and 8"),
        (["apply", field, "--angle", "7", folder / "wing.su2"], "7: the plan is of 8 alone; make one with a range"),
        (["apply", field, "--angle", "9", folder / "wing.su2"], "flap = 9 deg is outside its range 0:8"),
        (["apply", field, "--angle", "tab=9", folder / "wing.su2"], "'tab' is no surface of the plan"),
        (["apply", field, "--angle", "a b", folder / "wing.su2"], "must be a number, or NAME=NUMBER with commas"),
    ):
        code, _, said = sdm(*words)
        assert (code, said.count("\n")) == (2, 1), words
        assert want in said


def test_a_report_leaves_a_large_plan_out_and_says_how_to_write_it(folder, sdm, tmp_path, monkeypatch):
    monkeypatch.setattr("sdm_deflect.cases.report.folder.LARGEST_PLAN", 1e3)
    monkeypatch.chdir(tmp_path)
    shutil.copy(folder / "wing.su2", tmp_path)
    assert sdm("deflect", "wing.su2", *TURN[:-1])[0] == 0
    report = tmp_path / "wing-deflected-report"
    assert not (report / "plan.npz").exists()
    (note,) = (one for one in json.loads((report / "metrics.json").read_text())["notes"] if "plan.npz" in one)
    way = shlex.split(re.search("`(.+)`", note)[1])
    assert sdm(*way[1:])[0] == 0
    assert sdm("apply", "plan.npz", "--angle", "8", "wing.su2", "--out", "moved.su2")[0] == 0
    np.testing.assert_allclose(read("moved.su2").points, read("wing-deflected.su2").points, atol=1e-12)


def test_nodes_at_one_place_that_move_apart_have_no_plan_by_place():
    mesh = block_with_body(8)
    both = joined(mesh, mesh)
    one = deflect(both, ["body", "body'"], [[0, 0, 0], [0, 1, 0]], 5.0).deflection
    assert np.array_equal(MeshMotion.of_one_amount(one, ()).on(both.points).at(5.0), one.points)
    moved = one.points.copy()
    moved[one.plan.boxes[0].sites.moving[-1], 0] += 0.01
    with pytest.raises(InputError, match="nodes at one place move apart"):
        MeshMotion.of_one_amount(placed(one, moved), ()).on(both.points)

"""`sdm deflect` from the command line, on files."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect import deflect
from sdm_deflect.cases.run.mesh_files import HEAD
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS, format_of
from tests.deform.blocks import block_with_body, two_bodies
from tests.meshing.formats import fluent_files

FLAP = ["--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--no-report"]
HINGE = ["--hinge", "0.7,0.3,0", "0.7,0.7,0"]
TURN = [*FLAP, *HINGE, "--angle", "8"]


@pytest.fixture(scope="module")
def files(tmp_path_factory, hybrid_wing):
    """The wing in every format."""
    folder = tmp_path_factory.mktemp("meshes")
    made = {"fluent": fluent_files.written(hybrid_wing.mesh, folder / "wing.cas.h5", compression="gzip", chunks=True)}
    for name in writable():
        known = FORMATS[name]
        path = folder / ("case" if name == "openfoam" else f"wing{known.suffixes[0]}")
        known.write(hybrid_wing.mesh, path)
        made[name] = path
    return made


@pytest.fixture
def sdm(sdm):
    return lambda command, *words: sdm(command, "--no-report", *words)


def content(path):
    if path.is_dir():
        return {p.relative_to(path): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}
    return path.read_bytes()


def test_a_report_stands_beside_the_mesh_unless_it_is_not_wanted(files, sdm, tmp_path):
    words = ["deflect", files["su2"], *TURN, "--dry-run", "--json", "--out", tmp_path / "w.su2"]
    plain, reported = (json.loads(sdm(*words, *more)[1])["files"] for more in ([], ["--report"]))
    assert plain == [str(tmp_path / "w.su2")]
    assert len(reported) == 2


@pytest.mark.parametrize("name", sorted([*writable(), "fluent"]))
def test_each_format_is_deflected_in_itself_and_the_input_stays(name, files, sdm, tmp_path):
    source, out = files[name], tmp_path / ("turned" if name == "openfoam" else files[name].name)
    before = content(source)
    code, table, _ = sdm("deflect", source, *TURN, "--out", out, "--quiet")
    assert code == 0, table
    assert "all validations passed" in table
    assert content(source) == before
    old, new = format_of(source).read(source), format_of(out).read(out)
    assert {p.name: len(p) for p in new.patches} == {p.name: len(p) for p in old.patches}
    moved = np.abs(new.points - old.points).max(axis=1)
    assert moved[old.on("flap_base")].max() > 0.02
    assert not moved[old.on("wing_upper", "far_field")].any()


def test_few_lines_say_what_counts_and_verbose_says_all(files, sdm, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    words = ["deflect", files["su2"], *TURN, "--out", tmp_path / "w.su2"]
    lines, whole = (sdm(*words, *more)[1].splitlines() for more in (["--quiet"], ["--verbose"]))
    assert len(lines) <= 9  # the name of three patches takes a line of its own
    for text in (" moves by up to ", "^cells .* 0\\.\\d+ .* hexahedra$", f"^wrote +{tmp_path}"):
        assert any(re.search(text, line) for line in lines), text
    turned = "flap_upper, flap_lower, flap_base turn by 75 % of their angle on average (--strip)"
    assert lines[-1] == whole[-1] == f"all validations passed; {turned}"
    for text in ("outside_moved", "box along the hinge", "data sites:", "kernel:"):
        assert not any(text in line for line in lines), text
        assert any(text in line for line in whole), text


def test_boundary_conditions_of_an_earlier_export_stay(files, sdm, tmp_path):
    out, table = tmp_path / "wing.lb8.ugrid", tmp_path / "wing.mapbc"
    words = ["deflect", files["su2"], *TURN, "--out", out, "--quiet"]
    assert sdm(*words)[0] == 0
    assert FORMATS["ugrid"].read(out).names == FORMATS["su2"].read(files["su2"]).names
    table.write_text(table.read_text().replace(" 4000 ", " 3000 "))
    edited = table.read_bytes()
    assert sdm(*words)[0] == 0
    assert table.read_bytes() == edited
    table.write_bytes(edited.replace(b"wing_upper", b"wing"))
    code, _, complaint = sdm(*words)
    assert code == 2
    assert f"{table}: is there and names other surfaces" in complaint


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(files, sdm, tmp_path):
    source = shutil.copy(files["su2"], tmp_path / "wing.su2")
    code, table, _ = sdm("deflect", source, *TURN, "--dry-run")
    assert code == 0
    for text in ("moves by +8 deg", "fixed", "slides", "outside", "data sites", "would write", "wing-deflected.su2"):
        assert "".join(text.split()) in "".join(table.split())
    plan = json.loads(sdm("deflect", source, *TURN, "--dry-run", "--json")[1])
    assert plan["files"] == [str(tmp_path / "wing-deflected.su2")]
    assert plan["sites"]["surface"] > 0
    assert [path.name for path in tmp_path.iterdir()] == ["wing.su2"]


def test_a_warning_comes_first_and_is_counted_by_the_verdict(files, sdm, tmp_path, monkeypatch):
    """The hinge is on the other half of the wing: every check holds, and the flap turns the other way."""
    monkeypatch.setenv("COLUMNS", "160")
    words = ["deflect", files["su2"], *FLAP, "--hinge", "0.7,-0.3,0", "0.7,-0.7,0", "--angle", "8", "--quiet"]
    warning = "hinge: its two points cover 0 % of the span of flap_"
    code, table, _ = sdm(*words, "--out", tmp_path / "w.su2", "--report")
    lines = [line for line in table.splitlines() if line]
    assert code == 0
    assert lines[0] == lines[-1]
    assert lines[0].startswith("all validations passed, 3 warnings; flap_upper, flap_lower, flap_base turn by ")
    assert lines[1].startswith(f"warning: {warning}")
    assert sdm(*words, "--dry-run")[1].splitlines()[0].startswith(f"warning: {warning}")
    figures = json.loads(sdm(*words, "--dry-run", "--json")[1])
    assert figures["warnings"][0].startswith(warning)
    page = (tmp_path / "w-report" / "report.html").read_text()
    parts = (
        "all validations passed, 3 warnings</b>",
        "<b>3 warnings:</b> hinge: its two points cover 0 % of the span of flap_",
        "<p>flap turns by ",
        '<h2 id="slices">',
    )
    assert sorted(parts, key=page.index) == list(parts)
    assert json.loads((tmp_path / "w-report" / "metrics.json").read_text())["warnings"] == figures["warnings"]
    wing = {"fixed": "wing_*", "slide": "symmetry:plane", "motion": "blended"}
    with pytest.warns(UserWarning, match="hinge: its"):
        result = deflect(str(files["su2"]), "flap_*", [[0.7, -0.3, 0], [0.7, -0.7, 0]], 8, **wing)
    assert list(result.notes[:4]) == [*figures["warnings"], *figures["short_turns"]]
    assert result.title.endswith(f": all validations passed; {lines[0].partition('; ')[2]}")
    assert f"warning: {warning}" in repr(result)


def test_a_hinge_without_commas_is_refused_with_the_way_out(files, sdm):
    code, _, err = sdm("deflect", files["su2"], *FLAP, "--hinge", "0.865 -0.05", "--angle", "-1")
    assert (code, err) == (2, "sdm: --hinge '0.865 -0.05': write a point with commas, 0.865,-0.05\n")


def test_wildcards_of_fixed_patches_mean_the_others(files, sdm):
    """A wildcard for what stays that also matches the moving patch does not stop it."""
    words = ["--surface", "flap_*", "--fixed", "*_*", "--slide", "symmetry:plane", "--motion", "blended", *HINGE]
    code, table, complaint = sdm("deflect", files["su2"], *words, "--angle", "8", "--dry-run", "-q")
    assert code == 0, complaint
    assert "moves by +8 deg" in table


@pytest.mark.parametrize(("share", "code"), [("0.999", 1), ("0.1", 0), ("0", 0)])
def test_quality_may_not_fall_below_its_share(share, code, files, sdm, tmp_path):
    words = ["deflect", files["su2"], *TURN, "--out", tmp_path / "w.su2", "--json"]
    ended, out, _ = sdm(*words, "--min-quality", share)
    (one,) = json.loads(out)["angles"]
    found = {check["name"]: check["passed"] for check in one["validation"]["checks"] if "quality_min" in check["name"]}
    assert ended == code
    assert bool(found) == (share != "0")
    assert all(found.values()) == (code == 0)


def test_a_sweep_writes_a_file_for_each_angle_with_report_and_sensitivities(files, sdm, tmp_path):
    out = tmp_path / "flap.su2"
    words = [*FLAP, *HINGE, "--angles", "-4:8:4", "--out", out, "--json", "--sensitivity", "--repair", "off"]
    code, table, _ = sdm("deflect", files["su2"], *words)
    assert code == 0, table
    names = {path.name for path in tmp_path.iterdir()}
    angles = ("-4", "+0", "+4", "+8")
    assert {f"flap_{a}.su2" for a in angles} <= names
    assert "flap.json" not in names
    assert {f"flap_{a}-sensitivity.{s}" for a in angles for s in ("npz", "vtu")} <= names
    report = json.loads(table)
    assert report["passed"]
    assert [one["angle"] for one in report["angles"]] == [-4.0, 0.0, 4.0, 8.0]
    with np.load(tmp_path / "flap_+4-sensitivity.npz") as arrays:
        points, rates = arrays["points"], arrays["d_points_d_angle"]
    read = {a: FORMATS["su2"].read(tmp_path / f"flap_{a}.su2").points for a in angles}
    np.testing.assert_allclose(points, read["+4"], atol=1e-12)
    edge = FORMATS["su2"].read(files["su2"]).on("flap_base")
    np.testing.assert_allclose(rates[edge], (read["+8"] - read["+0"])[edge] / 8.0, atol=1e-5)
    import pyvista

    assert "d_points_d_angle" in pyvista.read(tmp_path / "flap_+4-sensitivity.vtu").point_data


def test_a_configuration_says_the_same_as_options(files, sdm, tmp_path):
    (tmp_path / "job.toml").write_text(
        'fixed = ["wing_*"]\nslide = { symmetry = "plane" }\n[[surface]]\npatches = ["flap_*"]\n'
        'hinge = [[0.7, 0.3, 0], [0.7, 0.7, 0]]\nangle = 8\nmotion = "blended"\n'
    )
    one, other, third = (tmp_path / f"{name}.su2" for name in ("one", "other", "third"))
    assert sdm("deflect", files["su2"], "--config", tmp_path / "job.toml", "--out", one, "--quiet")[0] == 0
    assert sdm("deflect", files["su2"], *TURN, "--out", other, "--quiet")[0] == 0
    assert one.read_bytes() == other.read_bytes()
    code, *_ = sdm("deflect", files["su2"], "--config", tmp_path / "job.toml", "--angle", 4, "--out", third, "--quiet")
    assert code == 0
    assert third.read_bytes() != one.read_bytes()


def test_a_first_surface_that_stays_does_not_keep_the_second_from_moving(sdm, tmp_path):
    mesh = two_bodies()
    FORMATS["su2"].write(mesh, tmp_path / "pair.su2")
    (tmp_path / "job.toml").write_text(
        '[[surface]]\npatches = "left"\nhinge = [[-1, 0, 0], [-1, 1, 0]]\nangle = 0\n'
        '[[surface]]\npatches = "right"\nhinge = [[1, 0, 0], [1, 1, 0]]\nangle = 15\n'
    )
    words = ("deflect", tmp_path / "pair.su2", "--config", tmp_path / "job.toml", "--quiet")
    code, table, _ = sdm(*words, "--out", tmp_path / "turned.su2")
    assert code == 0, table
    moved = np.abs(FORMATS["su2"].read(tmp_path / "turned.su2").points - mesh.points).max(axis=1)
    assert not moved[mesh.on("left")].any()
    assert moved[mesh.on("right")].max() > 0.1
    code, _, complaint = sdm(*words, "--angles", "0,5", "--out", tmp_path / "swept.su2")
    assert code == 2
    assert "put right first, or give rows of amounts" in complaint


def test_a_mesh_that_replaces_an_older_one_says_so(sdm, tmp_path):
    FORMATS["su2"].write(two_bodies(), tmp_path / "pair.su2")
    hinge = ("--hinge", "-1,0,0", "-1,1,0", "--no-report", "--quiet", "--out", tmp_path / "turned.su2")
    words = ("deflect", tmp_path / "pair.su2", "--surface", "left", *hinge, "--angle")
    assert "was replaced" not in sdm(*words, 5)[1]
    assert re.search("^note +an older turned.su2 was replaced$", sdm(*words, 6)[1], re.MULTILINE)


def test_the_files_of_a_sweep_name_the_amounts_of_all_surfaces(sdm, tmp_path):
    FORMATS["su2"].write(two_bodies(), tmp_path / "pair.su2")
    (tmp_path / "job.toml").write_text(
        '[[surface]]\npatches = "left"\nhinge = [[-1, 0, 0], [-1, 1, 0]]\nangle = 10\n'
        '[[surface]]\npatches = "right"\nhinge = [[1, 0, 0], [1, 1, 0]]\nangle = -5\n'
    )
    words = ("--config", tmp_path / "job.toml", "--no-report", "--quiet", "--angles", "-4,2")
    code, said, error = sdm("deflect", tmp_path / "pair.su2", *words)
    assert code == 0, said + error
    names = {path.name for path in tmp_path.glob("*deflected*")}
    assert names == {"pair-deflected_-4_+2.su2", "pair-deflected_+2_-1.su2", "pair-deflected.csv"}
    with (tmp_path / "pair-deflected.csv").open() as table:
        first, second = csv.DictReader(table)
    assert (first["file"], first["left"], first["right"]) == ("pair-deflected_-4_+2.su2", "-4.0", "2.0")
    assert (second["file"], second["left"], second["right"]) == ("pair-deflected_+2_-1.su2", "2.0", "-1.0")
    assert first["verdict"] == "all validations passed"
    assert 0.9 < float(first["least_quality"]) < 1.0
    assert float(first["right_share"]) == pytest.approx(1.0)
    assert [float(first[f"right_{end}_{axis}"]) for end in ("first", "second") for axis in "xyz"] == [1, 0, 0, 1, 1, 0]


TWO = (
    '[[surface]]\npatches = "left"\nhinge = [[-1, 0, 0], [-1, 1, 0]]\n'
    '[[surface]]\npatches = "right"\nhinge = [[1, 0, 0], [1, 1, 0]]\n'
)


@pytest.fixture
def paired_bodies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    FORMATS["su2"].write(two_bodies(), tmp_path / "pair.su2")
    (tmp_path / "job.toml").write_text(TWO)
    return ("deflect", "pair.su2", "--config", "job.toml", "--no-report", "--quiet", "--angles", "doe.csv")


def test_rows_of_amounts_are_meshes_with_derivatives_of_their_own(sdm, paired_bodies):
    rows = [(0.0, 4.0), (0.0, -2.0), (-3.0, 1.0)]
    Path("doe.csv").write_text("\ufeffright, left\n" + "".join(f"{right},{left}\n" for left, right in rows))
    code, said, error = sdm(*paired_bodies, "--sensitivity", "--json")
    assert code == 0, said + error
    figures = json.loads(said)
    mesh = two_bodies()
    assert sorted(
        (one["surfaces"]["left"]["amount"], one["surfaces"]["right"]["amount"]) for one in figures["angles"]
    ) == sorted(rows)
    for left, right in rows:
        name = f"pair-deflected_{left:+g}_{right:+g}"
        expected = deflect(
            mesh,
            [
                {"patches": "left", "hinge": [[-1, 0, 0], [-1, 1, 0]], "angle": left},
                {"patches": "right", "hinge": [[1, 0, 0], [1, 1, 0]], "angle": right},
            ],
        )
        points = FORMATS["su2"].read(Path(f"{name}.su2")).points
        for side in ("left", "right"):
            np.testing.assert_allclose(points[mesh.on(side)], expected.points[mesh.on(side)], atol=1e-14)
        assert np.abs(points - expected.points).max() < 0.01
        with np.load(f"{name}-sensitivity.npz") as stored:
            assert stored["surfaces"].tolist() == ["left", "right"]
            rates = dict(zip(stored["surfaces"], stored["d_points_d_angle"], strict=True))
        assert not rates["left"][mesh.on("right")].any()
        radius = points[mesh.on("right")] - [1.0, 0.0, 0.0]
        np.testing.assert_allclose(
            rates["right"][mesh.on("right")], np.radians(1.0) * np.cross([0, 1, 0], radius), atol=1e-11
        )
    with Path("pair-deflected.csv").open() as table:
        assert [(float(one["left"]), float(one["right"])) for one in csv.DictReader(table)] == sorted(rows)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("left\n1\n", "one column for each surface, titled left,right; its titles are left"),
        ("left,flap\n1,2\n", "titled left,right; its titles are left,flap"),
        ("left,right\n1,nan\n", "1 to 1000 rows of finite numbers"),
        ("left,right\n1\n", "2 titles stand above 1 columns"),
        ("left,right\n", "no table of amounts"),
        ("left,right\n1,95\n", "angle = 95 deg of right is out of range"),
    ],
)
def test_rows_that_do_not_suit_the_surfaces_are_one_sentence(sdm, paired_bodies, text, complaint):
    Path("doe.csv").write_text(text)
    code, _, error = sdm(*paired_bodies)
    assert code == 2
    assert complaint in error


def test_a_table_that_is_not_of_an_earlier_sweep_stays(sdm, tmp_path):
    FORMATS["su2"].write(two_bodies(), tmp_path / "pair.su2")
    words = (
        "--surface",
        "left",
        "--hinge",
        "-1,0,0",
        "-1,1,0",
        "--angles",
        "1,2",
        "--margin",
        "0.4",
        "--no-report",
        "-q",
    )
    table = tmp_path / "pair-deflected.csv"
    table.write_text("my own numbers\n")
    code, _, complaint = sdm("deflect", tmp_path / "pair.su2", *words)
    assert (code, table.read_text()) == (2, "my own numbers\n")
    assert "pair-deflected.csv exists already" in complaint
    table.write_bytes(HEAD + b"left\n")
    assert sdm("deflect", tmp_path / "pair.su2", *words)[0] == 0
    assert len(table.read_text().splitlines()) == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--surface", "flapp_upper", *HINGE, "--angle", "3"], ["wing.su2", "did you mean flap_upper"]),
        ([*FLAP, "--hinge", "0,0,0", "--angle", "3"], ["'--angle' follows one point", "a hinge needs two"]),
        ([*TURN, "--held", "flap_upper,flap_lower,flap_base"], ["nodes that follow the motion are held as well"]),
        ([*TURN, "--set", "max_center=9"], ["unknown setting max_center; did you mean max_centers"]),
        ([*TURN, "--steps", "²"], ["max_steps = '²' must be auto or a whole number"]),
        ([*FLAP, *HINGE, "--angle", "200"], ["angle = 200 deg", "out of range"]),
        ([*FLAP, *HINGE, "--angles", "0:200:50"], ["200 deg is out of range"]),
        ([*HINGE, "--angle", "3"], ["no surface to move: name its patches"]),
        ([*TURN, "--box", "none.toml"], ["none.toml"]),
        ([*TURN, "--slide", "far_field"], ["NAME:plane, NAME:cylinder or NAME:surface"]),
        ([*TURN, "--fixed", "wing_tip", "--slide", "wing_tip:plane"], ["wing_tip cannot be fixed and sliding"]),
        ([*TURN, "--out", "wing.off"], ["no mesh format has the suffix '.off'"]),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(arguments, words, files, sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(files["su2"], "wing.su2")
    code, _, complaint = sdm("deflect", "wing.su2", *arguments, "--quiet")
    assert code == 2
    assert len(complaint.strip().splitlines()) == 1
    assert all(word in complaint for word in words), complaint
    assert [path.name for path in tmp_path.iterdir()] == ["wing.su2"]


def test_the_input_is_never_the_output(files, sdm, tmp_path):
    source = shutil.copy(files["su2"], tmp_path / "wing.su2")
    code, _, complaint = sdm("deflect", source, *TURN, "--out", source, "--quiet")
    assert code == 2
    assert "this is a file that is read" in complaint


def test_a_failed_check_is_exit_code_1_and_the_table_says_which(files, sdm, tmp_path):
    """Far too large an angle for the room between the ribs, in a single step."""
    code, table, _ = sdm(
        "deflect", files["su2"], *FLAP, *HINGE, "--angle", "75", "--margin", "0.5", "--steps", "1",
        "--out", tmp_path / "w.su2", "--quiet",
    )  # fmt: skip
    assert code == 1
    assert re.search(
        r"FAILED: do not use this mesh; \d of \d+ checks: inverted_cells, .*layer_height", " ".join(table.split())
    )
    assert "FAILED" in table


@pytest.mark.parametrize("name", ["wing", "wing.v2"])
def test_a_case_named_by_its_file_is_written_beside_its_folder(name, files, sdm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(files["openfoam"], name)
    code, table, complaint = sdm("deflect", f"{name}/case.foam", *TURN, "--quiet")
    assert code == 0, complaint
    assert re.search(f"^wrote +{name.replace('.', '-')}-deflected$", table, re.MULTILINE)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, f"{name.replace('.', '-')}-deflected"])


@pytest.mark.parametrize("name", ["empty.npz", "array.npz", "empty.csv", "cut.npz"])
def test_a_damaged_table_is_one_line_and_code_two(name, files, sdm, tmp_path):
    np.savez(tmp_path / "table.npz", points=np.eye(9, 3), vectors=np.eye(9, 3))
    np.save(tmp_path / "array.npy", np.eye(9, 3))
    whole, path = (tmp_path / "table.npz").read_bytes(), tmp_path / name
    contents = {"empty": b"", "array": (tmp_path / "array.npy").read_bytes(), "cut": whole[: len(whole) // 2]}
    path.write_bytes(contents[path.stem])
    words = ["--surface", "flap_*", "--slide", "symmetry:plane", "--table", path, "--dry-run", "--quiet"]
    code, out, complaint = sdm("deflect", files["su2"], *words)
    assert (code, out, complaint.count("\n")) == (2, "", 1)
    assert complaint.startswith(f"sdm: {path}: no ")


def test_a_cell_that_cannot_be_mended_is_named_and_a_repaired_mesh_has_no_sensitivity(sdm, tmp_path):
    mesh = block_with_body(3)
    source, out = tmp_path / "block.su2", tmp_path / "turned.su2"
    FORMATS["su2"].write(mesh, source)
    outer = [word for name in mesh.names if name != "body" for word in ("--fixed", name)]
    about = ["--surface", "body", *outer, "--hinge", "0,0,0", "0,1,0", "--steps", "1", "--repair", "auto", "--out", out]
    code, _, complaint = sdm("deflect", source, *about, "--angle", "80", "--sensitivity", "--quiet")
    assert code == 2
    assert "was repaired" in complaint
    assert len(complaint.strip().split("\n")) == 1
    code, _, complaint = sdm("deflect", source, *about, "--angles", "10,80", "--sensitivity", "--quiet")
    assert (code, len(complaint.strip().split("\n"))) == (2, 1)
    assert {path.name for path in tmp_path.iterdir()} == {"block.su2"}
    code, table, _ = sdm("deflect", source, *about, "--angle", "80")
    assert code == 1
    assert "no repair can mend it" in " ".join(table.split())

"""`sdm compare`: figures and settings that differ, and by how much."""

import json
import re
import shutil
from dataclasses import replace
from functools import partial

import pytest

from sdm_deflect import deflect, read
from sdm_deflect.cases.compare import Row, comparison, differing_settings, read_runs, tables
from sdm_deflect.cases.report.folder import folder_of, write_run_folder
from sdm_deflect.cases.report.pictures import Gallery
from sdm_deflect.cases.run.mesh_files import write_mesh
from tests.meshing.formats.wing import wing

KINDS = {"tps": (8.0, {}), "wendland": (8.0, {"kernel": "wendland"}), "steep": (14.0, {"kernel": "mq"})}


def finished(home, mesh, out, hinge, angle, **options):
    """Deflect a file and write the folder beside its result, without pictures; return the folder."""
    options = {"motion": "blended", "fixed": "wing_*", "slide": "symmetry:plane", "repair": "off", **options}
    one = deflect(read(home / mesh), "flap_*", hinge, angle, **options)
    folder = folder_of(home / out)
    write_run_folder(folder, one.deflection, one.checks, home / out, {})
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory, hybrid_wing):
    """Three deflections of one mesh, and one of a coarser mesh; by name."""
    home, coarse = tmp_path_factory.mktemp("runs"), wing(cells=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sdm_deflect.cases.report.pictures.draw_pictures", lambda *_: Gallery(()))
        for name, one in (("wing.su2", hybrid_wing), ("coarse.su2", coarse)):
            write_mesh(None, one.mesh, one.mesh.points, home / name)
        own = {
            name: finished(home, "wing.su2", f"{name}.su2", hybrid_wing.hinge, angle, **options)
            for name, (angle, options) in KINDS.items()
        }
        return own | {"coarse": finished(home, "coarse.su2", "coarse-8.su2", coarse.hinge, 8.0)}


@pytest.fixture(scope="module")
def runs(folders):
    return read_runs([folders[name] for name in KINDS])


def rows_of(runs):
    return {row.name: row for table in tables(runs) for row in table.rows}


def test_figures_are_those_of_the_runs(runs):
    rows = rows_of(runs)
    figures = [run.data.figures for run in runs]
    assert rows["kernel"].values == ("tps", "wendland", "mq")
    assert rows["kernel"].texts == ("tps", "wendland", "mq")
    for direction in "xyz":
        expected = tuple(one["adaptation"][direction]["centers"] for one in figures)
        assert rows[f"centres, {direction}"].values == expected
    assert rows["condition"].values == tuple(
        max(fit["condition"] for fit in one["adaptation"].values()) for one in figures
    )
    assert rows["error between the sites, largest"].values == tuple(
        one["error_between_sites"]["max"] for one in figures
    )
    least = tuple(one["quality_inside"]["after"]["wedge"]["min"] for one in figures)
    assert rows["wedge: least quality, deflected"].values == least
    assert rows["points"].same
    assert not rows["moves"].same
    assert [run.name for run in runs] == ["tps-report", "wendland-report", "steep-report"]


def test_settings_that_differ_and_no_others(runs):
    found = {row.name: row.values for row in differing_settings(runs)}
    assert found["kernel"] == ("tps", "wendland", "mq")
    assert found["surface[0].angle"] == (8.0, 8.0, 14.0)
    assert found["kernel_radius"] == tuple(run.data.figures["kernel"]["radius"] or 0.0 for run in runs)
    assert not {"strategy", "fixed", "surface[0].hinge"} & found.keys()
    assert differing_settings(runs[:1] * 2) == ()


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ((100, 100), ("100", "100")),
        ((1000, 1090), ("1,000", "1,090 (+9 %)")),
        ((1.0, 0.5001), ("1", "0.5001 (-50 %)")),
        ((2.0, 10.0, 2.0), ("2", "10 (× 5)", "2")),
        ((0.0, 3.0), ("0", "3 (+3)")),
        ((-1.0, 1.0), ("-1", "1 (+2)")),
        ((1.0, 1.0 + 1e-5), ("1", "1 (by less than 0.05 %)")),
        ((None, 3.0, "a"), ("–", "3", "a")),
    ],
)
def test_changes_are_told_in_words(values, texts):
    row = Row("a", values, form="," if isinstance(values[0], int) else ".4g")
    assert row.texts == texts
    assert row.same == (len(set(values)) == 1)


@pytest.fixture
def compare(sdm, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return partial(sdm, "compare")


def test_the_command_prints_what_differs(folders, compare):
    code, out, _ = compare(folders["tps"], folders["steep"], "--json")
    found = json.loads(out)
    assert code == 0
    assert [one["name"] for one in found["runs"]] == ["tps-report", "steep-report"]
    assert found["same_mesh"]
    assert found["settings"]["kernel"] == ["tps", "mq"]
    rows = {row["name"]: row for row in found["tables"]["Interpolation"]}
    assert rows["kernel"] == {"name": "kernel", "unit": "", "values": ["tps", "mq"], "same": False}
    code, out, _ = compare(folders["tps"], folders["steep"], "-q")
    assert code == 0
    assert re.search(r"kernel +tps +mq", out)
    assert "points " not in out  # as many in both
    code, out, _ = compare(folders["tps"], folders["steep"], "--verbose")
    assert "points " in out


def test_another_mesh_is_said_to_be_another(folders):
    runs = read_runs([folders["tps"], folders["coarse"]])
    assert not comparison(runs)["same_mesh"]
    assert not rows_of(runs)["points"].same


def test_what_cannot_be_compared_is_one_sentence(folders, compare, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(folders["steep"], damaged)
    (damaged / "metrics.json").write_text("{")
    edited, figures = tmp_path / "edited", json.loads((folders["steep"] / "metrics.json").read_text())
    shutil.copytree(folders["steep"], edited)
    figures["validation"]["checks"][0]["limit"] = "none"
    (edited / "metrics.json").write_text(json.dumps(figures))
    for copy in (damaged, edited):  # their mesh stands beside the others
        text = (copy / "settings.toml").read_text()
        (copy / "settings.toml").write_text(text.replace("../", f"{folders['steep'].parent}/"))
    one = folders["tps"]
    for words, said in (
        ([one], "1 runs cannot be compared: give 2 to 8"),
        ([one] * 9, "9 runs cannot be compared"),
        ([one, one], "is given twice"),
        ([one, tmp_path], "has no case.toml and no settings.toml"),
        ([one, tmp_path / "none"], "has no case.toml and no settings.toml"),
        ([one, damaged], "metrics.json"),
        ([one, edited], "edited: no whole folder of a run"),
    ):
        code, _, err = compare(*words, "-q")
        assert (code, said in err, err.count("\n")) == (2, True, 1), (words, err)


def test_figures_that_are_missing_or_of_another_kind_are_left_out(runs):
    """As in folders of earlier versions, or edited ones."""
    odd = {"deflections": {"flap": {"adaptation": {"x": {"centers": "many"}}, "kernel": 5}}, "mesh": [], "points": {}}
    one = replace(runs[0], data=replace(runs[0].data, figures=odd))
    rows = rows_of([runs[1], one])
    assert rows["condition"].values[1] is None
    assert rows["kernel"].values == ("wendland", None)
    assert not rows["kernel"].same
    assert "flap" in rows["moves"].values[1]

"""Several surfaces, each in a box of its own: the bits of single runs, one mesh, one verdict, one folder."""

import json
import tomllib

import numpy as np
import pytest

import sdm_deflect
from sdm_deflect.base.errors import InputError
from sdm_deflect.cases.cli.commands import carry_out as main
from sdm_deflect.cases.report.finished import FinishedRun
from sdm_deflect.meshing.formats.registry import format_of
from tests.deform.blocks import two_bodies

SURFACES = [
    {"patches": name, "hinge": [[x, 0, 0], [x, 1, 0]], "angle": angle}
    for name, x, angle in (("left", -1.25, 6.0), ("right", 1.25, -3.0))
]
CONFIG = "\n".join(
    f"[[surface]]\npatches = ['{one['patches']}']\nhinge = {one['hinge']}\nangle = {one['angle']}" for one in SURFACES
)


def code_of(*words):
    """Run `sdm deflect`; return its exit code."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("sys.argv", ["sdm", "deflect", *map(str, words), "--quiet"])
        with pytest.raises(SystemExit) as end:
            main()
    return end.value.code


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boxes")
    format_of(folder / "two.su2").write(two_bodies(), folder / "two.su2")
    (folder / "two.toml").write_text(CONFIG)
    return folder


@pytest.fixture(scope="module")
def run(home):
    """The folder of the report of both surfaces, each in its box."""
    assert code_of(home / "two.su2", "--config", home / "two.toml", "--box-each", "--margin", 0.4) == 0
    return home / "two-deflected-report"


def alone(mesh, one, angle=None):
    return sdm_deflect.deflect(mesh, one["patches"], one["hinge"], angle or one["angle"], margin=0.4)


def test_each_box_has_the_bits_of_a_run_with_that_surface_alone(home, run):
    mesh, both = two_bodies(), format_of(home / "two.su2").read(home / "two-deflected.su2").points
    expected = mesh.points.copy()
    for one in SURFACES:
        result = alone(mesh, one)
        expected[result.plan.movable] = result.points[result.plan.movable]
    np.testing.assert_array_equal(both, expected)
    found = sdm_deflect.deflect(mesh, SURFACES, box_each=True, margin=0.4)
    assert found.passed
    np.testing.assert_array_equal(found.points, expected)
    assert {"site_error:left", "site_error:right", "inverted_cells"} < {check.name for check in found.checks}


def test_in_a_sweep_the_surfaces_keep_their_proportion():
    mesh = two_bodies()
    results = sdm_deflect.sweep(mesh, SURFACES, None, [2.0, 4.0], box_each=True, margin=0.4)
    assert [one.deflection.amounts for one in results] == [(2.0, -1.0), (4.0, -2.0)]
    right = sdm_deflect.sweep(mesh, "right", SURFACES[1]["hinge"], [-1.0, -2.0], margin=0.4)
    for both, one in zip(results, right, strict=True):
        nodes = one.plan.movable
        np.testing.assert_array_equal(both.points[nodes], one.points[nodes])


def test_files_tell_of_each_box(run):
    figures = json.loads((run / "metrics.json").read_text())
    assert list(figures["deflections"]) == ["left", "right"]
    inside = [one["cells_touched"] for one in figures["deflections"].values()]
    assert figures["cells_touched"] == sum(inside)
    assert set(figures["motion"]) == {"left", "right"}
    with np.load(run / "interpolant.npz") as arrays:
        assert {"centers_x", "centers_x_right", "hexahedron", "hexahedron_right"} < set(arrays)
    rows = (run / "convergence.csv").read_text().splitlines()
    assert {row.split(",")[5] for row in rows[1:]} == {"left", "right"}


def test_the_folder_makes_report_and_view_again(home, run):
    settings = tomllib.loads((run / "settings.toml").read_text())
    assert settings["box_each"] is True
    assert all(np.shape(one["box"]) == (8, 3) for one in settings["surface"])
    finished = FinishedRun.of(run)
    plan, points = finished.plan, finished.points
    assert [part.surface for part in plan.boxes] == ["left", "right"]
    np.testing.assert_array_equal(points, format_of(home / "two.su2").read(home / "two-deflected.su2").points)
    data = finished.report_data()
    assert [box.name for box in data.boxes] == list(data.figures["deflections"])
    shown = finished.motion.on(plan.mesh.points).at(finished.motion.in_order({"left": 3.0, "right": -1.5}))
    one = alone(two_bodies(), SURFACES[1], -1.5)
    nodes = one.plan.movable
    np.testing.assert_allclose(shown[nodes], one.points[nodes], atol=2.0 * one.plan.boxes[0].sites.tolerance)


def test_boxes_that_overlap_end_with_one_sentence(home, capsys):
    words = ("--box-each", "--margin", 0.9, "--out", home / "no.su2")
    assert code_of(home / "two.su2", "--config", home / "two.toml", *words) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "the boxes of left and right overlap by" in said[0]
    assert not (home / "no.su2").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"box_each": True, "box": [[-9, -9, -9], [9, 9, 9]]}, "give box in the table of each"),
        ({"own_box": True}, "it has a box of its own only if box_each"),
    ],
)
def test_settings_that_do_not_go_together_are_refused(options, said):
    given = [dict(one) for one in SURFACES]
    if options.pop("own_box", False):
        given[0]["box"] = [[-2, -1, -1], [-0.5, 1, 1]]
    with pytest.raises(InputError, match=said):
        sdm_deflect.deflect(two_bodies(), given, **options)
    with pytest.raises(InputError, match="there is one surface"):
        sdm_deflect.deflect(two_bodies(), given[:1], box_each=True)


def test_a_plan_of_one_amount_has_all_boxes(tmp_path):
    result = sdm_deflect.deflect(two_bodies(), SURFACES, box_each=True, margin=0.4)
    held = sdm_deflect.plan(two_bodies(), SURFACES, box_each=True, margin=0.4)
    held.save(tmp_path / "two.npz")
    found = sdm_deflect.MeshMotion.load(tmp_path / "two.npz")
    assert np.array_equal(found.on(two_bodies().points).at(result.deflection.amounts), result.points)

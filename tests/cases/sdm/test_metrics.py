"""What other programs read: names in metrics.json and of the checks, exit codes, files."""

import json
import re
from pathlib import Path

import pytest

from sdm_deflect.cases.aircraft.registry import case_named

pytestmark = pytest.mark.mesher

GUIDE = Path(__file__).parents[3] / "docs"
TOP = {
    "case", "scale", "angle_deg", "strategy", "version", "mesh", "confinement", "sites", "adaptation", "evaluation",
    "quality", "validation", "timings", "total_seconds", "peak_rss_bytes",
}  # fmt: skip
WITHIN = {
    "mesh": {"points", "cells", "patches", "quality_min", "boundary_to_cad_max", "seconds"},
    "confinement": {"corners", "inside", "filter_seconds"},
    "sites": {"surface", "hexahedron"},
    "adaptation": {"x", "y", "z"},
    "evaluation": {"seconds", "whole_mesh_seconds", "pairs_per_second"},
    "quality": {"before", "after", "inverted"},
    "validation": {"checks", "passed"},
}
FITTED = {"centers", "iterations", "max_error", "seconds", "stop"}
SHAPE = {"min", "p01", "mean", "below_0_2", "below_0_4"}
CHECKED = {"name", "value", "limit", "passed", "unit", "where", "verdict"}
# What any mesh is asked, besides.
ANY_MESH = {"quality_min:tetra", "left_behind", "layer_height"}
EVERY = {"outside_moved", "inverted_cells", "surfaces_crossed", "fixed_surfaces_moved", "held_moved", "quality_min"}
SURFACE = {"planarity", "surface_to_cad", "exact_to_cad", "surface_to_rigid_cad", "rigid_cad_predicted", "site_error"}
HINGED = SURFACE | {"trailing_edge_angle", "hinge_offset"}
TAIL = SURFACE | {"cylindricity", "root_on_cylinder"}


def keys_of(value):
    """All keys of nested dictionaries."""
    if isinstance(value, dict):
        return value.keys() | {key for item in value.values() for key in keys_of(item)}
    return {key for item in value for key in keys_of(item)} if isinstance(value, list) else set()


def read(folder):
    return json.loads((folder / "metrics.json").read_text(encoding="utf-8"))


def repairs_of(figures):
    """The names of the checks that repairs bring with them."""
    surfaces = figures["deflections"]
    if not any(one["repair"] for one in surfaces.values()):
        return set()
    kept = {"surface_kept" if len(surfaces) == 1 else f"surface_kept:{name}" for name in surfaces}
    slid = {one["name"] for one in figures["validation"]["checks"]} & {"slid_on_surfaces"}
    return kept | slid | {"repair_elsewhere"}


@pytest.fixture(
    params=[
        ("aileron_run", EVERY | HINGED),
        ("aileron_mv_run", EVERY | HINGED),
        ("tail_run", EVERY | TAIL),
        ("chimera_run", EVERY | HINGED | {"chimera_face_in_plane", "orphans"}),
    ],
    ids=lambda given: given[0],
)
def kept(request):
    """The figures of a run, and the names of the checks that belong to it."""
    name, names = request.param
    return read(request.getfixturevalue(name)[1]), names


def test_every_name_is_there(kept):
    figures, _ = kept
    assert figures.keys() >= TOP
    for part, names in WITHIN.items():
        assert figures[part].keys() >= names, part
    assert all(patch.keys() >= {"points", "triangles"} for patch in figures["mesh"]["patches"].values())
    assert len(figures["confinement"]["corners"]) == 8
    assert {len(corner) for corner in figures["confinement"]["corners"]} == {3}
    assert figures["sites"]["hexahedron"].keys() == set("xyz")
    assert all(fit.keys() >= FITTED for fit in figures["adaptation"].values())
    for when in ("before", "after"):
        assert figures["quality"][when].keys() >= SHAPE
    assert figures["total_seconds"] > sum(figures["timings"].values())


def test_no_note_says_that_the_file_of_the_whole_mesh_is_a_part(kept):
    assert kept[0]["notes"] == []


def test_the_checks_have_their_names(kept):
    figures, names = kept
    checks = figures["validation"]["checks"]
    assert {check["name"] for check in checks} == names | ANY_MESH | repairs_of(figures)
    assert all(check.keys() >= CHECKED for check in checks)
    assert figures["validation"]["passed"] is True


def test_the_guide_tells_every_name(kept):
    figures, names = kept
    page = (GUIDE / "results.md").read_text(encoding="utf-8")
    rows = page.split("`metrics.json` is in SI units")[1].split("\n## ")[0]
    told = set(re.findall(r"`(\w+)`", rows))
    own = {"tetra", *figures["mesh"]["patches"], *figures["deflections"], *figures["motion"], *figures["timings"]}
    assert keys_of(figures) - told - own == set()
    assert names - set(re.findall(r"`(\w+)`", (GUIDE / "cases.md").read_text(encoding="utf-8"))) == set()


def test_common_centres_are_told_three_times(aileron_mv_run):
    fits = read(aileron_mv_run[1])["adaptation"]
    assert fits["x"] == fits["y"] == fits["z"]


def test_several_surfaces_are_named_in_their_checks(finish):
    case = case_named("all")
    _, folder = finish(case, "all")
    figures = read(folder)
    expected = {
        f"{name}:{one.surface}"
        for one in case.deflections
        for name in (TAIL if one.surface.startswith("tail") else HINGED)
    }
    names = {check["name"] for check in figures["validation"]["checks"]}
    assert names == EVERY | ANY_MESH | expected | repairs_of(figures)
    assert figures["deflections"].keys() == {one.surface for one in case.deflections}


def test_without_a_report_everything_else_is_there(aileron_run, finish):
    _, whole = aileron_run
    _, folder = finish(case_named("aileron"), "aileron-bare")
    with_report, without = read(whole), read(folder)
    assert with_report["timings"].keys() - without["timings"].keys() == {"pictures", "report"}
    assert without.keys() == with_report.keys()
    assert {path.name for path in whole.iterdir()} - {path.name for path in folder.iterdir()} == {
        "report.html",
        "figures",
    }
    for name in ("case.toml", "undeflected.vtu", "deflected.vtu", "interpolant.npz"):
        assert (folder / name).read_bytes() == (whole / name).read_bytes(), name


def test_too_few_centres_fail_the_run(aileron_mesh, tmp_path, sdm):
    words = ["run", "aileron", "--set", "adaptation.max_centers=50", "--no-report", "-q", "--out", tmp_path]
    code, table, _ = sdm(*words)
    assert code == 1
    line, last = (line for line in table.splitlines() if "FAILED" in line and "site_error" in line)
    assert re.fullmatch(r"FAILED: do not use this mesh; 1 of \d+ checks: site_error", last)
    assert "<= 8e-05 m" in line
    validation = read(tmp_path)["validation"]
    assert not validation["passed"]
    assert [check["name"] for check in validation["checks"] if not check["passed"]] == ["site_error"]
    site_error = next(check for check in validation["checks"] if check["name"] == "site_error")
    assert site_error["value"] > 2.0 * site_error["limit"] == pytest.approx(1.6e-4)

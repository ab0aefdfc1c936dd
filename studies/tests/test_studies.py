"""The paper's studies: the paper's numbers pass every test of its own trends, and ours are measured row by row."""

import csv
from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from studies.files import FIELDS, markdown, write_study
from studies.measure import DEFAULT, GMRES, GROWN, LAPACK, carry_out, filter_is_cheap, initial_centers, savings
from studies.paper import Row, Setting, paper
from studies.trends import (
    TRENDS,
    all_at_limit,
    error_y_then_x_then_z,
    falls_then_rises,
    grows,
    mv_twice_as_dear,
    six_times_faster,
    y_least,
    z_equals_mv,
)
from tests.calls import run_study


def test_paper_has_all_rows():
    tables = paper().tables
    assert {name: len(table.rows) for name, table in tables.items()} == {
        "table1": 16,
        "table2": 12,
        "table3": 6,
        "table4": 3,
    }
    assert sum(row.seconds for row in tables["table3"].rows) == pytest.approx(1681.73)
    assert all(isnan(row.max_error) == (name != "table4") for name, table in tables.items() for row in table.rows)
    assert tables["table1"].rows[12].setting == tables["table2"].rows[0].setting


def test_paper_is_consistent():
    for name, table in paper().tables.items():
        assert table.case in {one.case for one in paper().sizes}
        for row in table.rows:  # every iteration adds n_add centres at most
            assert row.centers <= sum(row.setting.initial) + row.iterations * row.setting.n_add, (name, row)


def test_unknown_direction_is_named():
    with pytest.raises(ValueError, match=r"columns = 'xy' is not one of x, y, z, xyz"):
        Setting("xy", -12.0, (5, 5), 1)


@pytest.mark.parametrize(("name", "trend"), [(name, trend) for name, trends in TRENDS.items() for trend in trends])
def test_every_trend_holds_on_the_paper_s_own_numbers(name, trend):
    table = paper().tables[name]
    found = trend.test(table.rows, table)
    assert found is not None
    assert found.holds, found.evidence


def changed(table, change):
    return [change(row) for row in table.rows]


def cheaper_mv(row: Row) -> Row:
    return replace(row, seconds=row.seconds / (2.3 if row.setting.columns == "xyz" else 1.0))


@pytest.mark.parametrize(
    ("name", "test", "change"),
    [
        ("table1", mv_twice_as_dear, cheaper_mv),
        ("table1", z_equals_mv, lambda r: replace(r, centers=r.centers + (r.setting.columns == "z"))),
        ("table2", six_times_faster, lambda r: replace(r, seconds=r.seconds + 4.0)),
        ("table2", falls_then_rises, lambda r: replace(r, seconds=1.0 / r.setting.n_add)),
        ("table3", y_least, lambda r: replace(r, centers=1000 if r.setting.columns == "y" else r.centers)),
        ("table3", grows, lambda r: replace(r, centers=500)),
        ("table4", all_at_limit, lambda r: replace(r, max_error=7e-5)),
        ("table4", error_y_then_x_then_z, lambda r: replace(r, max_error=1.0 / r.max_error)),
    ],
)
def test_trends_fail_on_numbers_that_deny_them(name, test, change):
    table = paper().tables[name]
    found = test(changed(table, change), table)
    assert not found.holds
    assert found.verdict == "does not hold"


def test_converged_rows_have_no_order_of_errors():
    table = paper().tables["table4"]
    assert error_y_then_x_then_z(changed(table, lambda r: replace(r, max_error=7e-5)), table) is None


def test_paper_s_timings_agree_with_its_points():
    for one in paper().evaluations:
        assert savings(one, paper().size(one.case).points).holds
        assert filter_is_cheap(one).holds
    slow = replace(paper().evaluations[1], inside_seconds=80.0)
    assert not savings(slow, 623_387).holds


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["table5"], "No such command 'table5'"),
        (["table1", "--again"], "No such option '--again'"),
        (["page", "--mach", "0.3"], "No such option '--mach'"),
        (["table1", "--scale", "huge"], "'huge' is not one of 'small', 'medium', 'paper'"),
    ],
)
def test_mistake_is_one_line_and_code_2(words, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run_study(*words) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not any(tmp_path.iterdir())


@pytest.fixture(scope="module")
def results(aileron_mesh):
    """Tables 1 and 2 at small scale; under a minute."""
    mesh, _ = aileron_mesh
    names = ("table1", "table2")
    return {name: carry_out(name, case_named("aileron"), mesh, lambda text, done: None) for name in names}


@pytest.mark.nightly
@pytest.mark.mesher
@pytest.mark.parametrize("name", ["table1", "table2"])
def test_every_row_is_measured_and_converges(results, name):
    result = results[name]
    settings = [row.setting for row in result.table.rows]
    for loop in (GROWN, LAPACK, DEFAULT):
        assert [row.setting for row in result.by(loop)] == settings
    for one in result.measured:
        assert one.converged
        assert one.row.max_error < result.table.tolerance
        assert one.row.centers <= one.sites
        assert one.row.seconds > 0.0


@pytest.mark.nightly
@pytest.mark.mesher
@pytest.mark.parametrize("name", ["table1", "table2"])
def test_loops_with_the_paper_s_rule_choose_the_same_centres(results, name):
    grown = {row.setting: row for row in results[name].by(GROWN)}
    for loop in (LAPACK, GMRES):
        for row in results[name].by(loop):
            assert (row.iterations, row.centers) == (grown[row.setting].iterations, grown[row.setting].centers)
    for row in grown.values():  # one centre at a time: no block is cut short by the tolerance
        if row.setting.n_add == 1:
            assert row.centers == sum(row.setting.initial) + row.iterations


@pytest.mark.nightly
@pytest.mark.mesher
def test_the_cost_of_mv_is_judged_for_every_loop(results):
    """Which loops hold it depends on the machine's load; that each is judged from its own times does not."""
    found = results["table1"].findings(TRENDS["table1"][-1])
    assert {GROWN, GMRES} <= set(found)
    assert all(finding.evidence for finding in found.values())


@pytest.mark.nightly
@pytest.mark.mesher
def test_files_of_a_study(results, tmp_path):
    for name, result in results.items():
        write_study(result, tmp_path)
        with (tmp_path / f"{name}.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert tuple(rows[0]) == FIELDS
        sources = [row["source"] for row in rows]
        assert sources.count("paper") == sources.count("grown") == len(result.table.rows)
        text = markdown(result)
        assert text.count("\n| ") == 2 * (len(result.table.rows) + 2)  # counts, and times
        assert text.count("**holds**") + text.count("**does not hold**") >= len(TRENDS[name])
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (tmp_path / f"{name}.md").read_text(encoding="utf-8").startswith(text)


def test_initial_centres_come_from_surface_and_hexahedron():
    from sdm_deflect.deform.rbf.sites import DataSites

    points = np.random.default_rng(3).random((40, 3))
    sites = DataSites(points, np.zeros((40, 1)), (0,))
    rows = initial_centers(sites, 15, (4, 6))
    assert len(np.unique(rows)) == 10
    assert (rows[:4] < 15).all()
    assert (rows[4:] >= 15).all()

"""The paper's studies: the paper's numbers pass every test of its own trends, and ours are measured row by row."""

import csv
from math import isnan
from types import SimpleNamespace

import numpy as np
import pytest

from sdm_deflect.base.threads import silent
from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.rbf.data_sites import DataSites
from sdm_deflect.deform.rbf.rules import GreedyOptions
from studies.files import FIELDS, sizes, write_study
from studies.measure import DEFAULT, GMRES, GROWN, Task, carry_out, initial_centers, measure
from studies.paper import Setting, paper
from studies.trends import off
from tests.calls import run_study
from tests.docs.commands import ROOT


def test_paper_has_all_rows():
    tables = paper().tables
    assert {name: len(table.rows) for name, table in tables.items()} == {
        "table1": 16,
        "table2": 12,
        "table3": 6,
        "table4": 3,
    }
    assert [(one.stay, one.follow) for one in paper().counts if one.stay] == [(58, 18), (405, 200)]
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
    for loop in (GROWN, DEFAULT):
        assert [row.setting for row in result.by(loop)] == settings
    for one in result.measured:
        assert one.converged
        assert one.row.max_error < result.table.tolerance
        assert one.row.centers <= one.row.sites
        assert one.row.seconds > 0.0


def test_the_adaptation_of_median_time_is_kept(monkeypatch):
    seconds = iter((0.1, 0.9, 0.3, 0.2))  # the first loads compiled code
    monkeypatch.setattr(Task, "run", lambda task: SimpleNamespace(history=[SimpleNamespace(seconds=next(seconds))]))
    monkeypatch.setattr(Task, "measured", lambda task, fit: fit.history[-1].seconds)
    sites = DataSites(np.zeros((1, 3)), np.zeros((1, 1)), (0,))
    options = GreedyOptions(n_add=1, tol_add=1.0, tol_stop=1.0)
    task = Task(paper().tables["table1"].rows[0].setting, GROWN, sites, np.zeros(1, dtype=np.intp), options)
    assert measure([task]) == (0.3,)


@pytest.mark.nightly
@pytest.mark.mesher
@pytest.mark.parametrize("name", ["table1", "table2"])
def test_loops_with_the_paper_s_rule_choose_the_same_centres(results, name):
    grown = {row.setting: row for row in results[name].by(GROWN)}
    for row in results[name].by(GMRES):
        assert (row.iterations, row.centers) == (grown[row.setting].iterations, grown[row.setting].centers)
    for row in grown.values():  # one centre at a time: no block is cut short by the tolerance
        if row.setting.n_add == 1:
            assert row.centers == sum(row.setting.initial) + row.iterations


@pytest.mark.mesher
def test_every_row_of_table_2_has_the_paper_s_centres(aileron_mesh):
    """The hexahedron is smaller than that of the case; the number of zero sites is the paper's."""
    mesh, _ = aileron_mesh
    result = carry_out("table2", case_named("aileron"), mesh, silent, (GROWN,))
    assert off(result.by(GROWN)) == []
    assert result.ground.size.zero_sites == pytest.approx((800, 800, 800), abs=8)
    assert 0.7 < result.ground.spacing / result.ground.edge < 0.9
    assert "Margins of the hexahedron are 0.25 times the case's; zero sites stand 5." in sizes(result)
    (largest,) = result.ground.largest_mm.values()
    assert largest["z"] == pytest.approx(4.2, abs=0.2)


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
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_initial_centres_come_from_surface_and_hexahedron():
    points = np.random.default_rng(3).random((40, 3))
    sites = DataSites(points, np.zeros((40, 1)), (0,))
    rows = initial_centers(sites, 15, (4, 6))
    assert len(np.unique(rows)) == 10
    assert (rows[:4] < 15).all()
    assert (rows[4:] >= 15).all()


@pytest.mark.nightly
@pytest.mark.mesher
def test_the_table_of_distances_is_that_of_the_guide(tmp_path, monkeypatch):
    """On the guide's meshes."""
    monkeypatch.chdir(tmp_path)
    assert run_study("distances", "--quiet") == 0
    table = (tmp_path / "runs" / "distances" / "distances.md").read_text()
    assert table in (ROOT / "docs" / "cases.md").read_text()

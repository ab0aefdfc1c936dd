"""The page of the paper: written again from stored results to the letter, each verdict with its reason."""

import re
import string
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.rbf.greedy import Stop, adapt
from sdm_deflect.deform.rbf.interpolant import direct
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.selection import GreedyOptions, Worst
from sdm_deflect.deform.rbf.sites import DataSites
from studies import centres, studies
from studies.centres_findings import numbers
from studies.loop import Gmres, adapted
from studies.page import read_page, text_of
from studies.solves import DirectBasis
from studies.stored import Counted
from studies.trials import Trial, factors
from studies.verdicts import UNKNOWN, because, counted, reasons, verdicts
from tests.calls import run_study

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def page():
    return read_page(DOCS)


def test_the_page_is_what_its_stored_results_say(tmp_path):
    said = studies.again(tmp_path, DOCS)
    text = (tmp_path / "paper.md").read_text(encoding="utf-8")
    assert text == (DOCS / "paper.md").read_text(encoding="utf-8")
    assert said in text
    assert len(said) < 100
    assert (tmp_path / "figures" / "centres.png").read_bytes().startswith(b"\x89PNG")


def test_the_first_table_has_every_verdict_of_the_page(page):
    text = (DOCS / "paper.md").read_text(encoding="utf-8")
    head, body = text.split("## Figure 1", 1)
    found = list(verdicts(page))
    rows = [line for line in head.splitlines() if re.match(r"\| (Table|Figure|Timings)", line)]
    below = re.findall(r"\*\*(holds|does not hold)\*\*", body)
    assert len(rows) == len(found) == len(below) == 38
    assert [one.finding.verdict for one in found] == below
    assert counted(page) in head


def test_what_does_not_hold_has_a_measured_reason(page):
    explained = [(one, because(one, page)) for one in verdicts(page) if not one.finding.holds]
    for one, text in explained:
        assert UNKNOWN not in text, one
        assert re.search(r"\d", text), one
    for reason in reasons():
        assert any(reason.explains(one) for one, _ in explained), reason
        assert [name for _, name, *_ in string.Formatter().parse(reason.text) if name], reason


FAILS = {
    "The initial centres hardly influence the time. (`grown`)",
    "The initial centres hardly influence the time. (`lapack`)",
    "MV is dearer than SQUV by more than a factor of two. (`grown`)",
    "MV is dearer than SQUV by more than a factor of two. (`lapack`)",
    "The time falls by a factor of more than 6 at best. (`grown`)",
    "The time falls by a factor of more than 6 at best. (`lapack`)",
    "The time falls by a factor of more than 6 at best. (`gmres`)",
    "It falls monotonically up to M_add = 25 only, then often rises again. (`grown`)",
    "It falls monotonically up to M_add = 25 only, then often rises again. (`lapack`)",
    "It falls monotonically up to M_add = 25 only, then often rises again. (`gmres`)",
    "No direction reaches the tolerance; all end at the limit after the same iterations.",
    "The times differ little. (`lapack`)",
    "At +12° the deformed mesh has no cell below 0.4.",
    "aileron: confined evaluation is faster at least by the ratio of the numbers of points",
}
"""What the paper says and the stored results do not show; every other sentence holds."""


@pytest.mark.parametrize(
    "verdict", list(verdicts(read_page(DOCS))), ids=lambda one: f"{one.place}: {one.statement}{one.note}"
)
def test_each_trend_stands_as_the_page_states_it(verdict):
    sentence = verdict.statement + verdict.note
    assert verdict.finding.holds == (sentence not in FAILS), f"{sentence} Measured: {verdict.finding.evidence}"


def test_sentences_that_fail_are_on_the_page(page):
    assert {one.statement + one.note for one in verdicts(page)} >= FAILS


@pytest.mark.parametrize("name", ["unit", "norm", "size", "hinge", "sites", "gmres", "panel"])
def test_each_explanation_is_settled_as_the_page_states_it(name, page):
    assert numbers(page)[name]["settled"], f"the page's sentence on {name}: {numbers(page)[name]}"


def test_sections_that_could_not_be_made_say_why(page):
    missing = {"figure5": "no mesh", "table2": "no time", "timings": "no clock"}
    results = {name: result for name, result in page.results.items() if name not in missing}
    less = replace(page, stored=replace(page.stored, missing=missing, evaluations=[]), results=results, reasons=None)
    text = text_of(less)
    assert "## Figure 5: the mesh in the gap\n\nNot made: no mesh.\n\n## Figure 6" in text
    assert "5 + 5 initial centres)\n\nNot made: no time.\n\n## Figure 3" in text
    assert text.rstrip().endswith("Not made: no clock.")
    assert "Mesh points inside the hexahedron" not in text


def test_gmres_that_never_leaves_the_tail_s_error_is_not_the_reason(page):
    trials = tuple(replace(one, max_error=1e-9) if one.change == "GMRES" else one for one in page.reasons.trials)
    text = text_of(replace(page, reasons=replace(page.reasons, trials=trials)))
    assert "is left by none of these; with none of them do aileron and Chimera block reach theirs" in text


def test_a_verdict_that_fails_elsewhere_says_that_it_has_no_reason(page):
    one = next(one for one in verdicts(page) if one.finding.holds)
    failed = replace(one, finding=replace(one.finding, holds=False))
    assert because(failed, page).startswith(UNKNOWN)
    assert because(failed, replace(page, reasons=None)).startswith(UNKNOWN)


def test_tables_are_narrow_enough_to_read():
    for line in (DOCS / "paper.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("|"):
            assert line.count("|") <= 10, line


def test_cells_below_the_limit_are_judged_by_what_is_new(page):
    one = next(one for one in page.stored.counted if one.statement.finding == "as before")
    assert not replace(one, after=one.before + one.cells // 100).finding().holds
    none = next(one for one in page.stored.counted if one.statement.finding == "none" and one.after == 0)
    assert isinstance(none, Counted)
    assert not replace(none, after=1).finding().holds


@pytest.mark.parametrize(
    ("words", "message"), [(["page", "--again", "--out", "empty"], "page.json: cannot be read as stored results")]
)
def test_mistake_is_one_line_and_code_2(words, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run_study(*words) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "empty" / "paper.md").exists()


def bump(count: int = 300) -> DataSites:
    points = np.random.default_rng(4).random((count, 3))
    return DataSites(points, 0.01 * np.exp(-20.0 * ((points - 0.5) ** 2).sum(axis=1, keepdims=True)), (2,))


OPTIONS = GreedyOptions(n_add=3, tol_add=2e-4, tol_stop=2e-4)


@pytest.mark.parametrize("solve", [direct, Gmres(1e-10)])
@pytest.mark.parametrize("unit", [1.0, 0.3048, 1e-3])
def test_the_written_out_loop_finds_the_engine_s_centres_in_any_unit(solve, unit):
    sites, first = bump(), np.arange(10)
    engine = adapt(sites, ThinPlateSpline(), first, OPTIONS, rule=Worst(look_ahead=1), basis=DirectBasis.of)
    ended = adapted(sites, first, OPTIONS, solve, unit)
    assert (ended.centers, ended.iterations) == (len(engine.chosen), engine.history[-1].iteration)
    assert ended.stop is Stop.CONVERGED
    assert ended.max_error == pytest.approx(engine.max_error, rel=1e-4)


def test_gmres_that_is_stopped_early_leaves_centres_off():
    ended = adapted(bump(), np.arange(10), OPTIONS, Gmres(1e-10, most=5))
    assert ended.stop is Stop.EXHAUSTED
    assert ended.max_error > 10.0 * OPTIONS.tol_stop


def test_limits_end_the_written_out_loop():
    for limit, stop in (({"max_centers": 20}, Stop.MAX_CENTERS), ({"max_iterations": 2}, Stop.MAX_ITERATIONS)):
        ended = adapted(bump(), np.arange(10), replace(OPTIONS, **limit), direct)
        assert ended.stop is stop
        assert ended.centers <= 20


def trial(factor: float, centers: int, stop: str = "CONVERGED") -> Trial:
    return Trial("tolerance", f"/ {factor:g}", "table1", "z", -12.0, factor, 200, centers, 1, 1e-5, stop)


def test_the_factor_of_the_paper_s_number_is_interpolated_between_converged_adaptations():
    key = ("table1", -12.0, "z")
    assert factors([trial(1.0, 100), trial(4.0, 400)])[key] == pytest.approx(2.0)
    assert factors([trial(1.0, 100), trial(4.0, 150)])[key] == np.inf
    assert factors([trial(1.0, 100), trial(4.0, 400, "MAX_CENTERS")])[key] == np.inf


@pytest.mark.mesher
def test_changes_are_made_one_at_a_time(aileron_mesh):
    mesh, _ = aileron_mesh
    case = replace(case_named("aileron"), angle=-12.0)
    found = {(change, value): model for change, value, model in centres.variations(case, mesh)}
    base = found.pop(("nothing changed", ""))
    for (change, value), model in found.items():
        sizes = {d: len(one) for d, one in model.groups.items()}
        if change == "surface sites":
            assert (model.surface < base.surface) == (value == "every second"), value
        assert model.groups["z"].values[: model.surface].any()
        assert not model.groups["z"].values[model.surface :].any(), change
        assert sizes["x"] == sizes["z"]
    one = centres.demands("table1", -12.0, "z")[0]
    plain, small = (one.exact(base, one.options(factor)) for factor in (1.0, 4.0))
    feet = one.exact(base.in_unit(0.3048), one.options(unit=0.3048))
    assert plain.centers == feet.centers < small.centers

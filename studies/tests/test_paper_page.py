"""What docs/paper.md states of the paper's trends: each holds on the paper's own numbers, and on ours as stated."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.cases.aircraft.registry import case_named
from sdm_deflect.deform.rbf.greedy import GreedyOptions, Stop, Worst, adapt
from sdm_deflect.deform.rbf.interpolant import direct
from sdm_deflect.deform.rbf.kernels import ThinPlateSpline
from sdm_deflect.deform.rbf.problem import DataSites
from studies import centres
from studies.loop import Gmres, adapted
from studies.paper import Evaluation, Row, Setting, paper
from studies.solves import DirectBasis

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "paper.md").read_text(encoding="utf-8")
NUMBERS = json.loads((DOCS / "tables" / "page.json").read_text(encoding="utf-8"))


def rows_of(name, source):
    """The rows of a table: the paper's, or those of a loop as they are stored."""
    if source == "paper":
        return list(paper().tables[name].rows)
    with (DOCS / "tables" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if row["source"] == source]
    settings = (
        Setting(one["columns"], float(one["angle_deg"]), (int(one["initial_surface"]), int(one["initial_hexahedron"])),
                int(one["n_add"])) for one in found
    )  # fmt: skip
    figures = ((int(o["iterations"]), int(o["centers"]), float(o["seconds"]), float(o["max_error"])) for o in found)
    return [Row(setting, *own) for setting, own in zip(settings, figures, strict=True)]


def by(rows, name, columns=("xyz", "x", "y", "z")):
    """One figure of the rows, by direction."""
    found = [[getattr(row, name) for row in rows if row.setting.columns == own] for own in columns]
    return [own for own in found if own]


def rises(values):
    return [b > a for a, b in pairwise(values)]


def most(steps):
    return 2 * sum(steps) > len(steps)


def spread(values):
    return max(values) / min(values)


def mv_over_squv(rows):
    """Time of MV over that of the three directions, where a loop did all of them."""
    squv = [sum(times) for times in zip(*by(rows, "seconds", "xyz"), strict=True)]
    return min(mv / own for mv, own in zip(*by(rows, "seconds", ["xyz"]), squv, strict=False))


def ordered(rows, name, columns="yxz"):
    return all(all(rises(own)) for own in zip(*by(rows, name, columns), strict=True))


def grown(rows, name):
    """Whether the larger of two deflections has more of a figure in each direction."""
    return all(abs(a) < abs(b) for a, b in by(rows, name, "xyz"))


def least_in_y(rows, name):
    return all(min(own) == own[1] for own in zip(*by(rows, name, "xyz"), strict=True))


def until_25(rows):
    seconds = [row.seconds for row in rows if row.setting.n_add <= 25]
    later = [row.seconds for row in rows if row.setting.n_add >= 25]
    return not any(rises(seconds)) and any(rises(later))


def at_limit(rows):
    table = paper().tables["table4"]
    limited = all(row.centers == table.max_centers and row.max_error > table.tolerance for row in rows)
    return limited and len({row.iterations for row in rows}) == 1


TRENDS = (
    ("table1", "More initial centres mean fewer iterations.", {"grown": True},
     lambda rows: all(not any(own) or all(rises(own[::-1])) for own in by(rows, "iterations"))),
    ("table1", "More initial centres mostly mean more centres in the end.", {"grown": True},
     lambda rows: most([step for own in by(rows, "centers") for step in rises(own)])),
    ("table1", "The initial centres hardly influence the time.", {"grown": False, "lapack": False},
     lambda rows: all(spread(own) <= 1.25 for own in by(rows, "seconds"))),
    ("table1", "f_y needs the fewest centres, followed by f_x and f_z.", {"grown": True},
     lambda rows: ordered(rows, "centers")),
    ("table1", "SQUV for f_z ends with the same iterations and centres as MV.", {"grown": True},
     lambda rows: all(len({*own}) == 1 for name in ("iterations", "centers")
                      for own in zip(*by(rows, name, ("z", "xyz")), strict=True))),
    ("table1", "MV costs more than SQUV by a factor above two.", {"grown": False, "lapack": False, "gmres": True},
     lambda rows: mv_over_squv(rows) > 2.0),
    ("table2", "A larger M_add generally means fewer iterations.", {"grown": True},
     lambda rows: most(rises([row.iterations for row in rows][::-1]))),
    ("table2", "A larger M_add generally means more centres.", {"grown": True},
     lambda rows: most(rises([row.centers for row in rows]))),
    ("table2", "Any M_add above one takes less time than one.", {"grown": True, "lapack": True, "gmres": True},
     lambda rows: max(row.seconds for row in rows[1:]) < rows[0].seconds),
    ("table2", "The time falls by a factor of more than 6 at best.", {"grown": False, "lapack": False, "gmres": False},
     lambda rows: rows[0].seconds > 6.0 * min(row.seconds for row in rows)),
    ("table2", "It falls monotonically up to M_add = 25 only, then often rises again.",
     {"grown": False, "lapack": False, "gmres": False}, until_25),
    ("table3", "f_y needs the fewest centres, although it has the most sites.", {"grown": True},
     lambda rows: least_in_y(rows, "centers")),
    ("table3", "f_y takes the least time.", {"grown": True, "lapack": True}, lambda rows: least_in_y(rows, "seconds")),
    ("table3", "A larger deflection needs more centres in every direction.", {"grown": True},
     lambda rows: grown(rows, "centers")),
    ("table3", "A larger deflection takes more time in every direction.", {"grown": True, "lapack": True},
     lambda rows: grown(rows, "seconds")),
    ("table4", "No direction reaches the tolerance; all end at the limit after the same iterations.", {"grown": False},
     at_limit),
    ("table4", "The times differ little.", {"grown": True, "lapack": False},
     lambda rows: spread([row.seconds for row in rows]) <= 1.25),
    ("table4", "The largest error is smallest for f_y, followed by f_x.", {}, lambda rows: ordered(rows, "max_error")),
)  # fmt: skip
"""Table, sentence of the page, whether it holds for a loop here, and the test of it."""


@pytest.mark.parametrize(("name", "statement", "here", "test"), TRENDS, ids=[trend[1] for trend in TRENDS])
def test_each_trend_holds_for_the_paper_and_here_as_the_page_states_it(name, statement, here, test):
    assert test(rows_of(name, "paper"))
    for source, holds in here.items():
        assert test(rows_of(name, source)) == holds, source
        verdict = "holds" if holds else r"**does not hold**"
        loop = f" (`{source}`)" if f"{statement} (`{source}`)" in TEXT else ""
        assert f"| {statement}{loop} | {verdict} |" in TEXT


@pytest.mark.parametrize("counted", NUMBERS["counted"], ids=lambda one: f"figure {one['statement']['figure']}")
def test_cells_below_the_limit_of_the_paper_are_as_the_page_states(counted):
    """As before is what adds a hundredth of a histogram's highest bars at most, 3e-4 of all cells: less is not seen."""
    theirs = counted["statement"]
    none = theirs["finding"] == "none"
    holds = counted["after"] == 0 if none else counted["after"] - counted["before"] <= 3e-4 * counted["cells"]
    said = "the deformed mesh has no cell below" if none else "no deterioration is visible below"
    verdict = "holds" if holds else r"**does not hold**"
    loop = " (MV)" if counted["strategy"] == "mv" else ""
    figures = (
        f"{counted['before']} of {counted['cells']} cells below {theirs['below']:g} before, {counted['after']} after"
    )
    assert f"At {theirs['angle']:+g}° {said} {theirs['below']:g}.{loop} | {verdict} | {figures}" in TEXT


@pytest.mark.parametrize("source", ["paper", "here"])
def test_confined_evaluation_is_cheaper_as_the_page_states(source):
    known = paper().evaluations if source == "paper" else [Evaluation(**one) for one in NUMBERS["evaluations"]]
    for one in known:
        points = paper().size(one.case).points if source == "paper" else NUMBERS["sizes"][one.case]["points"]
        assert one.filter_seconds + one.inside_seconds < one.whole_seconds
        faster = 1.5 * one.whole_seconds / one.inside_seconds >= points / one.inside
        assert faster == ((source, one.case) != ("here", "aileron"))  # too few pairs there for two threads


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

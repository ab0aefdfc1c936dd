"""What the paper says of its tables, histograms and timings, as tests of the paper's numbers and of ours.

The cost of an adaptation is counted in pairs of a centre and a data site: milliseconds of a busy machine say little.
Times count only where a sentence is about solving, or about the evaluation of a whole mesh.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from studies.paper import COLUMNS, Evaluation, QualityStatement, Row, paper

Rows = Sequence[Row]
Test = Callable[[Rows], bool]
SAME = 1.25
"""Costs differ little if the largest is at most so many times the smallest; the paper's own differ by up to 1.22."""
SEEN = 3e-4
"""Share of all cells that a histogram shows: a hundredth of its highest bars."""
ROW_LIMIT = 0.15
"""Largest relative difference of our number of centres from the paper's in a row of table 2."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a sentence of the paper holds here, and the figures behind it, the paper's and ours."""

    table: str
    sentence: str
    holds: bool
    paper: str
    here: str

    @property
    def line(self) -> str:
        """A row of a Markdown table; numbers of iterations and centres stand in the table above it."""
        measured = "see above" if self.here.startswith(("iterations:", "centres:")) else self.here
        return f"| {self.sentence} | {'holds' if self.holds else '**does not hold**'} | {measured} |"


@dataclass(frozen=True, slots=True)
class Trend:
    """A sentence of the paper about the rows of a table.

    Attributes
    ----------
    figures : the figures of some rows behind the test.
    test : whether it holds for some rows.
    loop : name of the loop whose rows are tested here.
    """

    table: str
    sentence: str
    figures: Callable[[Rows], str]
    test: Test
    loop: str = "grown"

    def verdict(self, ours: Rows) -> Verdict:
        """Judge our rows of the table."""
        theirs = paper().tables[self.table].rows
        return Verdict(self.table, self.sentence, self.test(ours), self.figures(theirs), self.figures(ours))


def by(rows: Rows, name: str, columns: Iterable[str] = COLUMNS) -> dict[str, list[float]]:
    """Return one figure of the rows by direction, without directions that no row has."""
    found = {own: [float(getattr(row, name)) for row in rows if row.setting.columns == own] for own in columns}
    return {own: values for own, values in found.items() if values}


def listing(name: str, words: str = "", unit: float = 1.0, form: str = ".4g") -> Callable[[Rows], str]:
    """Return what lists a figure of rows by direction, under its own name or in words."""

    def figures(rows: Rows) -> str:
        parts = (
            f"{title(own)} {_listed((value / unit for value in values), form)}"
            for own, values in by(rows, name).items()
        )
        return f"{words or name}: {'; '.join(parts)}"

    return figures


def title(columns: str) -> str:
    """Return how the paper calls it: MV or f_x."""
    return "MV" if columns == "xyz" else f"f_{columns}"


def mv_over_squv(rows: Rows) -> list[float]:
    """Return the time of MV over that of all directions of SQUV, where a loop did them all."""
    times = by(rows, "seconds")
    squv = [sum(own) for own in zip(*(times[d] for d in "xyz"), strict=True)]
    return [mv / own for mv, own in zip(times["xyz"], squv, strict=False)]


def until_25(rows: Rows) -> bool:
    """Whether the cost falls up to M_add = 25, and rises somewhere beyond."""
    first = [row.pairs for row in rows if row.setting.n_add <= 25]
    later = [row.pairs for row in rows if row.setting.n_add >= 25]
    return not any(_rises(first)) and any(_rises(later))


def at_limit(rows: Rows) -> bool:
    """Whether all rows end at the limit of centres after the same iterations, above the tolerance."""
    table = paper().tables["table4"]
    limited = all(row.centers == table.max_centers and row.max_error > table.tolerance for row in rows)
    return limited and len({row.iterations for row in rows}) == 1


def least_error_in_y(rows: Rows) -> bool:
    """Whether errors above the tolerance are least for f_y, followed by f_x; below it all are alike."""
    errors = [own[0] for own in by(rows, "max_error", "yxz").values()]
    return all(_rises(errors)) and errors[0] > paper().tables["table4"].tolerance


def least_in_y(name: str) -> Test:
    """Return what tests whether f_y has least of a figure, at each angle."""
    return lambda rows: all(min(own) == own[1] for own in _beside(rows, name))


def more_with_angle(name: str) -> Test:
    """Return what tests whether the larger of two deflections has more of a figure in each direction."""
    return lambda rows: all(abs(a) < abs(b) for a, b in by(rows, name, "xyz").values())


def _beside(rows: Rows, name: str, columns: Iterable[str] = "xyz") -> Iterable[tuple[float, ...]]:
    return zip(*by(rows, name, columns).values(), strict=True)


def _rises(values: Sequence[float]) -> list[bool]:
    return [b > a for a, b in pairwise(values)]


def _most(rows: Rows, name: str, sign: int) -> bool:
    """Whether a figure rises (1) or falls (-1) in most steps from row to row."""
    steps = [step for own in by(rows, name).values() for step in _rises([sign * value for value in own])]
    return 2 * sum(steps) > len(steps)


def _listed(values: Iterable[float], form: str = ".3g") -> str:
    return ", ".join(f"{value:{form}}" for value in values)


def _spreads(rows: Rows) -> str:
    parts = (f"{title(own)} {max(values) / min(values):.2f}" for own, values in by(rows, "pairs").items())
    return f"most over least pairs: {'; '.join(parts)}"


def _falls(rows: Rows) -> str:
    return f"pairs of the first row over those of each: {_listed(rows[0].pairs / row.pairs for row in rows[1:])}"


_ITERATIONS, _CENTERS = listing("iterations"), listing("centers", "centres")
_PAIRS, _ERRORS = listing("pairs", "millions of pairs", 1e6), listing("max_error", "largest error, m", 1.0, ".2e")


def _ends(rows: Rows) -> str:
    return f"{_ITERATIONS(rows)}; {_CENTERS(rows)}"


TRENDS = (
    Trend("table1", "More initial centres mean fewer iterations.", _ITERATIONS,
          lambda rows: all(not any(own) or all(_rises(own[::-1])) for own in by(rows, "iterations").values())),
    Trend("table1", "More initial centres mostly mean more centres in the end.", _CENTERS,
          lambda rows: _most(rows, "centers", 1)),
    Trend("table1", "The initial centres hardly influence the cost.", _spreads,
          lambda rows: all(max(own) <= SAME * min(own) for own in by(rows, "pairs").values())),
    Trend("table1", "f_y needs the fewest centres, followed by f_x and f_z.", _CENTERS,
          lambda rows: all(all(_rises(own)) for own in _beside(rows, "centers", "yxz"))),
    Trend("table1", "SQUV for f_z ends with the same iterations and centres as MV.", _ends,
          lambda rows: all(len({*own}) == 1 for name in ("iterations", "centers")
                           for own in _beside(rows, name, ("z", "xyz")))),
    Trend("table1", "MV takes more than twice the time of SQUV, solved by GMRES.",
          lambda rows: f"time of MV over that of SQUV: {_listed(mv_over_squv(rows))}",
          lambda rows: min(mv_over_squv(rows)) > 2.0, "gmres"),
    Trend("table2", "A larger M_add generally means fewer iterations.", _ITERATIONS,
          lambda rows: _most(rows, "iterations", -1)),
    Trend("table2", "A larger M_add generally means more centres.", _CENTERS, lambda rows: _most(rows, "centers", 1)),
    Trend("table2", "Any M_add above one costs less than one.", _falls,
          lambda rows: max(row.pairs for row in rows[1:]) < rows[0].pairs),
    Trend("table2", "The cost falls by a factor of more than 6 at best.", _falls,
          lambda rows: rows[0].pairs > 6.0 * min(row.pairs for row in rows)),
    Trend("table2", "It falls monotonically up to M_add = 25 only, then often rises again.", _falls, until_25),
    Trend("table3", "f_y needs the fewest centres, although it has the most sites.", _CENTERS, least_in_y("centers")),
    Trend("table3", "f_y costs least.", _PAIRS, least_in_y("pairs")),
    Trend("table3", "A larger deflection needs more centres in every direction.", _CENTERS, more_with_angle("centers")),
    Trend("table3", "A larger deflection costs more in every direction.", _PAIRS, more_with_angle("pairs")),
    Trend("table4", "No direction reaches the tolerance; all end at the limit after the same iterations.", _ends,
          at_limit),
    Trend("table4", "The costs differ little.", _PAIRS,
          lambda rows: max(row.pairs for row in rows) <= SAME * min(row.pairs for row in rows)),
    Trend("table4", "The largest error is smallest for f_y, followed by f_x.", _ERRORS, least_error_in_y),
)  # fmt: skip
"""What the paper says of its tables."""


def off(rows: Rows) -> list[str]:
    """Return a sentence for each row of table 2 whose centres differ too much from the paper's."""
    found = []
    for theirs, ours in zip(paper().tables["table2"].rows, rows, strict=True):
        differs = ours.centers / theirs.centers - 1.0
        if abs(differs) > ROW_LIMIT:
            found.append(
                f"table 2, M_add = {theirs.setting.n_add}: {ours.centers} centres for {theirs.centers}: "
                f"{100 * differs:+.0f} %, more than {100 * ROW_LIMIT:.0f} %"
            )
    return found


def of_cells(counted: dict[str, Any]) -> Verdict:
    """Judge what the paper reads off a histogram, by the cells counted before and after."""
    theirs = QualityStatement(**counted["statement"])
    more = counted["after"] - counted["before"]
    said, holds = {
        "as before": ("no deterioration is visible", more <= SEEN * counted["cells"]),
        "none": ("the deformed mesh has no cell", counted["after"] == 0),
        "none deformed": ("no deformed cell is", counted["near_after"] == 0),
    }[theirs.finding]
    strategy = " (MV)" if counted["strategy"] == "mv" else ""
    here = (
        f"{counted['before']} of {counted['cells']} cells below {theirs.below:g} before, {counted['after']} after; "
        f"of the {counted['near']} cells that touch the hexahedron, {counted['near_before']} before, "
        f"{counted['near_after']} after, the smallest {counted['least'][0]:.3f} before, {counted['least'][1]:.3f} after"
    )
    sentence = f"At {theirs.angle:+g}° {said} below {theirs.below:g}.{strategy}"
    return Verdict(f"figure{theirs.figure}", sentence, holds, "read off the histogram", here)


def of_times(theirs: Evaluation, ours: Evaluation) -> Verdict:
    """Judge whether confinement saves time."""

    def figures(one: Evaluation) -> str:
        return f"{one.filter_seconds + one.inside_seconds:.3g} s against {one.whole_seconds:.3g} s"

    holds = ours.filter_seconds + ours.inside_seconds < ours.whole_seconds
    sentence = f"{theirs.case}: filter and confined evaluation together are cheaper than the whole mesh."
    return Verdict("timings", sentence, holds, figures(theirs), figures(ours))


def verdicts(rows: Callable[[str, str], Rows], numbers: dict[str, Any]) -> list[dict[str, Any]]:
    """Judge all that the paper says, by rows(table, loop) and the numbers of a page."""
    found = [one.verdict(rows(one.table, one.loop)) for one in TRENDS]
    found += [of_cells(one) for one in numbers["counted"] if one["repair"] == "off"]
    ours = [Evaluation(**{**one, "setting": one["setting"]}) for one in numbers["evaluations"]]
    found += [of_times(*pair) for pair in zip(paper().evaluations, ours, strict=True)]
    return [asdict(one) for one in found]

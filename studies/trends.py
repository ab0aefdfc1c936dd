"""What the paper says of its tables, curves, histograms and timings, as tests of the paper's numbers and of ours.

A sentence about the cost of an adaptation is tested twice: by seconds, and by pairs of a centre and a data site, which
no other work on the machine disturbs. It holds where both say so. One is tested by seconds alone: that MV takes more
than twice the time of SQUV. A pair of MV serves three directions.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import groupby, pairwise
from typing import Any

from studies.paper import COLUMNS, Evaluation, QualityStatement, Row, paper

Rows = Sequence[Row]
# The largest residual (m) at each number of centres.
Curve = Sequence[tuple[int, float]]
# Measures of a cost, as attributes of a row.
BOTH = ("seconds", "pairs")
# Costs differ little if the largest is at most so many times the smallest; the paper's own differ by up to 1.22.
SAME = 1.25
# Relative difference of two residuals that count as identical: no plot over two decades shows it.
IDENTICAL = 1e-3
# Share of the hexahedron's height within which a cell is near the aileron, or near a face of the hexahedron.
NEAR = 0.25
# Largest relative difference of our number of centres from the paper's in a row of table 2.
ROW_LIMIT = 0.15


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a sentence of the paper holds here, and the figures behind it, the paper's and ours."""

    table: str
    sentence: str
    holds: bool
    paper: str
    here: str

    def line(self, before: "Verdict | None" = None) -> str:
        """Return a row of a Markdown table, given the row before.

        Numbers of iterations and centres stand in the table above it, and those of the row before are not repeated.
        """
        measured = "see above" if self.here.startswith(("iterations:", "centres:")) else self.here
        if before and before.here == self.here and measured == self.here:
            measured = "the same numbers"
        return f"| {self.sentence} | {self.sign} | {measured} |"

    @property
    def sign(self) -> str:
        """A check mark if the sentence holds here, else a cross."""
        return "\N{CHECK MARK}" if self.holds else "**\N{BALLOT X}**"


@dataclass(frozen=True, slots=True)
class Trend:
    """A sentence of the paper about the rows of a table.

    Attributes
    ----------
    figures : the figures of some rows behind the test, by a measure of cost.
    test : whether it holds for some rows, by a measure of cost.
    measures : the measures of cost that are tested; one without a name where the sentence is not about a cost.
    timed : name of the loop whose seconds are tested here; all other figures are those of "grown".
    """

    table: str
    sentence: str
    figures: Callable[[Rows, str], str]
    test: Callable[[Rows, str], bool]
    measures: tuple[str, ...] = ("",)
    timed: str = "grown"

    def verdict(self, ours: Callable[[str], Rows]) -> Verdict:
        """Judge our rows of the table, which are given by their loop."""
        theirs = paper().tables[self.table].rows
        rows = {measure: ours(self.timed if measure == "seconds" else "grown") for measure in self.measures}
        found = {measure: self.test(own, measure) for measure, own in rows.items()}
        here = "; ".join(f"{self.figures(own, measure)}{self._said(found, measure)}" for measure, own in rows.items())
        said = "; ".join(self.figures(theirs, measure) for measure in self.measures)
        return Verdict(self.table, self.sentence, all(found.values()), said, here)

    def on_paper(self) -> list[bool]:
        """Return whether it holds on the paper's own rows, by each measure."""
        return [self.test(paper().tables[self.table].rows, measure) for measure in self.measures]

    @staticmethod
    def _said(found: dict[str, bool], measure: str) -> str:
        """Say by which measure the sentence holds, where they differ."""
        return "" if len({*found.values()}) == 1 else ": holds" if found[measure] else ": does not hold"


def by(rows: Rows, name: str, columns: Iterable[str] = COLUMNS) -> dict[str, list[float]]:
    """Return one figure of the rows by direction, without directions that no row has."""
    found = {own: [float(getattr(row, name)) for row in rows if row.setting.columns == own] for own in columns}
    return {own: values for own, values in found.items() if values}


def listing(name: str, words: str = "", form: Callable[[float], str] = "{:.4g}".format) -> Callable[[Rows, str], str]:
    """Return what lists a figure of rows by direction, under its own name or in words."""

    def figures(rows: Rows, _measure: str) -> str:
        parts = (f"{title(own)} {_listed(values, form)}" for own, values in by(rows, name).items())
        return f"{words or name}: {'; '.join(parts)}"

    return figures


def three_digits(value: float) -> str:
    """Return a number with three digits, or all digits before the point."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def title(columns: str) -> str:
    """Return how the paper calls it: MV or f_x."""
    return "MV" if columns == "xyz" else f"f_{columns}"


def mv_over_squv(rows: Rows, measure: str = "seconds") -> list[float]:
    """Return the cost of MV over that of all directions of SQUV, by initial centres."""
    costs = by(rows, measure)
    squv = [sum(own) for own in zip(*(costs[d] for d in "xyz"), strict=True)]
    return [mv / own for mv, own in zip(costs["xyz"], squv, strict=True)]


def until_25(rows: Rows, measure: str) -> bool:
    """Whether the cost falls in each step up to M_add = 25, and rises in half of the steps beyond, as the paper's."""
    first = [getattr(row, measure) for row in rows if row.setting.n_add <= 25]
    later = [getattr(row, measure) for row in rows if row.setting.n_add >= 25]
    rises = _rises(later)
    return not any(_rises(first)) and 2 * sum(rises) >= len(rises)


def at_limit(rows: Rows) -> bool:
    """Whether all rows end at the limit of centres after the same iterations, above the tolerance."""
    table = paper().tables["table4"]
    limited = all(row.centers == table.max_centers and row.max_error > table.tolerance for row in rows)
    return limited and len({row.iterations for row in rows}) == 1


def least_error_in_y(rows: Rows) -> bool:
    """Whether errors above the tolerance are least for f_y, followed by f_x; below it all are alike."""
    errors = [own[0] for own in by(rows, "max_error", "yxz").values()]
    return all(_rises(errors)) and errors[0] > paper().tables["table4"].tolerance


def least_in_y(rows: Rows, name: str) -> bool:
    """Whether f_y has least of a figure, at each angle."""
    return all(min(own) == own[1] for own in _beside(rows, name))


def more_with_angle(rows: Rows, name: str) -> bool:
    """Whether the larger of two deflections has more of a figure in each direction."""
    return all(abs(a) < abs(b) for a, b in by(rows, name, "xyz").values())


def _beside(rows: Rows, name: str, columns: Iterable[str] = "xyz") -> Iterable[tuple[float, ...]]:
    return zip(*by(rows, name, columns).values(), strict=True)


def _rises(values: Sequence[float]) -> list[bool]:
    return [b > a for a, b in pairwise(values)]


def _most(rows: Rows, name: str, sign: int) -> bool:
    """Whether a figure rises (1) or falls (-1) in most steps from row to row."""
    steps = [step for own in by(rows, name).values() for step in _rises([sign * value for value in own])]
    return 2 * sum(steps) > len(steps)


def _listed(values: Iterable[float], form: Callable[[float], str] = three_digits) -> str:
    return ", ".join(map(form, values))


def _spreads(rows: Rows, measure: str) -> str:
    parts = (f"{title(own)} {max(values) / min(values):.2f}" for own, values in by(rows, measure).items())
    return f"most over least {measure}: {'; '.join(parts)}"


def _falls(rows: Rows, measure: str) -> str:
    first, *others = (getattr(row, measure) for row in rows)
    return f"{measure} of the first row over those of each: {_listed(first / own for own in others)}"


def _costs(rows: Rows, measure: str) -> str:
    unit, words = (1e6, "millions of pairs") if measure == "pairs" else (1.0, "seconds")
    return listing(measure, words, lambda value: three_digits(value / unit))(rows, measure)


_ITERATIONS, _CENTERS = listing("iterations"), listing("centers", "centres")


def _ends(rows: Rows, measure: str) -> str:
    return f"{_ITERATIONS(rows, measure)}; {_CENTERS(rows, measure)}"


# What the paper says of its tables.
TRENDS = (
    Trend("table1", "More initial centres mean fewer iterations.", _ITERATIONS,
          lambda rows, _: all(not any(own) or all(_rises(own[::-1])) for own in by(rows, "iterations").values())),
    Trend("table1", "More initial centres mostly mean more centres in the end.", _CENTERS,
          lambda rows, _: _most(rows, "centers", 1)),
    Trend("table1", "The initial centres hardly influence the cost.", _spreads,
          lambda rows, cost: all(max(own) <= SAME * min(own) for own in by(rows, cost).values()), BOTH, "gmres"),
    Trend("table1", "f_y needs the fewest centres, followed by f_x and f_z.", _CENTERS,
          lambda rows, _: all(all(_rises(own)) for own in _beside(rows, "centers", "yxz"))),
    Trend("table1", "SQUV for f_z ends with the same iterations and centres as MV.", _ends,
          lambda rows, _: all(len({*own}) == 1 for name in ("iterations", "centers")
                              for own in _beside(rows, name, ("z", "xyz")))),
    Trend("table1", "MV takes more than twice the time of SQUV.",
          lambda rows, _: f"time of MV over that of SQUV, by GMRES: {_listed(mv_over_squv(rows))}",
          lambda rows, _: min(mv_over_squv(rows)) > 2.0, ("seconds",), "gmres"),
    Trend("table2", "A larger M_add generally means fewer iterations.", _ITERATIONS,
          lambda rows, _: _most(rows, "iterations", -1)),
    Trend("table2", "A larger M_add generally means more centres.", _CENTERS,
          lambda rows, _: _most(rows, "centers", 1)),
    Trend("table2", "Any M_add above one costs less than one.", _falls,
          lambda rows, cost: max(getattr(row, cost) for row in rows[1:]) < getattr(rows[0], cost), BOTH, "gmres"),
    Trend("table2", "The cost falls by a factor of more than 6 at best.", _falls,
          lambda rows, cost: getattr(rows[0], cost) > 6.0 * min(getattr(row, cost) for row in rows), BOTH, "gmres"),
    Trend("table2", "It falls monotonically up to M_add = 25 only, then often rises again.", _falls, until_25, BOTH,
          "gmres"),
    Trend("table3", "f_y needs the fewest centres, although it has the most sites.", _CENTERS,
          lambda rows, _: least_in_y(rows, "centers")),
    Trend("table3", "f_y costs least.", _costs, least_in_y, BOTH),
    Trend("table3", "A larger deflection needs more centres in every direction.", _CENTERS,
          lambda rows, _: more_with_angle(rows, "centers")),
    Trend("table3", "A larger deflection costs more in every direction.", _costs, more_with_angle, BOTH),
    Trend("table4", "No direction reaches the tolerance; all end at the limit after the same iterations.", _ends,
          lambda rows, _: at_limit(rows)),
    Trend("table4", "The costs differ little.", _costs,
          lambda rows, cost: max(getattr(row, cost) for row in rows) <= SAME * min(getattr(row, cost) for row in rows),
          BOTH),
    Trend("table4", "The largest error is smallest for f_y, followed by f_x.",
          listing("max_error", "largest error, m", "{:.2e}".format), lambda rows, _: least_error_in_y(rows)),
)  # fmt: skip


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


def of_curves(curves: Mapping[str, Curve]) -> Verdict:
    """Judge figure 2: the largest residuals of f_z and of MV against their centres."""
    alone, joint = dict(curves["z"]), dict(curves["xyz"])
    shared = [centres for centres in alone if centres in joint]
    most = max(abs(joint[centres] / alone[centres] - 1.0) for centres in shared)
    here = (
        f"{len(shared)} of {max(len(alone), len(joint))} numbers of centres in common; residuals there differ by "
        f"{100 * most:.2g} % at most"
    )
    holds = [*alone] == [*joint] and most <= IDENTICAL
    sentence = "The curves of f_z and of MV are identical, but for the time."
    return Verdict("figure2", sentence, holds, "read off the curves", here)


def of_cells(strategies: Sequence[dict[str, Any]]) -> Verdict:
    """Judge what the paper reads off the histograms of one deflection, by the cells that each strategy leaves."""
    theirs, cells = QualityStatement(**strategies[0]["statement"]), strategies[0]["cells"]
    said, holds = {
        "as before": ("no deterioration is visible", all(one["after"] <= one["before"] for one in strategies)),
        "none": ("the deformed mesh has no cell", not any(one["after"] for one in strategies)),
        "none deformed": ("no deformed cell is", not any(one["near_after"] for one in strategies)),
    }[theirs.finding]
    parts = [
        f"{one['before']:,} of {cells:,} cells below {theirs.below:g} before, {one['after']:,} after"
        f"{' by ' + one['strategy'].upper() if len(strategies) > 1 else ''}; of the {one['near']:,} cells that touch "
        f"the hexahedron, {one['near_before']:,} before, {one['near_after']:,} after, the smallest "
        f"{one['least'][0]:.3f} before, {one['least'][1]:.3f} after"
        for one in strategies
    ]
    sentence = f"At {theirs.angle:+g}° {said} below {theirs.below:g}."
    return Verdict(f"figure{theirs.figure}", sentence, holds, "read off the histogram", "; ".join(parts))


def of_worst(worst: dict[str, Any]) -> Verdict:
    """Judge where the worst cells are (figure 5)."""
    near = max(worst["to_surface"], worst["to_upper"]) <= NEAR * worst["height"]
    here = (
        f"{100 * worst['upper_half']:.0f} % of the {worst['cells']:,} worst cells are in the upper half of the "
        f"hexahedron, {1e3 * worst['height']:.0f} mm high; medians: {1e3 * worst['to_surface']:.1f} mm from a node "
        f"of the aileron, {1e3 * worst['to_upper']:.1f} mm below the upper face, {worst['volume']:.2f} of the volume "
        "before"
    )
    sentence = f"At {worst['angle']:+g}° the worst cells are near the aileron, near the upper face, and compressed."
    holds = near and worst["volume"] < 1.0
    return Verdict("figure5", sentence, holds, "read off the picture", here)


def of_sliding(angles: Sequence[dict[str, Any]]) -> Verdict:
    """Judge the main claim of section 5.2: the quality with nodes that slide on the Chimera face, and that cannot."""
    pairs = [(one["sliding"], one["pinned"]) for one in angles]
    holds = all(sliding[name] > pinned[name] for sliding, pinned in pairs for name in ("min", "p01"))

    def inverted(one: dict[str, Any]) -> str:
        return ", ".join(str(one[side]["inverted"]) for side in ("before", "sliding", "pinned"))

    parts = [
        f"{one['angle']:+g}°: least {one['before']['min']:.3f} before, {one['sliding']['min']:.3f} sliding, "
        f"{one['pinned']['min']:.3f} pinned; 1 % quantile {one['before']['p01']:.3f}, {one['sliding']['p01']:.3f}, "
        f"{one['pinned']['p01']:.3f}; inverted {inverted(one)}"
        for one in angles
    ]
    sentence = "In-plane motion on the Chimera face alleviates the loss of quality, even at large angles."
    return Verdict("figure5", sentence, holds, "said in sections 5.2 and 6", "; ".join(parts))


def of_times(theirs: Evaluation, ours: Evaluation) -> Verdict:
    """Judge whether confinement saves time."""

    def figures(one: Evaluation) -> str:
        return f"{one.filter_seconds + one.inside_seconds:.3g} s against {one.whole_seconds:.3g} s"

    holds = ours.filter_seconds + ours.inside_seconds < ours.whole_seconds
    sentence = f"{theirs.case}: filter and confined evaluation together are cheaper than the whole mesh."
    return Verdict("timings", sentence, holds, figures(theirs), figures(ours))


def verdicts(
    rows: Callable[[str, str], Rows], curves: Mapping[str, Curve], numbers: dict[str, Any]
) -> list[dict[str, Any]]:
    """Judge all that the paper says, by rows(table, loop), the curves of figure 2, and the numbers of a page."""
    found = [one.verdict(partial(rows, one.table)) for one in TRENDS]
    found.append(of_curves(curves))
    plain = [one for one in numbers["counted"] if one["repair"] == "off"]
    found += [of_cells([*own]) for _, own in groupby(plain, key=lambda one: one["statement"])]
    found += [of_worst(numbers["worst"]), of_sliding(numbers["sliding"])]
    ours = [Evaluation(**{**one, "setting": one["setting"]}) for one in numbers["evaluations"]]
    found += [of_times(*pair) for pair in zip(paper().evaluations, ours, strict=True)]
    return [asdict(one) for one in found]

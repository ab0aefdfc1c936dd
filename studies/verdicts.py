"""The verdicts of the page of the paper: what the paper says, whether it holds here, and why not."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from tomllib import loads

from cattrs import structure

from studies.measure import Result, filter_is_cheap, savings
from studies.reasons import figures_for
from studies.stored import Counted, Page
from studies.trends import TRENDS, Finding

SAID = {
    "none": "At {:+g}° the deformed mesh has no cell below {:g}.",
    "as before": "At {:+g}° no deterioration is visible below {:g}.",
}
SAVES = "confined evaluation is faster at least by the ratio of the numbers of points"
CHEAP = "filter and confined evaluation together are cheaper than the whole mesh"
UNKNOWN = "no reason was measured"
PLACES = {
    "table1": "Table 1", "table2": "Table 2", "figure3": "Figure 3", "table3": "Table 3", "figure4": "Figure 4",
    "table4": "Table 4", "figure7": "Figure 7", "timings": "Timings",
}  # fmt: skip
"""Parts of the page that have verdicts, in its order."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A sentence of the paper and what became of it; `by` is the loop, or the strategy, that it was judged with."""

    place: str
    statement: str
    by: str
    finding: Finding

    @property
    def note(self) -> str:
        """The loop or the strategy, as it stands behind the sentence."""
        name = self.by if self.by in ("", "MV") else f"`{self.by}`"
        return f" ({name})" if name else ""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a sentence does not hold; figures in braces are measured ones. `by` names the loops, none all."""

    place: str
    statement: str
    text: str
    by: tuple[str, ...] = ()

    def explains(self, verdict: Verdict) -> bool:
        """Return True if this is the verdict's reason."""
        same = (self.place, self.statement) == (verdict.place, verdict.statement)
        return same and (not self.by or verdict.by in self.by)


@cache
def reasons() -> tuple[Reason, ...]:
    """Read the data file of the package."""
    data = loads(files(__package__).joinpath("reasons.toml").read_text(encoding="utf-8"))
    return structure(data["reason"], tuple[Reason, ...])


def verdicts(page: Page) -> Iterator[Verdict]:
    """Yield all verdicts of the page, in its order."""
    for place in PLACES:
        if place in page.results:
            yield from _of_table(page.results[place])
        elif place == "timings":
            yield from _of_timings(page)
        for counted in page.stored.counted:
            if f"figure{counted.statement.figure}" == place:
                yield _of_histogram(place, counted)


def _of_timings(page: Page) -> Iterator[Verdict]:
    for timed in page.stored.evaluations:
        saved = savings(timed, page.stored.sizes[timed.case].points)
        for statement, finding in ((SAVES, saved), (CHEAP, filter_is_cheap(timed))):
            yield Verdict("timings", f"{timed.case}: {statement}", "", finding)


def _of_histogram(place: str, counted: Counted) -> Verdict:
    theirs = counted.statement
    statement = SAID[theirs.finding].format(theirs.angle, theirs.below)
    return Verdict(place, statement, "MV" if counted.strategy == "mv" else "", counted.finding())


def _of_table(result: Result) -> Iterator[Verdict]:
    for trend in TRENDS[result.name]:
        for loop, found in result.findings(trend).items():
            yield Verdict(result.name, trend.statement, loop.name if trend.of_time else "", found)


def because(verdict: Verdict, page: Page) -> str:
    """Return why a verdict is as it is: the figures by which it holds, or the reason why not."""
    if verdict.finding.holds:
        return verdict.finding.evidence
    found = [reason for reason in reasons() if reason.explains(verdict)]
    if not found or page.reasons is None:
        return f"{UNKNOWN} ({verdict.finding.evidence})"
    text = found[0].text.format(**figures_for(verdict.place, verdict.by, page))
    return f"{verdict.finding.evidence}. Why: {text}"


def counted(page: Page) -> str:
    """Return how many verdicts there are of each kind."""
    found = list(verdicts(page))
    good = sum(one.finding.holds for one in found)
    return f"Of {len(found)} verdicts on what the paper says {good} hold and {len(found) - good} do not."

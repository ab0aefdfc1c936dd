"""The sections of the page of the paper, in words: everything from stored results, nothing measured in here."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from studies.files import markdown
from studies.measure import Result, filter_is_cheap, savings
from studies.paper import Evaluation, paper
from studies.stored import Counted, Reasons, Stored
from studies.trends import Finding

SAID = {
    "none": "At {:+g}° the deformed mesh has no cell below {:g}.",
    "as before": "At {:+g}° no deterioration is visible below {:g}.",
}
SAVES = "confined evaluation is faster at least by the ratio of the numbers of points"
CHEAP = "filter and confined evaluation together are cheaper than the whole mesh"
GAP_SEEN = "nothing changes outside the hexahedron, that the wing is not influenced and that the aileron stays planar"
TAIL_SEEN = (
    "the tail stays planar, the fuselage circular and closed at the root, and that only the adjacent panel moves"
)


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """All that is known when the page is written."""

    stored: Stored
    results: dict[str, Result]
    reasons: Reasons | None


Text = Callable[[Page], str]
"""Returns the Markdown of a section."""


def statement(one: Counted) -> str:
    """Return what the paper says of a histogram."""
    return SAID[one.statement.finding].format(one.statement.angle, one.statement.below)


def evaluated(page: Page) -> Iterator[tuple[Evaluation, str, Finding]]:
    """Yield the timings of each case with what the paper says of them and whether it holds."""
    for one in page.stored.evaluations:
        yield one, SAVES, savings(one, page.stored.sizes[one.case].points)
        yield one, CHEAP, filter_is_cheap(one)


def figure1(page: Page) -> str:
    """The aircraft and the two blocks, with the sizes of both meshes."""
    lines = []
    for what, case in (("full model", "aileron"), ("Chimera block", "aileron-chimera")):
        theirs, ours = paper().size(case), page.stored.sizes[case]
        lines.append(
            f"- {what}: here {ours.points:,} points and {ours.cells:,} tetrahedra; "
            f"the paper: {theirs.points:,} and {theirs.cells:,}."
        )
    return f"{picture(page, 'figure1')}\n\n" + "\n".join(lines)


def table(page: Page, name: str) -> str:
    """A table of the paper, ours beside it."""
    body = markdown(page.results[name]).partition("\n\n")[2]
    return f"{body}\n{picture(page, name)}\n\nAll numbers: [{name}.csv](tables/{name}.csv)."


def histograms(page: Page, number: int) -> str:
    """Histograms, and what the paper reads off them."""
    lines = []
    for one in page.stored.counted:
        if one.statement.figure == number:
            found, note = one.finding(), " (MV)" if one.strategy == "mv" else ""
            lines.append(f"- {statement(one)} Here{note}: **{found.verdict}** ({found.evidence}).")
    return f"{picture(page, f'figure{number}')}\n\n" + "\n".join(lines)


def checks(page: Page, number: int, seen: str) -> str:
    """What the paper judges by eye, and what the checks measured."""
    lines = [
        f"- {one.angle:+g}°, `{one.name}`: {one.value:.3g} {one.unit}, {one.judgement} {one.limit:.3g} demanded: "
        f"{'passed' if one.passed else '**failed**'} ({one.where})."
        for one in page.stored.seen
        if one.figure == number
    ]
    head = f"{picture(page, f'figure{number}')}\n\nThe paper judges by eye that {seen}. Measured here:"
    return f"{head}\n\n" + "\n".join(lines)


def figure6(page: Page) -> str:
    """The tail with its hexahedron and sites."""
    theirs, ours = paper().size("tail"), page.stored.sizes["tail"]
    inside = {one.case: one.inside for one in page.stored.evaluations}.get("tail")
    lines = [
        f"- Sites: here {ours.surface} on the surface and {ours.zero_sites[0]} on the hexahedron; "
        f"the paper: {theirs.surface} and {theirs.zero_sites[0]}."
    ]
    if inside:
        lines.append(
            f"- Mesh points inside the hexahedron: here {inside} of {ours.points}; "
            f"the paper: {paper().evaluations[1].inside} of {theirs.points}."
        )
    return f"{picture(page, 'figure6')}\n\n" + "\n".join(lines)


def timings(page: Page) -> str:
    """Filter and evaluation times for f_x."""
    lines = [
        "| case | | N_c | points inside | filter, s | evaluation inside, s | on the whole mesh, s |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for theirs, ours in zip(paper().evaluations, page.stored.evaluations, strict=True):
        for who, one in (("paper", theirs), ("here", ours)):
            times = (one.filter_seconds, one.inside_seconds, one.whole_seconds)
            cells = (theirs.case, who, one.centers, one.inside, *(f"{seconds:.3g}" for seconds in times))
            lines.append(f"| {' | '.join(map(str, cells))} |")
    notes = [f"- {one.case}: {what}: **{found.verdict}** ({found.evidence})." for one, what, found in evaluated(page)]
    return "\n".join([*lines, "", *notes])


def picture(page: Page, name: str) -> str:
    """Return a picture with its text alternative."""
    return f"![{page.stored.pictures[name]}](figures/{name}.png)"


def joined(paragraphs: Iterable[str]) -> str:
    """Join paragraphs."""
    return "\n\n".join(paragraphs)

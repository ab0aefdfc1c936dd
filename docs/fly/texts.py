"""Sentences and tables of the guide that have numbers of `facts.json`.

They stand in the texts between the marks `<!-- facts NAME -->` and `<!-- end -->`.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

from docs.fly.tail import START, WORSE

Facts = dict[str, Any]
DOCS = Path(__file__).parents[1]
NAMES = (
    "ten-minutes.md",
    "teaching.md",
    "handout.md",
    "slides.html",
    "cases.md",
    "motions.md",
    "own-mesh.md",
    "flow.md",
)
TEXTS = tuple(DOCS / name for name in NAMES)
# Largest number of letters of a line.
WIDTH = 140


def table(heads: Sequence[str], rows: Iterable[Sequence[object]], words: int = 1) -> str:
    """Return a table whose first columns are words, and the others numbers."""
    lines = [heads, ["---"] * words + ["---:"] * (len(heads) - words), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def plus(centres: Sequence[int]) -> str:
    """Return numbers of centres with plus signs."""
    return " + ".join(f"{count:,}" for count in centres)


def steps(facts: Facts) -> str:
    """Return the table of the greedy steps."""
    rows = [
        (count, f"{1e3 * one['error']:.1f}", one["inverted"], f"{one['least']:.3f}")
        for count, one in facts["tail"]["centres"].items()
    ]
    return table(("centres", "largest error, mm", "cells inside out", "least quality"), rows, words=0)


def choices(facts: Facts) -> str:
    """Return the table of SQUV and MV."""
    rows = []
    for name, both in facts["strategies"].items():
        squv, mv = both["squv"], both["mv"]
        own = plus(squv["centres"]), squv["weights"], f"{squv['seconds']:.3f}"
        rows.append((f"`{name}`", *own, mv["centres"][0], mv["weights"], f"{mv['seconds']:.3f}"))
    heads = ("surface", "SQUV: centres of x, y, z", "weights", "s", "MV: centres", "weights", "s")
    return table(heads, rows, words=2)


def box(facts: Facts) -> str:
    """Return the sentences about the sites on the box."""
    tail = facts["tail"]
    jump, motion, inverted = 1e3 * tail["jump"], 1e3 * tail["motion"], tail["without_box"]["inverted"]
    angle = f"{tail['angle']:g}°"
    return (
        f"Turn the fighter's left tail by {angle} without sites on its box. The field jumps there by {jump:.0f} mm,\n"
        f"and the tail itself moves by at most {motion:.0f} mm: {inverted} cells are inside out. With\n"
        f"{tail['zero_sites']} sites on the box none is."
    )


def files(facts: Facts) -> str:
    """Return the sentences on what SQUV saves."""
    found = facts["lesson"]["files"]
    squv, mv = (found[f"aileron {strategy}"] for strategy in ("squv", "mv"))
    return (
        f"SQUV pays where a direction needs little. For the aileron at 12 degrees `interpolant.npz` has "
        f"{squv['bytes'] / 1e3:.0f} kB by SQUV, and {mv['bytes'] / 1e3:.0f} kB\n"
        f"by MV: {plus(squv['centres'])} weights against 3 · {mv['centres'][0]}."
    )


def answers(facts: Facts) -> str:
    """Return the answers to the questions of the page's six steps."""
    page, tail = facts["lesson"]["page"], facts["tail"]
    counts = {int(count): one["inverted"] for count, one in tail["centres"].items()}
    first = next(count for count, inverted in counts.items() if not inverted)
    falling = ", ".join(str(inverted) for count, inverted in counts.items() if count <= first)
    (low, fewer), (high, more) = rise(counts)
    start, following, *_ = counts
    off, motion = 1e3 * tail["centres"][str(sum(START))]["error"], 1e3 * tail["motion"]
    lines = [
        f"Those between the tails and their boxes. {page['worse']:,} of {page['cells']:,} cells lose more than "
        f"{WORSE:g}, and {page['inverted'] or 'none'} is inside out.",
        f"At its {sum(START)} centres alone. Elsewhere it is off by up to {off:.1f} mm; "
        f"the tail moves by {motion:.1f} mm.",
        f"At the box: there the field is {1e3 * tail['jump']:.0f} mm, and beyond the box nothing moves. "
        f"{tail['without_box']['inverted']} cells are inside out.",
        f"{first}. With {start}, {following}, and so on {falling} cells are inside out: "
        f"{more} with {high}, and only {fewer} with {low}.",
        "At its hinge edges and at both ends.",
        f"The free aileron of the SDM: its nodes are within {facts['rigid']:.0e} m of the CAD. That of the fighter is "
        "closed, so it cannot turn rigidly.",
    ]
    return "\n".join(f"{number}. {line}" for number, line in enumerate(lines, 1))


def rise(counts: dict[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return two numbers of centres, one after the other, between which the number of cells inside out rises."""
    rows = [*counts.items()]
    return next(pair for pair in pairwise(rows) if pair[0][1] < pair[1][1])


def roll(facts: Facts) -> str:
    """Return the answers of the first exercise."""
    found = facts["lesson"]["roll"]
    return (
        f"Down, towards -z. It turns by the full angle over {found['full']} of the span, by {found['mean']} of it\n"
        "on average: both ends are closed, and beside them the angle rises from zero. "
        f"{found['moved']:,} nodes moved, and\n{found['stayed']:,} did not."
    )


def margins(facts: Facts) -> str:
    """Return the table of the exercise on the box."""
    rows = [
        (margin, one["inverted"], f"{one['least']:.3f}", f"{1e3 * one['off']:.0f}")
        for margin, one in facts["lesson"]["margins"].items()
    ]
    return table(("margin, m", "cells inside out", "worst cell", "its distance from the box, mm"), rows, words=0)


def tolerances(facts: Facts) -> str:
    """Return the table of the exercise on centres."""
    rows = []
    for tolerance, one in facts["lesson"]["tolerances"].items():
        asked = f"{float(tolerance):.0e}".replace("-0", "-")
        rows.append((asked, plus(one["centres"]), f"{1e3 * one['between']:.1f}", f"{one['least']:.3f}"))
    return table(("tolerance, m", "centres of x, y, z", "error between sites, mm", "worst cell"), rows, words=0)


def both(facts: Facts) -> str:
    """Return the table of the exercise on SQUV and MV."""
    rows = []
    for name, one in facts["lesson"]["files"].items():
        surface, strategy = name.split()
        count = plus(one["centres"]) if strategy == "squv" else f"{one['centres'][0]}"
        rows.append((surface, strategy.upper(), count, f"{one['bytes']:,}", f"{one['seconds']:.2f}"))
    return table(("surface", "strategy", "centres", "bytes", "s"), rows, words=2)


def angles(facts: Facts) -> str:
    """Return the table of large angles."""
    rows = [(*name.split(), *found) for name, found in facts["lesson"]["angles"].items()]
    return table(("surface", "degrees", "without repair", "with repair"), rows)


def blanks(facts: Facts) -> str:
    """Return the table of large angles to be filled in."""
    found = [name.split() for name in facts["lesson"]["angles"]]
    by_surface = [[angle for name, angle in found if name == surface] for surface in ("aileron", "tail")]
    count = max(map(len, by_surface))
    columns = [[*angles, *[""] * (count - len(angles))] for angles in by_surface]
    rows = [(first, "", "", second, "", "") for first, second in zip(*columns, strict=True)]
    return table(("aileron, degrees", "no repair", "repair", "tail, degrees", "no repair", "repair"), rows, words=0)


def strips(facts: Facts) -> str:
    """Return the table of strips beside the ends of a blended flap."""
    rows = [
        (one["angle"], f"`{one['strip']}`", one["full"], one["mean"], f"{one['least']:.3f}")
        for one in facts["wing"]["strips"]
    ]
    heads = ("degrees", "`--strip`", "of the span turns by all of it", "mean share of the angle", "worst cell")
    return table(heads, rows, words=0)


def apart(facts: Facts) -> str:
    """Return the sentence on how far a plan's mesh is from that of one deflection."""
    found = facts["wing"]["plan"]
    return fill(
        f"At the 12 degrees above nodes within the flow are up to {found['most']:.3f} chords apart, half of them less "
        f"than {found['median']:.1g}; the flap moves by up to {found['moves']:.3f}.",
        WIDTH,
    )


def verdicts(facts: Facts) -> str:
    """Return what the last line says, by the angle."""
    meanings = (
        "the mesh can be used. The exit code is 0.",
        "the mesh can be used, and some cells are poor; a line before says what helps. The exit code is 0.",
        "a check failed, and a table says by how much. The exit code is 1.",
    )
    said = zip(facts["wing"]["said"].items(), meanings, strict=True)
    return "\n".join(f"- `{line}`, as at {angle} degrees: {meaning}" for (angle, line), meaning in said)


def limits(_: Facts) -> str:
    """Return the sentence on how far each surface turns, from the table of `python -m studies limits`."""
    from studies.limits import pieces  # which needs CAD

    sentence, _table = pieces(DOCS / "tables" / "limits.csv")
    return fill(sentence, WIDTH)


def _of_flow(name: str) -> Callable[[Facts], str]:
    """Return what gives a block of docs/flow.md, from the results of `python -m studies flow`."""

    def block(_: Facts) -> str:
        from studies.flow.kept import BLOCKS  # which needs CAD

        found = BLOCKS[name]()
        return found if found.startswith("|") else fill(found, WIDTH)

    return block


# What is written between the marks, by name.
OF_FACTS = (
    steps, choices, box, files, answers, roll, margins, tolerances, both, angles, blanks, limits, strips, verdicts,
    apart,
)  # fmt: skip
OF_FLOW = ("differences", "disagreement", "slopes", "needed")
BLOCKS: dict[str, Callable[[Facts], str]] = {one.__name__: one for one in OF_FACTS}
BLOCKS |= {f"flow_{name}": _of_flow(name) for name in OF_FLOW}


def with_facts(text: str, facts: Facts) -> str:
    """Replace the marked blocks of a text by the facts."""

    def block(found: re.Match[str]) -> str:
        return f"<!-- facts {found[1]} -->\n\n{BLOCKS[found[1]](facts)}\n\n<!-- end -->"

    return re.sub(r"<!-- facts (\w+) -->.*?<!-- end -->", block, text, flags=re.DOTALL)


def stale(facts: Facts) -> list[Path]:
    """Return the texts that have other numbers than the facts."""
    return [path for path in TEXTS if with_facts(text := path.read_text(encoding="utf-8"), facts) != text]

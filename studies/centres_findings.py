"""What the varied adaptations settle about the paper's numbers of centres, and what they do not."""

from collections.abc import Iterator
from math import atan, degrees, log

from studies.measure import GROWN
from studies.paper import paper
from studies.sections import Page
from studies.trends import TWICE, among
from studies.trials import CASES, GMRES, NOTHING, TOLERANCE, Trial, Trials, cell, factors, of

SAME = 0.02
"""Numbers of centres that differ by less are alike."""
PLAIN = ("margins of the hexahedron", "distance of zero sites", "surface sites", "sites on the trailing edge",
         "strip beside the rib", "polynomial")  # fmt: skip
"""Changes that concern no more than where the sites are and what is added to the kernels."""

Runs = dict[tuple[str, str, float, str], Trial]
"""By table, direction, factor and what GMRES was told."""


def findings(page: Page) -> Iterator[str]:
    """Yield what the trials settle, each with its numbers."""
    assert page.reasons is not None
    trials = page.reasons.trials
    yield from (_unit(trials), _norm(page), _size(trials), _hinge(page, trials), _sites(trials))
    yield from (_gmres_aileron(trials), _gmres_tail(trials), _early(), _panel(trials))


def settled(yes: bool) -> str:
    """Return it in words."""
    return "**Settled.**" if yes else "**Not settled.**"


def sufficient(yes: bool) -> str:
    """Return what an explanation is worth that fits the numbers, and that nothing else supports."""
    return "**Suffices, not proven.**" if yes else "**Not settled.**"


def _unit(trials: Trials) -> str:
    plain = {(one.table, one.columns): one.centers for one in of(trials, NOTHING)}
    own = of(trials, "unit of length")
    same = sum(one.centers == plain[one.table, one.columns] for one in own)
    return (
        f"{settled(same == len(own))} r² log r depends on the unit of length, its interpolant with a linear polynomial "
        f"does not: in millimetres and in feet {same} of {len(own)} adaptations end with the same centres."
    )


def _norm(page: Page) -> str:
    rows = page.results["table1"].by(GROWN)
    pairs = list(zip(among(rows, "xyz"), among(rows, "z"), strict=True))
    same = sum(a.centers == b.centers for a, b in pairs)
    return (
        f"{settled(same == len(pairs))} The norm of the error: chosen by the error's length in space (MV) or by its z "
        f"alone (f_z), {same} of {len(pairs)} adaptations of table 1 end with the same centres."
    )


def _size(trials: Trials) -> str:
    own = [factor for (table, _, d), factor in factors(trials).items() if table != "table4" and d != "y"]
    small, large = min(own), max(own)
    return (
        f"{sufficient(large <= TWICE * small)} The aileron's f_x and f_z: a tolerance {small:.1f} to {large:.1f} times "
        f"smaller by the size of the model gives the paper's numbers in all {len(own)} rows, without and with a gap, "
        "at both angles. The paper gives its tolerance without a unit; which unit it was is not known."
    )


def _hinge(page: Page, trials: Trials) -> str:
    found = factors(trials)
    ratios = [found[t, a, "y"] / found[t, a, "x"] for t, a, d in found if d == "y" and t != "table4"]
    ours = next(iter(page.results["table1"].ground.largest_mm.values()))
    slope = ours["y"] / ours["x"]
    swept = [degrees(atan(slope * ratio)) for ratio in (min(ratios), max(ratios))]
    return (
        f"{sufficient(max(ratios) <= TWICE * min(ratios))} The aileron's f_y needs a further {min(ratios):.1f} to "
        f"{max(ratios):.1f}, as if the motion in y were so much larger by that in x. Their ratio is the tangent of the "
        f"hinge's angle to the y axis: {degrees(atan(slope)):.1f}° here, as if it were "
        f"{swept[0]:.0f}° to {swept[1]:.0f}° in the paper, which says only that it is not aligned."
    )


def _sites(trials: Trials) -> str:
    parts, all_ratios = [], []
    for table, columns in (("table1", "z"), ("table4", "z")):
        plain = next(one.centers for one in of(trials, NOTHING, table) if one.columns == columns)
        own = [one for change in PLAIN for one in of(trials, change, table) if one.columns == columns]
        most = max(own, key=lambda one: one.centers)
        all_ratios.append(most.centers / plain < most.theirs / plain)
        what = f"{most.change} {most.value}; paper {most.theirs}"
        parts.append(f"{CASES[table]} {plain} to at most {most.centers} ({what})")
    return (
        f"{settled(all(all_ratios))} Number and place of the sites, those on the trailing edge among them, points "
        "between the sites, the size of the box, the blended strip and the polynomial change f_z from "
        f"{'; '.join(parts)}. None of them alone is the reason."
    )


def _gmres_aileron(trials: Trials) -> str:
    exact = {one.factor: one.centers for one in of(trials, TOLERANCE, "table1") if one.columns == "z"}
    runs = [one for one in of(trials, GMRES, "table1") if not one.value.endswith("iterations")]
    close = [one for one in runs if float(one.value) <= 1e-3]
    most = max(abs(one.centers / exact[one.factor] - 1.0) for one in close)
    return (
        f"{settled(most <= SAME)} GMRES and the aileron: with a residual of 1e-3 or less f_z has the centres of exact "
        f"solves, to {100.0 * most:.1f} %. GMRES is not why the paper needs more there."
    )


def _gmres_tail(trials: Trials) -> str:
    """Say which ends of GMRES leave the tail's error and let the others reach the tolerance."""
    theirs = among(paper().tables["table4"].rows, "z")[0]
    runs = {(one.table, one.columns, one.factor, one.value): one for one in of(trials, GMRES)}
    tail = [one for one in runs.values() if one.table == "table4" and one.columns == "z"]
    leave = [one for one in tail if TWICE * _in_unit(one) >= theirs.max_error]
    both = [one for one in leave if all(other.stop == "CONVERGED" for other in _beside(runs, one))]
    names = ", ".join(f"{one.value} (/ {one.factor:g})" for one in leave) or "none of these"
    left = f"GMRES and the tail's f_z: at least half of the paper's error, {theirs.max_error:.1e}, is left by {names}"
    if not both:
        return f"{settled(False)} {left}; with none of them do aileron and Chimera block reach theirs, as in the paper."
    limited = [one for one in both if one.stop == "MAX_CENTERS"] or both
    best = min(limited, key=lambda one: abs(log(_in_unit(one) / theirs.max_error)))
    others = ", ".join(f"{CASES[one.table]} {one.centers} centres ({one.theirs})" for one in _beside(runs, best))
    ends = "; ".join(_tail_end(runs, best, d) for d in "zxy" if ("table4", d, best.factor, best.value) in runs)
    return (
        f"{settled(False)} {left}. Of these {len(both)} let aileron and Chimera block reach the tolerance, as there; "
        f"nearest is {best.value} with the tolerance / {best.factor:g} (the paper's in brackets): {others}; tail "
        f"{ends}. Together a larger model and a GMRES that is stopped early go the right way for every f_z, but "
        f"{_all_rows(runs)}."
    )


def _tail_end(runs: Runs, best: Trial, columns: str) -> str:
    """Return where a direction of the tail ends with some GMRES."""
    one, theirs = runs["table4", columns, best.factor, best.value], among(paper().tables["table4"].rows, columns)[0]
    return f"f_{columns} {one.centers} left {_in_unit(one):.1e} ({theirs.centers} left {theirs.max_error:.1e})"


def _all_rows(runs: Runs) -> str:
    """Return how many of the early ends have all rows as in the paper: the tail's at the limit, others converged."""
    early = {(factor, value) for _, d, factor, value in runs if d == "x"}
    wanted = {"table1": "CONVERGED", "table3": "CONVERGED", "table4": "MAX_CENTERS"}
    right = [key for key in early if all(runs[t, d, *key].stop == end for t, end in wanted.items() for d in "xyz")]
    return f"{len(right)} of {len(early)} limits on its iterations end all nine rows as the paper's did"


def _in_unit(one: Trial) -> float:
    """Return the error in the unit in which the tolerance is the paper's."""
    return one.max_error * one.factor


def _beside(runs: Runs, one: Trial) -> list[Trial]:
    """Return the runs of aileron and Chimera block with the same direction, factor and GMRES."""
    return [runs[table, one.columns, one.factor, one.value] for table in ("table1", "table3")]


def _early() -> str:
    """Compare the paper's own times: what a solve cost by the square of its centres."""
    parts = []
    for name, angle in (("table3", -30.0), ("table4", 12.0)):
        row = next(one for one in among(paper().tables[name].rows, "z") if one.setting.angle == angle)
        first = sum(row.setting.initial)
        squares = sum(min(first + k * row.setting.n_add, row.centers) ** 2 for k in range(row.iterations + 1))
        parts.append((CASES[name], 1e6 * row.seconds / squares))
    (one, dear), (other, cheap) = parts
    return (
        f"**A hint.** The paper's times: by iteration and square of the centres f_z took {dear:.1f} µs in the "
        f"{one} and {cheap:.1f} µs for the {other}. Larger systems need more iterations of GMRES, not fewer: a hint "
        "that those of the tail were ended before they were accurate."
    )


def _panel(trials: Trials) -> str:
    panel = [one for one in of(trials, "fuselage panel", "table4") if one.columns == "z"]
    rough = [one for one in panel if one.value.startswith("rough")]
    theirs = among(paper().tables["table4"].rows, "z")[0]
    left = "; ".join(f"{one.value.removeprefix('rough by ')}: {cell(one)}" for one in rough)
    still = next(one for one in panel if one.value == "does not move")
    enough = any(one.stop == "MAX_CENTERS" and TWICE * one.max_error >= theirs.max_error for one in rough)
    return (
        f"{sufficient(enough)} The panel's displacement: if its nodes are rough, f_z ends with {left} (paper: "
        f"{theirs.centers} left {1e3 * theirs.max_error:.2g} mm, if its unit is the metre). A panel that stays "
        f"while the tail moves: {cell(still)}. The paper moves the panel's nodes by interpolation and then projects "
        "them; how smoothly is not said."
    )

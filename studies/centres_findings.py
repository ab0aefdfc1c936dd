"""The numbers that say what the varied adaptations settle about the paper's centres; the page has the sentences."""

from math import atan, degrees, log
from typing import Any

from studies.centres import ACCURACIES
from studies.centres_page import changes, solver, tolerance
from studies.measure import GROWN
from studies.paper import paper
from studies.stored import Page
from studies.trends import TWICE, among
from studies.trials import CASES, GMRES, NOTHING, TOLERANCE, Trial, Trials, factors, of

SAME = 0.02
"""Numbers of centres that differ by less are alike."""
PLAIN = ("margins of the hexahedron", "distance of zero sites", "surface sites", "sites on the trailing edge",
         "strip beside the rib", "polynomial")  # fmt: skip
"""Changes that concern no more than where the sites are and what is added to the kernels."""

Runs = dict[tuple[str, str, float, str], Trial]
"""By table, direction, factor and the limit at which GMRES stops."""
Numbers = dict[str, Any]
"""The numbers of a sentence, by the names that the page gives them; `settled` says whether it is."""


def numbers(page: Page) -> Numbers | None:
    """Return all numbers of the page's last section; None where they were not measured."""
    if page.reasons is None:
        return None
    trials = page.reasons.trials
    return {
        "scale": page.reasons.scale, "accuracy": ACCURACIES[-1], "ratios": _ratios(page),
        "tail": among(paper().tables["table4"].rows, "z")[0],
        "tolerance": tolerance(trials), "changes": changes(trials), "solver": solver(trials),
        "unit": _unit(trials), "norm": _norm(page), "size": _size(trials), "hinge": _hinge(page, trials),
        "sites": _sites(trials), "gmres": _gmres_aileron(trials), "early": _gmres_tail(trials), "cost": _cost(),
        "panel": _panel(trials),
    }  # fmt: skip


def _ratios(page: Page) -> tuple[float, float]:
    """Return the smallest and the largest number of centres here by that of the paper."""
    ratios = [
        ours.centers / theirs.centers
        for result in page.results.values()
        for ours, theirs in zip(result.by(GROWN), result.table.rows, strict=True)
    ]
    return min(ratios), max(ratios)


def _unit(trials: Trials) -> Numbers:
    plain = {(trial.table, trial.columns): trial.centers for trial in of(trials, NOTHING)}
    other = of(trials, "unit of length")
    same = sum(trial.centers == plain[trial.table, trial.columns] for trial in other)
    return {"settled": same == len(other), "same": same, "of": len(other)}


def _norm(page: Page) -> Numbers:
    rows = page.results["table1"].by(GROWN)
    pairs = list(zip(among(rows, "xyz"), among(rows, "z"), strict=True))
    same = sum(a.centers == b.centers for a, b in pairs)
    return {"settled": same == len(pairs), "same": same, "of": len(pairs)}


def _size(trials: Trials) -> Numbers:
    reached = [factor for (table, _, d), factor in factors(trials).items() if table != "table4" and d != "y"]
    least, most = min(reached), max(reached)
    return {"settled": most <= TWICE * least, "least": least, "most": most, "rows": len(reached)}


def _hinge(page: Page, trials: Trials) -> Numbers:
    reached = factors(trials)
    ratios = [reached[t, a, "y"] / reached[t, a, "x"] for t, a, d in reached if d == "y" and t != "table4"]
    ours = next(iter(page.results["table1"].ground.largest_mm.values()))
    slope, least, most = ours["y"] / ours["x"], min(ratios), max(ratios)
    swept = [degrees(atan(slope * ratio)) for ratio in (least, most)]
    angle = degrees(atan(slope))
    return {"settled": most <= TWICE * least, "least": least, "most": most, "angle": angle, "swept": swept}


def _sites(trials: Trials) -> Numbers:
    rows: list[Numbers] = []
    for table in ("table1", "table4"):
        plain = next(trial.centers for trial in of(trials, NOTHING, table) if trial.columns == "z")
        other = [trial for change in PLAIN for trial in of(trials, change, table) if trial.columns == "z"]
        rows.append({"case": CASES[table], "plain": plain, "most": max(other, key=lambda trial: trial.centers)})
    return {"settled": all(row["most"].centers < row["most"].theirs for row in rows), "rows": rows}


def _gmres_aileron(trials: Trials) -> Numbers:
    exact = {trial.factor: trial.centers for trial in of(trials, TOLERANCE, "table1") if trial.columns == "z"}
    runs = [trial for trial in of(trials, GMRES, "table1") if not trial.value.endswith("iterations")]
    close = [trial for trial in runs if float(trial.value) <= 1e-3]
    most = max(abs(trial.centers / exact[trial.factor] - 1.0) for trial in close)
    return {"settled": most <= SAME, "most": most}


def _gmres_tail(trials: Trials) -> Numbers:
    """Return which ends of GMRES leave the tail's error and let the others reach the tolerance."""
    theirs = among(paper().tables["table4"].rows, "z")[0]
    runs: Runs = {(trial.table, trial.columns, trial.factor, trial.value): trial for trial in of(trials, GMRES)}
    leave = [
        trial
        for trial in runs.values()
        if (trial.table, trial.columns) == ("table4", "z") and TWICE * _in_unit(trial) >= theirs.max_error
    ]
    both = [trial for trial in leave if _converged(_beside(runs, trial))]
    limited = [trial for trial in both if trial.stop == "MAX_CENTERS"] or both
    nearest = min(limited, key=lambda trial: abs(log(_in_unit(trial) / theirs.max_error)), default=None)
    beside, ends = (_beside(runs, nearest), _tail_ends(runs, nearest)) if nearest else ([], [])
    limits, right = _limits(runs)
    return {"leave": leave, "both": len(both), "nearest": nearest, "beside": beside, "ends": ends, "limits": limits,
            "right": right}  # fmt: skip


def _tail_ends(runs: Runs, nearest: Trial) -> list[Numbers]:
    """Return where each direction of the tail ends with the same limit of GMRES."""
    rows = paper().tables["table4"].rows
    ends = [runs.get(("table4", columns, nearest.factor, nearest.value)) for columns in "zxy"]
    return [
        {"columns": end.columns, "centers": end.centers, "error": _in_unit(end), "theirs": among(rows, end.columns)[0]}
        for end in ends
        if end
    ]


def _limits(runs: Runs) -> tuple[int, int]:
    """Return how many limits there are, and how many end the tail's rows at the limit and converge the others."""
    early = {(factor, value) for _, d, factor, value in runs if d == "x"}
    wanted = {"table1": "CONVERGED", "table3": "CONVERGED", "table4": "MAX_CENTERS"}
    right = [key for key in early if all(runs[t, d, *key].stop == end for t, end in wanted.items() for d in "xyz")]
    return len(early), len(right)


def _in_unit(trial: Trial) -> float:
    """Return the error in the unit in which the tolerance is the paper's."""
    return trial.max_error * trial.factor


def _beside(runs: Runs, trial: Trial) -> list[Trial]:
    """Return the runs of aileron and Chimera block with the same direction, factor and GMRES."""
    return [runs[table, trial.columns, trial.factor, trial.value] for table in ("table1", "table3")]


def _converged(trials: Trials) -> bool:
    return all(trial.stop == "CONVERGED" for trial in trials)


def _cost() -> dict[str, float]:
    """Return the paper's microseconds for f_z by iteration and square of the centres."""
    cost = {}
    for name, angle in (("table3", -30.0), ("table4", 12.0)):
        row = next(row for row in among(paper().tables[name].rows, "z") if row.setting.angle == angle)
        first = sum(row.setting.initial)
        squares = sum(min(first + k * row.setting.n_add, row.centers) ** 2 for k in range(row.iterations + 1))
        cost[name] = 1e6 * row.seconds / squares
    return cost


def _panel(trials: Trials) -> Numbers:
    panel = [trial for trial in of(trials, "fuselage panel", "table4") if trial.columns == "z"]
    rough = [trial for trial in panel if trial.value.startswith("rough")]
    theirs = among(paper().tables["table4"].rows, "z")[0]
    still = next(trial for trial in panel if trial.value == "does not move")
    enough = any(trial.stop == "MAX_CENTERS" and TWICE * trial.max_error >= theirs.max_error for trial in rough)
    return {"settled": enough, "rough": rough, "still": still}

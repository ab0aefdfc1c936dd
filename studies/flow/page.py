"""The page of the study: what agrees, by how much, and how it was computed."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np

from sdm_deflect.base.numbers import percent
from sdm_deflect.cases.report.pictures import write_png
from sdm_deflect.cases.run.output import output_files
from sdm_deflect.geometry.parameters import reference_values
from studies.flow.fields import iterations_done
from studies.flow.members import DEFLECTED, FRESH, REPAIRED, FlowStudy, Member
from studies.flow.pictures import LABELS, curves, pressures, settling
from studies.flow.reference import surface_reference
from studies.flow.results import ALLOWED, CONFIDENCE, CONVERGED, LAST, WINDOW, Increment, Results, judged, results_of
from studies.flow.solve import FOLDER, seconds_of
from studies.flow.trend import slopes_of

PER_HOUR = 3600.0


def write_results(study: FlowStudy, members: tuple[Member, ...], out: Path) -> tuple[Results, str]:
    """Write <case>.md, its figures and .json of a study whose members are in `out` into it; return the text as well.

    All appear together, in place of earlier ones.
    """
    results = results_of(study, members, out / FOLDER)
    with output_files(out) as scratch:
        text = write_page(results, members, out / FOLDER, scratch)
    return results, text


def write_page(results: Results, members: tuple[Member, ...], cases: Path, folder: Path) -> str:
    """Write the page into `folder`; `cases` has the members."""
    study = results.study
    name = f"flow-{study.case.name}"
    first = study.angles[0]
    kinds = {member.kind: member for member in members if member.angle == first and member.number in (0, 1)}
    shown = [(LABELS[kind], cases / kinds[kind].name) for kind in (DEFLECTED, REPAIRED, FRESH) if kind in kinds]
    figures = {
        "increments": (curves(results), "Increments of the coefficients over the angle."),
        "pressure": (pressures(study, shown), f"Pressure coefficient at {first:+g} degrees on each mesh."),
        "settling": (settling(study, members, cases), "Lift and rolling moment coefficient over the iterations."),
    }
    (folder / "figures").mkdir()
    for key, (figure, _) in figures.items():
        write_png(figure, folder / "figures" / f"{name}-{key}.png")
    spent = _spent([cases / member.name for member in members])
    pictures = [f"![{words}](figures/{name}-{key}.png)" for key, (_, words) in figures.items()]
    text = "\n\n".join([*_sections(results, spent), *pictures])
    (folder / f"{name}.md").write_text(f"{text}\n", encoding="utf-8")
    (folder / f"{name}.json").write_text(json.dumps(figures_of(results), indent=2), encoding="utf-8")
    return text


def figures_of(results: Results) -> dict[str, Any]:
    """Return the numbers of a study, as JSON has them."""
    study = results.study
    rows = [
        {**asdict(one), "expected": one.expected, "scatter": one.scatter, "agrees": one.agrees,
         "converged": one.converged, "interval": None if isnan(one.interval[0]) else one.interval}
        for one in results.increments
    ]  # fmt: skip
    return {
        "case": study.case.name, "scale": study.case.scale, "stream": asdict(study.stream),
        "reference": asdict(reference_values(study.case.fighter)),
        "surface": {"name": study.surface, **asdict(surface_reference(study.case.fighter, study.surface))},
        "increments": [{key: None if _missing(value) else value for key, value in row.items()} for row in rows],
        "slopes": {name: asdict(slope) for name, slope in slopes_of(results).items()},
        "passed": results.passed,
    }  # fmt: skip


def _missing(value: object) -> bool:
    return isinstance(value, float) and isnan(value)


def _spent(cases: Sequence[Path]) -> str:
    """Say how many iterations the flows took, and how long."""
    done = sorted(iterations_done(case) for case in cases)
    iterations = f"{done[0]}" if done[0] == done[-1] else f"{done[0]} to {done[-1]}"
    hours = seconds_of(cases) / PER_HOUR
    return f"{len(cases)} flows of {iterations} iterations took the solvers {hours:.1f} hours of one core."


def _sections(results: Results, spent: str) -> Iterator[str]:
    study = results.study
    stream, values = study.stream, reference_values(study.case.fighter)
    own = surface_reference(study.case.fighter, study.surface)
    yield f"# The flow about the {study.case.name} case"
    yield (
        f"Mach {stream.mach:g} at {stream.alpha:g} degrees, {stream.pressure:g} Pa and {stream.temperature:g} K. "
        f"Meshes of scale `{study.case.scale}`. Reference area {values.area:.4g} m2, chord {values.chord:.4g} m, span "
        f"{values.span:.4g} m, moments about x = {values.point[0]:.4g} m. Of {study.surface}: "
        f"{own.area:.3g} m2, {own.chord:.3g} m. {spent}"
    )
    yield "\n".join(_table(results))
    if study.fresh > 1 and len(study.angles) > 1:
        yield (
            f"Where there is one new mesh alone, the scatter at {study.angles[0]:+g} degrees counts, in brackets; its "
            "increment is that from the mean of the new undeflected meshes."
        )
    decided = [one for one in results.judged if not one.agrees]
    verdict = (
        f"All {len(results.judged)} increments that decide agree: the difference to the mean of the new meshes "
        f"is within their scatter or within {percent(ALLOWED)} of the increment."
        if results.passed
        else f"{len(decided)} of {len(results.judged)} increments do not agree; the table says which."
    )
    yield verdict
    yield from several(results)
    yield _convergence(results)
    if poor := [f"{one.angle:+g}" for one in results.of(judged(study)[0]) if one.deflected is None]:
        yield (
            f"At {', '.join(poor)} degrees no flow could be computed on the mesh without repair: cells are inverted, "
            "or the solver ends with an error."
        )
    for name, slope in slopes_of(results).items():
        if any(one.judged for one in results.of(name)):
            yield (
                f"{name}: {slope.rate:.4g} per degree. Increments are within 5 % of that line from {slope.low:+g} to "
                f"{slope.high:+g} degrees."
            )


def several(results: Results) -> Iterator[str]:
    """Say of several deflected meshes and several new ones whether their means differ."""
    rows = [one for one in results.increments if one.others and one.judged]
    study = results.study
    lacking = study.fresh - (len(rows[0].others) if rows else 0)
    if study.fresh > 1 and lacking:
        yield (
            f"{lacking} of the {study.fresh} new undeflected meshes could not be deflected to "
            f"{study.angles[0]:+g} degrees without inverted cells, and are left out."
        )
    if not rows:
        return
    yield (
        f"One deflected mesh may differ by chance. The {len(rows[0].others)} new undeflected meshes were "
        f"deflected to {rows[0].angle:+g} degrees, too. Increments of all that were deflected, each on its own cells, "
        "beside the new ones (mean, standard deviation), and the difference of the means with its confidence "
        f"interval of {percent(CONFIDENCE)} (Welch), by the increment. Above 0 the deflected meshes have the larger "
        "effect:"
    )
    lines = [
        "|  | increment, deflected meshes | increment, new meshes | difference | interval | holds 0 |",
        "| --- | ---: | ---: | ---: | ---: | --- |",
    ]
    for one in rows:
        sides = [f"{np.mean(side):+.5f}, {np.std(side, ddof=1):.5f}" for side in (one.all_deflected, one.fresh)]
        low, high = one.interval
        difference = float(np.mean(one.all_deflected)) - one.expected
        share, *ends = [100.0 * value / one.expected for value in (difference, low, high)]
        interval = " to ".join(f"{end:+.1f} %" for end in sorted(ends))
        holds = "yes" if low <= 0.0 <= high else "no"
        lines.append(f"| {' | '.join([one.name, *sides, f'{share:+.1f} %', interval, holds])} |")
    yield "\n".join(lines)


def _table(results: Results) -> Iterator[str]:
    """Yield the lines of the table of increments; without a column of repaired meshes where there are none."""
    heads = ["deg", "", "undeflected", "deflected", "repaired", "new meshes", "scatter", "difference", "agrees",
             "swing"]  # fmt: skip
    judged_alone = (one for one in results.increments if one.judged)
    rows = [heads, ["---:", "---", *["---:"] * 6, "---", "---:"], *map(_cells, judged_alone)]
    if all(one.repaired is None for one in results.increments):
        rows = [[cell for head, cell in zip(heads, row, strict=True) if head != "repaired"] for row in rows]
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def _cells(one: Increment) -> list[str]:
    def number(value: float | None) -> str:
        return "" if value is None or isnan(value) else f"{value:+.5f}"

    agrees = "" if not (one.fresh and one.judged) else "yes" if one.agrees else "no"
    share = "" if not one.fresh else f"{100.0 * one.share:+.1f} %"
    scatter = number(one.scatter)
    if scatter and len(one.fresh) == 1:  # one has none of its own
        scatter = f"({scatter})"
    middle = [number(one.base), number(one.deflected), number(one.repaired), number(one.expected), scatter]
    return [f"{one.angle:+g}", one.name, *middle, share, agrees, number(one.amplitude)]


def _convergence(results: Results) -> str:
    left = [one for one in results.increments if one.judged and not one.converged]
    share = percent(CONVERGED, 1)
    what = f"Over the last {LAST} iterations averages over {WINDOW} change by less than {share} of the increment"
    if not left:
        return what + " of each coefficient that decides."
    worst = max(left, key=lambda one: one.change)
    far = f"most of all {worst.name} at {worst.angle:+g} deg, by {worst.change:.1e}"
    return what + f", but not {len(left)} of them, {far}. Go on with more iterations in the same folder."

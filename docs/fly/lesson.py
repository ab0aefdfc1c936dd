"""What the exercises of `docs/teaching.md` give, measured with the settings of their commands."""

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import sdm_deflect
from docs.fly.flight import planned
from docs.fly.tail import Tail, fighter
from docs.fly.texts import Facts
from sdm_deflect.base.numbers import percent
from sdm_deflect.cases.run.output import write_interpolants
from sdm_deflect.deform.checks import checks_of
from sdm_deflect.deform.volume.deflection import BoxDeflection

# Surface, hinge and further settings of the commands.
COMMANDS: dict[str, Facts] = {
    "aileron": {
        "surfaces": "aileron_left",
        "hinge": [[0.69181, -0.3048, 0.0], [0.6767, -0.11627, 0.0]],
        "fixed": "wing_left",
        "motion": "blended",
    },
    "tail": {
        "surfaces": "tail_left",
        "hinge": [[0.86842, -0.2228, -0.01163], [0.86842, -0.06598, -0.01163]],
        "fixed": ["fuselage", "fuselage_rear", "ventral_left"],
        "motion": "root",
        "on": "fuselage_panel_left",
    },
}
# Margins (m) and tolerances (m) of the tail at 20 degrees, without repair.
MARGINS = (0.005, 0.01, 0.02, 0.04)
TOLERANCES = (5e-4, 5e-5, 5e-6)
# Degrees of the table of large angles.
ANGLES = {"aileron": (30, 45, 60, 75, 90), "tail": (12, 20, 25, 30)}
# Runs of which the median time is taken.
RUNS = 5


def deflected(name: str, angle: float, **settings: Any) -> sdm_deflect.Result:
    """Deflect a surface as its command does, with further settings."""
    return sdm_deflect.deflect(fighter()[0], angle=angle, **(COMMANDS[name] | settings))


def roll() -> Facts:
    """Return the nodes that moved and stayed, and how far the aileron turns."""
    result = deflected("aileron", 12.0)
    (box,) = result.deflection.boxes
    ((_, share),) = box.plan.boundary.reaches(box.amounts)
    moved = int(result.displacement.any(axis=1).sum())
    shares = {"full": percent(share.full), "mean": percent(share.mean)}
    return {"moved": moved, "stayed": len(fighter()[0].points) - moved, **shares}


def page() -> Facts:
    """Return what "Fly the mesh" shows with the stick fully forward: both tails down at the end of their ranges."""
    plan, tail = planned(), Tail.at()
    rows = np.flatnonzero(np.isin(tail.tets, np.concatenate(plan.rows)).any(axis=1))
    judged = tail.judged(plan.at({"tail_left": tail.angle, "tail_right": tail.angle}), rows)
    return {"cells": len(rows), **judged._asdict()}


def centres(box: BoxDeflection) -> list[int]:
    """Return the numbers of centres of each fit."""
    return [len(one.chosen) for one in box.steps[0].fits.adaptations]


def margins() -> Iterator[tuple[str, Facts]]:
    """Yield the cells inside out, the least quality, and how far that cell is from the box (m), by the margin."""
    tail = Tail.at()
    for margin in MARGINS:
        result = deflected("tail", 20.0, margin=margin, repair="off")
        found = result.deflection
        rows = np.flatnonzero(np.isin(tail.tets, np.flatnonzero(result.displacement.any(axis=1))).any(axis=1))
        quality, _ = tail.quality(result.points, rows)
        centre = tail.mesh.points[tail.tets[rows[quality.argmin()]]].mean(axis=0)
        box = found.boxes[0].plan.region.hexahedron.corners
        off = np.abs(centre - [box.min(axis=0), box.max(axis=0)]).min()
        yield f"{margin:g}", {"inverted": found.inverted, "least": found.quality[0].min, "off": float(off)}


def tolerances() -> Iterator[tuple[str, Facts]]:
    """Yield the centres of x, y and z, the error between sites and the least quality by the tolerance."""
    for tolerance in TOLERANCES:
        found = deflected("tail", 20.0, tolerance=tolerance, repair="off").deflection
        (box,) = found.boxes
        assert box.error_between is not None
        between, least = box.error_between.max, found.quality[0].min
        yield f"{tolerance:g}", {"centres": centres(box), "between": between, "least": least}


def files() -> Iterator[tuple[str, Facts]]:
    """Yield the centres, the bytes of `interpolant.npz` and the seconds by surface and strategy."""
    for name in COMMANDS:
        for strategy in ("squv", "mv"):
            results = [deflected(name, 12.0, strategy=strategy) for _ in range(RUNS)]
            boxes = results[0].deflection.boxes
            with TemporaryDirectory() as scratch:
                path = Path(scratch, "interpolant.npz")
                write_interpolants(path, boxes)
                size = path.stat().st_size
            seconds = round(median(result.deflection.boxes[0].seconds for result in results), 2)
            yield f"{name} {strategy}", {"centres": centres(boxes[0]), "bytes": size, "seconds": seconds}


def angles() -> Iterator[tuple[str, list[str]]]:
    """Yield what becomes of the worst cell without repair and with it, by surface and angle."""
    for name, degrees in ANGLES.items():
        for angle in degrees:
            yield f"{name} {angle}", [outcome(deflected(name, angle, repair=repair)) for repair in ("off", "auto")]


def outcome(result: sdm_deflect.Result) -> str:
    """Return the least quality, or why the mesh fails."""
    failed = {check.name.partition(":")[0]: check for check in checks_of(result.deflection) if not check.passed}
    if "inverted_cells" in failed:
        return f"fails: {failed['inverted_cells'].value:g} cells inverted"
    if "surfaces_crossed" in failed:
        return f"fails: {failed['surfaces_crossed'].value:g} faces cross"
    least = f"{result.deflection.quality[0].min:.3f}"
    return f"fails: worst cell {least}" if failed else least


def lesson() -> Facts:
    """Measure all exercises."""
    return {
        "page": page(),
        "roll": roll(),
        "margins": dict(margins()),
        "tolerances": dict(tolerances()),
        "files": dict(files()),
        "angles": dict(angles()),
    }
